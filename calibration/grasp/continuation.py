"""Following equilibria while the drive moves: tangent prediction, Newton correction, and smaller steps where it is
curved.

Continuation is what picks the physical branch: a step that moves any scaled unknown too far is halved, so a solution
never jumps to a mirrored one. Works on many states at once. Source: hand-mechanics reference 11 and 14.
"""

from __future__ import annotations

import numpy as np

from calibration.grasp.equilibrium import Drive, GraspSystem
from calibration.hand.finger import Reals

LONGEST_STEP = 0.3
"""Largest change of a joint (rad) that one step may bring."""
CORRECTION = 0.1
"""Largest scaled difference between prediction and solution. Past a configuration where contacts and tendons lock,
forces come back with the other sign: such a jump is far from every prediction, however small the step."""
HALVINGS = 5


def advance(
    system: GraspSystem,
    w: Reals,
    drive: Drive,
    start: Reals,
    end: Reals,
    *,
    stops: bool = False,
    halvings: int = HALVINGS,
) -> Reals:
    """Move solutions `w` (B, size) of drive targets `start` (B, 2) to `end` (B, 2); a state that cannot follow
    becomes NaN."""
    result = np.full_like(w, np.nan)
    alive = np.flatnonzero(np.isfinite(w).all(1))
    if alive.size == 0:
        return result
    before, change = w[alive], (end - start)[alive]
    if stops:
        guess = before
    else:
        guess = before + np.einsum("bij,bj->bi", system.tangent(before, drive), change)
        guess = np.where(np.isfinite(guess).all(1)[:, None], guess, before)
    states = system.solve(guess, drive, end[alive], stops=stops)
    joints = slice(0, system.joints)
    small = np.abs(states.w[:, joints] - before[:, joints]).max(1) < LONGEST_STEP
    near = stops | (np.abs((states.w - guess) / system.column_scale[: system.size]).max(1) < CORRECTION)
    good = states.converged & small & near
    result[alive[good]] = states.w[good]
    if halvings > 0 and not good.all():
        again = alive[~good]
        middle = 0.5 * (start[again] + end[again])
        half = advance(system, w[again], drive, start[again], middle, stops=stops, halvings=halvings - 1)
        result[again] = advance(system, half, drive, middle, end[again], stops=stops, halvings=halvings - 1)
    return result
