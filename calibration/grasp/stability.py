"""Grasp stability: grasp matrix, force closure, and the force decomposition of a compliant hand.

Planar: two point contacts with friction, G (3, 4), contact forces f = (right N, f_t, left N, f_t) on the object,
G f = −f_ext about the object's reference point. Normals n run from fingertip to object, tangents t = i n. Points and
normals are complex numbers, hand frame, m. Source: paper II-B, (2)–(5); hand-mechanics reference 7.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from calibration.grasp.equilibrium import GraspSystem
from calibration.hand.finger import Complexes, Reals
from drivers.errors import MechanicsError

RANK_LENGTH_M = 0.030
"""Moments are compared with forces at this length when a rank is counted."""


@dataclass(frozen=True)
class ForceClosure:
    """Verdict on two contacts with friction μ."""

    rank: int
    """of the planar grasp matrix; 3 resists every planar wrench"""
    spatial_rank: int
    """of the 6 × 6 matrix of two hard fingers in space: 5, since nothing resists rotation about their line"""
    cone_margin_rad: tuple[float, float]
    """how far the line between the contacts lies inside the friction cone, right and left; < 0 is outside"""

    @property
    def holds(self) -> bool:
        """Planar force closure: full rank, and the line strictly inside both cones."""
        return self.rank == 3 and min(self.cone_margin_rad) > 0


@dataclass(frozen=True)
class ForceDecomposition:
    """(3): f = particular + internal; each (4,), N."""

    particular_N: Reals
    """G⁺ (−f_ext): what carries the external wrench"""
    internal_N: Reals
    """(I − G⁺ G)(K_s Δp + K_c δp): what squeezes the object"""

    @property
    def total_N(self) -> Reals:
        """Contact forces, N."""
        return self.particular_N + self.internal_N


def contact_frames(system: GraspSystem, w: Reals) -> tuple[Complexes, Complexes]:
    """Contact points (2,) and unit normals fingertip → object (2,) at a state (size,), right and left."""
    pose = w[None, system.joints : system.unknowns]
    points, normals = [], []
    for contact, part in zip(system.contacts, system.parts, strict=True):
        q = w[None, part]
        points.append(complex(contact.contact_point(q, pose)[0]))
        normals.append(complex(contact.normal(q, pose)[0]))
    return np.array(points), np.array(normals)


def grasp_matrix(points: Complexes, normals: Complexes, reference: complex) -> Reals:
    """Planar G (3, 4): columns right n, t, left n, t; rows force x, y and moment about `reference`."""
    columns = []
    for point, normal in zip(points, normals, strict=True):
        for direction in (normal, 1j * normal):
            moment = ((point - reference).conjugate() * direction).imag
            columns.append([direction.real, direction.imag, moment])
    return np.array(columns, float).T


def spatial_grasp_matrix(points: Complexes, normals: Complexes, reference: complex) -> Reals:
    """G (6, 6) of two hard fingers in space, contacts in the closing plane: columns n, t, o (out of plane) of each."""
    columns = []
    for point, normal in zip(points, normals, strict=True):
        arm = np.array([(point - reference).real, (point - reference).imag, 0.0])
        for direction in ([normal.real, normal.imag, 0.0], [-normal.imag, normal.real, 0.0], [0.0, 0.0, 1.0]):
            columns.append(np.concatenate([direction, np.cross(arm, direction)]))
    return np.array(columns).T


def force_closure(points: Complexes, normals: Complexes, friction: float) -> ForceClosure:
    """Rank and cone test of two contacts, (2) and (5). Errors: MechanicsError for a coefficient that is not ≥ 0."""
    if not friction >= 0:
        raise MechanicsError("contact_friction", f"{friction!r} is not ≥ 0.")
    middle = complex(points.mean())
    moments = np.array([1.0, 1.0, 1 / RANK_LENGTH_M])
    planar = grasp_matrix(points, normals, middle) * moments[:, None]
    spatial = spatial_grasp_matrix(points, normals, middle) * np.repeat([1.0, 1 / RANK_LENGTH_M], 3)[:, None]
    line = complex(points[1] - points[0])
    right, left = (
        math.atan(friction) - abs(cmath.phase(direction / complex(normal)))
        for direction, normal in zip((line, -line), normals, strict=True)
    )
    ranks = (int(np.linalg.matrix_rank(matrix, tol=1e-9)) for matrix in (planar, spatial))
    planar_rank, spatial_rank = ranks
    return ForceClosure(planar_rank, spatial_rank, (right, left))


def internal_force(points: Complexes, normals: Complexes) -> Reals:
    """Contact forces (4,) of unit size along the line between the contacts: equal, opposite, no net wrench."""
    line = complex(points[1] - points[0])
    line /= abs(line)
    parts = [direction / complex(n) for direction, n in zip((line, -line), normals, strict=True)]
    return np.array([parts[0].real, parts[0].imag, parts[1].real, parts[1].imag])


def hand_jacobian(system: GraspSystem, w: Reals) -> Reals:
    """J_h (4, joints): motion of the fingertips' contact points per joint coordinate, in the contact frames, m/rad."""
    pose = w[None, system.joints : system.unknowns]
    jacobian = np.zeros((4, system.joints))
    for side, (contact, part) in enumerate(zip(system.contacts, system.parts, strict=True)):
        jacobian[2 * side : 2 * side + 2, part] = -contact.at(w[None, part], pose).gradient[0, :, :-3]
    return jacobian


