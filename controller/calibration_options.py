"""What the commands of `stillgrasp calibrate` have in common: options, the arm's own file, talking to the operator."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Annotated

import typer

from controller.config import RobotConfig
from drivers.errors import InputError

Config = Annotated[Path | None, typer.Option(help="Your robot.toml; without one, the default installation.")]
OwnFile = Annotated[
    Path | None, typer.Option("--output", "-o", help="The arm's own file, .toml; else arm.own_file of robot.toml.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


def own_file(robot: RobotConfig, output: Path | None) -> Path:
    """Where the arm's calibration goes: `output`, else what robot.toml names. Raises InputError if neither says."""
    file = output or (Path(robot.arm.own_file) if robot.arm.own_file else None)
    if file is None:
        raise InputError(
            "it is not said where the calibration shall be written.",
            help='Give --output FILE, or write own_file = "FILE" under [arm] of robot.toml.',
        )
    return file


def await_enter(request: str) -> None:
    """Ask the operator for something and wait for Enter. Raises InputError if nobody can answer."""
    say(f"{request} and press Enter")
    if not sys.stdin.readline():
        raise InputError("nobody pressed Enter; nothing was measured.", help="Run it at a terminal, or with --yes.")


def say(text: str) -> None:
    """A line for the operator, on standard error; nobody need listen."""
    with contextlib.suppress(OSError):
        print(f"stillgrasp: {text}", file=sys.stderr, flush=True)
