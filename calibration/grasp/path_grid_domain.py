"""Where the domain of each column of a grid begins and ends, and by which event.

A column's domain is the first stretch on which no margin is negative: it begins where the fingers press (N ≥ 0) and
ends at the first event. Crossings between two nodes are found by a bracketing secant method (Illinois) on equilibria
solved in between, for all columns at once. Source: hand-mechanics reference 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.grasp.equilibrium import Flags, GraspSystem
from calibration.grasp.path_grid_events import ROUNDING, Watch, known
from calibration.grasp.path_grid_march import Indices, inside
from calibration.grasp.path_grid_solutions import Solutions, in_column
from calibration.hand.finger import Reals

NO_SOLUTION = "no stable equilibrium"
ITERATIONS = 12
CLOSE = 1e-9
"""Share of the way between two nodes by which the secant method may still move: 0.2 pm."""


@dataclass(frozen=True)
class Domain:
    """Per column: mean excursion at the beginning and the end (equal without a domain), state and event at the end."""

    start_m: Reals
    end_m: Reals
    end_w: Reals
    end_event: tuple[str, ...]


def domain(system: GraspSystem, watch: Watch, solutions: Solutions, within: float = CLOSE) -> Domain:
    """Domain of every column, its ends found to `within` of the distance between two nodes."""
    mean_m = solutions.axes.mean_m
    fine = inside(solutions.margins)
    rows, columns = fine.shape
    some, first = np.asarray(fine.any(0)), np.asarray(fine.argmax(0))
    outside: Flags = ~fine & (np.arange(rows)[:, None] > first)
    last = np.asarray(np.where(outside.any(0), outside.argmax(0) - 1, rows - 1), int)
    start_m, end_m = np.where(some, mean_m[first], 0.0), np.where(some, mean_m[last], 0.0)
    end_w, names = solutions.w[last, np.arange(columns)], [NO_SOLUTION] * columns
    solved = known(solutions.margins)
    lowest = np.asarray(solved.argmax(0))
    for column in np.flatnonzero(~some & np.asarray(solved.any(0))):
        margins = solutions.margins[lowest[column], column]
        margins = np.where(
            np.append(watch.later, False) & (margins[:-1][~watch.later] < -ROUNDING).any(), np.inf, margins
        )
        names[column] = (*watch.names, NO_SOLUTION)[int(np.argmin(margins))]
    begun = np.flatnonzero(some & (first > 0))
    begins = _crossings(system, watch, solutions, begun, first[begun], first[begun] - 1, within)
    start_m[begins.column] = 0.0
    np.maximum.at(start_m, begins.column, begins.mean_m)
    ended = np.flatnonzero(some & (last < rows - 1))
    ends = _crossings(system, watch, solutions, ended, last[ended], last[ended] + 1, within)
    for index in np.argsort(-ends.mean_m, kind="stable"):  # the earliest of a column comes last
        column = ends.column[index]
        end_m[column], end_w[column] = ends.mean_m[index], ends.w[index]
        names[column] = (*watch.names, NO_SOLUTION)[ends.event[index]]
    return Domain(start_m, end_m, end_w, tuple(names))


def readable(solved: Flags, axis: Reals, start: Reals, end: Reals) -> tuple[Reals, Reals]:
    """The domain of both ends of every cell column drawn in to where its cells have their four corners; start and end
    (columns,) on `axis`."""
    step = axis[1] - axis[0]
    cells = solved[:-1, :-1] & solved[1:, :-1] & solved[:-1, 1:] & solved[1:, 1:]
    low, high = np.maximum(start[:-1], start[1:]), np.maximum(end[:-1], end[1:])
    middle = np.clip((0.5 * (low + np.maximum(low, high)) - axis[0]) / step, 0, axis.size - 2).astype(int)
    bottom, top = np.full(low.size, -np.inf), np.full(low.size, np.inf)
    for column, (complete, row) in enumerate(zip(cells.T, middle, strict=True)):
        holes = np.flatnonzero(~complete)
        below, above = holes[holes <= row], holes[holes >= row]
        if below.size:
            bottom[column] = axis[below[-1] + 1]
        if above.size:
            top[column] = axis[above[0]] - 1e-9 * step  # the edge belongs to the cell below it
    start = np.maximum(start, np.maximum([*bottom, -np.inf], [-np.inf, *bottom]))
    end = np.minimum(end, np.minimum([*top, np.inf], [np.inf, *top]))
    return start, np.maximum(start, end)


@dataclass(frozen=True)
class _Crossings:
    """P crossings: column, event, mean (m) and state there."""

    column: Indices
    event: Indices
    mean_m: Reals
    w: Reals


def _crossings(
    system: GraspSystem,
    watch: Watch,
    solutions: Solutions,
    columns: Indices,
    inner: Indices,
    outer: Indices,
    within: float,
) -> _Crossings:
    """All margins that change sign in `columns` between the rows `inner` (≥ 0) and `outer`. Where no equilibrium can be
    solved in between, the inner node stands for the crossing."""
    axes, step_m = solutions.axes, solutions.axes.steps_m[0]
    margins_in, margins_out = solutions.margins[inner, columns], solutions.margins[outer, columns]
    with np.errstate(invalid="ignore"):
        which, event = np.nonzero((margins_in >= -ROUNDING) & (margins_out < -ROUNDING))
    column, row_in, row_out = columns[which], inner[which], outer[which]
    near, far = np.zeros(which.size), np.ones(which.size)
    f_near, f_far = np.maximum(margins_in[which, event], 0.0), margins_out[which, event]
    best, w, last_side = near.copy(), solutions.w[row_in, column], np.zeros(which.size, int)
    previous = near
    for _ in range(ITERATIONS if which.size else 0):
        share = near + (far - near) * f_near / (f_near - f_far)
        place = np.asarray(row_in + share * (row_out - row_in), np.float64)
        guess = in_column(solutions.w, solutions.nodes.along_0, step_m, place, column)
        target = axes.origin + np.column_stack([axes.mean_m[0] + step_m * place, axes.difference_m[column]])
        wrench = None
        if solutions.wrench is not None:
            wrench = in_column(solutions.wrench.value, solutions.wrench.along_0, step_m, place, column)
        states = system.solve(guess, axes.drive, target, wrench=wrench)
        found = watch.each_margin(states.w, event)
        usable = states.converged & np.isfinite(found)
        best, w = np.where(usable, share, best), np.where(usable[:, None], states.w, w)
        side = np.where(usable, np.where(found >= 0, 1, -1), 0)
        if (np.abs(share - previous) < within).all():
            break
        previous = share
        f_far = np.where((side == 1) & (last_side == 1), 0.5 * f_far, f_far)  # an end that stays twice counts half
        f_near = np.where((side == -1) & (last_side == -1), 0.5 * f_near, f_near)
        near, f_near = np.where(side == 1, share, near), np.where(side == 1, found, f_near)
        far, f_far = np.where(side == -1, share, far), np.where(side == -1, found, f_far)
        last_side = side
    return _Crossings(column, event, axes.mean_m[0] + step_m * (row_in + best * (row_out - row_in)), w)
