"""Equilibria on a grid with all that follows from them: slopes, margins, stability.

Arrays over (rows, columns, …), NaN where there is no equilibrium. Slopes are those of the equations (implicit
functions), and of the external wrench on the grid. Source: hand-mechanics reference 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.grasp.equilibrium import Drive, Flags, GraspSystem, WrenchSlopes
from calibration.grasp.path_grid_events import Watch, known
from calibration.grasp.path_grid_march import Axes, Indices
from calibration.hand.finger import Reals
from calibration.table_grid import GridNodes


@dataclass(frozen=True)
class Solutions:
    """Solved nodes of a grid."""

    axes: Axes
    nodes: GridNodes
    """states w (rows, columns, size) with their slopes along mean and difference, per m"""
    wrench: GridNodes | None
    """(rows, columns, 3) external wrench on the object with its slopes; None is none"""
    stability: Reals
    """(rows, columns) smallest eigenvalue, > 0 is stable"""
    margins: Reals
    """(rows, columns, events) of a `Watch`; last, the stability"""
    residual: float
    """largest scaled residual of all nodes"""

    @property
    def w(self) -> Reals:
        """(rows, columns, size)"""
        return self.nodes.value

    @property
    def solved(self) -> Flags:
        """(rows, columns) where there is a solution."""
        return known(self.w)

    def share(self, mean_m: Reals) -> Reals:
        """Means counted in rows."""
        counted: Reals = (mean_m - self.axes.mean_m[0]) / self.axes.steps_m[0]
        return counted


def solutions(
    system: GraspSystem, watch: Watch, axes: Axes, w: Reals, wrench: Reals | None, margins: Reals | None = None
) -> Solutions:
    """Slopes, stability and (where not given) margins at the nodes of `w`; `wrench` (rows, columns, 3)."""
    solved = known(w)
    field = None if wrench is None else on_grid(wrench, axes.steps_m)
    nodes, residual = with_slopes(system, axes.drive, w, field)
    if margins is None:
        margins = np.full((*solved.shape, len(watch.names)), np.nan)
        margins[solved] = watch.margins(w[solved])
    stability = np.full(solved.shape, np.nan)
    stability[solved] = system.stability(w[solved])
    every = np.concatenate([margins, stability[:, :, None]], axis=2)
    return Solutions(axes, nodes, field, stability, every, residual)


def with_slopes(system: GraspSystem, drive: Drive, w: Reals, wrench: GridNodes | None) -> tuple[GridNodes, float]:
    """States `w` (rows, columns, size) with their slopes along the drive's targets; and the largest residual."""
    solved = known(w)
    field = None
    if wrench is not None:
        along = np.stack([wrench.along_0[solved], wrench.along_1[solved]], axis=-1)
        field = WrenchSlopes(wrench.value[solved], along, wrench.mixed[solved])
    slopes = system.slopes(w[solved], drive, field)
    along_0, along_1, mixed = np.full((3, *w.shape), np.nan)
    along_0[solved], along_1[solved] = slopes.tangent[:, :, 0], slopes.tangent[:, :, 1]
    mixed[solved] = slopes.mixed
    return GridNodes(w, along_0, along_1, mixed), float(slopes.residual.max(initial=0.0))


def on_grid(values: Reals, steps: tuple[float, float]) -> GridNodes:
    """Values (rows, columns, k) with slopes taken from the grid itself."""
    along_0 = grid_slope(values, steps[0], 0)
    return GridNodes(values, along_0, grid_slope(values, steps[1], 1), grid_slope(along_0, steps[1], 1))


def in_column(values: Reals, slopes: Reals, step: float, place: Reals, column: Indices) -> Reals:
    """Cubics through values and slopes (rows, columns, k) along columns, at places (P,) counted in rows; (P, k), NaN
    beside a missing node."""
    row = np.clip(np.floor(place + 1e-9).astype(int), 0, values.shape[0] - 2)
    t = (place - row)[:, None]
    start, end = values[row, column], values[row + 1, column]
    leaving, arriving = step * slopes[row, column], step * slopes[row + 1, column]
    rest = end - start
    cubic = start + t * (leaving + t * (3 * rest - 2 * leaving - arriving + t * (leaving + arriving - 2 * rest)))
    return np.asarray(np.where(np.abs(t) < 1e-9, start, cubic))


def grid_slope(values: Reals, step: float, axis: int) -> Reals:
    """Derivative of `values` (rows, columns, k) along an axis with nodes `step` apart, where some nodes are NaN.

    Fourth-order central differences inside, second-order ones next to a missing node; 0 where a node stands alone.
    """
    v = np.moveaxis(values, axis, 0)
    padded = np.pad(v, ((2, 2), (0, 0), (0, 0)), constant_values=np.nan)
    far_back, back, ahead, far_ahead = (padded[2 + k : 2 + k + v.shape[0]] for k in (-2, -1, 1, 2))
    choices = (
        (8 * (ahead - back) - (far_ahead - far_back)) / 12,
        (ahead - back) / 2,
        (4 * ahead - far_ahead - 3 * v) / 2,
        (3 * v - 4 * back + far_back) / 2,
        ahead - v,
        v - back,
    )
    result = np.where(np.isfinite(v), 0.0, np.nan)
    for choice in reversed(choices):
        result = np.where(np.isfinite(choice) & np.isfinite(v), choice, result)
    return np.moveaxis(result / step, 0, axis)
