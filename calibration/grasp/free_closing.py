"""The fingers closing with nothing between them: where the fingertips are at every tendon load (paper, Fig. 2).

The loads of the two tendons are T(1 + δ) right and T(1 − δ) left, T their mean and δ the onset split. Hand frame, SI,
finger order right, left. Source: hand-mechanics reference 4; paper II-A.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.hand.finger import Complexes, FingerModel, Reals, finger_models
from calibration.hand.parameters import Hand
from drivers.errors import MechanicsError


@dataclass(frozen=True)
class ClosingPath:
    """Free closing at K mean loads `load_N` (K,); per finger, right then left: coordinates `joint_rad` (K, n),
    centre of the tip arc and end of the fingertip, x + i y m (K,), and the distal link's angle, rad (K,)."""

    load_N: Reals
    joint_rad: tuple[Reals, Reals]
    arc_centre_m: tuple[Complexes, Complexes]
    fingertip_m: tuple[Complexes, Complexes]
    distal_angle_rad: tuple[Reals, Reals]


def load_shares(onset_split: float) -> tuple[float, float]:
    """Right and left tendon load per mean load."""
    return 1.0 + onset_split, 1.0 - onset_split


def closing_path(hand: Hand, load_N: Reals, onset_split: float = 0.0) -> ClosingPath:
    """Both fingers closing freely at mean loads `load_N` (K,), each ≥ 0. Errors: MechanicsError for other loads."""
    if load_N.ndim != 1 or not np.all(np.isfinite(load_N)) or not np.all(load_N >= 0):
        raise MechanicsError("load_N", "free closing needs a row of finite loads ≥ 0 N.")
    return path_of(finger_models(hand), load_N, onset_split)


def path_of(fingers: tuple[FingerModel, FingerModel], load_N: Reals, onset_split: float) -> ClosingPath:
    """As `closing_path`, for finger models."""
    joints, centres, ends, angles = [], [], [], []
    for finger, share in zip(fingers, load_shares(onset_split), strict=True):
        q = np.array([finger.free_closing(share * load) for load in load_N])
        angle = finger.angle_rad + q @ finger.angle_row
        centre = finger.tip.at(q).value
        joints.append(q)
        angles.append(angle)
        centres.append(centre)
        ends.append(centre + finger.tip_radius_m * np.exp(1j * angle))
    return ClosingPath(
        load_N, (joints[0], joints[1]), (centres[0], centres[1]), (ends[0], ends[1]), (angles[0], angles[1])
    )
