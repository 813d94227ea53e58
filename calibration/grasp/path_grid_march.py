"""Following equilibria over a grid of mean and difference of the tendon excursions.

From solved nodes outwards, many at a time, every step a continuation (`continuation.advance`), so that no node belongs
to another branch. Solutions are those of the smooth equations, in which joints pass their stops. A column is followed
until something ends it, and as far as its neighbours are, so that cells which the domain's end crosses have all their
corners. Source: hand-mechanics reference 11 and 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import Drive, Flags, GraspSystem
from calibration.grasp.path_grid_events import ROUNDING, Watch, known
from calibration.hand.finger import Reals

CLOSE_M = 2e-3
"""Clearances that coarser nodes show to be at least this are not computed again at finer ones: between two coarse
nodes they depart from a straight line by less than 0.1 mm."""

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Axes:
    """Nodes of a grid: means and differences since first contact (m), and the drive's target there."""

    drive: Drive
    origin: Reals
    mean_m: Reals
    difference_m: Reals

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.mean_m.size, self.difference_m.size

    @property
    def steps_m(self) -> tuple[float, float]:
        """Distance of nodes along the mean and along the difference, m."""
        return float(self.mean_m[1] - self.mean_m[0]), float(self.difference_m[1] - self.difference_m[0])

    def targets(self, rows: Indices, columns: Indices) -> Reals:
        """(P, 2) targets of the nodes at `rows`, `columns` (P,)."""
        targets: Reals = self.origin + np.column_stack([self.mean_m[rows], self.difference_m[columns]])
        return targets


@dataclass
class Followed:
    """What is known so far; arrays over (rows, columns) that following fills in."""

    w: Reals
    """(rows, columns, size), NaN where there is no solution"""
    margins: Reals
    """(rows, columns, events), NaN likewise"""
    wrench: Reals | None
    """(rows, columns, 3) external wrench on the object; None is none"""
    tried: Flags
    """(ways, rows, columns) from which neighbours a node could not be reached"""

    @classmethod
    def nothing(cls, axes: Axes, system: GraspSystem, watch: Watch) -> Followed:
        """An empty grid."""
        rows, columns = axes.shape
        return cls(
            np.full((rows, columns, system.size), np.nan),
            np.full((rows, columns, len(watch.names)), np.nan),
            None,
            np.zeros((4, rows, columns), bool),
        )


def follow(system: GraspSystem, watch: Watch, axes: Axes, found: Followed, expected: Reals | None = None) -> None:
    """Fill in all wanted nodes that can be reached from those already in `found`.

    `expected` (rows, columns, not linear events): margins as coarser nodes show them; NaN where they do not.
    """
    while True:
        fresh = known(found.w) & ~known(found.margins)
        if fresh.any():
            hint = np.full((int(fresh.sum()), len(watch.names) - watch.linear), np.nan)
            hint = hint if expected is None else expected[fresh]
            found.margins[fresh] = watch.close_margins(found.w[fresh], hint, CLOSE_M)
        missing = wanted(watch, found.margins) & ~known(found.w)
        if not _reach(system, axes, found, missing):
            return


def inside(margins: Reals) -> Flags:
    """(rows, columns) where no margin (…, events) is negative."""
    with np.errstate(invalid="ignore"):
        return np.asarray((margins >= -ROUNDING).all(-1), np.bool_)


def wanted(watch: Watch, margins: Reals) -> Flags:
    """(rows, columns) nodes up to the first beyond each column's end, and as far in its neighbours."""
    rows = margins.shape[0]
    been_inside = np.maximum.accumulate(inside(margins), axis=0)
    with np.errstate(invalid="ignore"):
        negative = margins < -ROUNDING
    ended = negative[:, :, ~watch.later].any(2) | (negative[:, :, watch.later].any(2) & been_inside)
    ended = np.maximum.accumulate(ended, axis=0)
    up_to = np.where(ended.any(0), ended.argmax(0), rows - 1)
    begun = np.isfinite(margins).all(2).any(0)
    padded = np.concatenate([[-1], np.where(begun, up_to, -1), [-1]])
    reach = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    return np.asarray(np.arange(rows)[:, None] <= reach, np.bool_)


def _reach(system: GraspSystem, axes: Axes, found: Followed, missing: Flags) -> bool:
    """One round: every missing node from one solved neighbour; False when there was nothing left to try."""
    rows, columns = np.nonzero(missing)
    if rows.size == 0:
        return False
    inwards = np.sign(axes.shape[1] // 2 - columns)
    solved = np.pad(known(found.w), 1)
    source = np.zeros((rows.size, 2), int)
    way_of = np.full(rows.size, -1)
    ways = ((-1, 0 * inwards), (0, inwards), (0, -inwards), (1, 0 * inwards))
    for way, (up, aside) in enumerate(ways):
        usable = solved[rows + 1 + up, columns + 1 + aside] & ~found.tried[way, rows, columns] & (way_of < 0)
        usable &= (up != 0) | (aside != 0)
        way_of[usable] = way
        source[usable] = np.column_stack([rows + up, columns + aside])[usable]
    chosen = way_of >= 0
    if not chosen.any():
        return False
    rows, columns, source, way_of = rows[chosen], columns[chosen], source[chosen], way_of[chosen]
    there = (source[:, 0], source[:, 1])
    wrench = None if found.wrench is None else (found.wrench[there], found.wrench[there])
    moved = advance(
        system, found.w[there], axes.drive, axes.targets(*there), axes.targets(rows, columns), wrench=wrench
    )
    found.w[rows, columns] = moved
    if found.wrench is not None and wrench is not None:
        found.wrench[rows, columns] = wrench[1]
    failed = ~known(moved)
    found.tried[way_of[failed], rows[failed], columns[failed]] = True
    return True
