"""How right first contact is found: every motor model, three closing speeds, an object that is not the table's.

    python -m benchmarks.contact_study            run what is missing, print the tables
    python -m benchmarks.contact_study --write    write them into docs/contact.md, and draw docs/contact.png

Whole daemon, simulated motors and world on virtual time: the same figures on any machine. Each closing takes some
seconds of processor time; what was run is kept under build/ with the state of the sources, so that an interrupted study
goes on where it was. `--models` runs a part, such as beside another process.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from benchmarks.closing_trial import Trial, run
from benchmarks.contact_figure import draw
from benchmarks.sources import ROOT, sources_sha256

PAGE, FIGURE, DIRECTORY = ROOT / "docs" / "contact.md", ROOT / "docs" / "contact.png", ROOT / "build" / "contact-study"
BEGIN, END = "<!-- contact study: begin -->", "<!-- contact study: end -->"

MODELS = ("RX-28", "MX-28", "MX-28(2.0)", "XM430-W350", "XM430-W210", "XL430-W250")
RATES_M_S = (0.005, 0.010, 0.020)
WIDER_M = (0.012, 0.006, 0.0, -0.006, -0.012)
"""Of the object's 40 mm; a millimetre wider is some 0.05 mm of excursion earlier."""


@dataclass(frozen=True)
class Row:
    """A trial's outcome as it is kept; excursions in mm."""

    trial: dict[str, Any]
    outcome: str
    off_centre: bool
    object_offset_mm: float
    error_mm: tuple[float, float]
    late_mm: tuple[float, float]
    pushed_mm: float


OTHERS: dict[str, dict[str, Any]] = {
    "2 mm wider": {"wider_m": 0.002},
    "2 mm narrower": {"wider_m": -0.002},
    "10 % split, 6 mm wider": {"split": True, "wider_m": 0.006},
    "right spool's zero 0.3 mm off": {"zero_error_m": (3e-4, 0.0)},
    "both zeros −0.3 mm off": {"zero_error_m": (-3e-4, -3e-4)},
    "tendons 4.5e4 N/m, 6 mm wider": {"tendon_stiffness_N_per_m": 4.5e4, "wider_m": 0.006},
    "0.4 kg on the support, 6 mm narrower": {"mass_kg": 0.4, "wider_m": -0.006},
    "3 mm aside": {"aside_m": 0.003},
}
"""What else may differ, all at 10 mm/s."""

WRONG: dict[str, tuple[str, dict[str, Any]]] = {
    "nothing there": ("no_contact", {"present": False}),
    "one finger only (16 mm object, 9 mm aside)": ("one_sided_contact", {"wider_m": -0.024, "aside_m": 0.009}),
    "far too wide (66 mm)": ("contact_unexpected", {"wider_m": 0.026}),
}
"""What is no contact of this grasp, and what the command must then fail with."""


def pad_trials() -> list[Trial]:
    """With pads: the same speeds, and contact where load would not say so."""
    trials = [Trial(closing_rate_m_s=rate, wider_m=w, pads=True) for rate in RATES_M_S for w in (0.006, 0.0, -0.006)]
    return [*trials, Trial(pads=True, **WRONG["one finger only (16 mm object, 9 mm aside)"][1])]


def trials(models: Sequence[str]) -> list[Trial]:
    """All of the study, for these models."""
    found = [Trial(m, rate, wider_m=w) for m in models for rate in RATES_M_S for w in WIDER_M]
    others = [Trial(m, **changes) for m in models for changes in OTHERS.values()]
    wrong = [Trial(m, **changes) for m in models for _, changes in WRONG.values()]
    return [*found, *others, *wrong, *(pad_trials() if Trial().model in models else [])]


def key(trial: Trial) -> str:
    """What a trial is kept under."""
    return json.dumps(asdict(trial), sort_keys=True)


def kept_file() -> Path:
    """Where rows are kept."""
    return DIRECTORY / f"{sources_sha256()[:16]}.jsonl"


