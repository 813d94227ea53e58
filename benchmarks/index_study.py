"""`make verdict`: which index leaves the object stillest, for each motor type, on virtual time.

    python -m benchmarks.index_study [--models NAME …] [--conditions NAME …] [--jobs N] [--write]

One run a motor type, condition and grasp, seen by all indices at once (`controller/simulation/index_shadows.py`); and
for some of them runs that are themselves compensated by the load or the fused index, to show that this is the same.
Results are kept under build/ with the state of the sources, so that an interrupted study goes on where it was.
`--write` puts the tables into docs/index.md between their markers, all figures into docs/index.csv, and draws
docs/index.png.
Runs take some 10 s of processor time each, those that hold for a minute 90 s. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console

from benchmarks import index_page
from benchmarks.sources import ROOT, sources_sha256
from controller.simulation.index_shadows import Cell
from controller.simulation.index_study import CONDITIONS, GRASPS, MODEL_NAMES, Condition, prepare, run_cells

DIRECTORY = ROOT / "build" / "index-study"
CARRIER = "excursion"
OWN_RUNS = (
    ("XM430-W350", "softer", "load"),
    ("XM430-W350", "softer", "fused"),
    ("RX-28", "nominal", "load"),
    ("RX-28", "nominal", "fused"),
)
"""Model, condition and carrier of the runs that are compensated by another index, in the grasp off the centre."""


@dataclass(frozen=True)
class Job:
    """One run."""

    model: str
    condition: Condition
    grasp: str
    carrier: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What its cells are found by."""
        return self.model, self.condition.name, self.grasp, self.carrier


def main(arguments: list[str] | None = None) -> None:
    """Run what is not yet there, print the tables."""
    parser = argparse.ArgumentParser(prog="index_study", description=(__doc__ or "").splitlines()[0])
    names = [condition.name for condition in CONDITIONS]
    parser.add_argument("--models", nargs="+", choices=MODEL_NAMES, default=list(MODEL_NAMES), metavar="NAME")
    parser.add_argument("--conditions", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--write", action="store_true", help="write docs/index.md, docs/index.csv and docs/index.png")
    chosen = parser.parse_args(arguments)
    if chosen.jobs < 1:
        parser.error("--jobs must be at least 1")
    if chosen.write and (chosen.models != list(MODEL_NAMES) or chosen.conditions != names):
        parser.error("--write needs all models and conditions")
    jobs = list(wanted(chosen.models, [c for c in CONDITIONS if c.name in chosen.conditions]))
    cells = results(jobs, chosen.jobs, Console(stderr=True))
    studied = [cell for cell in cells if cell.carrier == CARRIER]
    own = [cell for cell in cells if cell.carrier != CARRIER]
    print(index_page.tables(studied, own))
    if chosen.write:
        index_page.write(studied, own, ROOT / "docs")


def wanted(models: list[str], conditions: list[Condition]) -> Iterator[Job]:
    """The runs of a study, the long ones first."""
    runs = [Job(model, c, grasp, CARRIER) for model in models for c in conditions for grasp in GRASPS]
    by_name = {condition.name: condition for condition in conditions}
    runs += [
        Job(model, by_name[name], GRASPS[1], carrier)
        for model, name, carrier in OWN_RUNS
        if model in models and name in by_name
    ]
    return iter(sorted(runs, key=lambda job: -job.condition.hold_s(job.model, job.grasp)))


def results(jobs: list[Job], processes: int, progress: Console) -> list[Cell]:
    """Cells of all jobs, from the file where they are there already."""
    DIRECTORY.mkdir(parents=True, exist_ok=True)
    file = DIRECTORY / f"{sources_sha256()[:16]}.jsonl"
    done = _read(file)
    missing = [job for job in jobs if job.key not in done]
    for model, condition in {(job.model, job.condition) for job in missing}:
        prepare(model, condition, DIRECTORY)
    with ProcessPoolExecutor(processes) as pool, file.open("ab") as lines:
        running = {
            pool.submit(run_cells, job.model, job.condition, job.grasp, DIRECTORY, carrier=job.carrier): job
            for job in missing
        }
        for number, finished in enumerate(as_completed(running), 1):
            cells = finished.result()
            lines.writelines(msgspec.json.encode(cell) + b"\n" for cell in cells)
            lines.flush()
            done[running[finished].key] = cells
            progress.print(f"{number}/{len(missing)} {' · '.join(running[finished].key)}")
    return [cell for job in jobs for cell in done[job.key]]


def _read(file: Path) -> dict[tuple[str, str, str, str], list[Cell]]:
    """Runs that are complete: with a cell for every index and for none."""
    found: dict[tuple[str, str, str, str], list[Cell]] = {}
    for line in file.read_bytes().splitlines() if file.exists() else ():
        cell = msgspec.json.decode(line, type=Cell)
        found.setdefault((cell.model, cell.condition, cell.grasp, cell.carrier), []).append(cell)
    return {key: cells for key, cells in found.items() if len(cells) == index_page.CELLS_A_RUN}


if __name__ == "__main__":
    main()
