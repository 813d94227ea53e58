"""Static equilibrium of hand and object: one grasp's equations with their solutions, slopes and stability.

States are those of `equilibrium_equations`; all functions take many at once. The drive says what is prescribed: two
excursions, mean load and excursion difference, or an event such as 'this joint meets its stop'. An external wrench on
the object (f_x, f_y N, τ N m about its reference point, hand frame) may be given per state. Source: hand-mechanics
reference 6, 11 and 14.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from calibration.grasp import equilibrium_newton as newton
from calibration.grasp import equilibrium_stability
from calibration.grasp.contact import rolling_contact
from calibration.grasp.equilibrium_equations import Drive, Flags, GraspEquations
from calibration.grasp.equilibrium_newton import TOLERANCE, States
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
    "States",
    "excursion_drive",
    "grasp_system",
    "load_drive",
    "spool_drive",
]


class GraspSystem(GraspEquations):
    """One grasp, to be solved. Build it with `grasp_system`."""

    def solve(
        self, guess: Reals, drive: Drive, target: Reals, *, stops: bool = False, wrench: Reals | None = None
    ) -> States:
        """Newton from `guess` (B, size) to the drive's `target` (B, 2). Without `stops` the joints move beyond them.

        `wrench` (B, 3): external wrench on the object; None is none. A state that does not converge says so; nothing is
        raised. With all of an excursion drive's freedom taken by stops the equations contradict each other: such a
        state does not converge either; drive by load there.
        """
        return newton.solve(self, guess, drive, target, stops=stops, wrench=wrench)

    def tangent(
        self, w: Reals, drive: Drive, at_stop: Reals | None = None, *, wrench_slope: Reals | None = None
    ) -> Reals:
        """dw/dtarget at solutions `w` (B, size), by the implicit function theorem: (B, size, 2).

        `wrench_slope` (B, 3, 2): how the external wrench changes with the targets.
        """
        right = np.zeros((w.shape[0], self.size, 2))
        right[:, -2:] = np.diag(1 / self.drive_scale(drive))
        if wrench_slope is not None:
            right[:, self.joints : self.unknowns] = wrench_slope * self.row_scale[self.joints : self.unknowns, None]
        K = self.matrix(w, self.terms(w), drive)
        if at_stop is not None:
            newton.hold(K, at_stop)
        return newton.solved(K, right) * self.column_scale[:, None]

    def mixed_derivative(self, w: Reals, drive: Drive, tangent: Reals, *, wrench_mixed: Reals | None = None) -> Reals:
        """∂²w/∂target_0 ∂target_1 at solutions with no joint at a stop: (B, size). `wrench_mixed` (B, 3): that of the
        external wrench."""
        return self.second_derivative(w, drive, tangent[:, :, 0], tangent[:, :, 1], wrench_second=wrench_mixed)

    def second_derivative(
        self, w: Reals, drive: Drive, u: Reals, v: Reals, *, wrench_second: Reals | None = None
    ) -> Reals:
        """Second derivative of the solution along two directions of the targets, in which it changes by `u` and `v`
        (B, size): (B, size)."""
        terms = self.terms(w)
        right = -self.second(w, terms, u, v)
        if wrench_second is not None:
            right[:, self.joints : self.unknowns] += wrench_second * self.row_scale[self.joints : self.unknowns]
        return newton.solved(self.matrix(w, terms, drive), right[:, :, None])[:, :, 0] * self.column_scale

    def wrench_tangent(self, w: Reals, drive: Drive) -> Reals:
        """dw/dwrench at fixed targets: (B, size, 3)."""
        right = np.zeros((w.shape[0], self.size, 3))
        right[:, self.joints : self.unknowns] = np.diag(self.row_scale[self.joints : self.unknowns])
        return newton.solved(self.matrix(w, self.terms(w), drive), right) * self.column_scale[:, None]

    def residual(self, w: Reals, drive: Drive, wrench: Reals | None = None) -> Reals:
        """Largest scaled residual of balance, contacts and tendons at `w` (B, size) with no joint at a stop; (B,)."""
        worst: Reals = np.abs(self.residual_vector(w, self.terms(w), drive, w @ drive.rows.T, wrench)).max(1)
        return worst

    def stability(self, w: Reals, at_stop: Reals | None = None) -> Reals:
        """Smallest eigenvalue of the energy's Hessian on the motions that contacts, excursions and stops leave, per
        stiffest joint (dimensionless, lengths / 30 mm); > 0 is stable, inf when nothing is left to move; (B,)."""
        return equilibrium_stability.stability(self, w, at_stop)


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
