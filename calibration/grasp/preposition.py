"""Where a grasp begins: free closing of both fingers until they touch the object.

A grasp whose fingers touch at loads T(1 + δ) right and T(1 − δ) left has the onset split δ; δ = 0 is symmetric. The
object stands with its centre on the line between the two tip centres, midway; its axes are those of the hand at that
moment (θ = 0). Contact forces are still zero there, so it is an exact equilibrium to start from. Hand frame, SI.
Source: hand-mechanics reference 4 and 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import FingerModel, Reals, finger_models
from calibration.hand.parameters import Hand
from calibration.objects import GraspObject
from drivers.errors import MechanicsError

SAMPLED_LOADS = 400
"""Loads at which the closing gap is sampled for the first contact: less than 1° of joint motion apart."""


@dataclass(frozen=True)
class FirstContact:
    """State at first contact, finger order right, left."""

    finger_joint_rad: tuple[Reals, Reals]
    tendon_load_N: Reals
    """(2,)"""
    tendon_excursion_m: Reals
    """(2,) finger-side, zero at rest"""
    object_pose: Reals
    """(x m, y m, θ rad) in the hand frame"""
    free_closing_stiffness_N_per_m: Reals
    """(2,) load per excursion while closing freely"""


def first_contact(hand: Hand, grasped: GraspObject, grasp: GraspSpec) -> FirstContact:
    """Free closing to first contact. Errors: MechanicsError when the fingers cannot take the object so."""
    fingers = finger_models(hand)
    shares = (1.0 + grasp.onset_split, 1.0 - grasp.onset_split)
    wanted_m = grasped.shape.extent_m(0.0) + fingers[0].tip_radius_m + fingers[1].tip_radius_m

    def gap_m(load_N: float) -> float:
        right, left = (_tip(finger, share * load_N) for finger, share in zip(fingers, shares, strict=True))
        return abs(right - left) - wanted_m

    cap_N = min(hand.load_cap_N, grasp.load_cap_N or hand.load_cap_N) / max(shares)
    loads = np.linspace(0, cap_N, SAMPLED_LOADS + 1)
    touching = np.flatnonzero(np.array([gap_m(load) for load in loads]) <= 0)
    if touching.size == 0:
        raise MechanicsError(
            "object.shape",
            f"the fingers close freely up to {cap_N:.1f} N mean load without touching a width of "
            f"{grasped.shape.extent_m(0.0) * 1e3:.1f} mm.",
            help="Take a wider object or a smaller onset split.",
        )
    if touching[0] == 0:
        raise MechanicsError(
            "object.shape",
            f"a width of {grasped.shape.extent_m(0.0) * 1e3:.1f} mm does not fit between the open fingers.",
            help="Take a narrower object.",
        )
    mean_N = float(brentq(gap_m, loads[touching[0] - 1], loads[touching[0]], xtol=1e-14, rtol=1e-15))
    tension = mean_N * np.array(shares)
    joints = [finger.free_closing(load) for finger, load in zip(fingers, tension, strict=True)]
    for side, finger, q in zip(("right", "left"), fingers, joints, strict=True):
        if np.any(q >= finger.upper_rad) or np.any(q <= finger.lower_rad):
            raise MechanicsError(
                "onset_split" if grasp.onset_split else "object.shape",
                f"the {side} finger meets a stop before it touches the object.",
                help="Take a wider object or a smaller onset split.",
            )
    right, left = (finger.tip.at(q[None, :]).value[0] for finger, q in zip(fingers, joints, strict=True))
    centre = left + (grasped.shape.extent_m(0.0) / 2 + fingers[1].tip_radius_m) * (right - left) / abs(right - left)
    return FirstContact(
        (joints[0], joints[1]),
        tension,
        np.array([finger.tendon_arm_m @ q for finger, q in zip(fingers, joints, strict=True)]),
        np.array([centre.real, centre.imag, 0.0]),
        np.array([finger.free_closing_stiffness_N_per_m for finger in fingers]),
    )


def _tip(finger: FingerModel, load_N: float) -> complex:
    return complex(finger.tip.at(finger.free_closing(load_N)[None, :]).value[0])
