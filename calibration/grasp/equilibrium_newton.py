"""Newton's method on the equations of a grasp, many states at once, with joints at their stops.

A joint at a stop trades its balance for z = stop; what its balance then lacks is the stop's torque. Which joints are
at a stop is decided anew in every step from torque and overshoot together (primal–dual active set), so that symmetric
joints are taken and released together. Source: hand-mechanics reference 11 and 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.equilibrium_equations import Drive, Flags, GraspEquations
from calibration.hand.finger import Reals

STEP_LIMIT = 0.2
"""Largest change of a scaled unknown of z in one Newton step (rad, or 30 mm × that)."""
TOLERANCE = 1e-12
ITERATIONS = 30


@dataclass(frozen=True)
class States:
    """B solutions: `w` (B, size); `stop_torque_Nm` (B, joints), positive at an upper stop, 0 when free; `converged`
    (B,)."""

    w: Reals
    stop_torque_Nm: Reals
    at_stop: Reals
    """(B, joints): 1 at the upper, −1 at the lower stop, else 0"""
    converged: Flags
    residual: Reals
    """(B,) largest scaled residual"""


def solve(
    system: GraspEquations, guess: Reals, drive: Drive, target: Reals, *, stops: bool, wrench: Reals | None
) -> States:
    """Solutions near `guess` (B, size) at the drive's `target` (B, 2); see `GraspSystem.solve`."""
    w = np.array(guess, dtype=float)
    torque, active = np.zeros((2, w.shape[0], system.joints))
    residual = np.full(w.shape[0], np.inf)
    open_ = np.flatnonzero(np.isfinite(w).all(1))
    for _ in range(ITERATIONS):
        terms = system.terms(w[open_])
        F = system.residual_vector(w[open_], terms, drive, target[open_], None if wrench is None else wrench[open_])
        K = system.matrix(w[open_], terms, drive)
        if stops:
            hold_stops(system, w, torque, active, open_, F, K)
        residual[open_] = np.abs(F).max(1)
        moving = ~(residual[open_] < TOLERANCE) & np.isfinite(residual[open_])
        if stops:
            moving &= regular(system, active[open_], drive)
        if not moving.any():
            break
        open_, F, K = open_[moving], F[moving], K[moving]
        step = -solved(K, F[:, :, None])[:, :, 0]
        longest = np.abs(step[:, : system.unknowns]).max(1)
        step *= np.minimum(1.0, STEP_LIMIT / np.maximum(longest, 1e-300))[:, None] * system.column_scale
        w[open_] += step
    return States(w, torque, active, residual < TOLERANCE, residual)


def hold(K: Reals, active: Reals) -> None:
    """Replace the balance of every active joint in scaled matrices (B, size, size) by z = stop."""
    state, joint = np.nonzero(active)
    K[state, joint] = 0.0
    K[state, joint, joint] = 1.0


def regular(system: GraspEquations, active: Reals, drive: Drive) -> Flags:
    """False where contacts, stops and what the drive prescribes of the geometry are more than z has unknowns."""
    n = system.unknowns
    moved = np.abs(drive.rows[:, [*range(n), n + 4, n + 5]]).max(1) > 0
    soft = np.abs(drive.rows[:, [*range(n, n + 4), n + 6, n + 7]]).max(1) > 0
    enough: Flags = (active != 0).sum(1) + 4 + int((moved & ~soft).sum()) <= n
    return enough


def solved(K: Reals, right: Reals) -> Reals:
    """Batched solve; a singular matrix gives NaN for its own state instead of an exception for all."""
    try:
        return np.asarray(np.linalg.solve(K, right), np.float64)
    except np.linalg.LinAlgError:
        return np.stack([_solved_one(matrix, column) for matrix, column in zip(K, right, strict=True)])


def _solved_one(K: Reals, right: Reals) -> Reals:
    try:
        return np.asarray(np.linalg.solve(K, right), np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)


def hold_stops(
    system: GraspEquations, w: Reals, torque: Reals, active: Reals, open_: NDArray[np.intp], F: Reals, K: Reals
) -> None:
    """Decide what is at a stop, note its torque, and put z = stop into F and K."""
    joints = system.joints
    stiffness = system.stiffness[:joints]
    q = w[open_, :joints]
    missing = -F[:, :joints] / system.row_scale[:joints]
    held = np.where(active[open_] != 0, missing, 0.0)
    upper = held + stiffness * (q - system.upper_rad) > 1e-12 * stiffness
    lower = held + stiffness * (q - system.lower_rad) < -1e-12 * stiffness
    now = upper.astype(float) - lower.astype(float)
    active[open_] = now
    torque[open_] = np.where(now != 0, missing, 0.0)
    overshoot = np.where(upper, q - system.upper_rad, np.where(lower, q - system.lower_rad, 0.0))
    F[:, :joints] = np.where(now != 0, overshoot, F[:, :joints])
    hold(K, now)
