"""Finger kinematics in bundle form: points, link angle and tendon length with exact derivatives.

Every absolute angle is linear in the joint coordinates q, so any point of a finger is

    p(q) = p_0 + Σ_m w_m exp(i (θ_m + C_m q)),

a complex number x + i y, m, in the hand frame, with one term for each rigid link (and, later, several for each
flexure). The left finger is the mirror image: θ → π − θ, C → −C. q is flexion from rest, rad, positive closing.
Source: hand-mechanics reference 1, 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.hand.parameters import Finger, Hand, PinJoint
from drivers.errors import MechanicsError

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class PointJet:
    """A point at B configurations: value (B,), gradient (B, n), Hessian (B, n, n) in q; complex, m."""

    value: Complexes
    gradient: Complexes
    hessian: Complexes


@dataclass(frozen=True)
class Bundle:
    """One point of a finger: `origin` m, `weights` (m,) m, `phases` (m,) rad, `coordinates` C (m, n)."""

    origin: complex
    weights: Reals
    phases: Reals
    coordinates: Reals

    def at(self, q: Reals) -> PointJet:
        """Point with first and second derivatives at `q` (B, n)."""
        C = self.coordinates
        terms = self._terms(q)
        return PointJet(
            self.origin + terms.sum(1),
            1j * (terms @ C),
            -np.einsum("bm,mj,mk->bjk", terms, C, C),
        )

    def third(self, q: Reals, u: Reals, v: Reals) -> Complexes:
        """∂_u ∂_v ∇p at `q`: third derivative with the directions `u`, `v` (B, n) put in; (B, n)."""
        C = self.coordinates
        directed: Complexes = -1j * (self._terms(q) * (u @ C.T) * (v @ C.T)) @ C
        return directed

    def _terms(self, q: Reals) -> Complexes:
        terms: Complexes = self.weights * np.exp(1j * (self.phases + q @ self.coordinates.T))
        return terms


@dataclass(frozen=True)
class FingerModel:
    """What the mechanics need of one finger with n coordinates.

    `tip`: centre of the fingertip arc, radius `tip_radius_m`. Absolute distal link angle: `angle_rad + angle_row ·
    q`. Tendon excursion since rest: `tendon_arm_m · q`. Energy: ½ Σ `stiffness_Nm_per_rad` q². Stops: `lower_rad`,
    `upper_rad`.
    """

    tip: Bundle
    tip_radius_m: float
    angle_rad: float
    angle_row: Reals
    tendon_arm_m: Reals
    stiffness_Nm_per_rad: Reals
    lower_rad: Reals
    upper_rad: Reals
    load_free_per_N: Reals
    """Coordinates per newton of tendon load while nothing is touched, rad/N."""

    def free_closing(self, load_N: float) -> Reals:
        """Coordinates at a tendon load while nothing is touched, clipped at the stops; (n,) rad."""
        return np.clip(self.load_free_per_N * load_N, self.lower_rad, self.upper_rad)

    @property
    def free_closing_stiffness_N_per_m(self) -> float:
        """Tendon load per excursion while nothing is touched and no stop is met, N/m."""
        return float(1.0 / (self.tendon_arm_m @ self.load_free_per_N))


def finger_model(finger: Finger, root_half_distance_m: float, *, mirrored: bool) -> FingerModel:
    """Model of one finger; `mirrored` for the left. Errors: MechanicsError for what is not modelled."""
    stiffness = []
    for name, joint in zip(("proximal_joint", "distal_joint"), finger.joints, strict=True):
        if not isinstance(joint, PinJoint):
            raise MechanicsError(
                f"finger.{name}", "flexures are not supported yet.", help="Use a hand with pin joints."
            )
        stiffness.append(joint.stiffness_Nm_per_rad)
    if finger.routing_friction != 0:
        raise MechanicsError(
            "finger.routing_friction",
            f"{finger.routing_friction:g} is given, but friction of the tendon routing is not modelled yet.",
            help="Set it to 0.",
        )
    arms = np.array(finger.tendon_arm_m)
    stiffnesses = np.array(stiffness)
    phases = np.cumsum(finger.rest_angle_rad)
    C = np.array([[1.0, 0.0], [1.0, 1.0]])
    if mirrored:
        phases, C = np.pi - phases, -C
    limits = np.array([joint.flexion_limit_rad for joint in finger.joints])
    return FingerModel(
        tip=Bundle(
            complex(-root_half_distance_m if mirrored else root_half_distance_m),
            np.array([finger.proximal_link_m, finger.distal_link_m - finger.tip.radius_m]),
            phases,
            C,
        ),
        tip_radius_m=finger.tip.radius_m,
        angle_rad=float(phases[1]),
        angle_row=C[1],
        tendon_arm_m=arms,
        stiffness_Nm_per_rad=stiffnesses,
        lower_rad=limits[:, 0],
        upper_rad=limits[:, 1],
        load_free_per_N=arms / stiffnesses,
    )


def finger_models(hand: Hand) -> tuple[FingerModel, FingerModel]:
    """Right and left finger of a hand."""
    b = hand.root_half_distance_m
    return finger_model(hand.right, b, mirrored=False), finger_model(hand.left, b, mirrored=True)
