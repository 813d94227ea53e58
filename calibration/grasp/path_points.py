"""The points of a path of equilibria: what they hold, how one follows from another, and what lies between two of them.

Hand frame, SI, finger order right, left. How paths are followed is `path.py`. Source: hand-mechanics reference 6, 11.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from scipy.optimize import brentq

from calibration.grasp.equilibrium import Drive, Flags, GraspSystem, States
from calibration.hand.finger import Reals

PathDrive = Literal["excursion", "load", "spool"]

NO_EQUILIBRIUM = "no equilibrium beyond it"
BEYOND_STOP_RAD = 1e-6
LEAST_SHARE = 0.01


class Rule(Protocol):
    """How the next state of a path follows from the last one. Without friction it needs the drive alone."""

    @property
    def without_solution(self) -> str:
        """What to call the end of a path beyond which there is no next state."""
        ...

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """States (one) at the drive's `target` (2,), near `guess` (size,), coming from `before` (size,)."""
        ...

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """Expected change (size,) of the state per change of the drive's first target; `last` is the state ahead of
        `before`, `held` (joints,) what is at a stop."""
        ...


@dataclass(frozen=True)
class Equilibria:
    """Nothing resists but springs: states depend on the drive's targets, not on how they were reached."""

    system: GraspSystem
    without_solution: str = NO_EQUILIBRIUM

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """An equilibrium, joints at their stops."""
        return self.system.solve(guess[None], drive, target[None], stops=True)

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """The tangent of the equilibria."""
        tangent: Reals = self.system.tangent(before[None], drive, held[None])[0, :, 0]
        return tangent


@dataclass(frozen=True)
class Path:
    """K equilibria in order of winding."""

    system: GraspSystem
    drive: PathDrive
    w: Reals
    """(K, size) states"""
    at_stop: Reals
    """(K, joints) 1 at the upper, −1 at the lower stop, else 0; on the side that follows the point"""
    stability: Reals
    """(K,) smallest eigenvalue under this drive, dimensionless; > 0 is stable, inf when nothing is left to move"""
    segments: tuple[Drive, ...]
    """K − 1 drives; the target of each rises linearly from one point to the next"""
    rule: Rule
    """how a state follows from the one before"""
    end: str
    """what ends the path: the name of a stop, a load cap, a collision, …"""

    @property
    def excursion_m(self) -> Reals:
        """(K, 2) finger-side excursion since first contact, m."""
        wound: Reals = self.w @ self.system.excursion_rows().T
        wound -= wound[0].copy()
        return wound

    @property
    def load_N(self) -> Reals:
        """(K, 2) tendon loads, N."""
        loads: Reals = self.w @ self.system.load_rows().T
        return loads

    @property
    def pose(self) -> Reals:
        """(K, 3) object x m, y m, θ rad in the hand frame."""
        pose: Reals = self.w[:, self.system.joints : self.system.unknowns]
        return pose

    @property
    def motion(self) -> Reals:
        """(K, 3) object motion since first contact, m, m, rad; negative y is towards the palm."""
        pose = self.pose
        motion: Reals = pose - pose[0]
        return motion

    @property
    def contact_force_N(self) -> Reals:
        """(K, 4) force on the object: right N, f_t, left N, f_t, N."""
        forces: Reals = self.w @ self.system.contact_rows().T
        return forces

    @property
    def required_friction(self) -> Reals:
        """(K,) largest |f_t|/N of both contacts; NaN where a finger does not press, as at first contact."""
        return required_friction(self.contact_force_N)

    @property
    def stable(self) -> Flags:
        """(K,) whether the equilibrium is stable under this drive."""
        return np.asarray(self.stability > 0, np.bool_)

    @property
    def first_stop(self) -> int | None:
        """Index of the point at which the first joint meets a stop; None if none does."""
        held = np.flatnonzero((self.at_stop != 0).any(1))
        return int(held[0]) if held.size else None


def required_friction(contact_force_N: Reals) -> Reals:
    """Largest |f_t|/N of contact forces (B, 4); NaN where a finger does not press."""
    normal, along = contact_force_N[:, ::2], np.abs(contact_force_N[:, 1::2])
    ratio = np.divide(along, normal, out=np.full_like(along, np.nan), where=normal > 1e-9)
    largest: Reals = ratio.max(1)
    return largest


def state_between(path: Path, index: int, fraction: float) -> Reals:
    """State (size,) that share of the way from point `index` to the next, solved anew; NaN if it cannot be."""
    before, after = path.w[index], path.w[index + 1]
    found = between(path.rule, path.segments[index], before, after, fraction, path.at_stop[index])
    state: Reals = found.w[0] if found.converged[0] else np.full(before.size, np.nan)
    return state


def first_crossing(path: Path, margin: Callable[[Reals], Reals], start: int = 0) -> tuple[int, Reals] | None:
    """First place at or after point `start` where `margin` (B, size) → (B,) is ≥ 0.

    The index of the point before it and the state (size,), found to rounding; None if there is none. A margin that
    is NaN counts as negative.
    """
    values = np.nan_to_num(margin(path.w), nan=-1.0)
    reached = np.flatnonzero(values[start:] >= 0)
    if reached.size == 0:
        return None
    first = start + int(reached[0])
    if first == start:
        return first, path.w[first]

    def at(fraction: float) -> float:
        return float(np.nan_to_num(margin(state_between(path, first - 1, fraction)[None])[0], nan=-1.0))

    least = 0.0 if at(0.0) < 0 else LEAST_SHARE  # friction does not act yet where nothing has moved
    share = least if at(least) >= 0 else float(brentq(at, least, 1.0, xtol=1e-13)) if at(1.0) >= 0 else 1.0
    return first - 1, state_between(path, first - 1, share)


def pressed(guess: Reals, held: Reals) -> Reals:
    """The guess with joints that are at a stop a little beyond it, so that the solver begins with them held."""
    pressed = guess.copy()
    pressed[: held.size] += BEYOND_STOP_RAD * held
    return pressed


def between(rule: Rule, drive: Drive, before: Reals, after: Reals, fraction: float, held: Reals) -> States:
    mixed: Reals = before + fraction * (after - before)
    return rule.solve(before, pressed(mixed, held), drive, drive.rows @ mixed)
