"""Letting out again with friction in the tendon routing: the other half of the hysteresis loop.

The tendon rubs where it passes the proximal joint. While it runs one way its tension at the distal joint is T e^(−c)
winding, T e^(+c) unwinding; between the two it does not run: the length over the distal joint stays as it was, and the
tension there is whatever balances. So when winding turns into unwinding, the hand holds its shape while the load falls
through the band, and only then follows the unwinding branch. Which of the three a finger is in is what a step looks
for; the length at which it stuck is in the state itself. Tendons at a constant distance from the distal joint.
Source: hand-mechanics reference 4; textbook capstan.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from calibration.grasp.equilibrium import Drive, GraspSystem, States
from calibration.grasp.friction import OnTable, incremental
from calibration.grasp.path import NO_EQUILIBRIUM, STEP_M, Path, trace_back
from calibration.grasp.slip import LIFTED
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

STUCK, UNWINDING, WINDING = 0, -1, 1
ROUNDING = 1e-9


@dataclass(frozen=True)
class RubbingTendons:
    """The rule of a path (`path.Rule`) whose tendons rub at the proximal joint; `system` on its winding branch."""

    system: GraspSystem
    without_solution: str = NO_EQUILIBRIUM

    def __post_init__(self) -> None:
        for side, finger in zip(("right", "left"), self.system.fingers, strict=True):
            if not finger.tendon.laws[1].linear:
                raise MechanicsError(
                    f"finger.{side}.distal_joint.tendon",
                    "a straight tendon at the distal joint cannot be followed through the reversal of its friction.",
                    help="Take a tendon at a constant distance from the distal joint.",
                )

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """From the last two states."""
        return OnTable(self.system, LIFTED).slope(before, last, drive, held)

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """State in which each tendon sticks within its band or runs against friction; it does not converge where there
        is none."""
        found: States | None = None
        for right, left in product((STUCK, UNWINDING, WINDING), repeat=2):
            found = self._with((right, left), before, guess, drive, target)
            if found.converged[0] and self._fits((right, left), before, found):
                return found
        assert found is not None
        return States(found.w, found.stop_torque_Nm, found.at_stop, np.array([False]), found.residual)

    def distal_share(self, w: Reals) -> Reals:
        """Tension at the distal joints over tendon load, right and left, that balances a state (size,): (2,)."""
        system = self.system
        terms = system.terms(w[None])
        shares = np.zeros(2)
        for side, (contact, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, system.parts, strict=True)):
            column = system.fingers[side].joint_index[1]
            multipliers = w[system.unknowns + 2 * side : system.unknowns + 2 * side + 2]
            torque = (system.stiffness[part] * w[part])[column] + multipliers @ contact.gradient[0, :, column]
            shares[side] = torque / (tendon.gradient[0, 1, column] * w[system.size - 2 + side])
        return shares

    def _with(self, runs: tuple[int, int], before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """The step with given tendon states."""
        system = self.system
        held_columns = [system.joint_columns[2 * side + 1] for side in (0, 1) if runs[side] == STUCK]

        def law(w: Reals, F: Reals, K: Reals) -> None:
            terms = system.terms(w)
            for side, (run, tendon, part) in enumerate(zip(runs, terms.tendons, system.parts, strict=True)):
                loss = system.fingers[side].routing_loss
                more = np.exp(-run * loss) - system.tendon_shares[side, 1] if run != STUCK else 0.0
                load = system.size - 2 + side
                torque = more * tendon.gradient[0, 1] * system.row_scale[part]
                F[0, part] -= w[0, load] * torque
                K[0, part, load] -= torque * system.column_scale[load]
            for column in held_columns:
                F[0, column] = w[0, column] - before[column]
                K[0, column] = 0.0
                K[0, column, column] = 1.0

        return incremental(system, before, guess, drive, target, LIFTED, law)

    def _fits(self, runs: tuple[int, int], before: Reals, found: States) -> bool:
        """Whether sticking tendons are within their bands and running ones run against friction."""
        after = found.w[0]
        shares = self.distal_share(after)
        for side, run in enumerate(runs):
            column = self.system.joint_columns[2 * side + 1]
            moved = float(after[column] - before[column])
            band = self.system.fingers[side].routing_loss
            stopped = found.at_stop[0, column] != 0
            if run == STUCK and not (stopped or abs(np.log(max(shares[side], 1e-300))) <= band + ROUNDING):
                return False
            if run != STUCK and run * moved < -ROUNDING:
                return False
        return True


def unwind(path: Path, *, step_m: float = STEP_M) -> Path:
    """Let out again from the end of `path`: first the load falls while the hand holds its shape, then it opens.

    The result starts where `path` ends; its winding and motion count from there. Errors: MechanicsError for tendons
    that are not at a constant distance from the distal joint.
    """
    return trace_back(path, RubbingTendons(path.system), step_m=step_m)
