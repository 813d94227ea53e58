"""Newton's method on the equations of a grasp, many states at once, with joints at their stops.

A joint at a stop trades its balance for z = stop; what its balance then lacks is the stop's torque. Which joints are
at a stop is decided anew in every step from torque and overshoot together (primal–dual active set), so that symmetric
joints are taken and released together. Source: hand-mechanics reference 11 and 14.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.equilibrium_equations import Drive, Flags, GraspEquations
from calibration.hand.finger import Reals

STEP_LIMIT = 0.2
"""Largest change of a scaled unknown of z in one Newton step (rad, or 30 mm × that)."""
TOLERANCE = 1e-12
"""Largest scaled residual of a solution."""
REACTION_TOLERANCE = 1e-7
"""Likewise with a wrench that depends on the pose: rounding of the place of an object that sticks leaves some 1e-9."""
ITERATIONS = 30
TOGETHER = 256
"""States whose matrices are worked on at once."""


class Reaction(Protocol):
    """An external wrench on the object that depends on its pose."""

    def at(self, pose: Reals, states: NDArray[np.intp]) -> tuple[Reals, Reals]:
        """Wrench (b, 3), and its derivative in the pose (b, 3, 3) that Newton's method is to reckon with, at `pose`
        (b, 3) of the numbered `states` (b,)."""
        ...

    def moved(self, pose_change: Reals, states: NDArray[np.intp]) -> None:
        """Told by how much (b, 3) these poses have been moved since `at`."""
        ...


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
    system: GraspEquations, guess: Reals, drive: Drive, target: Reals, *, stops: bool, wrench: Reals | Reaction | None
) -> States:
    """Solutions near `guess` (B, size) at the drive's `target` (B, 2); see `GraspSystem.solve`."""
    count = guess.shape[0]
    torque, active = np.zeros((2, count, system.joints))
    states = States(np.array(guess, float), torque, active, np.zeros(count, bool), np.full(count, np.inf))
    for part in parts(count):
        _solve(system, states, drive, target, stops, wrench, np.arange(count)[part])
    states.converged[:] = states.residual < _tolerance(wrench)
    return states


def parts(count: int) -> list[slice]:
    """Slices over many states, each small enough to stay in the processor's cache."""
    return [slice(first, min(first + TOGETHER, count)) for first in range(0, count, TOGETHER)]


def _solve(
    system: GraspEquations,
    states: States,
    drive: Drive,
    target: Reals,
    stops: bool,
    wrench: Reals | Reaction | None,
    chosen: NDArray[np.intp],
) -> None:
    """Newton in place for the `chosen` states."""
    open_ = chosen[np.isfinite(states.w[chosen]).all(1)]
    pose = slice(system.joints, system.unknowns)
    for _ in range(ITERATIONS):
        w = states.w[open_]
        terms = system.terms(w)
        pull, stiffness = _pull(wrench, w[:, pose], open_)
        F = system.residual_vector(w, terms, drive, target[open_], pull)
        K = system.matrix(w, terms, drive)
        if stiffness is not None:
            K[:, pose, pose] -= stiffness * system.row_scale[pose, None] * system.column_scale[pose]
        if stops:
            hold_stops(system, states.w, states.stop_torque_Nm, states.at_stop, open_, F, K)
        residual = np.abs(F).max(1)
        states.residual[open_] = residual
        moving = ~(residual < _tolerance(wrench)) & np.isfinite(residual)
        if stops:
            moving &= regular(system, states.at_stop[open_], drive)
        if not moving.any():
            break
        open_, F, K = open_[moving], F[moving], K[moving]
        step = -solved(K, F[:, :, None])[:, :, 0]
        longest = np.abs(step[:, : system.unknowns]).max(1)
        step *= np.minimum(1.0, STEP_LIMIT / np.maximum(longest, 1e-300))[:, None] * system.column_scale
        states.w[open_] += step
        if stiffness is not None and not isinstance(wrench, np.ndarray) and wrench is not None:
            wrench.moved(step[:, pose], open_)


def _tolerance(wrench: Reals | Reaction | None) -> float:
    return TOLERANCE if wrench is None or isinstance(wrench, np.ndarray) else REACTION_TOLERANCE


def _pull(wrench: Reals | Reaction | None, pose: Reals, states: NDArray[np.intp]) -> tuple[Reals | None, Reals | None]:
    if wrench is None:
        return None, None
    return (wrench[states], None) if isinstance(wrench, np.ndarray) else wrench.at(pose, states)


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
    """Decide which joints of the states `open_` are at a stop, note its torque, and put z = stop into their F and K."""
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
