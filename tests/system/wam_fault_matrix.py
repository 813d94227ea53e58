"""What a row of the fault matrix is: a fault of the arm or its bus, and what is expected of the robot in each phase.

Times in s from the fault on. `matrix` writes rows for docs/faults.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from drivers.simulated.faults import Fault

PHASES = ("start-up", "idle", "moving", "squeezing")
BEGIN, END = "<!-- matrix of tests/system/wam_fault_cases.py: begin -->", "<!-- matrix: end -->"
Kind = Literal["goes on", "holds", "idles", "unpowered", "lost", "starts", "refuses"]


@dataclass(frozen=True)
class Cell:
    """What is expected in one phase."""

    kind: Kind
    code: str = ""
    """The fault's name; of a start-up that refuses, its class of error."""
    within_s: float = 0.0
    """When the arm stands by command, is idle or without power; where the bus is lost, when that is said."""
    says: str = ""
    """Words of the error with which start-up refuses."""


GOES_ON, STARTS = Cell("goes on"), Cell("starts")


def holds(code: str, within_s: float = 0.2) -> Cell:
    """It stops along its path, or winding, and holds."""
    return Cell("holds", code, within_s)


def idles(code: str, within_s: float) -> Cell:
    """It is idle, by whomever."""
    return Cell("idles", code, within_s)


def lost(code: str, within_s: float = 0.005) -> Cell:
    """The bus is lost: nothing can be commanded, the pucks keep their torque, and that is said."""
    return Cell("lost", code, within_s)


def refuses(error: str, says: str) -> Cell:
    """Start-up ends with an error."""
    return Cell("refuses", error, says=says)


@dataclass(frozen=True)
class Case:
    """A fault and the cells of its row; None where it makes no sense."""

    name: str
    faults: tuple[Fault[Any], ...]
    start: Cell | None
    idle: Cell | None
    moving: Cell | None
    squeezing: Cell | None
    duration_s: float = 0.25
    foreign_torques: bool = False
    """Torque frames on the wire are somebody else's too."""

    def cell(self, phase: str) -> Cell | None:
        """What is expected in a phase."""
        return dict(zip(PHASES, (self.start, self.idle, self.moving, self.squeezing), strict=True))[phase]


def matrix(cases: Sequence[Case]) -> str:
    """The rows as they stand in docs/faults.md."""
    lines = ["| what goes wrong | start-up | idle | moving | squeezing |", "|---|---|---|---|---|"]
    for case in cases:
        lines.append(f"| {case.name} | " + " | ".join(_text(case, phase) for phase in PHASES) + " |")
    return "\n".join(lines)


def _text(case: Case, phase: str) -> str:
    cell = case.cell(phase)
    if cell is None:
        return "–"
    if cell.kind == "refuses":
        return f"refused: “{cell.says}”"
    limit = f"≤ {cell.within_s * 1e3:.0f} ms"
    if phase in ("start-up", "idle"):
        text = {"goes on": "goes on", "starts": "starts", "unpowered": f"no power {limit}"}.get(
            cell.kind, f"stays idle; said {limit}"
        )
    else:
        text = {
            "goes on": "goes on",
            "holds": f"stops and holds {limit}",
            "idles": f"idle {limit}",
            "unpowered": f"no power {limit}",
            "lost": f"last torque until the heartbeat; said {limit}",
        }[cell.kind]
    return f"{text}, `{cell.code}`" if cell.code else text
