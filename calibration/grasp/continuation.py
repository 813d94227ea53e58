"""Following equilibria while the drive moves: tangent prediction, Newton correction, and smaller steps where it is
curved.

Continuation is what picks the physical branch: a step that moves any scaled unknown too far is halved, so a solution
never jumps to a mirrored one. Works on many states at once. Source: hand-mechanics reference 11 and 14.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from calibration.grasp.equilibrium import Drive, Flags, GraspSystem, States
from calibration.hand.finger import Reals

LONGEST_STEP = 0.3
"""Largest change of a joint (rad) that one step may bring."""
CORRECTION = 0.1
"""Largest scaled difference between prediction and solution. Past a configuration where contacts and tendons lock,
forces come back with the other sign: such a jump is far from every prediction, however small the step."""
HALVINGS = 5
FRICTION_STEP = 0.1
"""Largest change of a routing friction's exponent in one step from one branch to the other."""


def advance(
    system: GraspSystem,
    w: Reals,
    drive: Drive,
    start: Reals,
    end: Reals,
    *,
    stops: bool = False,
    wrench: tuple[Reals, Reals] | None = None,
    halvings: int = HALVINGS,
) -> Reals:
    """Move solutions `w` (B, size) of drive targets `start` (B, 2) to `end` (B, 2); a state that cannot follow
    becomes NaN. `wrench`: external wrench on the object (B, 3) at the start and at the end; None is none."""
    result = np.full_like(w, np.nan)
    alive = np.flatnonzero(np.isfinite(w).all(1))
    if alive.size == 0:
        return result
    before = w[alive]
    pulls = None if wrench is None else (wrench[0][alive], wrench[1][alive])
    guess = before
    if not stops:
        pull = None if pulls is None else pulls[1] - pulls[0]
        guess = before + system.change(before, drive, (end - start)[alive], pull)
        guess = np.where(np.isfinite(guess).all(1, keepdims=True), guess, before)
    states = system.solve(guess, drive, end[alive], stops=stops, wrench=None if pulls is None else pulls[1])
    joints = slice(0, system.joints)
    good: Flags = states.converged & (np.abs((states.w - before)[:, joints]).max(1) < LONGEST_STEP)
    if not stops:
        good &= as_predicted(system, states.w, guess)
    result[alive[good]] = states.w[good]
    missed: Flags = ~good
    if halvings > 0 and missed.any():
        again = alive[missed]
        middle = 0.5 * (start[again] + end[again])
        first, second = None, None
        if pulls is not None:
            middle_pull = 0.5 * (pulls[0][missed] + pulls[1][missed])
            first, second = (pulls[0][missed], middle_pull), (middle_pull, pulls[1][missed])
        left = halvings - 1
        half = advance(system, w[again], drive, start[again], middle, stops=stops, wrench=first, halvings=left)
        result[again] = advance(system, half, drive, middle, end[again], stops=stops, wrench=second, halvings=left)
    return result


def as_predicted(system: GraspSystem, w: Reals, guess: Reals, within: float = CORRECTION) -> Flags:
    """Whether solutions `w` (B, size) are no further from their prediction than `within` of each unknown's scale."""
    near: Flags = np.abs((w - guess) / system.column_scale).max(1) < within
    return near


def unwound(system: GraspSystem, w: Reals, drive: Drive, target: Reals) -> Reals:
    """Solutions `w` (B, size) of the winding branch, carried over to the branch of `system` at the same targets while
    the routing friction changes its direction; NaN where that cannot be followed."""
    loss = max(finger.routing_loss for finger in system.fingers)
    way = 1.0 - system.friction_direction
    result = np.array(w)
    if loss * way == 0:
        return result
    for direction in np.linspace(1.0, system.friction_direction, math.ceil(way * loss / FRICTION_STEP) + 1)[1:]:
        states: States = replace(system, friction_direction=float(direction)).solve(result, drive, target)
        good = states.converged & as_predicted(system, states.w, result, 10 * CORRECTION)
        result = np.where(good[:, None], states.w, np.nan)
    return result
