"""What a row of the tendon motors' fault matrix is: a fault, and what is expected of the robot in each phase.

Times in s from the fault on. `matrix` writes rows for docs/faults.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from drivers.simulated.faults import Fault
from tests.system.motor_fault_rig import PHASES, HandStall

BEGIN, END = "<!-- motors of tests/system/motor_fault_cases.py: begin -->", "<!-- motors: end -->"
XM = "XM430-W350"
WATCH_S = 0.3
REST_S = 0.4
"""Until a motor that had been given up is asked again, or a line that is back is opened."""
Kind = Literal["starts", "refuses", "goes on", "waits", "warns", "stops", "holds", "slackens", "lets go", "opens"]
After = Literal["", "clear", "open", "restart"]


@dataclass(frozen=True)
class Cell:
    """What is expected in one phase."""

    kind: Kind
    code: str = ""
    """What the operator is told last while it lasts; of a start-up that refuses, its class of error."""
    within_s: float = 0.0
    """When the operator was first told, from when on it can be known."""
    then: str = ""
    """What is told behind it, once more is known."""
    says: str = ""
    """Words of the error with which start-up refuses."""
    known_s: float = 0.0
    """From when on it can be known."""


GOES_ON, STARTS = Cell("goes on"), Cell("starts")
WAITS = Cell("waits")
"""Winding stands while nothing is heard of the motors, and goes on."""


def warns(code: str, within_s: float = 0.1) -> Cell:
    """Nothing is in the hand, or nothing suffers: it is told, and all goes on."""
    return Cell("warns", code, within_s)


def stops(code: str) -> Cell:
    """The squeeze ends early; both hold, which is no fault."""
    return Cell("stops", code)


def holds(code: str, within_s: float = 0.1, then: str = "") -> Cell:
    """Both excursions are frozen, with the torque on."""
    return Cell("holds", code, within_s, then)


def slackens(code: str, within_s: float = 0.1) -> Cell:
    """The motors' own watchdogs hold, without the lead of their goals: both tendons give way a little, once."""
    return Cell("slackens", code, within_s)


def lets_go(code: str, within_s: float = 0.1, then: str = "", known_s: float = 0.0) -> Cell:
    """A motor lets go, or its loop moves the spool: it is told; what is sound is frozen."""
    return Cell("lets go", code, within_s, then, known_s=known_s)


def refuses(error: str, says: str) -> Cell:
    """Start-up ends with an error."""
    return Cell("refuses", error, says=says)


@dataclass(frozen=True)
class Case:
    """A fault and the cells of its row, None where it makes no sense. `after`: what leads back once it is over."""

    name: str
    faults: tuple[Fault[Any] | HandStall, ...]
    cells: tuple[Cell | None, ...]
    """One a phase."""
    after: After
    let_go: tuple[int, ...] = ()
    """Motors (0 right, 1 left) that lose their torque, or whose loop is mistaken."""
    mend: tuple[Fault[Any], ...] = ()
    """What makes the motors sound again."""
    model: str = XM
    watch_s: float = WATCH_S
    opens: bool = True
    """The hand can be opened while it lasts: motors that did not let go pay out."""

    def cell(self, phase: str) -> Cell | None:
        """What is expected in a phase."""
        return dict(zip(PHASES, self.cells, strict=True))[phase]

    @property
    def title(self) -> str:
        """As it stands in the page."""
        return self.name if self.model == XM else f"{self.name} ({self.model})"


_AFTER = {"": "–", "clear": "`fault.clear`", "open": "`hand.open`, `fault.clear`", "restart": "`hand.open`, restart"}


def matrix(cases: Sequence[Case]) -> str:
    """The rows as they stand in docs/faults.md."""
    columns = ("what goes wrong", *PHASES, "afterwards")
    lines = [f"| {' | '.join(columns)} |", "|" + "---|" * len(columns)]
    for case in cases:
        cells = (_text(case.cell(phase)) for phase in PHASES)
        lines.append(f"| {case.title} | {' | '.join(cells)} | {_AFTER[case.after]} |")
    return "\n".join(lines)


def _text(cell: Cell | None) -> str:
    if cell is None:
        return "–"
    limit = f"≤ {cell.within_s * 1e3:.0f} ms"
    if cell.kind == "refuses":
        return f"refused: “{cell.says}”"
    if cell.kind in ("goes on", "waits", "starts"):
        return cell.kind
    text = {
        "warns": f"told {limit}",
        "stops": "stops at its cap",
        "holds": f"holds; told {limit}",
        "slackens": f"holds, a little looser; told {limit}",
        "lets go": f"told {limit}",
    }[cell.kind]
    codes = ", then ".join(f"`{code}`" for code in (cell.code, cell.then) if code)
    return f"{text}, {codes}" if codes else text
