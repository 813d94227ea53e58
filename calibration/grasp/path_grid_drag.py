"""Friction of the support on which the object stands, along columns of equal excursion difference.

While the object slides, its support pulls on it with the wrench −∂D/∂v, D(v) = sqrt(F² |v_xy|² + M² ω²): the
ellipsoidal limit surface. F = μ m g, M = F times the mean distance of the pressed patch from its centroid; v is the
object's motion per winding, whose size does not matter. At first contact the object stands where it is without
friction; from there on it moves only against friction, so its way depends on what has been before. Motion per winding
is taken from the last nodes by backward differences of second order (BDF2), implicit in the new one, because the hand's
soft motions settle within tenths of a millimetre of winding. Hand frame, N, N m, m. Source: hand-mechanics reference 8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.continuation import LONGEST_STEP
from calibration.grasp.equilibrium import Flags, GraspSystem
from calibration.grasp.path_grid_march import Axes, Indices
from calibration.hand.finger import Reals

SMOOTHING = 1e-3
"""Motion per winding (m/m) below which friction fades."""
FIRST_SHARES = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
"""Where the first stretch between two nodes is divided: motion begins abruptly."""

SLIDING_SHARE = 0.95
"""Of the largest friction: an object that is pulled at by less sticks."""

Guess = Callable[[Reals, Indices], Reals]
"""States (P, size) without drag, near enough to start from, at means (P,) counted in rows and columns (P,)."""


@dataclass(frozen=True)
class SupportDrag:
    """Largest friction of the support: `force_N` F against sliding, `moment_Nm` M against turning."""

    force_N: float
    moment_Nm: float

    @property
    def limits(self) -> Reals:
        """(F, F, M)."""
        return np.array([self.force_N, self.force_N, self.moment_Nm])

    def wrench(self, motion: Reals) -> Reals:
        """f_x, f_y N, τ N m (B, 3) on the object that moves by `motion` (B, 3): x, y m/m and θ rad/m of winding."""
        wrench: Reals = -self.limits * self.share(motion)[0]
        return wrench

    def share(self, motion: Reals) -> tuple[Reals, Reals]:
        """Opposed wrench over its limits (B, 3), at most 1 in size; and D (B,), W per m of winding."""
        pressed = self.limits * motion
        power = np.sqrt((pressed * pressed).sum(1) + (self.force_N * SMOOTHING) ** 2)
        return pressed / power[:, None], power


class Sliding:
    """Drag of B states whose motion per winding is `rate` (B,) · (pose − `last`) + `drift`; `last`, `drift` (B, 3).

    Newton's method reckons with the wrench as an unknown of its own, which keeps it from overshooting between sticking
    and sliding (`equilibrium_newton.Reaction`); it begins with `wrench` (B, 3).
    """

    def __init__(self, drag: SupportDrag, rate: Reals, last: Reals, drift: Reals, wrench: Reals) -> None:
        self._drag, self._rate, self._last, self._drift = drag, rate, last, drift
        self._share = -wrench / np.maximum(drag.limits, 1e-300)
        self._now, self._growth = np.zeros((rate.size, 3)), np.zeros((rate.size, 3, 3))

    def wrench(self, pose: Reals) -> Reals:
        """(B, 3) at `pose` (B, 3)."""
        return self._drag.wrench(self._rate[:, None] * (pose - self._last) + self._drift)

    def at(self, pose: Reals, states: NDArray[np.intp]) -> tuple[Reals, Reals]:
        rate, limits = self._rate[states], self._drag.limits
        now, power = self._drag.share(rate[:, None] * (pose - self._last[states]) + self._drift[states])
        growth = (np.eye(3) - self._share[states][:, :, None] * now[:, None, :]) * limits
        growth *= (rate / power)[:, None, None]
        self._now[states], self._growth[states] = now, growth
        return -limits * now, -limits[:, None] * growth

    def moved(self, pose_change: Reals, states: NDArray[np.intp]) -> None:
        share = self._now[states] + (self._growth[states] @ pose_change[:, :, None])[:, :, 0]
        self._share[states] = share / np.maximum(1.0, np.linalg.norm(share, axis=1))[:, None]


def slide(system: GraspSystem, drag: SupportDrag, axes: Axes, present: Flags, guess: Guess) -> tuple[Reals, Reals]:
    """Equilibria (rows, columns, size) and wrenches (rows, columns, 3) at the nodes `present` (rows, columns), from
    where each column begins in the direction in which the tendons move; NaN from where one cannot be followed."""
    rows, columns = axes.shape
    w, wrench = np.full((rows, columns, system.size), np.nan), np.full((rows, columns, 3), np.nan)
    ahead = 1 if system.friction_direction > 0 else -1
    track = _Track(system, drag, axes, guess, ahead)
    begun, lost = np.zeros(columns, bool), np.zeros(columns, bool)
    fresh = np.zeros(columns, bool)
    for row in range(rows)[::ahead]:
        going, beginning = present[row] & begun & ~lost, present[row] & ~begun
        lost |= begun & ~present[row]
        for chosen, shares in ((np.flatnonzero(going & fresh), FIRST_SHARES), (np.flatnonzero(going & ~fresh), (1.0,))):
            for share in shares if chosen.size else ():
                track.step(chosen, row - ahead + ahead * share)
        chosen = np.flatnonzero(beginning)
        if chosen.size:
            track.begin(chosen, row)
        w[row], wrench[row] = track.w, track.wrench
        w[row, ~(going | beginning)] = wrench[row, ~(going | beginning)] = np.nan
        lost |= (going | beginning) & ~np.isfinite(w[row]).all(1)
        begun |= beginning
        fresh = beginning
    rows_, columns_ = np.nonzero(np.isfinite(w).all(2))
    exact = system.solve(w[rows_, columns_], axes.drive, axes.targets(rows_, columns_), wrench=wrench[rows_, columns_])
    w[rows_, columns_] = np.where(exact.converged[:, None], exact.w, np.nan)
    return w, wrench


class _Track:
    """Where every column is now, and whence it came."""

    def __init__(self, system: GraspSystem, drag: SupportDrag, axes: Axes, guess: Guess, ahead: int) -> None:
        self._system, self._drag, self._axes, self._guess, self._ahead = system, drag, axes, guess, ahead
        columns = axes.shape[1]
        self._place = np.zeros(columns)
        self._poses = np.zeros((2, columns, 3))
        self._step_m = np.full(columns, np.nan)
        self._away = np.zeros((2, columns, system.size))
        self.w, self.wrench = np.full((columns, system.size), np.nan), np.full((columns, 3), np.nan)

    def begin(self, columns: Indices, row: int) -> None:
        """Winding: stand at a row without drag, and find the wrench with which motion begins. Unwinding: slide already,
        as free motion would go."""
        place = np.full(columns.size, float(row))
        drive, target = self._axes.drive, self._targets(place, columns)
        near = self._guess(place, columns)
        free = self._system.solve(near, drive, target)
        if self._ahead < 0:
            pose = slice(self._system.joints, self._system.unknowns)
            wrench = self._drag.wrench(-self._system.tangent(free.w, drive)[:, pose, 0])
            pulled = self._system.solve(free.w, drive, target, wrench=wrench)
            self._take(columns, place, pulled.w, pulled.converged, wrench)
            self._step_m[columns], self._away[:, columns] = np.nan, pulled.w - near
            return
        self._take(columns, place, free.w, free.converged, np.full((columns.size, 3), np.nan))
        self._step_m[columns], self._away[:, columns] = np.nan, free.w - near
        here, poses = self.w[columns], self._poses[:, columns]
        wrench = self._first_wrench(columns, row)
        self._place[columns] = place
        held = self._system.solve(here, drive, target, wrench=wrench)
        self._take(columns, place, held.w, held.converged, wrench)
        self._poses[:, columns] = poses
        self._step_m[columns], self._away[:, columns] = np.nan, held.w - near

    def _first_wrench(self, columns: Indices, row: int) -> Reals:
        """Wrench (P, 3) with which the object begins to slide. Where it sticks for less than a quarter of the way to
        the next row (soft shapes of flexures take up the winding), it is taken as sliding at once: no grid shows more.
        """
        first: Reals | None = None
        for share in FIRST_SHARES[:-2]:
            self.step(columns, row + self._ahead * share)
            now = self.wrench[columns]
            slides = np.linalg.norm(now / np.maximum(self._drag.limits, 1e-300), axis=1) > SLIDING_SHARE
            if first is None:
                first, settled = now, slides
            first = np.where((slides & ~settled)[:, None], now, first)
            settled |= slides | ~np.isfinite(now).all(1)
            if settled.all():
                break
        assert first is not None
        return first

    def step(self, columns: Indices, place: float) -> None:
        """Move on to a mean counted in rows."""
        before, now = self._place[columns], np.full(columns.size, place)
        step_m = np.abs(now - before) * self._axes.steps_m[0]
        ratio = np.nan_to_num(step_m / self._step_m[columns])  # 0 for a first step: backward Euler
        newest, older = self._poses[:, columns]
        drift = -(ratio**2 / (1 + ratio) / step_m)[:, None] * (newest - older)
        wrench = np.nan_to_num(self.wrench[columns])
        sliding = Sliding(self._drag, (1 + 2 * ratio) / (1 + ratio) / step_m, newest, drift, wrench)
        free = self._guess(now, columns)
        guess = free + self._away[0, columns] + ratio[:, None] * (self._away[0, columns] - self._away[1, columns])
        states = self._system.solve(guess, self._axes.drive, self._targets(now, columns), wrench=sliding)
        joints = slice(0, self._system.joints)
        good = states.converged & (np.abs(states.w - self.w[columns])[:, joints].max(1) < LONGEST_STEP)
        pose = states.w[:, self._system.joints : self._system.unknowns]
        self._take(columns, now, states.w, good, sliding.wrench(pose))
        self._step_m[columns] = step_m
        self._away[1, columns], self._away[0, columns] = self._away[0, columns], states.w - free

    def _take(self, columns: Indices, place: Reals, w: Reals, good: Flags, wrench: Reals) -> None:
        self._place[columns] = place
        self.w[columns] = np.where(good[:, None], w, np.nan)
        self.wrench[columns] = np.where(good[:, None], wrench, np.nan)
        self._poses[1, columns] = self._poses[0, columns]
        self._poses[0, columns] = self.w[columns, self._system.joints : self._system.unknowns]

    def _targets(self, place: Reals, columns: Indices) -> Reals:
        mean = self._axes.mean_m[0] + place * self._axes.steps_m[0]
        targets: Reals = self._axes.origin + np.column_stack([mean, self._axes.difference_m[columns]])
        return targets
