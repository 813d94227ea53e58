"""The fault matrix of the tendon motors: every fault of the motors and their bus, in every phase, against a whole robot
on virtual time. Here: start-up, open hand, closing and squeezing, with XM430-W350.

Front, cycle, hand process, driver and world are the daemon's own; each fault meets the same prepared robot
(`motor_fault_rig.py`). What is expected stands in `motor_fault_cases.py`, how it is judged in `motor_fault_judge.py`.
"""

from __future__ import annotations

import pytest

from tests.system.fault_page import PAGE, written
from tests.system.motor_fault_cases import CASES
from tests.system.motor_fault_matrix import BEGIN, END, XM, Case, matrix
from tests.system.motor_fault_rig import PHASES
from tests.system.motor_fault_runs import RobotIn, entries, live_through

pytestmark = pytest.mark.slow
ENTRIES = entries((XM,), ("start-up", "open", "closing", "squeezing"))


@pytest.mark.parametrize(("case", "phase"), ENTRIES)
def test_fault(case: Case, phase: str, robot_in: RobotIn) -> None:
    """Protects the object, the fingers in the hand, and the operator who reads what happened."""
    live_through(case, phase, robot_in)


def test_the_matrix_is_large_enough() -> None:
    """Protects its extent: at least thirty faults, most of them with something in the hand."""
    names = {case.name for case in CASES}
    assert len(names) >= 50
    assert len({case.title for case in CASES}) == len(CASES)
    assert len(entries(tuple({case.model for case in CASES}), PHASES)) >= 150


def test_the_matrix_is_in_the_docs() -> None:
    """Protects the reader of docs/faults.md: it holds what these tests hold. Else: python -m
    tests.system.motor_fault_cases --write"""
    page = PAGE.read_text(encoding="utf-8")
    assert page == written(page, BEGIN, END, matrix(CASES))
