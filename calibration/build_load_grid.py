"""The same equilibria on mean tendon load and excursion difference: the table's second index.

For a given difference the mean load rises with the winding, so every column of the excursion grid is re-sampled at
even loads: found on the cubic between two nodes, then solved with the load prescribed. Where the load hardly rises any
more it no longer tells the pose; there the domain ends. Hand frame, SI. Source: design 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.grasp.continuation import advance, as_predicted
from calibration.grasp.equilibrium import Drive, GraspSystem, excursion_drive, load_drive
from calibration.grasp.path_grid import AGREEMENT, PathGrid
from calibration.grasp.path_grid_domain import readable
from calibration.grasp.path_grid_events import known
from calibration.grasp.path_grid_march import Indices
from calibration.grasp.path_grid_solutions import in_column, on_grid, with_slopes
from calibration.hand.finger import Reals
from calibration.table_grid import GridNodes

LEAST_LOAD_SLOPE = 0.3
"""The load tells the pose only while it rises by at least this share of its mean rise with equal excursions."""
CUBIC_STEPS = 4
"""Newton steps on a cubic between two nodes."""


@dataclass(frozen=True)
class LoadGrid:
    """Solved nodes on mean load × difference, and the domain of each column."""

    load_N: Reals
    nodes: GridNodes
    """states w (rows, columns, size) with their slopes per N and per m"""
    start_N: Reals
    end_N: Reals
    residual: float
    """largest scaled residual of all nodes"""


def solve_load_grid(system: GraspSystem, path: PathGrid, rows: int) -> LoadGrid:
    """`rows` loads, and one more beyond, over the loads of all columns' domains."""
    drive = load_drive(system)
    curve = _LoadCurve(path, drive)
    start_N, end_N = curve.domain()
    axis = np.linspace(float(start_N.min()), float(end_N.max()), rows)
    step = float(axis[1] - axis[0])
    axis = np.append(axis, axis[-1] + step)
    low, high = (_with_neighbours(edge, pick) for edge, pick in ((start_N, np.minimum), (end_N, np.maximum)))
    wanted = (axis[:, None] >= low - step) & (axis[:, None] <= high + step) & (axis[:, None] <= curve.reach_N)
    row, column = np.nonzero(wanted & curve.rises)
    place, near = curve.place(axis[row], column)
    solved = path.solutions
    guess = in_column(solved.w, solved.nodes.along_0, solved.axes.steps_m[0], place, column)
    field = solved.wrench
    wrench = None if field is None else in_column(field.value, field.along_0, solved.axes.steps_m[0], place, column)
    target = np.column_stack([axis[row], solved.axes.difference_m[column] + drive.rows[1] @ system.first_state()])
    found = np.full_like(guess, np.nan)
    states = system.solve(guess[near], drive, target[near], wrench=None if wrench is None else wrench[near])
    good = states.converged & as_predicted(system, states.w, guess[near], AGREEMENT)
    found[near] = np.where(good[:, None], states.w, np.nan)
    beside = ~near
    pulls = None if wrench is None else (wrench[beside], wrench[beside])
    found[beside] = advance(
        system, guess[beside], drive, guess[beside] @ drive.rows.T, target[beside], wrench=pulls, halvings=1
    )
    w = np.full((axis.size, curve.rises.size, system.size), np.nan)
    w[row, column] = found
    pull = None
    if wrench is not None:
        pull = np.full((axis.size, curve.rises.size, 3), np.nan)
        pull[row, column] = np.where(known(found)[:, None], wrench, np.nan)
    steps = step, solved.axes.steps_m[1]
    nodes, residual = with_slopes(system, drive, w, None if pull is None else on_grid(pull, steps))
    beyond_top = ~(nodes.along_0 @ excursion_drive(system).rows[0] > 0)
    for array in (nodes.value, nodes.along_0, nodes.along_1, nodes.mixed):
        array[beyond_top] = np.nan
    start_N, end_N = readable(nodes.known, axis, start_N, end_N)
    return LoadGrid(axis, nodes, start_N, end_N, residual)


