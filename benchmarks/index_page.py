"""Tables, figure and list of the index study: what `docs/index.md` shows. Pure but for `write` and `draw`.

Motions in mm and degrees; of both grasps always the one that moved more.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from calibration.figures.style import BLACK, BLUE, GREEN, ORANGE, as_curves, new_figure, styled
from controller.simulation.index_shadows import INDICES, NO_INDEX, PHASES, Cell, Residual
from controller.simulation.index_study import CONDITIONS, MODEL_NAMES

BEGIN, END = "<!-- tables of benchmarks/index_study.py: begin -->", "<!-- tables: end -->"
CELLS_A_RUN = len(INDICES) + 1
UNKNOWN = ("softer", "stiffer")
"""Conditions in which the hand file is wrong about the tendons."""
_COLOURS = dict(zip(INDICES, (BLUE, ORANGE, GREEN), strict=True))
_RESIDUAL_COLUMNS = tuple(Residual.__struct_fields__)


def tables(cells: Sequence[Cell], own: Sequence[Cell]) -> str:
    """All of the page that is generated, as Markdown."""
    parts = [
        "**All conditions in one line a motor**: root mean square over winding and holding, and in brackets the "
        "largest displacement of all phases, mm. Bold: the index that leaves least.",
        _summary(cells),
    ]
    for phase in PHASES:
        parts += [f"**{phase.capitalize()}**: largest displacement, mm, and rotation, °.", _phase(cells, phase)]
    if own:
        parts += [
            "**By itself or beside another**: displacement, mm, of the same index while it compensates and while the "
            "excursion does.",
            _own(cells, own),
        ]
    return "\n\n".join(parts)


def write(cells: Sequence[Cell], own: Sequence[Cell], docs: Path) -> None:
    """Write the page's tables, the list and the figure. ValueError if the page has no place for the tables."""
    page = docs / "index.md"
    page.write_text(written(page.read_text(encoding="utf-8"), tables(cells, own)), encoding="utf-8")
    (docs / "index.csv").write_text(listed([*cells, *own]), encoding="utf-8")
    draw(cells, docs / "index.png")


