"""Equilibria of a grasp on a grid, and the curves on which its domain begins and ends.

Grid axes: mean tendon excursion since first contact, and its difference, right − left (finger-side, m). Nodes are
solutions of the smooth equations, in which joints pass their stops; so cells that the domain's end crosses can be
interpolated right up to it. A coarse grid is followed from first contact (`path_grid_march`); the nodes of the fine one
are solved all at once from its interpolation, and count only where they agree with it, so that they lie on the same
branch. Source: hand-mechanics reference 6 and 11.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibration.grasp.continuation import as_predicted, unwound
from calibration.grasp.equilibrium import Flags, GraspSystem, excursion_drive
from calibration.grasp.path_grid_domain import Domain, domain
from calibration.grasp.path_grid_drag import SupportDrag, slide
from calibration.grasp.path_grid_events import ROUNDING, Event, Watch, events, known
from calibration.grasp.path_grid_march import Axes, Followed, Indices, follow, wanted
from calibration.grasp.path_grid_solutions import Solutions, solutions
from calibration.hand.finger import Reals
from calibration.table_grid import read_nodes
from drivers.errors import MechanicsError

__all__ = ["Event", "PathGrid", "events", "known", "solve_path_grid"]

COARSE_STEP_M = 6e-4
COARSE_DIFFERENCE_M = 4e-4
LONGEST_PATH_M = 0.06
SHORTEST_PATH_M = 1e-3
BEYOND_CAP = 1.5
"""The coarse grid is followed so far beyond the load cap, because the support's drag or another branch moves it."""
AGREEMENT = 0.03
"""Largest scaled difference between a node and its prediction from coarser nodes or from its neighbours."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class PathGrid:
    """Solved nodes with their domain; a column that has none keeps no nodes, so that nobody interpolates towards it."""

    solutions: Solutions
    domain: Domain
    left_out: Flags
    """(rows, columns) wanted nodes for which no solution on the branch was found"""


def solve_path_grid(
    system: GraspSystem,
    *,
    nodes: int,
    columns: int,
    difference_range_m: float,
    drag: SupportDrag | None = None,
    progress: Progress = lambda _: None,
) -> PathGrid:
    """Solve the grid: `columns` (odd) differences over ±`difference_range_m`, about `nodes` means up to the longest
    column's end.

    Errors: MechanicsError when there is no path from first contact with equal excursions.
    """
    watch = Watch(system)
    at_contact = watch.margins(system.first_state()[None])[0]
    if (at_contact < -ROUNDING).any():
        raise MechanicsError(
            "grasp",
            f"impossible from first contact on: {watch.names[int(np.argmin(at_contact))]}.",
            help="Take another object, its other placement, or a smaller onset split.",
        )
    alike = drag is None and system.friction_direction == 1
    coarse = _coarse_solutions(system, watch, columns, difference_range_m, 1.0 if alike else BEYOND_CAP)
    progress(0.3)
    ends = domain(system, watch, coarse, within=1e-2)
    end_m = float(ends.end_m[ends.end_m.size // 2])
    if end_m < SHORTEST_PATH_M:
        raise MechanicsError(
            "grasp",
            f"the path from first contact ends after {end_m * 1e3:.1f} mm of winding: "
            f"{ends.end_event[ends.end_m.size // 2]}.",
            help="Take another object, or a smaller onset split, or a higher load cap.",
        )
    step_m = float(ends.end_m.max()) / (nodes - 3)
    axes = Axes(
        coarse.axes.drive,
        coarse.axes.origin,
        step_m * np.arange(float(nodes + max(4, nodes // 4))),
        np.linspace(-difference_range_m, difference_range_m, columns),
    )
    found, expected = _interpolated(system, watch, coarse, ends, axes, drag)
    progress(0.7)
    follow(system, watch, axes, found, expected)
    return _with_domain(system, watch, axes, found)


def _coarse_solutions(
    system: GraspSystem, watch: Watch, columns: int, difference_range_m: float, beyond_cap: float
) -> Solutions:
    """A coarse grid without drag, followed from first contact while winding, then brought to the system's branch."""
    drive = excursion_drive(system)
    first = system.first_state()
    half = min(columns // 2, math.ceil(difference_range_m / COARSE_DIFFERENCE_M))
    axes = Axes(
        drive,
        drive.rows @ first,
        np.arange(0.0, LONGEST_PATH_M, COARSE_STEP_M),
        np.linspace(-difference_range_m, difference_range_m, 2 * half + 1),
    )
    winding = replace(system, friction_direction=1.0, load_cap_N=beyond_cap * system.load_cap_N)
    winding_watch = Watch(winding)
    found = Followed.nothing(axes, winding, winding_watch)
    found.w[0, half] = first
    far = np.ones((*axes.shape, len(winding_watch.names) - winding_watch.linear))
    follow(winding, winding_watch, axes, found, far)  # clearances are looked at afterwards, all at once
    rows = max(4, int(np.flatnonzero(known(found.w).any(1))[-1]) + 1)
    axes = replace(axes, mean_m=axes.mean_m[:rows])
    w = found.w[:rows]
    solved = known(w)
    w[solved] = unwound(system, w[solved], drive, axes.targets(*np.nonzero(solved)))
    return solutions(system, watch, axes, w, None)


def _interpolated(
    system: GraspSystem, watch: Watch, coarse: Solutions, ends: Domain, axes: Axes, drag: SupportDrag | None
) -> tuple[Followed, Reals]:
    """Fine nodes solved from the interpolation of the coarse ones, and what the clearances are expected to be."""
    found = Followed.nothing(axes, system, watch)
    share_0 = coarse.share(axes.mean_m)
    share_1 = (axes.difference_m - coarse.axes.difference_m[0]) / coarse.axes.steps_m[1]
    longer = np.maximum(ends.end_m[:-1], ends.end_m[1:])
    cell = np.clip(share_1.astype(int), 0, longer.size - 1)
    near = axes.mean_m[:, None] <= longer[cell] + 2 * axes.steps_m[0]
    near &= share_0[:, None] <= coarse.axes.shape[0] - 1
    rows, columns = np.nonzero(near)

    def guess(places: Reals, columns: Indices) -> Reals:
        mean = axes.mean_m[0] + places * axes.steps_m[0]
        return read_nodes(coarse.nodes, coarse.axes.steps_m, coarse.share(mean), share_1[columns])

    guesses = np.full((*axes.shape, system.size), np.nan)
    guesses[near] = guess(rows.astype(float), columns)
    if drag is None:
        rows, columns = np.nonzero(known(guesses))
        states = system.solve(guesses[rows, columns], axes.drive, axes.targets(rows, columns))
        good = states.converged & as_predicted(system, states.w, guesses[rows, columns], AGREEMENT)
        found.w[rows[good], columns[good]] = states.w[good]
    else:
        found.w, found.wrench = slide(system, drag, axes, known(guesses), guess)
    expected = np.full((*axes.shape, len(watch.names) - watch.linear), np.nan)
    rows, columns = np.nonzero(near)
    expected[near] = _bilinear(coarse.margins[:, :, watch.linear : -1], share_0[rows], share_1[columns])
    return found, expected


def _bilinear(values: Reals, share_0: Reals, share_1: Reals) -> Reals:
    """Values (P, k) between the nodes of (rows, columns, k) at places (P,) counted in nodes."""
    i = np.clip(share_0.astype(int), 0, values.shape[0] - 2)
    j = np.clip(share_1.astype(int), 0, values.shape[1] - 2)
    u, v = (share_0 - i)[:, None], (share_1 - j)[:, None]
    low = (1 - v) * values[i, j] + v * values[i, j + 1]
    high = (1 - v) * values[i + 1, j] + v * values[i + 1, j + 1]
    return np.asarray((1 - u) * low + u * high)


def _with_domain(system: GraspSystem, watch: Watch, axes: Axes, found: Followed) -> PathGrid:
    """The finished grid."""
    rows = max(4, int(np.flatnonzero(known(found.w).any(1))[-1]) + 1)
    axes = replace(axes, mean_m=axes.mean_m[:rows])
    left_out = wanted(watch, found.margins)[:rows] & ~known(found.w[:rows])
    wrench = None if found.wrench is None else found.wrench[:rows]
    solved = solutions(system, watch, axes, found.w[:rows], wrench, found.margins[:rows])
    stray = ~_agreeing(system, solved)
    if stray.any():
        w = np.where(stray[:, :, None], np.nan, solved.w)
        margins = np.where(stray[:, :, None], np.nan, found.margins[:rows])
        solved = solutions(system, watch, axes, w, wrench, margins)
    found_domain = domain(system, watch, solved)
    empty = found_domain.end_m <= found_domain.start_m
    solved.w[:, empty] = np.nan
    return PathGrid(solved, found_domain, left_out | stray)


def _agreeing(system: GraspSystem, solved: Solutions) -> Flags:
    """(rows, columns) where a node agrees with what its neighbours on either side predict of it, or has none."""
    agree = np.ones(solved.solved.shape, bool)
    along = solved.nodes.along_0, solved.nodes.along_1
    for axis in (0, 1):
        w, slope = (np.moveaxis(values, axis, 0) for values in (solved.w, along[axis]))
        step = solved.axes.steps_m[axis]
        predicted = 0.5 * (w[:-2] + w[2:]) + step / 4 * (slope[:-2] - slope[2:])
        away = np.abs((w[1:-1] - predicted) / system.column_scale).max(2)
        np.moveaxis(agree, axis, 0)[1:-1] &= ~(away > AGREEMENT)
    return agree
