"""Static equilibrium of hand and object: one grasp's equations with their solutions, slopes and stability.

States are those of `equilibrium_equations`; all functions take many at once. The drive says what is prescribed: two
excursions, mean load and excursion difference, or an event such as 'this joint meets its stop'. An external wrench on
the object (f_x, f_y N, τ N m about its reference point, hand frame) may be given per state. Source: hand-mechanics
reference 6, 11 and 14.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from calibration.grasp import equilibrium_newton as newton
from calibration.grasp.contact import rolling_contact
from calibration.grasp.equilibrium_equations import Drive, Flags, GraspEquations, Terms
from calibration.grasp.equilibrium_newton import TOLERANCE, Reaction, States
from calibration.grasp.equilibrium_stability import stability
from calibration.grasp.preposition import first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals, finger_models
from calibration.hand.parameters import Hand
from calibration.objects import GraspObject

__all__ = [
    "TOLERANCE",
    "Drive",
    "Flags",
    "GraspSystem",
    "Reaction",
    "Slopes",
    "States",
    "WrenchSlopes",
    "excursion_drive",
    "grasp_system",
    "load_drive",
    "spool_drive",
]


class WrenchSlopes(NamedTuple):
    """External wrench at B states (B, 3), its slopes along both targets (B, 3, 2), their mixed derivative (B, 3)."""

    value: Reals
    along: Reals
    mixed: Reals


@dataclass(frozen=True)
class Slopes:
    """At B solutions: dw/dtarget `tangent` (B, size, 2), ∂²w/∂target_0 ∂target_1 `mixed` (B, size), and the largest
    scaled `residual` (B,) of balance, contacts and tendons."""

    tangent: Reals
    mixed: Reals
    residual: Reals


class GraspSystem(GraspEquations):
    """One grasp, to be solved. Build it with `grasp_system`."""

    def solve(
        self, guess: Reals, drive: Drive, target: Reals, *, stops: bool = False, wrench: Reals | Reaction | None = None
    ) -> States:
        """Newton from `guess` (B, size) to the drive's `target` (B, 2). Without `stops` the joints move beyond them.

        `wrench`: external wrench on the object, (B, 3) or a function of its pose; None is none. A state that does not
        converge says so; nothing is raised. With all of an excursion drive's freedom taken by stops the equations
        contradict each other: such a state does not converge either; drive by load there.
        """
        return newton.solve(self, guess, drive, target, stops=stops, wrench=wrench)

    def tangent(
        self, w: Reals, drive: Drive, at_stop: Reals | None = None, *, wrench_slope: Reals | None = None
    ) -> Reals:
        """dw/dtarget at solutions `w` (B, size), by the implicit function theorem: (B, size, 2).

        `wrench_slope` (B, 3, 2): how the external wrench changes with the targets.
        """
        result = np.empty((*w.shape, 2))
        for part in newton.parts(w.shape[0]):
            K = self.matrix(w[part], self.terms(w[part]), drive)
            if at_stop is not None:
                newton.hold(K, at_stop[part])
            result[part] = self._tangent(K, drive, None if wrench_slope is None else wrench_slope[part])
        return result

    def mixed_derivative(self, w: Reals, drive: Drive, tangent: Reals) -> Reals:
        """∂²w/∂target_0 ∂target_1 at solutions with no joint at a stop and no external wrench: (B, size)."""
        terms = self.terms(w)
        return self._second(w, terms, self.matrix(w, terms, drive), tangent, None)

    def slopes(self, w: Reals, drive: Drive, wrench: WrenchSlopes | None = None) -> Slopes:
        """Slopes at solutions `w` (B, size) with no joint at a stop, and how well they are solved."""
        tangent, mixed, residual = np.empty((*w.shape, 2)), np.empty_like(w), np.empty(w.shape[0])
        for part in newton.parts(w.shape[0]):
            here = w[part]
            terms = self.terms(here)
            K = self.matrix(here, terms, drive)
            value, along, turning = (None,) * 3 if wrench is None else (array[part] for array in wrench)
            tangent[part] = self._tangent(K, drive, along)
            mixed[part] = self._second(here, terms, K, tangent[part], turning)
            residual[part] = np.abs(self.residual_vector(here, terms, drive, here @ drive.rows.T, value)).max(1)
        return Slopes(tangent, mixed, residual)

    def _tangent(self, K: Reals, drive: Drive, wrench_slope: Reals | None) -> Reals:
        right = np.zeros((*K.shape[:2], 2))
        right[:, -2:] = np.diag(1 / self.drive_scale(drive))
        if wrench_slope is not None:
            right[:, self.joints : self.unknowns] = wrench_slope * self.row_scale[self.joints : self.unknowns, None]
        return newton.solved(K, right) * self.column_scale[:, None]

    def _second(self, w: Reals, terms: Terms, K: Reals, tangent: Reals, wrench_mixed: Reals | None) -> Reals:
        right = -self.second(w, terms, tangent[:, :, 0], tangent[:, :, 1])
        if wrench_mixed is not None:
            right[:, self.joints : self.unknowns] += wrench_mixed * self.row_scale[self.joints : self.unknowns]
        return newton.solved(K, right[:, :, None])[:, :, 0] * self.column_scale

    def change(self, w: Reals, drive: Drive, target_change: Reals, wrench_change: Reals | None = None) -> Reals:
        """First-order change of solutions `w` (B, size) with changes of target (B, 2) and external wrench (B, 3);
        (B, size)."""
        right = np.zeros((w.shape[0], self.size, 1))
        right[:, -2:, 0] = target_change / self.drive_scale(drive)
        if wrench_change is not None:
            right[:, self.joints : self.unknowns, 0] = wrench_change * self.row_scale[self.joints : self.unknowns]
        return newton.solved(self.matrix(w, self.terms(w), drive), right)[:, :, 0] * self.column_scale

    def stability(self, w: Reals, at_stop: Reals | None = None) -> Reals:
        """Smallest eigenvalue of the energy's Hessian on the motions that contacts, excursions and stops leave, per
        stiffest joint (dimensionless, lengths / 30 mm); > 0 is stable, inf when nothing is left to move; (B,)."""
        result = np.empty(w.shape[0])
        for part in newton.parts(w.shape[0]):
            result[part] = stability(self, w[part], None if at_stop is None else at_stop[part])
        return result


def grasp_system(
    hand: Hand, grasped: GraspObject, grasp: GraspSpec, *, branch: Literal["winding", "unwinding"] | None = None
) -> GraspSystem:
    """Equations of a grasp from its first contact on, on the grasp's branch unless another is given.

    Errors: MechanicsError when there is no first contact.
    """
    start = first_contact(hand, grasped, grasp)
    fingers = finger_models(hand)
    right, left = (
        rolling_contact(finger, grasped.shape, q, start.object_pose, start.outline_angle_rad)
        for finger, q in zip(fingers, start.finger_joint_rad, strict=True)
    )
    cap_N = hand.load_cap_N if grasp.load_cap_N is None else min(hand.load_cap_N, grasp.load_cap_N)
    winding = (grasp.branch if branch is None else branch) == "winding"
    return GraspSystem(fingers, (right, left), start, grasped, cap_N, math.copysign(1.0, winding - 0.5))


def excursion_drive(system: GraspEquations) -> Drive:
    """Prescribes mean excursion and difference right − left, m, since rest."""
    right, left = system.excursion_rows()
    return Drive(np.array([0.5 * (right + left), right - left]))


def load_drive(system: GraspEquations) -> Drive:
    """Prescribes mean tendon load, N, and excursion difference, m, since rest."""
    return Drive(np.array([0.5 * system.load_rows().sum(0), excursion_drive(system).rows[1]]))


def spool_drive(system: GraspEquations) -> Drive:
    """Prescribes mean and difference of the spools' excursions, m, since rest."""
    right, left = system.spool_rows()
    return Drive(np.array([0.5 * (right + left), right - left]))