def structure_stiffness(
    jacobian: Reals, joint_compliance_rad_per_Nm: Reals, pad_compliance_m_per_N: Reals | float = 0.0
) -> Reals:
    """K_s = (C_s + J_h C_q J_hᵀ)⁻¹ (4, 4), N/m; C_q (joints,) and C_s (4,) are diagonals, C_s = 0 rigid pads.

    Errors: MechanicsError where the fingertips cannot yield in some direction, as with a joint at its stop.
    """
    compliance = (
        np.diag(np.broadcast_to(pad_compliance_m_per_N, 4)) + jacobian * joint_compliance_rad_per_Nm @ jacobian.T
    )
    if not np.linalg.cond(compliance) < 1e12:
        raise MechanicsError(
            "pad_compliance_m_per_N",
            "the fingertips do not yield in every direction, so that the hand has no finite stiffness.",
            help="Give the pads a compliance, or take a state in which no joint is at a stop.",
        )
    return np.asarray(np.linalg.inv(compliance), np.float64)


def weighted_right_inverse(G: Reals, stiffness: Reals) -> Reals:
    """G⁺ = K_s Gᵀ (G K_s Gᵀ)⁻¹ (4, 3) of the planar grasp matrix: G G⁺ = I."""
    inverse: Reals = stiffness @ G.T @ np.linalg.inv(G @ stiffness @ G.T)
    return inverse


def force_decomposition(
    G: Reals,
    stiffness: Reals,
    external_wrench: Reals,
    finger_displacement_m: Reals,
    contact_stiffness: Reals | None = None,
    object_deformation_m: Reals | None = None,
) -> ForceDecomposition:
    """(3) with K_s (4, 4), f_ext (3,), Δp (4,); K_c (4, 4) and δp (4,) where the object yields.

    Δp is where the fingertips would be without contact, less where they are, in the contact frames: then K_s Δp is
    the force that bends them, and (3) returns the forces of the equilibrium (hand-mechanics reference 7). Of one
    deflection K_s Δp and K_c δp are the same force, seen from finger and object: give the part of each.
    """
    inverse = weighted_right_inverse(G, stiffness)
    force = stiffness @ finger_displacement_m
    if contact_stiffness is not None and object_deformation_m is not None:
        force = force + contact_stiffness @ object_deformation_m
    return ForceDecomposition(-inverse @ external_wrench, force - inverse @ (G @ force))


def finger_deflection(system: GraspSystem, w: Reals) -> Reals:
    """Δp (4,) at a state with no joint at a stop: where the fingertips would be if the tendons' torques met the springs
    alone, less where they are, in the contact frames, to first order in the joints' deflection; m."""
    deflection = -w[: system.joints].copy()
    loads = system.load_rows() @ w
    for tendon, part, shares, load in zip(
        system.terms(w[None]).tendons, system.parts, system.tendon_shares, loads, strict=True
    ):
        deflection[part] += load * (shares @ tendon.gradient[0]) / system.stiffness[part]
    moved: Reals = hand_jacobian(system, w) @ deflection
    return moved


def load_stability(system: GraspSystem, w: Reals, at_stop: Reals) -> Reals:
    """Smallest eigenvalue of the energy's Hessian under prescribed tendon loads, on the motions that contacts and stops
    leave; (B,), scaled as in `GraspSystem.stability`: > 0 is stable, inf when nothing is left to move."""
    n, scale = system.unknowns, system.column_scale[: system.unknowns]
    terms = system.terms(w)
    curvature = system.curvature(w, terms) * (np.outer(scale, scale) / system.torque_Nm)
    gradients = np.zeros((w.shape[0], 4, n))
    for index, (contact, part) in enumerate(zip(terms.contacts, system.parts, strict=True)):
        local = np.r_[part, system.joints : n]
        gradients[:, 2 * index : 2 * index + 2, local] = contact.gradient
    result = np.full(w.shape[0], np.inf)
    for index, (H, contact_rows, held) in enumerate(zip(curvature, gradients * scale, at_stop, strict=True)):
        rows = np.vstack([contact_rows, np.eye(n)[np.flatnonzero(held)]])
        free = null_space(rows / np.linalg.norm(rows, axis=1, keepdims=True), rcond=1e-9)
        if free.size:
            result[index] = np.linalg.eigvals(free.T @ H @ free).real.min()
    return result