def kept() -> dict[str, Row]:
    """What was run before, by the sources as they are."""
    file = kept_file()
    if not file.exists():
        return {}
    rows = [Row(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    return {json.dumps(row.trial, sort_keys=True): row for row in rows}


def measured(trial: Trial) -> Row:
    """Run one closing."""
    DIRECTORY.mkdir(parents=True, exist_ok=True)
    closing = run(trial, DIRECTORY)
    late_m = closing.true_m - closing.expected_m
    return Row(
        json.loads(key(trial)),
        closing.outcome,
        closing.off_centre,
        round(1e3 * closing.object_offset_m, 1),
        _millimetres(closing.error_m),
        _millimetres(late_m),
        round(1e3 * closing.pushed_m, 1),
    )


def _millimetres(pair_m: Any) -> tuple[float, float]:
    right, left = (round(1e3 * float(value), 4) for value in pair_m)
    return right, left


def report(rows: dict[str, Row], models: Sequence[str]) -> str:
    """The tables as Markdown."""
    parts = [_found(rows, models), _others(rows, models), _wrong(rows, models)]
    return "\n\n".join([*parts, _pads(rows)] if Trial().model in models else parts)


def _found(rows: dict[str, Row], models: Sequence[str]) -> str:
    late = [f"{_mean_late(rows, models, wider_m):+.1f} mm" for wider_m in WIDER_M]
    lines = [
        "Error of the excursion of first contact, mm, right / left, by how much later than in the table it truly came:",
        "",
        f"| motor | closing | {' | '.join(late)} | largest |",
        f"|---|---|{'---|' * len(WIDER_M)}---|",
    ]
    for model in models:
        for rate in RATES_M_S:
            cells = [rows[key(Trial(model, rate, wider_m=wider_m))] for wider_m in WIDER_M]
            lines.append(
                f"| {model} | {1e3 * rate:g} mm/s | {' | '.join(_error(row) for row in cells)} | {_largest(cells)} |"
            )
    return "\n".join(lines)


def _mean_late(rows: dict[str, Row], models: Sequence[str], wider_m: float) -> float:
    return float(np.mean([rows[key(Trial(m, rate, wider_m=wider_m))].late_mm for m in models for rate in RATES_M_S]))


def _others(rows: dict[str, Row], models: Sequence[str]) -> str:
    lines = [
        "Other things that differ, closing at 10 mm/s: how much later true contact came, and error, mm, right / left:",
        "",
        f"| | later | {' | '.join(models)} |",
        f"|---|---|{'---|' * len(models)}",
    ]
    for name, changes in OTHERS.items():
        cells = [rows[key(Trial(model, **changes))] for model in models]
        right, left = np.mean([row.late_mm for row in cells], axis=0)
        lines.append(f"| {name} | {right:+.2f} / {left:+.2f} | {' | '.join(_error(row) for row in cells)} |")
    lines.append(
        f"| largest | | {' | '.join(_largest([rows[key(Trial(m, **c))] for c in OTHERS.values()]) for m in models)} |"
    )
    return "\n".join(lines)


def _wrong(rows: dict[str, Row], models: Sequence[str]) -> str:
    lines = [
        "What is no contact of this grasp: what the command failed with, and how far the object was pushed until then:",
        "",
        f"| | {' | '.join(models)} |",
        f"|---|{'---|' * len(models)}",
    ]
    for name, (_, changes) in WRONG.items():
        cells = [rows[key(Trial(model, **changes))] for model in models]
        lines.append(f"| {name} | {' | '.join(f'{row.outcome}, {row.pushed_mm:.1f} mm' for row in cells)} |")
    return "\n".join(lines)


def _pads(rows: dict[str, Row]) -> str:
    lines = [
        f"With tactile pads on both fingertips ({Trial().model}); found by them:",
        "",
        "| closing | later | error, mm | outcome |",
        "|---|---|---|---|",
    ]
    for trial in pad_trials():
        row = rows[key(trial)]
        right, left = (_signed(value) for value in row.late_mm)
        errors = _error(row) if row.outcome == "contact" else "–"
        lines.append(f"| {1e3 * trial.closing_rate_m_s:g} mm/s | {right} / {left} | {errors} | {row.outcome} |")
    return "\n".join(lines)


def _error(row: Row) -> str:
    if row.outcome != "contact":
        return row.outcome
    right, left = (_signed(value) for value in row.error_mm)
    return f"{right} / {left}" + (f" (off-centre: {row.object_offset_mm:+.0f} mm)" if row.off_centre else "")


def _signed(value: float) -> str:
    return "–" if math.isnan(value) else f"{round(value, 2) + 0.0:+.2f}"


def _largest(rows: Sequence[Row]) -> str:
    return f"{max(abs(value) for row in rows for value in row.error_mm):.2f}"


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write docs/contact.md and docs/contact.png")
    parser.add_argument("--models", nargs="+", choices=MODELS, default=MODELS, help="only these (not with --write)")
    asked = parser.parse_args()
    models: Sequence[str] = MODELS if asked.write else asked.models
    rows = kept()
    DIRECTORY.mkdir(parents=True, exist_ok=True)
    with kept_file().open("a", encoding="utf-8") as file:
        for trial in track([t for t in trials(models) if key(t) not in rows], description="closing"):
            row = rows[key(trial)] = measured(trial)
            file.write(json.dumps(asdict(row)) + "\n")
            file.flush()
    tables = report(rows, models)
    if not asked.write:
        print(tables)
        return
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, found, after = rest.partition(END)
    if not found:
        raise SystemExit(f"{PAGE} lacks the line {BEGIN} or {END}.")
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}", encoding="utf-8")
    draw(
        {
            model: [
                (
                    rate,
                    list(rows[key(Trial(model, rate, wider_m=w))].late_mm),
                    list(rows[key(Trial(model, rate, wider_m=w))].error_mm),
                )
                for rate in RATES_M_S
                for w in WIDER_M
            ]
            for model in MODELS
        },
        FIGURE,
    )


if __name__ == "__main__":
    main()
