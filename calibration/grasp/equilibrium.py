"""Static equilibrium of hand and object: Newton's method on the KKT conditions, many states of a grasp at once.

One state is w = [z, λ, T]: z = right and left joint coordinates (rad), object x, y (m), θ (rad) in the hand frame; λ
= contact multipliers (right n, t, left n, t; force on the object = −λ, N); T = tendon loads (right, left; N). It
solves

    ∇V(z) + ∇gᵀλ − ∇lᵀT + μ = 0,   g(z) = 0 (contacts),   A w = target (the drive: two linear conditions),

and for every joint at a stop z_i = stop, with its torque μ_i (else μ_i = 0). The drive says what is prescribed: two
excursions, mean load and excursion difference, or an event such as 'this joint meets its stop'. Unknowns and rows are
scaled (lengths by 30 mm, torques by the joints' stiffness). Source: hand-mechanics reference 6, 11 and 14.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.grasp.contact import ConstraintJet, RollingContact, rolling_contact
from calibration.grasp.preposition import FirstContact, first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import FingerModel, Reals, finger_models
from calibration.hand.parameters import Hand
from calibration.objects import GraspObject

LENGTH_M = 0.030
STEP_LIMIT = 0.2
"""Largest change of a scaled unknown of z in one Newton step (rad, or 30 mm × that)."""
TOLERANCE = 1e-12
ITERATIONS = 30

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Drive:
    """Two linear conditions `rows` @ w = target; `rows` (2, size of w)."""

    rows: Reals


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


@dataclass(frozen=True)
class GraspSystem:
    """The equations of one grasp. Build it with `grasp_system`."""

    fingers: tuple[FingerModel, FingerModel]
    contacts: tuple[RollingContact, RollingContact]
    start: FirstContact
    load_cap_N: float

    @cached_property
    def joints(self) -> int:
        """Number of joint coordinates."""
        return sum(finger.tendon_arm_m.size for finger in self.fingers)

    @cached_property
    def unknowns(self) -> int:
        """Size of z."""
        return self.joints + 3

    @cached_property
    def size(self) -> int:
        """Size of w: z, four contact multipliers, two tendon loads."""
        return self.unknowns + 6

    @cached_property
    def stiffness(self) -> Reals:
        """(size of z,) joint stiffness, N m/rad; 0 for the object."""
        return np.concatenate([*(finger.stiffness_Nm_per_rad for finger in self.fingers), np.zeros(3)])

    @cached_property
    def tendon_rows(self) -> Reals:
        """(2, size of z) tendon excursion since rest per unknown, m/rad."""
        rows = np.zeros((2, self.unknowns))
        for row, part, finger in zip(rows, self._parts, self.fingers, strict=True):
            row[part] = finger.tendon_arm_m
        return rows

    @cached_property
    def lower_rad(self) -> Reals:
        """(joints,) lower stops."""
        return np.concatenate([finger.lower_rad for finger in self.fingers])

    @cached_property
    def upper_rad(self) -> Reals:
        """(joints,) upper stops."""
        return np.concatenate([finger.upper_rad for finger in self.fingers])

    @cached_property
    def column_scale(self) -> Reals:
        """Typical size of each unknown: w, then the stops' torques."""
        torque = float(self.stiffness.max())
        lengths = [1.0] * self.joints + [LENGTH_M, LENGTH_M, 1.0]
        loads = [torque / LENGTH_M] * 4 + [torque / float(self.tendon_rows.max())] * 2
        return np.array([*lengths, *loads, *[torque] * self.joints])

    @cached_property
    def row_scale(self) -> Reals:
        """Reciprocal of the typical size of each equation: balance, contacts, drive, stops."""
        torque = float(self.stiffness.max())
        balance = self.column_scale[: self.unknowns] / torque
        return np.concatenate([balance, [1 / LENGTH_M] * 4, [1.0] * 2, [1.0] * self.joints])

    # -- what is in a state ------------------------------------------------------------------------------------------

    def first_state(self) -> Reals:
        """w at first contact: no contact force, tendon loads of free closing; (size,)."""
        q = np.concatenate(self.start.finger_joint_rad)
        return np.concatenate([q, self.start.object_pose, np.zeros(4), self.start.tendon_load_N])

    def excursion_rows(self) -> Reals:
        """Rows (2, size) giving right and left finger-side excursion since rest, m, when applied to w."""
        return np.hstack([self.tendon_rows, np.zeros((2, 6))])

    def load_rows(self) -> Reals:
        """Rows (2, size) giving right and left tendon load, N."""
        return np.hstack([np.zeros((2, self.unknowns + 4)), np.eye(2)])

    def contact_rows(self) -> Reals:
        """Rows (4, size) giving right N, f_t and left N, f_t, N."""
        return np.hstack([np.zeros((4, self.unknowns)), -np.eye(4), np.zeros((4, 2))])

    def joint_row(self, joint: int) -> Reals:
        """Row (size,) giving one joint coordinate, rad."""
        row: Reals = np.eye(1, self.size, joint)[0]
        return row

    # -- equations ---------------------------------------------------------------------------------------------------

    def solve(self, guess: Reals, drive: Drive, target: Reals, *, stops: bool = False) -> States:
        """Newton from `guess` (B, size) to the drive's `target` (B, 2). Without `stops` the joints move beyond them.

        A state that does not converge says so; nothing is raised. With all of an excursion drive's freedom taken by
        stops the equations contradict each other: such a state does not converge either; drive by load there.
        """
        w = np.array(guess, dtype=float)
        batch = w.shape[0]
        mu = np.zeros((batch, self.joints))
        active = np.zeros((batch, self.joints))
        residual = np.full(batch, np.inf)
        open_ = np.arange(batch)
        for _ in range(ITERATIONS):
            if stops:
                active[open_] = self._active(w[open_], mu[open_])
            F, K = self._equations(w[open_], mu[open_], active[open_], drive, target[open_])
            residual[open_] = np.abs(F).max(1)
            moving = ~(residual[open_] < TOLERANCE)
            open_, F, K = open_[moving], F[moving], K[moving]
            regular = self._regular(active[open_], drive) & np.isfinite(K).all((1, 2))
            open_, F, K = open_[regular], F[regular], K[regular]
            if open_.size == 0:
                break
            step = -_solve(K, F[:, :, None])[:, :, 0]
            longest = np.abs(step[:, : self.unknowns]).max(1)
            step *= np.minimum(1.0, STEP_LIMIT / np.maximum(longest, 1e-300))[:, None] * self.column_scale
            w[open_] += step[:, : self.size]
            mu[open_] += step[:, self.size :]
        return States(w, mu, active, residual < TOLERANCE, residual)

    def tangent(self, w: Reals, drive: Drive, at_stop: Reals | None = None) -> Reals:
        """dw/dtarget at solutions `w` (B, size), by the implicit function theorem: (B, size, 2)."""
        K = self._matrix(w, at_stop, drive)
        right = np.zeros((w.shape[0], K.shape[1], 2))
        right[:, self.unknowns + 4 : self.unknowns + 6] = np.diag(1 / self._drive_scale(drive))
        return (_solve(K, right) * self.column_scale[:, None])[:, : self.size]

    def mixed_derivative(self, w: Reals, drive: Drive, tangent: Reals) -> Reals:
        """∂²w/∂target_0 ∂target_1 at solutions with no joint at a stop: (B, size)."""
        n = self.unknowns
        u, v = tangent[:, :, 0], tangent[:, :, 1]
        jet = self._constraints(w)
        multipliers = w[:, n : n + 4]
        right = np.zeros((w.shape[0], self.size + self.joints))
        right[:, :n] = np.einsum("bc,bcj->bj", multipliers, self._third(w, u[:, :n], v[:, :n]))
        right[:, :n] += np.einsum("bc,bcjk,bk->bj", u[:, n : n + 4], jet.hessian, v[:, :n])
        right[:, :n] += np.einsum("bc,bcjk,bk->bj", v[:, n : n + 4], jet.hessian, u[:, :n])
        right[:, n : n + 4] = np.einsum("bcjk,bj,bk->bc", jet.hessian, u[:, :n], v[:, :n])
        K = self._matrix(w, None, drive)
        return (_solve(K, -(right * self.row_scale)[:, :, None])[:, :, 0] * self.column_scale)[:, : self.size]

    def residual(self, w: Reals, drive: Drive) -> Reals:
        """Largest scaled residual of balance and contacts at `w` (B, size) with no joint at a stop; (B,)."""
        free = np.zeros((w.shape[0], self.joints))
        worst: Reals = np.abs(self._equations(w, free, free, drive, w @ drive.rows.T)[0]).max(1)
        return worst

    def stability(self, w: Reals, at_stop: Reals | None = None) -> Reals:
        """Smallest eigenvalue of the energy's Hessian on the motions that contacts, excursions and stops leave, per
        stiffest joint (dimensionless, lengths / 30 mm); > 0 is stable, inf when nothing is left to move; (B,)."""
        n = self.unknowns
        jet = self._constraints(w)
        scale = self.column_scale[:n]
        hessian = np.diag(self.stiffness) + np.einsum("bc,bcjk->bjk", w[:, n : n + 4], jet.hessian)
        hessian = hessian * scale[:, None] * scale * self.row_scale[0]
        rows = np.concatenate([jet.gradient, np.broadcast_to(self.tendon_rows, (w.shape[0], 2, n))], axis=1) * scale
        result = np.full(w.shape[0], np.inf)
        for index, (H, A) in enumerate(zip(hessian, rows, strict=True)):
            if at_stop is not None:
                A = np.vstack([A, np.eye(n)[np.flatnonzero(at_stop[index])]])
            _, singular, directions = np.linalg.svd(A / np.linalg.norm(A, axis=1, keepdims=True))
            Z = directions[int((singular > 1e-9).sum()) :]
            if Z.size:
                result[index] = np.linalg.eigvalsh(Z @ H @ Z.T)[0]
        return result

    def energy_J(self, w: Reals) -> Reals:
        """Elastic energy of the joints, J; (B,)."""
        z = w[:, : self.unknowns]
        energy: Reals = 0.5 * (z * z) @ self.stiffness
        return energy

    @cached_property
    def _parts(self) -> tuple[slice, slice]:
        right = self.fingers[0].tendon_arm_m.size
        return slice(0, right), slice(right, self.joints)

    def _local(self, part: slice) -> list[int]:
        return [*range(part.start, part.stop), *range(self.joints, self.unknowns)]

    def _constraints(self, w: Reals) -> ConstraintJet:
        """All contacts on all of z."""
        n = self.unknowns
        batch = w.shape[0]
        value, slope, curve = np.zeros((batch, 4)), np.zeros((batch, 4, n)), np.zeros((batch, 4, n, n))
        pose = w[:, self.joints : n]
        for index, (contact, part) in enumerate(zip(self.contacts, self._parts, strict=True)):
            jet, local, rows = contact.at(w[:, part], pose), self._local(part), slice(2 * index, 2 * index + 2)
            value[:, rows] = jet.value
            slope[:, rows, local] = jet.gradient
            curve[:, rows][:, :, np.array(local)[:, None], local] = jet.hessian
        return ConstraintJet(value, slope, curve)

    def _third(self, w: Reals, u: Reals, v: Reals) -> Reals:
        result = np.zeros((w.shape[0], 4, self.unknowns))
        pose = w[:, self.joints : self.unknowns]
        for index, (contact, part) in enumerate(zip(self.contacts, self._parts, strict=True)):
            local = self._local(part)
            result[:, 2 * index : 2 * index + 2, local] = contact.third(w[:, part], pose, u[:, local], v[:, local])
        return result

    def _equations(self, w: Reals, mu: Reals, active: Reals, drive: Drive, target: Reals) -> tuple[Reals, Reals]:
        """Scaled residual (B, rows) and its matrix (B, rows, columns)."""
        n, m, joints = self.unknowns, self.size, self.joints
        z, multipliers, load = w[:, :n], w[:, n : n + 4], w[:, n + 4 :]
        jet = self._constraints(w)
        F = np.zeros((w.shape[0], m + joints))
        F[:, :n] = z * self.stiffness + np.einsum("bc,bcj->bj", multipliers, jet.gradient) - load @ self.tendon_rows
        F[:, :joints] += mu
        F[:, n : n + 4] = jet.value
        F[:, n + 4 : m] = (w @ drive.rows.T - target) / self._drive_scale(drive)
        stop = np.where(active > 0, self.upper_rad, self.lower_rad)
        held = active != 0
        F[:, m:] = np.where(held, z[:, :joints] - stop, mu * self.row_scale[0])
        K = np.zeros((w.shape[0], m + joints, m + joints))
        K[:, :n, :n] = np.diag(self.stiffness) + np.einsum("bc,bcjk->bjk", multipliers, jet.hessian)
        K[:, :n, n : n + 4] = jet.gradient.transpose(0, 2, 1)
        K[:, :n, n + 4 : m] = -self.tendon_rows.T
        K[:, :joints, m:] = np.eye(joints)
        K[:, n : n + 4, :n] = jet.gradient
        K[:, n + 4 : m, :m] = drive.rows / self._drive_scale(drive)[:, None]
        K[:, m:, :joints] = np.eye(joints) * held[:, :, None]
        K[:, m:, m:] = np.eye(joints) * self.row_scale[0] * ~held[:, :, None]
        return F * self.row_scale, K * self.row_scale[:, None] * self.column_scale

    def _matrix(self, w: Reals, at_stop: Reals | None, drive: Drive) -> Reals:
        batch = w.shape[0]
        free = np.zeros((batch, self.joints))
        return self._equations(w, free, free if at_stop is None else at_stop, drive, w @ drive.rows.T)[1]

    def _drive_scale(self, drive: Drive) -> Reals:
        scale: Reals = np.abs(drive.rows * self.column_scale[: self.size]).max(1)
        return scale

    def _active(self, w: Reals, mu: Reals) -> Reals:
        """Joints at a stop, decided by torque and overshoot together (primal–dual active set): symmetric joints are
        taken and released together."""
        q = w[:, : self.joints]
        stiffness = self.stiffness[: self.joints]
        upper = mu + stiffness * (q - self.upper_rad) > 1e-12 * stiffness
        lower = mu + stiffness * (q - self.lower_rad) < -1e-12 * stiffness
        active: Reals = upper.astype(float) - lower.astype(float)
        return active

    def _regular(self, active: Reals, drive: Drive) -> Flags:
        """False where contacts, stops and the drive's conditions on z are more than z has unknowns."""
        on_z = int((np.abs(drive.rows[:, : self.unknowns]).max(1) > 0).sum())
        regular: Flags = (active != 0).sum(1) + 4 + on_z <= self.unknowns
        return regular


def grasp_system(hand: Hand, grasped: GraspObject, grasp: GraspSpec) -> GraspSystem:
    """Equations of a grasp from its first contact on. Errors: MechanicsError when there is no first contact."""
    start = first_contact(hand, grasped, grasp)
    fingers = finger_models(hand)
    right, left = (
        rolling_contact(finger, grasped.shape, q, start.object_pose)
        for finger, q in zip(fingers, start.finger_joint_rad, strict=True)
    )
    cap_N = hand.load_cap_N if grasp.load_cap_N is None else min(hand.load_cap_N, grasp.load_cap_N)
    return GraspSystem(fingers, (right, left), start, cap_N)


def _solve(K: Reals, right: Reals) -> Reals:
    """Batched solve; a singular matrix gives NaN for its own state instead of an exception for all."""
    try:
        return np.asarray(np.linalg.solve(K, right), np.float64)
    except np.linalg.LinAlgError:
        return np.stack([_solve_one(matrix, column) for matrix, column in zip(K, right, strict=True)])


def _solve_one(K: Reals, right: Reals) -> Reals:
    try:
        return np.asarray(np.linalg.solve(K, right), np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)
