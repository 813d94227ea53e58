"""Fault scripts from files: TOML with `[[fault]]` tables, or JSON lines with a fault a line.

What a script may say is in `drivers/simulated/faults.py`; which actions there are, in the device's own union. Times in
s of the simulation.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from calibration.toml_files import from_document, load_document
from drivers.errors import ConfigurationError
from drivers.simulated.arm_faults import ArmAction
from drivers.simulated.can_fault_actions import CanAction
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.takktile_fault_actions import TakktileAction

JSON_LINES = (".jsonl", ".ndjson", ".json")


def read_wam_faults(path: Path) -> FaultScript[CanAction | ArmAction]:
    """The script of a simulated WAM and its CAN bus. ConfigurationError names file, fault, key and what is accepted."""
    return read_faults(path, FaultScript[CanAction | ArmAction])


def read_motor_faults(path: Path) -> FaultScript[SerialAction]:
    """The script of simulated tendon motors and their serial bus. Errors: ConfigurationError, likewise."""
    return read_faults(path, FaultScript[SerialAction])


def read_takktile_faults(path: Path) -> FaultScript[TakktileAction]:
    """The script of simulated tactile pads and their bridge. Errors: ConfigurationError, likewise."""
    return read_faults(path, FaultScript[TakktileAction])


def wam_fault(line: str) -> Fault[CanAction | ArmAction]:
    """One fault of the arm as a JSON object, as somebody types it. ConfigurationError: key, and what is accepted."""
    return from_document(_typed(line), Fault[CanAction | ArmAction], "standard input")


def motor_fault(line: str) -> Fault[SerialAction]:
    """One fault of the tendon motors, likewise."""
    return from_document(_typed(line), Fault[SerialAction], "standard input")


def pad_fault(line: str) -> Fault[TakktileAction]:
    """One fault of the tactile pads, likewise."""
    return from_document(_typed(line), Fault[TakktileAction], "standard input")


def read_faults(path: Path, script: type[FaultScript[Any]]) -> FaultScript[Any]:
    """A script whose type, `FaultScript[…]`, names the actions of a device. Errors: ConfigurationError."""
    if path.suffix in JSON_LINES:
        document, lines = _json_lines(path)
        return from_document(
            document, script, path, written_as=lambda key: re.sub(r"fault\[(\d+)\]", lambda at: lines[int(at[1])], key)
        )
    return from_document(load_document(path), script, path)


def _typed(line: str) -> Any:
    try:
        return json.loads(line)
    except json.JSONDecodeError as error:
        raise ConfigurationError("standard input", "(line)", str(error), "a JSON object") from error


def _json_lines(path: Path) -> tuple[dict[str, Any], list[str]]:
    """The lines as one document, and for each fault where it stands; `{"seed": 7}` may stand on a line of its own."""
    document: dict[str, Any] = {"fault": []}
    lines: list[str] = []
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise ConfigurationError(path, "(file)", error.strerror or str(error), "a readable file") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(path, "(file)", f"byte {error.start} is not UTF-8", "UTF-8 text") from error
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            entry = json.loads(line)
        except json.JSONDecodeError as error:
            raise ConfigurationError(path, f"line {number}", str(error), "a JSON object") from error
        if not isinstance(entry, dict):
            raise ConfigurationError(path, f"line {number}", entry, "a JSON object")
        if entry.keys() == {"seed"}:
            document |= entry
        else:
            document["fault"].append(entry)
            lines.append(f"line {number}")
    return document, lines
