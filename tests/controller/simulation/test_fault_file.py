"""Fault scripts as files: both forms, and every mistake named by file, fault and key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from controller.simulation.device_commands import app
from controller.simulation.fault_file import motor_fault, read_wam_faults, wam_fault
from drivers.errors import ConfigurationError
from drivers.simulated.arm_faults import Press, Silence
from drivers.simulated.can_fault_actions import Drop, Flood, Unplug
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.serial_fault_actions import Supply

Script = FaultScript[Any]
TOML = """
seed = 7
[[fault]]
name = "loose cable"
on = "active"
at_s = 0.5
for_s = 0.1
chance = 0.3
action = { kind = "drop", node = 3, on_wire = true }
[[fault]]
for_s = inf
action = { kind = "silence", nodes = [3, 10] }
[[fault]]
at_frame = 5
action = { kind = "press", button = "estop" }
"""
LINES = """{"seed": 3}

{"at_s": 1, "for_s": 2, "action": {"kind": "unplug"}}
{"action": {"kind": "flood", "id": 2047}}
"""


def test_toml_and_json_lines_say_the_same_things(tmp_path: Path) -> None:
    """Protects the format that users write: times, selection, defaults, infinity."""
    (tmp_path / "f.toml").write_text(TOML)
    assert read_wam_faults(tmp_path / "f.toml") == Script(
        seed=7,
        faults=(
            Fault(name="loose cable", on="active", at_s=0.5, for_s=0.1, chance=0.3, action=Drop(node=3, on_wire=True)),
            Fault(for_s=float("inf"), action=Silence(nodes=(3, 10))),
            Fault(at_frame=5, action=Press(button="estop")),
        ),
    )
    (tmp_path / "f.jsonl").write_text(LINES)
    assert read_wam_faults(tmp_path / "f.jsonl") == Script(
        seed=3, faults=(Fault(at_s=1.0, for_s=2.0, action=Unplug()), Fault(action=Flood(id=2047)))
    )
    assert wam_fault('{"action": {"kind": "unplug"}}') == Fault(action=Unplug())


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("node = 3,", "nod = 3,", r"fault\[0\].action.nod = 3 .* no such key"),
        ('"drop"', '"drp"', r"fault\[0\].action.kind = 'drp' .* one of 'drop', 'delay'"),
        ("chance = 0.3", "chance = 2", r"fault\[0\].chance = 2 .* > 0 and ≤ 1"),
        ("at_s = 0.5", "at_s = nan", r"fault\[0\].at_s = nan .* a finite number"),
        ("for_s = inf", "for_s = -1", r"fault\[1\].for_s = -1 "),
        ("[3, 10]", "[3, 11]", r"fault\[1\].action.nodes\[1\] = 11 .* ≥ 1 and ≤ 10"),
        ('"estop"', '"stop"', r"fault\[2\].action.button = 'stop' .* one of"),
        ("seed", "sed", r"sed = 7 .* one of seed, fault"),
        ("[[fault]]", "[[fault]", r"\(file\) = .* valid TOML"),
    ],
)
def test_mistakes_in_toml_are_named(tmp_path: Path, right: str, wrong: str, told: str) -> None:
    """Protects authors: one line with file, fault, key, value and what is accepted."""
    (tmp_path / "f.toml").write_text(TOML.replace(right, wrong, 1))
    with pytest.raises(ConfigurationError, match=told):
        read_wam_faults(tmp_path / "f.toml")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b'{"at_s": 1}\n', r"line 1.action = '\(missing\)'"),
        (b'{"seed": 3}\n\n{"action": {"kind": "flood"}}\n', r"line 3.action.id = '\(missing\)'"),
        (b'{"seed": 3, "at_s": 1}\n', "line 1.seed = 3 .* no such key"),
        (b"[1]\n", r"line 1 = \[1\] .* a JSON object"),
        (b'{"at_s"\n', "line 1 = .* a JSON object"),
        (b"\xff\n", r"\(file\) = .* UTF-8"),
    ],
)
def test_mistakes_in_json_lines_are_named_by_line(tmp_path: Path, content: bytes, told: str) -> None:
    """Protects programs that write scripts: the line is named."""
    (tmp_path / "f.jsonl").write_bytes(content)
    with pytest.raises(ConfigurationError, match=told):
        read_wam_faults(tmp_path / "f.jsonl")


def test_missing_files_and_typed_mistakes_are_named(tmp_path: Path) -> None:
    """Protects the command line: no file, and a fault typed wrongly."""
    for name in ("f.toml", "f.jsonl"):
        with pytest.raises(ConfigurationError, match="No such file"):
            read_wam_faults(tmp_path / name)
    with pytest.raises(ConfigurationError, match="a JSON object"):
        wam_fault("{")
    with pytest.raises(ConfigurationError, match=r"standard input: action.kind = 'x'"):
        wam_fault('{"action": {"kind": "x"}}')
    with pytest.raises(ConfigurationError, match=r"standard input: action.volts"):
        motor_fault('{"action": {"kind": "supply", "volts": 99}}')


def test_a_typed_fault_of_the_motors_is_the_script_s() -> None:
    """The same words as in a file."""
    assert motor_fault('{"action": {"kind": "supply", "volts": 9}, "for_s": 1}') == Fault(
        action=Supply(volts=9), for_s=1
    )


@pytest.mark.parametrize("device", ["wam", "dynamixel", "takktile"])
def test_help_shows_a_script_as_it_is_written(device: str) -> None:
    """Double brackets are markup to the help's printer, which showed a user `[]`."""
    shown = CliRunner().invoke(app, [device, "--help"], env={"COLUMNS": "300"}).stdout
    assert "faults.toml: [[fault]] on = " in " ".join(shown.split())
