"""The figures of docs/pads.md, from the simulated bridge on virtual time.

    python -m tests.system.pad_figures            print them
    python -m tests.system.pad_figures --write    write them into docs/pads.md

Faults: what befalls one of a finger's eight cells, or the bridge, while a steady 4 N lies on each finger; how soon
the driver knows, and by how much the finger's force is wrong until then. The rest are the tests' own scenarios.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from controller.config import Tactile
from controller.pad_messages import PadReport
from drivers.clock import nanoseconds, seconds
from drivers.simulated.faults import Fault
from drivers.simulated.takktile import SimulatedTakktile, two_fingers, uneven
from drivers.simulated.takktile_fault_actions import (
    Dead,
    Garbage,
    Lose,
    MoreCells,
    Noise,
    Press,
    Repeat,
    Silence,
    Stuck,
    TakktileAction,
    Truncate,
    Unplug,
    Warmth,
)
from tests.controller.service.tactile_rig import PartRig, nominal_pads
from tests.system.fault_page import written
from tests.system.pad_calibration import calibrated

BEGIN, END = "<!-- pads: begin -->", "<!-- pads: end -->"
PAGE = Path(__file__).parents[2] / "docs" / "pads.md"
HELD_N, FAULT_S, LASTS_S = 4.0, 3.0, 6.0
_HIT = ((0, 1),)
_CELLS = tuple((row, column) for row, columns in ((0, 5), (1, 3)) for column in range(columns))


class Row(NamedTuple):
    """A fault in words, and as scripts have it."""

    name: str
    action: TakktileAction
    chance: float = 1.0


ROWS = (
    Row("a cell dies", Dead(cells=_HIT)),
    Row("a cell sticks", Stuck(cells=_HIT)),
    Row("a cell becomes noisy (20 counts)", Noise(cells=_HIT, counts=20.0)),
    Row("a cell's temperature jumps by 20 °C", Warmth(cells=_HIT, kelvin=20.0)),
    Row("a cell is pressed beyond its range", Press(cells=_HIT, newtons=100.0)),
    Row("one frame in three is lost", Lose(), 0.33),
    Row("all frames repeat the one before", Repeat()),
    Row("frames break off", Truncate(length=30)),
    Row("frames have a cell too many", MoreCells()),
    Row("frames of any bytes", Garbage()),
    Row("no frames come", Silence()),
    Row("the bridge is unplugged", Unplug()),
)


class Outcome(NamedTuple):
    """What the part told: cells of the right finger that count, s until that was so, largest error while all counted,
    and s from the fault's end until all counted again."""

    valid: int
    after_s: float
    error_N: float
    whole_s: float


def outcome(row: Row) -> Outcome:
    """One fault, begun at 3 s and over 6 s later."""
    force_N = [0.0, 0.0]
    rig = PartRig(SimulatedTakktile(lambda: force_N), nominal_pads())
    rig.order(True, 1)
    told: list[tuple[float, int, float]] = []
    scripted = False
    while rig.clock.now_ns() < nanoseconds(FAULT_S + LASTS_S + 6.0):
        rig.part.step()
        rig.states.new_values()
        for payload, sample_ns in rig.reports.new_values():
            state = PadReport.unpack(payload).state
            told.append((seconds(sample_ns), state.valid_cells[0], state.force_N[0]))
        if rig.clock.now_ns() > nanoseconds(1.0) and not force_N[0]:
            force_N[:] = (HELD_N, HELD_N)
            rig.order(False, 1)
        if rig.clock.now_ns() > nanoseconds(2.0) and not scripted:
            scripted = True
            at_s = FAULT_S - seconds(rig.clock.now_ns())
            fault = Fault(action=row.action, at_s=at_s, for_s=LASTS_S, chance=row.chance)
            rig.device.add_fault(fault, rig.clock.now_ns())
    return _judged(told)


def _judged(told: list[tuple[float, int, float]]) -> Outcome:
    during = [one for one in told if FAULT_S <= one[0] < FAULT_S + LASTS_S]
    final = min(valid for _, valid, _ in during)
    after_s = next(time_s for time_s, valid, _ in during if valid == final) - FAULT_S if final < 8 else 0.0
    before = [force for _, valid, force in during if valid == 8]
    error_N = max((abs(force - HELD_N) for force in before), default=0.0)
    back = [time_s for time_s, valid, _ in told if time_s >= FAULT_S + LASTS_S and valid == 8]
    return Outcome(final, after_s, error_N, back[0] - FAULT_S - LASTS_S if back else float("inf"))


def fault_table() -> str:
    """What the driver does with each fault."""
    lines = [
        "| what goes wrong | cells that then count | known after | wrong by, while all count | whole again after |",
        "|---|---|---|---|---|",
    ]
    for row in ROWS:
        found = outcome(row)
        noticed = f"{found.after_s:.2f} s" if found.valid < 8 else "–"
        lines.append(
            f"| {row.name} | {found.valid} of 8 | {noticed} | {found.error_N:.2f} N | {max(found.whole_s, 0.0):.2f} s |"
        )
    return "\n".join(lines)


def calibration_lines() -> str:
    """What a calibration of uneven cells is worth."""
    left = tuple((row + 2, column) for row, column in _CELLS)
    tactile = Tactile(interface="socket", channel="memory", right_cells=_CELLS, left_cells=left)
    with tempfile.TemporaryDirectory() as directory:
        device = SimulatedTakktile(lambda: (0.0, 0.0), uneven(two_fingers(), 0))
        fits = calibrated(tactile, device, Path(directory, "tactile.toml"))
    worst = max(found.relative_residual for found in fits)
    return (
        f"Calibrated with weights as above, simulated pads whose cells differ by ±20 % have a held-out residual of\n"
        f"{worst * 100.0:.1f} % of the largest load."
    )


def page() -> str:
    """The generated part."""
    return f"{fault_table()}\n\n{calibration_lines()}"


def main(arguments: list[str]) -> Any:
    """Print, or write."""
    if arguments == ["--write"]:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(written(text, BEGIN, END, page()), encoding="utf-8")
    else:
        print(page())


if __name__ == "__main__":
    main(sys.argv[1:])
