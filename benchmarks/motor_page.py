"""The table of docs/motors.md: what each motor model is, and how old its samples are in the cycle.

    python -m benchmarks.motor_page [--write]

Facts from the control tables, ages and rates of `bench_motors` on virtual time: the same on every machine. --write puts
it between the page's markers, else it is printed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.bench_motors import measure
from drivers.dynamixel.control_tables import MODELS, MotorModel
from tests.system.fault_page import written

PAGE = Path(__file__).parents[1] / "docs" / "motors.md"
BEGIN, END = "<!-- motors: begin -->", "<!-- motors: end -->"
POLL_HZ = 200.0
DURATION_S = 1.0
HEADINGS = ("model", "number", "protocol", "tells", "position", "watchdog", "samples/s", "age, median", "99 %")


def row(model: MotorModel) -> str:
    """One model's line."""
    figures = measure(model, POLL_HZ, DURATION_S)
    one_turn = "one turn" if "multi_turn_offset" in model.registers else "300°"
    position = "many turns" if model.protocol == 2 else one_turn
    cells = (
        model.name,
        model.number,
        f"{model.protocol}.0",
        model.effort,
        f"{model.ticks_per_revolution} a turn, {position}",
        "yes" if model.watchdog_firmware else "no",
        f"{figures['read_rate_hz']:.0f}",
        f"{figures['age_median_ms']:.1f} ms",
        f"{figures['age_p99_ms']:.1f} ms",
    )
    return f"| {' | '.join(map(str, cells))} |"


def table() -> str:
    """All of it."""
    head = [f"| {' | '.join(HEADINGS)} |", "|---" * len(HEADINGS) + "|"]
    return "\n".join([*head, *map(row, MODELS.values())])


def main() -> None:
    """Print or write it."""
    if sys.argv[1:] not in ([], ["--write"]):
        raise SystemExit("usage: python -m benchmarks.motor_page [--write]")
    if sys.argv[1:]:
        PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), BEGIN, END, table()), encoding="utf-8")
    else:
        print(table())


if __name__ == "__main__":
    main()
