"""The index study's page: its tables are those of its list, and its list is what the study finds."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from benchmarks import index_page
from benchmarks.index_study import CARRIER, wanted
from controller.simulation.index_shadows import INDICES, NO_INDEX, PHASES, Cell
from controller.simulation.index_study import CONDITIONS, GRASPS, MODEL_NAMES, run_cells

DOCS = Path(__file__).resolve().parents[2] / "docs"
LIST = index_page.read((DOCS / "index.csv").read_text(encoding="utf-8"))
REPEATED = ("XM430-W350", "softer", GRASPS[0])
TOLERANCE = 0.05
"""mm and degrees: processors round differently, and the noise of the motors makes something of it."""
ADVICE = "the sources moved on: run `python -m benchmarks.index_study --write`"


def test_the_page_shows_its_list() -> None:
    """Nobody edits a figure by hand: tables and list come of one run."""
    studied = [cell for cell in LIST if cell.carrier == CARRIER]
    own = [cell for cell in LIST if cell.carrier != CARRIER]
    assert index_page.tables(studied, own) in (DOCS / "index.md").read_text(encoding="utf-8"), ADVICE


def test_the_list_is_complete() -> None:
    """Every motor type, condition, grasp and index is in it."""
    jobs = {job.key for job in wanted(list(MODEL_NAMES), list(CONDITIONS))}
    assert {(cell.model, cell.condition, cell.grasp, cell.carrier) for cell in LIST} == jobs
    assert len(LIST) == len(jobs) * index_page.CELLS_A_RUN
    assert index_page.read(index_page.listed(LIST)) == LIST


@pytest.mark.slow
def test_a_row_of_the_page_is_found_again(tmp_path: Path) -> None:
    """One grasp of the study on virtual time: page and code are in step."""
    model, name, grasp = REPEATED
    condition = next(condition for condition in CONDITIONS if condition.name == name)
    shown = {
        cell.index: cell
        for cell in LIST
        if (cell.model, cell.condition, cell.grasp, cell.carrier) == (*REPEATED, CARRIER)
    }
    found = {cell.index: cell for cell in run_cells(model, condition, grasp, tmp_path)}
    assert set(found) == set(shown) == {*INDICES, NO_INDEX}
    for index, cell in found.items():
        assert figures(cell) == pytest.approx(figures(shown[index]), abs=TOLERANCE), ADVICE


def figures(cell: Cell) -> list[float]:
    return [value for phase in PHASES for value in msgspec.structs.astuple(getattr(cell, phase))]


def test_a_page_without_a_place_is_told() -> None:
    """Tables are never lost in silence."""
    with pytest.raises(ValueError, match="has no lines"):
        index_page.written("no markers", "tables")
