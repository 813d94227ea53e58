"""Where a grasp begins: free closing of both fingers until they touch the object.

The object stands so that the line between its two contact points passes `object_offset_m` towards the palm from its
centroid, its outline turned by `object_angle_deg` from that line: the contact points are the ends of a chord of the
outline, and its centroid is as near to the middle between them as the offset lets it be (Q_DC, paper eq. 1). Which
load closes the hand to that chord is one equation, `placement.py`. Object axes are those of the hand at that moment
(θ = 0). Contact forces are still zero there, so it is an exact equilibrium to start from. Hand frame, SI, finger order
right, left. Source: hand-mechanics reference 4 and 6; paper II-A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.grasp.contact import rolling_contact
from calibration.grasp.free_closing import load_shares
from calibration.grasp.placement import Placement, placed
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Complexes, Reals, finger_models
from calibration.hand.parameters import Hand
from calibration.objects import GraspObject
from calibration.objects.chord import chord
from calibration.objects.shapes import Round
from drivers.errors import MechanicsError

SIDES = ("right", "left")
APPROACH = 1e-4
"""Share of the load that a fingertip is followed back by, to see whether it comes from outside the object."""


@dataclass(frozen=True)
class FirstContact:
    """State at first contact, finger order right, left."""

    finger_joint_rad: tuple[Reals, Reals]
    tendon_load_N: Reals
    """(2,)"""
    tendon_excursion_m: Reals
    """(2,) finger-side, zero at rest"""
    object_pose: Reals
    """(x m, y m, θ rad) in the hand frame; θ = 0"""
    free_closing_stiffness_N_per_m: Reals
    """(2,) load per excursion from rest to here"""
    outline_angle_rad: float
    """Turn of the outline in the object's axes"""
    contact_points_m: Complexes
    """(2,) x + i y"""
    normals: Complexes
    """(2,) unit normals from fingertip to object"""
    contact_line_angle_rad: float
    """Direction from the left to the right contact point"""
    quality_m: float
    """Q_DC: distance of the object's centroid from the middle between the contact points"""


def first_contact(hand: Hand, grasped: GraspObject, grasp: GraspSpec) -> FirstContact:
    """Free closing to first contact. Errors: MechanicsError when the fingers cannot take the object so."""
    fingers, shape = finger_models(hand), grasped.shape
    shares = load_shares(grasp.onset_split)
    turn_rad = math.radians(grasp.object_angle_deg)
    ends = chord(shape, -turn_rad, -grasp.object_offset_m)
    cap_N = min(hand.load_cap_N, grasp.load_cap_N or hand.load_cap_N) / max(shares)
    place = placed(fingers, ends, grasp, cap_N, pads_roll=isinstance(shape, Round))

    tension = place.load_N * np.array(shares)
    excursion = np.array(
        [finger.tendon.at(q[None]).value[0].sum() for finger, q in zip(fingers, place.joint_rad, strict=True)]
    )
    pose = np.array([place.centre_m.real, place.centre_m.imag, 0.0])
    outline_rad = place.line_angle_rad + turn_rad
    _refuse_palm(place, float((grasped.shape.outline_m(360) @ [math.sin(outline_rad), math.cos(outline_rad)]).min()))
    points, normals = np.zeros(2, complex), np.zeros(2, complex)
    for index, (finger, q) in enumerate(zip(fingers, place.joint_rad, strict=True)):
        contact = rolling_contact(finger, shape, q, pose, outline_rad)
        points[index] = contact.contact_point(q[None], pose[None])[0]
        normals[index] = contact.normal(q[None], pose[None])[0]
        earlier = finger.free_closing(tension[index] * (1 - APPROACH))
        if not contact.at(earlier[None], pose[None]).value[0, 0] > 0:
            raise MechanicsError(
                "object_offset_m" if grasp.object_offset_m else "object_angle_deg",
                f"the {SIDES[index]} finger moves away from the object as it closes: it would come from inside.",
                help="Shift or turn the object so that its sides face the fingertips.",
            )
    return FirstContact(
        place.joint_rad,
        tension,
        excursion,
        pose,
        tension / excursion,
        outline_rad,
        points,
        normals,
        place.line_angle_rad,
        abs(points.mean() - place.centre_m),
    )


def _refuse_palm(place: Placement, lowest_m: float) -> None:
    if place.centre_m.imag + lowest_m < 0:
        raise MechanicsError(
            "object.shape",
            f"the object would reach {-(place.centre_m.imag + lowest_m) * 1e3:.1f} mm through the palm.",
            help="Take a smaller object, turn it, or shift it away from the palm (object_offset_m > 0).",
        )
