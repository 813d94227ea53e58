"""Fingertips that slip on the object where rolling would need more friction than there is.

A contact either rolls, g_t as it was in the state before, or slides at the edge of its friction cone, f_t = ±μ N with
g_t free, and friction takes energy out: f_t · Δg_t ≤ 0. Which of the two, for each contact, is what a step looks for;
the place from which a contact rolls is in the state itself, g_t(z), so nothing else need be remembered. Where no
combination fits, the grasp has no quasi-static continuation: the object is ejected, and the path ends. Source:
hand-mechanics reference 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from calibration.grasp.equilibrium import Drive, GraspSystem, States
from calibration.grasp.equilibrium_equations import LENGTH_M
from calibration.grasp.friction import OnTable, Sliding, incremental
from calibration.grasp.path import Path
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

ROLLS = 0.0
LIFTED = Sliding(0.0, 0.0)
ROUNDING = 1e-9
"""Share of the force scale, and of 30 mm, by which a cone or a slip may be wrong."""


@dataclass(frozen=True)
class SlippingTips:
    """The rule of a path (`path.Rule`) whose contacts slip beyond friction `contact_friction`; `limits` of the table,
    `LIFTED` where there is none."""

    system: GraspSystem
    contact_friction: float
    limits: Sliding = LIFTED
    without_solution: str = "the fingertips slip off: no quasi-static continuation"

    def __post_init__(self) -> None:
        if not 0 < self.contact_friction <= 5:
            raise MechanicsError("contact_friction", f"{self.contact_friction!r} is not > 0 and ≤ 5.")

    def slope(self, before: Reals, last: Reals | None, drive: Drive, held: Reals) -> Reals:
        """As on a table: from the last two states."""
        return OnTable(self.system, self.limits).slope(before, last, drive, held)

    def solve(self, before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """State in which each contact rolls within its cone or slides against friction; it does not converge where
        there is none."""
        found: States | None = None
        sides: tuple[float, float] = (ROLLS, ROLLS)
        tried = set()
        while sides not in tried:
            tried.add(sides)
            found = self._with(sides, before, guess, drive, target)
            if not found.converged[0]:
                break
            wanted = self._corrected(sides, before, found.w[0])
            if wanted == sides:
                return found
            sides = wanted
        for right, left in product((ROLLS, 1.0, -1.0), repeat=2):
            sides = (right, left)
            if sides not in tried:
                found = self._with(sides, before, guess, drive, target)
                if found.converged[0] and self._corrected(sides, before, found.w[0]) == sides:
                    return found
        assert found is not None
        return States(found.w, found.stop_torque_Nm, found.at_stop, np.array([False]), found.residual)

    def slip_m(self, w: Reals) -> Reals:
        """How far the right and the left contact have slid since first contact, at states (B, size); (B, 2) m."""
        terms = self.system.terms(w)
        return np.stack([contact.value[:, 1] for contact in terms.contacts], axis=1)

    def _with(self, sides: tuple[float, float], before: Reals, guess: Reals, drive: Drive, target: Reals) -> States:
        """The step with given contact states: 0 rolls, ±1 slides at f_t = ±μ N."""
        system = self.system
        n, force_N = system.unknowns, float(system.column_scale[system.unknowns])
        earlier = self.slip_m(before[None])[0]

        def law(w: Reals, F: Reals, K: Reals) -> None:
            for index, side in enumerate(sides):
                row = n + 2 * index + 1
                if side == ROLLS:
                    F[0, row] -= earlier[index] * system.row_scale[row]
                    continue
                pressing, along = w[0, row - 1], w[0, row]
                F[0, row] = (along - side * self.contact_friction * pressing) / force_N
                K[0, row] = 0.0
                K[0, row, row] = system.column_scale[row] / force_N
                K[0, row, row - 1] = -side * self.contact_friction * system.column_scale[row - 1] / force_N

        return incremental(system, before, guess, drive, target, self.limits, law)

    def _corrected(self, sides: tuple[float, float], before: Reals, after: Reals) -> tuple[float, float]:
        """Contact states that a solution asks for: beyond the cone a contact slides, pushed by friction it rolls."""
        forces = self.system.contact_rows() @ after
        moved = (self.slip_m(after[None]) - self.slip_m(before[None]))[0]
        force_N = float(self.system.column_scale[self.system.unknowns])
        wanted = []
        for index, side in enumerate(sides):
            normal, along = float(forces[2 * index]), float(forces[2 * index + 1])
            if side == ROLLS:
                beyond = abs(along) > self.contact_friction * normal + ROUNDING * force_N
                wanted.append(float(np.sign(along)) if beyond else ROLLS)
            else:
                wanted.append(ROLLS if along * moved[index] > ROUNDING * force_N * LENGTH_M else side)
        return wanted[0], wanted[1]


def slip_m(path: Path) -> Reals:
    """How far each contact has slid along a path that was followed with `SlippingTips`; (K, 2) m."""
    if not isinstance(path.rule, SlippingTips):
        raise MechanicsError("rule", "the path was followed without slip.", help="Trace it with SlippingTips.")
    return path.rule.slip_m(path.w)