def written(page: str, text: str) -> str:
    """The page with other text between its markers. ValueError if it has none."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page has no lines {BEGIN!r} and {END!r}.")
    return f"{before}{begin}\n\n{text}\n\n{end}{after}"


def listed(cells: Sequence[Cell]) -> str:
    """Every figure, as CSV."""
    file = io.StringIO()
    rows = csv.writer(file, lineterminator="\n")
    columns = [f"{phase}_{name}" for phase in PHASES for name in _RESIDUAL_COLUMNS]
    rows.writerow(["model", "condition", "grasp", "index", "carrier", "hold_s", "load_N", *columns])
    for cell in cells:
        figures = [getattr(getattr(cell, phase), name) for phase in PHASES for name in _RESIDUAL_COLUMNS]
        rows.writerow(
            [cell.model, cell.condition, cell.grasp, cell.index, cell.carrier, cell.hold_s, cell.load_N, *figures]
        )
    return file.getvalue()


def read(text: str) -> list[Cell]:
    """The cells of a list that `listed` wrote."""
    cells = []
    for row in csv.DictReader(io.StringIO(text)):
        phases = [Residual(*(float(row[f"{phase}_{name}"]) for name in _RESIDUAL_COLUMNS)) for phase in PHASES]
        what = (row["model"], row["condition"], row["grasp"], row["index"], row["carrier"])
        cells.append(Cell(*what, float(row["hold_s"]), float(row["load_N"]), *phases))
    return cells


def draw(cells: Sequence[Cell], file: Path) -> None:
    """One panel a motor: the largest displacement while winding and holding, and hollow while unwinding."""
    models = [model for model in MODEL_NAMES if any(cell.model == model for cell in cells)]
    names = [condition.name for condition in CONDITIONS if any(cell.condition == condition.name for cell in cells)]
    with styled():
        figure, panels = new_figure(11.0, 6.4, 2, 3)
        for panel, model in zip(panels, models, strict=False):
            for shift, index in zip((-0.22, 0.0, 0.22), INDICES, strict=True):
                chosen = [_of(cells, model, name, index) for name in names]
                places = np.arange(len(names)) + shift
                held = [max(max(c.winding.peak_mm, c.holding.peak_mm) for c in some) for some in chosen]
                freed = [max(c.unwinding.peak_mm for c in some) for some in chosen]
                panel.bar(places, held, width=0.2, color=_COLOURS[index], label=index)
                panel.plot(places, freed, "_", color=BLACK, markersize=7, markeredgewidth=1.2)
            panel.plot([], [], "_", color=BLACK, label="unwinding")
            panel.axvspan(names.index("softer") - 0.5, names.index("stiffer") + 0.5, color="#f2f2f2", zorder=0)
            panel.set_xticks(range(len(names)), names, rotation=35, ha="right")
            as_curves(panel, "", "largest motion left  mm", model)
            panel.grid(False, axis="x")
        top = max(panel.get_ylim()[1] for panel in panels)
        for panel in panels:
            panel.set_ylim(0.0, top)
        panels[0].legend(loc="upper left", ncols=2)
        figure.savefig(file)


def _summary(cells: Sequence[Cell]) -> str:
    groups: list[tuple[str, Callable[[str], bool]]] = [
        ("tendons known", lambda name: name not in UNKNOWN),
        ("tendons wrong by 30 %", lambda name: name in UNKNOWN),
    ]
    head = ["motor", "no compensation"] + [f"{words}: {index}" for words, _ in groups for index in INDICES]
    rows = []
    for model in MODEL_NAMES:
        mine = [cell for cell in cells if cell.model == model]
        if not mine:
            continue
        row = [model, _both([cell for cell in mine if cell.index == NO_INDEX])[0]]
        for _, belongs in groups:
            found = {
                index: _both([cell for cell in mine if cell.index == index and belongs(cell.condition)])
                for index in INDICES
            }
            least = min(value for _, value in found.values())
            row += [f"**{text}**" if value == least else text for text, value in found.values()]
        rows.append(row)
    return _markdown(head, rows)


def _both(cells: Sequence[Cell]) -> tuple[str, float]:
    """Root mean square over winding and holding, with the largest displacement of all phases."""
    if not cells:
        return "–", float("inf")
    squares = [residual.rms_mm**2 for cell in cells for residual in (cell.winding, cell.holding)]
    rms_mm = float(np.sqrt(np.mean(squares)))
    peak_mm = max(getattr(cell, phase).peak_mm for cell in cells for phase in PHASES)
    return f"{rms_mm:.2f} ({peak_mm:.1f})", rms_mm


def _phase(cells: Sequence[Cell], phase: str) -> str:
    head = ["motor", "condition", *INDICES, "without"]
    rows = []
    for model in MODEL_NAMES:
        for condition in CONDITIONS:
            if not _of(cells, model, condition.name, NO_INDEX):
                continue
            row = [model, condition.name]
            for index in (*INDICES, NO_INDEX):
                some = [getattr(cell, phase) for cell in _of(cells, model, condition.name, index)]
                row.append(f"{max(r.peak_mm for r in some):.2f}, {max(r.peak_deg for r in some):.2f}°")
            rows.append(row)
    return _markdown(head, rows)


def _own(cells: Sequence[Cell], own: Sequence[Cell]) -> str:
    rows = []
    for run in own:
        if run.index != run.carrier:
            continue
        (beside,) = [c for c in _of(cells, run.model, run.condition, run.index) if c.grasp == run.grasp]
        figures = [f"{getattr(run, phase).peak_mm:.2f}, {getattr(beside, phase).peak_mm:.2f}" for phase in PHASES]
        rows.append([run.model, run.condition, run.index, *figures])
    return _markdown(["motor", "condition", "index", *PHASES], rows)


def _of(cells: Sequence[Cell], model: str, condition: str, index: str) -> list[Cell]:
    return [c for c in cells if (c.model, c.condition, c.index) == (model, condition, index)]


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
