"""The equations of one grasp: what a state holds, and its balance with exact derivatives, for many states at once.

A state is w = [z, λ, e, T]: z = right and left joint coordinates (rad), object x, y (m), θ (rad) in the hand frame; λ
= contact multipliers (right n, t, left n, t; force on the object = −λ, N); e = finger-side tendon excursions since
rest (right, left; m); T = tendon loads (right, left; N). The equations are

    ∇V(z) + ∇gᵀλ − Σ_f T_f (∇l_f,proximal + s_f ∇l_f,distal) − wrench = 0      balance, one row for each of z
    g(z) = 0                                                                      contacts: gap and rolling
    l_f(z) − e_f = 0                                                              tendons

and two linear conditions A w = target, the drive. s_f = exp(∓c) is what routing friction leaves of the load behind
the proximal joint, less while winding and more while unwinding; so the balance is symmetric only without it. Unknowns
and rows are scaled (lengths by 30 mm, torques by the joints' stiffness). Source: hand-mechanics reference 4, 6 and 14.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.contact import ConstraintJet, RollingContact
from calibration.grasp.preposition import FirstContact
from calibration.hand.finger import FingerModel, Reals
from calibration.hand.tendon import TendonJet
from calibration.objects import GraspObject

LENGTH_M = 0.030

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Drive:
    """Two linear conditions `rows` @ w = target; `rows` (2, size of w)."""

    rows: Reals


@dataclass(frozen=True)
class Terms:
    """What the equations are made of at B states: contacts and tendons, right and left."""

    contacts: tuple[ConstraintJet, ConstraintJet]
    tendons: tuple[TendonJet, TendonJet]


@dataclass(frozen=True)
class GraspEquations:
    """Unknowns, scales and equations of one grasp from its first contact on."""

    fingers: tuple[FingerModel, FingerModel]
    contacts: tuple[RollingContact, RollingContact]
    start: FirstContact
    object: GraspObject
    load_cap_N: float
    friction_direction: float = 1.0
    """1 while the tendons wind in, −1 while they are let out; between them the routing friction fades"""

    # -- what is in a state ------------------------------------------------------------------------------------------

    @cached_property
    def joints(self) -> int:
        """Number of joint coordinates."""
        return sum(finger.stiffness_Nm_per_rad.size for finger in self.fingers)

    @cached_property
    def unknowns(self) -> int:
        """Size of z."""
        return self.joints + 3

    @cached_property
    def size(self) -> int:
        """Size of w: z, four contact multipliers, two excursions, two loads."""
        return self.unknowns + 8

    @cached_property
    def parts(self) -> tuple[slice, slice]:
        """Where the right and the left finger's coordinates are in w."""
        right = self.fingers[0].stiffness_Nm_per_rad.size
        return slice(0, right), slice(right, self.joints)

    @cached_property
    def joint_columns(self) -> tuple[int, int, int, int]:
        """Coordinates that are joint angles: right proximal, right distal, left proximal, left distal."""
        (a, b), (c, d) = (finger.joint_index for finger in self.fingers)
        left = self.parts[1].start
        return a, b, left + c, left + d

    @cached_property
    def stiffness(self) -> Reals:
        """(size of z,) joint stiffness, N m/rad; 0 for the object."""
        return np.concatenate([*(finger.stiffness_Nm_per_rad for finger in self.fingers), np.zeros(3)])

    @cached_property
    def tendon_shares(self) -> Reals:
        """(2 fingers, 2 joints): share of the tendon load that acts at the proximal and at the distal joint."""
        loss = np.array([finger.routing_loss for finger in self.fingers])
        return np.stack([np.ones(2), np.exp(-self.friction_direction * loss)], axis=1)

    @cached_property
    def lower_rad(self) -> Reals:
        """(joints,) lower stops; −inf where there is none."""
        return np.concatenate([finger.lower_rad for finger in self.fingers])

    @cached_property
    def upper_rad(self) -> Reals:
        """(joints,) upper stops; inf where there is none."""
        return np.concatenate([finger.upper_rad for finger in self.fingers])

    def first_state(self) -> Reals:
        """w at first contact: no contact force, tendon loads of free closing; (size,)."""
        q = np.concatenate(self.start.finger_joint_rad)
        excursion, load = self.start.tendon_excursion_m, self.start.tendon_load_N
        return np.concatenate([q, self.start.object_pose, np.zeros(4), excursion, load])

    def excursion_rows(self) -> Reals:
        """Rows (2, size) giving right and left finger-side excursion since rest, m, when applied to w."""
        return np.eye(self.size)[self.unknowns + 4 : self.unknowns + 6]

    def load_rows(self) -> Reals:
        """Rows (2, size) giving right and left tendon load, N."""
        return np.eye(self.size)[self.unknowns + 6 :]

    def spool_rows(self) -> Reals:
        """Rows (2, size) giving right and left excursion at the spool since rest, m: that of the finger and the
        tendon's stretch."""
        stretch = np.array([1.0 / finger.tendon_stiffness_N_per_m for finger in self.fingers])
        rows: Reals = self.excursion_rows() + stretch[:, None] * self.load_rows()
        return rows

    def contact_rows(self) -> Reals:
        """Rows (4, size) giving right N, f_t and left N, f_t, N."""
        return -np.eye(self.size)[self.unknowns : self.unknowns + 4]

    def joint_angle_rows(self) -> Reals:
        """Rows (4, size) giving right proximal, right distal, left proximal and left distal joint angle, rad."""
        return np.eye(self.size)[list(self.joint_columns)]

    def joint_row(self, joint: int) -> Reals:
        """Row (size,) giving one joint coordinate, rad."""
        row: Reals = np.eye(self.size)[joint]
        return row

    def energy_J(self, w: Reals) -> Reals:
        """Elastic energy of the joints, J; (B,)."""
        z = w[:, : self.unknowns]
        energy: Reals = 0.5 * (z * z) @ self.stiffness
        return energy

    # -- scales ------------------------------------------------------------------------------------------------------

    @cached_property
    def torque_Nm(self) -> float:
        """Torque that everything is measured by: that of the stiffest joint at 1 rad."""
        return float(self.stiffness.max())

    @cached_property
    def arm_m(self) -> float:
        """Largest tendon arm at first contact, m."""
        arms = [f.tendon.at(q[None]).gradient for f, q in zip(self.fingers, self.start.finger_joint_rad, strict=True)]
        return max(float(np.abs(arm).max()) for arm in arms)

    @cached_property
    def column_scale(self) -> Reals:
        """(size,) typical size of each unknown."""
        lengths = [1.0] * self.joints + [LENGTH_M, LENGTH_M, 1.0]
        loads = [self.torque_Nm / LENGTH_M] * 4 + [self.arm_m] * 2 + [self.torque_Nm / self.arm_m] * 2
        return np.array(lengths + loads)

    @cached_property
    def row_scale(self) -> Reals:
        """(size,) reciprocal of the typical size of each equation."""
        balance = self.column_scale[: self.unknowns] / self.torque_Nm
        return np.concatenate([balance, [1 / LENGTH_M] * 4, [1 / self.arm_m] * 2, [1.0] * 2])

    def drive_scale(self, drive: Drive) -> Reals:
        """(2,) typical size of what the drive prescribes."""
        scale: Reals = np.abs(drive.rows * self.column_scale).max(1)
        return scale

    # -- equations ---------------------------------------------------------------------------------------------------

    def terms(self, w: Reals) -> Terms:
        """Contacts and tendons at `w` (B, size)."""
        pose = w[:, self.joints : self.unknowns]
        right, left = self.parts
        return Terms(
            (self.contacts[0].at(w[:, right], pose), self.contacts[1].at(w[:, left], pose)),
            (self.fingers[0].tendon.at(w[:, right]), self.fingers[1].tendon.at(w[:, left])),
        )

    def residual_vector(self, w: Reals, terms: Terms, drive: Drive, target: Reals, wrench: Reals | None) -> Reals:
        """Scaled residual of all equations; (B, size)."""
        n, joints = self.unknowns, self.joints
        F = np.empty_like(w)
        F[:, :n] = w[:, :n] * self.stiffness
        if wrench is not None:
            F[:, joints:n] -= wrench
        for index, (contact, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, self.parts, strict=True)):
            own = part.stop - part.start
            rows = slice(n + 2 * index, n + 2 * index + 2)
            force = (w[:, rows, None] * contact.gradient).sum(1)
            torque = w[:, n + 6 + index, None] * (self.tendon_shares[index, :, None] * tendon.gradient).sum(1)
            F[:, part] += force[:, :own] - torque
            F[:, joints:n] += force[:, own:]
            F[:, rows] = contact.value
            F[:, n + 4 + index] = tendon.value.sum(1) - w[:, n + 4 + index]
        F[:, n + 6 :] = (w @ drive.rows.T - target) / self.drive_scale(drive)
        F *= self.row_scale
        return F

    def curvature(self, w: Reals, terms: Terms) -> Reals:
        """Second derivative of energy, contacts and tendons, weighed by their forces: ∂balance/∂z; (B, n, n)."""
        n, joints = self.unknowns, self.joints
        result = np.zeros((w.shape[0], n, n))
        result[:] = np.diag(self.stiffness)
        pose = slice(joints, n)
        for index, (contact, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, self.parts, strict=True)):
            own = part.stop - part.start
            at = n + 2 * index
            bent = w[:, at, None, None] * contact.hessian[:, 0] + w[:, at + 1, None, None] * contact.hessian[:, 1]
            result[:, part, part] += bent[:, :own, :own]
            result[:, part, pose] = bent[:, :own, own:]
            result[:, pose, part] = bent[:, own:, :own]
            result[:, pose, pose] += bent[:, own:, own:]
            if not self.fingers[index].tendon.linear:
                shares = self.tendon_shares[index]
                turning = shares[0] * tendon.hessian[:, 0] + shares[1] * tendon.hessian[:, 1]
                result[:, part, part] -= w[:, n + 6 + index, None, None] * turning
        return result

    def matrix(self, w: Reals, terms: Terms, drive: Drive) -> Reals:
        """Scaled derivative of all equations in w; (B, size, size)."""
        n, joints = self.unknowns, self.joints
        K = np.zeros((w.shape[0], self.size, self.size))
        K[:, :n, :n] = self.curvature(w, terms)
        pose = slice(joints, n)
        for index, (contact, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, self.parts, strict=True)):
            own = part.stop - part.start
            rows = slice(n + 2 * index, n + 2 * index + 2)
            K[:, rows, part], K[:, rows, pose] = contact.gradient[:, :, :own], contact.gradient[:, :, own:]
            K[:, :n, rows] = K[:, rows, :n].transpose(0, 2, 1)
            K[:, n + 4 + index, part] = tendon.gradient.sum(1)
            K[:, n + 4 + index, n + 4 + index] = -1.0
            K[:, part, n + 6 + index] = -(self.tendon_shares[index, :, None] * tendon.gradient).sum(1)
        K[:, n + 6 :] = drive.rows / self.drive_scale(drive)[:, None]
        K *= self.row_scale[:, None] * self.column_scale
        return K

    def second(self, w: Reals, terms: Terms, u: Reals, v: Reals) -> Reals:
        """Scaled second derivative of all equations along `u` and `v` (B, size); (B, size)."""
        n, joints = self.unknowns, self.joints
        result = np.zeros_like(w)
        pose = w[:, joints:n]
        for index, (contact, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, self.parts, strict=True)):
            finger = self.fingers[index]
            local = [*range(part.start, part.stop), *range(joints, n)]
            rows = slice(n + 2 * index, n + 2 * index + 2)
            u_local, v_local = u[:, local], v[:, local]
            bent_u = (contact.hessian * u_local[:, None, None, :]).sum(3)  # (B, 2, own + 3): ∇²g u
            bent_v = (contact.hessian * v_local[:, None, None, :]).sum(3)
            third = self.contacts[index].third(w[:, part], pose, u_local, v_local)
            force = w[:, rows, None] * third + v[:, rows, None] * bent_u + u[:, rows, None] * bent_v
            result[:, local] += force.sum(1)
            result[:, rows] = (bent_u * v_local[:, None, :]).sum(2)
            if not finger.tendon.linear:
                load = slice(n + 6 + index, n + 7 + index)
                curled_u = (tendon.hessian * u[:, None, None, part]).sum(3)
                curled_v = (tendon.hessian * v[:, None, None, part]).sum(3)
                third = finger.tendon.third(w[:, part], u[:, part], v[:, part])
                torque = w[:, load, None] * third + v[:, load, None] * curled_u + u[:, load, None] * curled_v
                result[:, part] -= (self.tendon_shares[index, :, None] * torque).sum(1)
                result[:, n + 4 + index] = (curled_u * v[:, None, part]).sum((1, 2))
        result *= self.row_scale
        return result
