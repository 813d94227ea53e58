"""Equilibria of a grasp on a grid, and the curves on which its domain begins and ends.

Grid axes: mean tendon excursion since first contact, and its difference, right − left (finger-side, m). Nodes are
solutions of the smooth equations, in which joints pass their stops; so cells that the domain's end crosses can be
interpolated right up to it. The domain of a column of equal difference begins where the fingers press (N ≥ 0) and
ends at the first event: a joint at a stop, a tendon at its load cap or slack, contact lost, or no stable equilibrium.
Source: hand-mechanics reference 6 and 11.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import Drive, Flags, GraspSystem, excursion_drive, load_drive
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

TRACE_STEP_M = 1e-4
LONGEST_PATH_M = 0.06
NO_SOLUTION = "no stable equilibrium"
ROUNDING_N = 1e-9

__all__ = ["Event", "PathGrid", "events", "excursion_drive", "known", "load_drive", "solve_path_grid"]

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Event:
    """A linear function of w, `row` @ w, that stays on the inner side of `limit`: `sign` · (row @ w − limit) ≥ 0."""

    name: str
    row: Reals
    limit: float
    sign: float
    stop: bool = False

    def inside(self, w: Reals) -> Reals:
        """How far inside, positive inside; (…, ) for `w` (…, size)."""
        distance: Reals = self.sign * (w @ self.row - self.limit)
        return distance


@dataclass(frozen=True)
class PathGrid:
    """Solutions on mean × difference; `w` (rows, columns, size), NaN where there is none."""

    mean_m: Reals
    difference_m: Reals
    w: Reals
    start_m: Reals
    """(columns,) mean excursion where the fingers begin to press"""
    end_m: Reals
    """(columns,) mean excursion of the first event; equal to the start where the column has no domain"""
    end_w: Reals
    """(columns, size) state at the end"""
    end_event: tuple[str, ...]
    """name of the event per column"""

    @property
    def solved(self) -> Flags:
        """(rows, columns) where there is a solution."""
        return known(self.w)


def events(system: GraspSystem) -> list[Event]:
    """All that can end a path, stops first."""
    names = [f"{side} {joint}" for side in ("right", "left") for joint in ("proximal", "distal")]
    loads, contacts = system.load_rows(), system.contact_rows()
    found = []
    for name, index in zip(names, system.joint_columns, strict=True):
        row = system.joint_row(index)
        found.append(Event(f"{name} stop", row, float(system.upper_rad[index]), -1.0, stop=True))
        found.append(Event(f"{name} lower stop", row, float(system.lower_rad[index]), 1.0, stop=True))
    for index, side in enumerate(("right", "left")):
        found.append(Event(f"{side} load cap", loads[index], system.load_cap_N, -1.0))
        found.append(Event(f"{side} tendon slack", loads[index], 0.0, 1.0))
        found.append(Event(f"{side} contact lost", contacts[2 * index], 0.0, 1.0))
    return found


def solve_path_grid(
    system: GraspSystem, *, nodes: int, columns: int, difference_range_m: float, progress: Progress = lambda _: None
) -> PathGrid:
    """Solve the grid: `columns` differences over ±`difference_range_m`, about `nodes` means up to the longest
    column's end.

    Errors: MechanicsError when there is no path from first contact with equal excursions.
    """
    drive = excursion_drive(system)
    origin = drive.rows @ system.first_state()
    difference = np.linspace(-difference_range_m, difference_range_m, columns)
    step = _middle_end(system, drive, origin) / (nodes - 3)
    row = _first_row(system, drive, origin, difference)
    watched = events(system)
    rows, means = [row], [0.0]
    ended = ~known(row)
    pressed = _pressed(system, row, 0.0)
    while not _with_neighbours(ended).all() and means[-1] < LONGEST_PATH_M:
        alive = ~_with_neighbours(ended)
        target = origin + np.column_stack([np.full(columns, means[-1]), difference])
        row = advance(system, np.where(alive[:, None], row, np.nan), drive, target, target + np.array([step, 0.0]))
        rows.append(row)
        means.append(means[-1] + step)
        outside = np.array([event.inside(row) < 0 for event in watched if "contact" not in event.name]).any(0)
        lost = pressed & (row @ system.contact_rows()[[0, 2]].T < 0).any(1)
        pressed |= _pressed(system, row, 0.0)
        ended |= outside | lost | ~known(row)
        progress(min(1.0, len(rows) / (nodes + 4)))
    grid = PathGrid(
        np.array(means), difference, np.array(rows), np.zeros(columns), np.zeros(columns), np.empty((0, 0)), ()
    )
    return _with_ends(system, drive, origin, grid)


def known(values: Reals) -> Flags:
    """Where the last axis is finite throughout."""
    return np.asarray(np.isfinite(values).all(-1), np.bool_)


def _middle_end(system: GraspSystem, drive: Drive, origin: Reals) -> float:
    """Mean excursion at which the path of equal excursions ends, from a fine trace, m."""
    w, mean = system.first_state()[None], 0.0
    watched = [event for event in events(system) if "contact" not in event.name]
    while mean < LONGEST_PATH_M:
        target = origin + np.array([[mean, 0.0]])
        step = np.array([[TRACE_STEP_M, 0.0]])
        moved = advance(system, w, drive, target, target + step)
        if not np.isfinite(moved).all() or min(float(event.inside(moved)[0]) for event in watched) < 0:
            break
        if not _pressed(system, moved, 0.0)[0]:
            break
        w, mean = moved, mean + TRACE_STEP_M
    if mean < 10 * TRACE_STEP_M:
        raise MechanicsError(
            "grasp",
            f"the path from first contact ends after {mean * 1e3:.1f} mm of winding.",
            help="Take another object, or a smaller onset split, or a higher load cap.",
        )
    return mean


def _first_row(system: GraspSystem, drive: Drive, origin: Reals, difference: Reals) -> Reals:
    """Solutions at mean 0 for all differences, followed outwards from first contact."""
    middle = difference.size // 2
    row = np.full((difference.size, system.size), np.nan)
    row[middle] = system.first_state()
    for k in range(1, middle + 1):
        to, back = np.array([middle + k, middle - k]), np.array([middle + k - 1, middle - k + 1])
        start, end = (origin + np.column_stack([[0.0, 0.0], difference[columns]]) for columns in (back, to))
        row[to] = advance(system, row[back], drive, start, end)
    return row


def _pressed(system: GraspSystem, w: Reals, least_N: float) -> Flags:
    return np.asarray((w @ system.contact_rows()[[0, 2]].T > least_N).all(1), np.bool_)


def _with_neighbours(ended: Flags) -> Flags:
    """Columns that have ended and whose neighbours have: nobody interpolates beyond them."""
    padded = np.concatenate([[True], ended, [True]])
    done: Flags = padded[:-2] & padded[1:-1] & padded[2:]
    return done


def _with_ends(system: GraspSystem, drive: Drive, origin: Reals, grid: PathGrid) -> PathGrid:
    """The grid with its domain; a column that has none keeps no nodes, so that nobody interpolates towards it."""
    columns = grid.difference_m.size
    w, start, end = grid.w.copy(), np.zeros(columns), np.zeros(columns)
    end_w, names = np.full((columns, system.size), np.nan), []
    stable = np.zeros(grid.solved.shape, bool)
    stable[grid.solved] = system.stability(grid.w[grid.solved]) > 0
    for column in range(columns):
        path, steady = w[:, column], stable[:, column]
        difference = float(grid.difference_m[column] + origin[1])
        first = _column_start(system, drive, origin, path, difference, grid.mean_m)
        mean, state, name = 0.0, path[0], NO_SOLUTION
        if first is not None:
            mean, state, name = _column_end(system, drive, origin, path, steady, difference, first, grid.mean_m)
        names.append(name)
        if first is None or mean <= first:
            w[:, column] = np.nan
        else:
            start[column], end[column], end_w[column] = first, mean, state
    return PathGrid(grid.mean_m, grid.difference_m, w, start, end, end_w, tuple(names))


def _column_start(
    system: GraspSystem, drive: Drive, origin: Reals, path: Reals, difference: float, mean_m: Reals
) -> float | None:
    """Mean excursion, not below 0, from which both fingers press; None if they never do."""
    contacts = system.contact_rows()[[0, 2]]
    pressing = np.flatnonzero((path @ contacts.T >= -ROUNDING_N).all(1))
    if pressing.size == 0:
        return None
    first = int(pressing[0])
    if first == 0:
        return 0.0
    start = 0.0
    for row in contacts:
        if row @ path[first - 1] < 0:
            event = Event("", row, 0.0, 1.0)
            found = _crossing(system, drive, event, path[first - 1], path[first], difference)
            start = max(start, float(drive.rows[0] @ found - origin[0]) if found is not None else float(mean_m[first]))
    return start


def _crossing(
    system: GraspSystem, drive: Drive, event: Event, before: Reals, after: Reals, difference: float
) -> Reals | None:
    """State between two nodes of a column at which the event happens; None if it cannot be found there."""
    inside, outside = float(event.inside(before)), float(event.inside(after))
    guess = before + inside / (inside - outside) * (after - before)
    states = system.solve(
        guess[None], Drive(np.array([event.row, drive.rows[1]])), np.array([[event.limit, difference]])
    )
    first, mean, last = (float(drive.rows[0] @ w) for w in (before, states.w[0], after))
    return states.w[0] if states.converged[0] and first - 1e-9 <= mean <= last + 1e-9 else None


def _column_end(
    system: GraspSystem,
    drive: Drive,
    origin: Reals,
    path: Reals,
    stable: Flags,
    difference: float,
    start_m: float,
    mean_m: Reals,
) -> tuple[float, Reals, str]:
    """First event of a column: mean excursion, state, name."""
    watched = events(system)
    inner = mean_m >= start_m
    for event in watched:
        if "contact" not in event.name and not event.inside(path[0]) >= 0:
            return 0.0, path[0], event.name
    for index in range(1, mean_m.size):
        if not stable[index - 1 : index + 1].all():
            return float(mean_m[index - 1]), path[index - 1], NO_SOLUTION
        before, after = path[index - 1], path[index]
        crossed = [
            event
            for event in watched
            if event.inside(after) < -ROUNDING_N <= event.inside(before)
            and (inner[index - 1] or "contact" not in event.name)
        ]
        found = []
        for event in crossed:
            state = _crossing(system, drive, event, before, after, difference)
            if state is not None:
                found.append((float(drive.rows[0] @ state - origin[0]), state, event.name))
        if found:
            return min(found, key=lambda item: item[0])
        if crossed:
            return float(mean_m[index - 1]), before, crossed[0].name
    return float(mean_m[-1]), path[-1], NO_SOLUTION
