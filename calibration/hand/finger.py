"""Kinematics, springs and tendon of one finger: two joints, two rigid phalanges, a tip.

Coordinates q of a finger: those of the proximal joint, then those of the distal one; a pin has one, a flexure n, its
end angle first. Flexion from rest, rad, positive closing in both fingers; hand frame, m. Angles of the right finger are
absolute, counter-clockwise; the left finger is its mirror image: θ → π − θ. At a joint with rest angle β a pin's link
starts at β to the one before; a flexure stands straight at rest, at β/2 to both of its neighbours. The finger's root is
the pin, or the root of the flexure. Source: hand-mechanics reference 1 to 4, design 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.hand.bundle import Bundle, Complexes, PointJet, Reals
from calibration.hand.free_closing import settled
from calibration.hand.joints import JointModel, joint_model
from calibration.hand.parameters import (
    Finger,
    FlexureJoint,
    Hand,
    PinJoint,
    StraightTendonAtFlexure,
    StraightTendonAtPin,
)
from calibration.hand.tendon import TendonLaw, TendonModel, constant_offset, straight_run

__all__ = [
    "Bundle",
    "Complexes",
    "FingerModel",
    "LinkModel",
    "Pad",
    "PointJet",
    "Reals",
    "finger_model",
    "finger_models",
]

Branch = Literal["winding", "unwinding"]

CUT = 1.001
"""How much more than needed the faces at a pin are cut, so that the stop is met before they are: some µm."""


@dataclass(frozen=True)
class LinkModel:
    """A rigid phalanx of length `length_m`, its axis at `angle_rad + angle_row · q` through `root`."""

    root: Bundle
    angle_rad: float
    angle_row: Reals
    length_m: float
    inner_side: float
    """Sign of a counter-clockwise quarter turn that leads from the axis to the inner, palmar side: 1 right, −1 left."""
    inner_corners_m: tuple[tuple[float, float], tuple[float, float]]
    """(along, across) where the inner side begins and ends. Faces at a flexure stand square to it, so that those of
    the two phalanges meet when it is bent by length / inner_m; faces at a pin are cut so that they meet at its stop."""

    def point(self, along_m: float, across_m: float) -> Bundle:
        """Point fixed to the link, `along_m` from its root, `across_m` from its axis towards the inner side."""
        return self.root.with_arm(complex(along_m, self.inner_side * across_m), self.angle_rad, self.angle_row)


@dataclass(frozen=True)
class Pad:
    """Flat pad on the inner side of the distal link, tangent to the tip arc; from the foot of the arc's centre
    `length_m` back along the link."""

    length_m: float


@dataclass(frozen=True)
class FingerModel:
    """What the mechanics need of one finger with n coordinates.

    `tip`: centre of the fingertip arc, radius `tip_radius_m`. Absolute distal link angle: `angle_rad + angle_row · q`.
    `links`: proximal, distal, `inner_m` and `outer_m` thick on the two sides of their axes. Energy: ½ Σ
    `stiffness_Nm_per_rad` q². Stops: `lower_rad`, `upper_rad`, ±inf for changes of a flexure's shape. `joint_index`:
    the coordinates that are the proximal and distal joint angle.
    """

    tip: Bundle
    tip_radius_m: float
    angle_rad: float
    angle_row: Reals
    links: tuple[LinkModel, LinkModel]
    inner_m: float
    outer_m: float
    pad: Pad | None
    tendon: TendonModel
    routing_loss: float
    """c: a tension T at the proximal joint is T exp(−c) at the distal one while winding, T exp(c) while unwinding."""
    tendon_stiffness_N_per_m: float
    """Series stiffness, may be inf: the spool's excursion is the finger's plus T / stiffness."""
    stiffness_Nm_per_rad: Reals
    lower_rad: Reals
    upper_rad: Reals
    joint_index: tuple[int, int]
    joints: tuple[JointModel, JointModel]

    def joint_tension_N(self, load_N: float, branch: Branch = "winding") -> tuple[float, float]:
        """Tension that acts at the proximal and the distal joint when the tendon comes with `load_N`."""
        return load_N, load_N * math.exp(-self.routing_loss if branch == "winding" else self.routing_loss)

    def free_closing(self, load_N: float, branch: Branch = "winding") -> Reals:
        """Coordinates at a tendon load while nothing is touched, clipped at the stops; (n,) rad."""
        tensions_N = self.joint_tension_N(load_N, branch)
        return np.concatenate([settled(*item) for item in zip(self.joints, self.tendon.laws, tensions_N, strict=True)])

    @property
    def free_closing_stiffness_N_per_m(self) -> float:
        """Tendon load per excursion at rest, while winding and nothing is touched, N/m."""
        arms = self.tendon.at(np.zeros((1, self.stiffness_Nm_per_rad.size))).gradient[0]
        slope = np.array(self.joint_tension_N(1.0)) @ arms / self.stiffness_Nm_per_rad
        return float(1.0 / (arms.sum(0) @ slope))


def finger_model(finger: Finger, root_half_distance_m: float, *, mirrored: bool) -> FingerModel:
    """Model of one finger; `mirrored` for the left."""
    joints = joint_model(finger.proximal_joint), joint_model(finger.distal_joint)
    parts = slice(0, joints[0].size), slice(joints[0].size, joints[0].size + joints[1].size)
    size = parts[1].stop
    links: list[LinkModel] = []
    end = Bundle(complex(root_half_distance_m), np.zeros(0), np.zeros(0), np.zeros((0, size)))
    angle, row = 0.0, np.zeros(size)
    lengths_m = finger.proximal_link_m, finger.distal_link_m
    for joint, part, rest, length_m, corners_m in zip(
        joints, parts, finger.rest_angle_rad, lengths_m, _inner_corners_m(finger), strict=True
    ):
        bend = joint.bend
        root = Bundle(
            end.origin,
            np.concatenate([end.weights, bend.weights]),
            np.concatenate([end.phases, angle + rest / 2 + bend.phases]),
            np.vstack([end.coordinates, row + _embedded(bend.coordinates, part, size)]),
        )
        angle, row = angle + rest, row + _embedded(joint.angle_row[None, :], part, size)[0]
        link = LinkModel(root, angle, row, length_m, 1.0, corners_m)
        links.append(link)
        end = link.point(length_m, 0.0)
    if mirrored:
        links = [
            LinkModel(
                link.root.mirrored(),
                math.pi - link.angle_rad,
                -link.angle_row,
                link.length_m,
                -1.0,
                link.inner_corners_m,
            )
            for link in links
        ]
    proximal, distal = links
    return FingerModel(
        tip=distal.point(finger.distal_link_m - finger.tip.radius_m, 0.0),
        tip_radius_m=finger.tip.radius_m,
        angle_rad=distal.angle_rad,
        angle_row=distal.angle_row,
        links=(proximal, distal),
        inner_m=finger.outline.inner_m,
        outer_m=finger.outline.outer_m,
        pad=Pad(finger.tip.pad_length_m) if finger.tip.pad_length_m > 0 else None,
        tendon=TendonModel(_tendon_laws(finger, joints), parts),
        routing_loss=finger.routing_friction,
        tendon_stiffness_N_per_m=finger.tendon_stiffness_N_per_m,
        stiffness_Nm_per_rad=np.concatenate([joint.stiffness_Nm_per_rad for joint in joints]),
        lower_rad=np.concatenate([joint.lower_rad for joint in joints]),
        upper_rad=np.concatenate([joint.upper_rad for joint in joints]),
        joint_index=(0, parts[1].start),
        joints=joints,
    )


def finger_models(hand: Hand) -> tuple[FingerModel, FingerModel]:
    """Right and left finger of a hand."""
    b = hand.root_half_distance_m
    return finger_model(hand.right, b, mirrored=False), finger_model(hand.left, b, mirrored=True)


def _tendon_laws(finger: Finger, joints: tuple[JointModel, JointModel]) -> tuple[TendonLaw, TendonLaw]:
    proximal, distal = (
        _tendon_law(parameters, joint, offset_m)
        for parameters, joint, offset_m in zip(finger.joints, joints, finger.tendon_arm_m, strict=True)
    )
    return proximal, distal


def _tendon_law(parameters: PinJoint | FlexureJoint, joint: JointModel, offset_m: float) -> TendonLaw:
    tendon = parameters.tendon
    if isinstance(tendon, StraightTendonAtPin):
        return straight_run(joint, offset_m, tendon.before_m, tendon.after_m)
    if isinstance(tendon, StraightTendonAtFlexure):
        return straight_run(joint, offset_m)
    return constant_offset(joint, offset_m)


def _inner_corners_m(finger: Finger) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Ends of the inner sides of both links; the distal one ends under the centre of the tip's arc, not beyond it."""
    inner_m, rest, joint = finger.outline.inner_m, finger.rest_angle_rad[1], finger.distal_joint
    tip_m = (finger.distal_link_m - finger.tip.radius_m, min(inner_m, finger.tip.radius_m))
    if isinstance(joint, FlexureJoint):
        cut_m, across_m = inner_m * math.sin(rest / 2), inner_m * math.cos(rest / 2)
    else:
        half = (rest + joint.flexion_limit_rad[1]) / 2
        shortest_m = min(finger.proximal_link_m, tip_m[0])
        cut_m, across_m = (CUT * inner_m * math.tan(half) if 0 < half < math.pi / 2 else shortest_m), inner_m
        cut_m = min(cut_m, shortest_m)
    return [((0.0, inner_m), (finger.proximal_link_m - cut_m, across_m)), ((cut_m, across_m), tip_m)]


def _embedded(columns: Reals, part: slice, size: int) -> Reals:
    """Columns of one joint among those of the whole finger."""
    result = np.zeros((columns.shape[0], size))
    result[:, part] = columns
    return result
