"""docs/motors.md says what is so: its tests exist, and its table is what the command prints."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.motor_page import PAGE, row
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel

TESTS = Path(__file__).parents[2]


def test_every_trap_s_test_exists() -> None:
    """A reader who doubts must find it."""
    named = set(re.findall(r"`(test_\w+)`", PAGE.read_text(encoding="utf-8")))
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (TESTS / "drivers").rglob("test_*.py"))
    assert len(named) > 14
    assert {name for name in named if f"def {name}(" not in sources} == set()


@pytest.mark.parametrize("model", [XM430_W350, MX_28], ids=lambda model: model.name)
def test_the_table_is_the_command_s(model: MotorModel) -> None:
    """After a change: python -m benchmarks.motor_page --write."""
    assert row(model) in PAGE.read_text(encoding="utf-8").splitlines()