class _LoadCurve:
    """Mean load over the winding, column by column."""

    def __init__(self, path: PathGrid, drive: Drive) -> None:
        solved = path.solutions
        self._path, self._step_m = path, solved.axes.steps_m[0]
        self._load, self._slope = solved.w @ drive.rows[0], solved.nodes.along_0 @ drive.rows[0]
        columns = self._load.shape[1]
        middle = columns // 2
        own = np.searchsorted(solved.axes.mean_m, (path.domain.start_m[middle], path.domain.end_m[middle])) - [0, 1]
        rise = float(np.diff(self._load[own, middle])[0] / np.diff(solved.axes.mean_m[own])[0])
        least = LEAST_LOAD_SLOPE * rise
        first = np.argmax(np.isfinite(self._load), axis=0)
        self._first = first
        self._flat = self._until(least)
        """rows counted up to which the load rises steeply enough"""
        self._top = np.floor(self._until(0.0)).astype(int)
        self.rises = self._top > first
        """(columns,) whether there is anything to re-sample"""
        each = np.arange(columns)
        steepness = self._slope[self._top, each]
        self.reach_N = self._load[self._top, each] + np.where(steepness > least, self._step_m * steepness, 0.0)
        """(columns,) highest load looked for: that of the last node, and while it is steep what one more adds"""

    def _until(self, least: float) -> Reals:
        """Per column, the place (counted in rows) from which the slope is below `least` or nothing is solved."""
        rows, columns = self._load.shape
        with np.errstate(invalid="ignore"):
            flat = ~(self._slope > least) & (np.arange(rows)[:, None] >= self._first)
        where = np.where(flat.any(0), flat.argmax(0), rows)
        each = np.arange(columns)
        last, beyond = np.maximum(where - 1, 0), np.minimum(where, rows - 1)
        above, below = self._slope[last, each] - least, self._slope[beyond, each] - least
        with np.errstate(invalid="ignore", divide="ignore"):
            share = above / (above - below)
        return np.asarray(last + np.where((where < rows) & np.isfinite(share), np.clip(share, 0, 1), 0.0))

    def domain(self) -> tuple[Reals, Reals]:
        """Loads (columns,) at which each column's domain begins and ends; equal where it has none."""
        solved, domain = self._path.solutions, self._path.domain
        columns = np.arange(self._first.size)
        start, end = solved.share(domain.start_m), np.minimum(solved.share(domain.end_m), self._flat)
        start_N, end_N = (self._at(place, columns)[0] for place in (start, np.maximum(start, end)))
        has = self.rises & (end > start) & np.isfinite(start_N) & np.isfinite(end_N)
        start_N[~has] = end_N[~has] = start_N[has].min()
        return start_N, end_N

    def place(self, load_N: Reals, column: Indices) -> tuple[Reals, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
        """Places (P,) counted in rows at which columns have the loads; and whether they do, or the nearest node stands
        for it."""
        place = np.empty(load_N.size)
        for own in np.unique(column):
            chosen = column == own
            rows = np.arange(self._first[own], self._top[own] + 1)
            place[chosen] = np.interp(load_N[chosen], self._load[rows, own], rows)
        low, high = self._load[self._first[column], column], self._load[self._top[column], column]
        within = (load_N >= low) & (load_N <= high)
        cell = np.clip(np.floor(place), self._first[column], self._top[column] - 1)
        for _ in range(CUBIC_STEPS):
            load, slope = self._at(np.where(within, place, cell), column)
            place = np.where(within, np.clip(place + (load_N - load) / slope, cell, cell + 1), place)
        return place, within

    def _at(self, place: Reals, column: Indices) -> tuple[Reals, Reals]:
        """Load, N, and its slope, N per row, on the cubic between two nodes."""
        row = np.clip(np.floor(place + 1e-9).astype(int), 0, self._load.shape[0] - 2)
        t = place - row
        start, end = self._load[row, column], self._load[row + 1, column]
        leaving, arriving = (self._step_m * self._slope[index, column] for index in (row, row + 1))
        rest = end - start
        square, cube = 3 * rest - 2 * leaving - arriving, leaving + arriving - 2 * rest
        exact = np.abs(t) < 1e-9
        load = np.where(exact, start, start + t * (leaving + t * (square + t * cube)))
        return load, np.where(exact, leaving, leaving + t * (2 * square + 3 * t * cube))


def _with_neighbours(edge: Reals, pick: np.ufunc) -> Reals:
    """Per column, the outermost of its own edge and its neighbours'."""
    padded = np.concatenate([edge[:1], edge, edge[-1:]])
    outer: Reals = pick(pick(padded[:-2], padded[1:-1]), padded[2:])
    return outer
