"""Rolling contact of a fingertip on the object: which kind it is, from where both first touch.

    contact_jet     what every contact answers
    contact_frame   the arc's centre in turning frames
    contact_arc     arc (or point) on a round outline, arc on a flat side
    contact_pad     flat pad on a round outline, pad and arc together

A flat pad on a flat side would be a surface contact, which two constraints cannot describe. Hand frame, m, rad. Source:
hand-mechanics reference 5.
"""

from __future__ import annotations

import math

import numpy as np

from calibration.grasp.contact_arc import ArcOnRound, ArcOnSide, facing_pad
from calibration.grasp.contact_jet import ConstraintJet, RollingContact
from calibration.grasp.contact_pad import PadOnRound, TipOnRound
from calibration.hand.finger import FingerModel, Reals
from calibration.objects.shapes import Flat, Shape
from drivers.errors import MechanicsError

__all__ = ["ConstraintJet", "RollingContact", "rolling_contact"]

CORNER_M = 1e-5
"""A contact nearer than this to the end of a side is one on a corner."""
TOUCHING_M = 1e-8
"""A gap or overlap larger than this is no contact."""
FLAT_RAD = 1e-6
"""A pad that leans by less lies on the side."""


def rolling_contact(
    finger: FingerModel, shape: Shape, q: Reals, pose: Reals, outline_angle_rad: float = 0.0
) -> RollingContact:
    """Contact of `finger` on `shape`, turned by `outline_angle_rad` in the object's axes, that starts rolling at
    coordinates `q` (n,) and object pose `pose` (3,).

    Errors: MechanicsError for contacts on a corner or a surface, and where the two do not touch.
    """
    pad_length_m = 0.0 if finger.pad is None else finger.pad.length_m
    contact: ArcOnRound | ArcOnSide | TipOnRound
    if isinstance(shape, Flat):
        contact = _on_side(finger, shape, q, pose, outline_angle_rad, pad_length_m)
    else:
        contact = ArcOnRound(finger, shape.support, outline_angle_rad)
        if pad_length_m > 0:
            contact = TipOnRound(contact, PadOnRound(finger, shape.support, outline_angle_rad), pad_length_m)
    contact = contact.starting_at(q, pose)
    apart_m = float(contact.at(q[None], pose[None]).value[0, 0])
    if not abs(apart_m) < TOUCHING_M:
        raise MechanicsError(
            "outline_angle_rad",
            f"fingertip and object are {apart_m * 1e6:.3g} µm apart where rolling should begin.",
            help="Give joints, object pose and outline angle of one first contact.",
        )
    return contact


def _on_side(
    finger: FingerModel, shape: Flat, q: Reals, pose: Reals, outline_angle_rad: float, pad_length_m: float
) -> ArcOnSide:
    contacts = [ArcOnSide(finger, side, outline_angle_rad, pad_length_m) for side in shape.sides]
    contact = max(contacts, key=lambda one: float(one.at(q[None], pose[None]).value[0, 0]))
    margins = {name: float(margin[0]) for name, margin in contact.features(q[None], pose[None]).items()}
    if margins["side end"] < CORNER_M:
        raise MechanicsError(
            "object_angle_deg",
            "a fingertip meets a corner of the object, where it would not stay.",
            help="Turn the object, or shift it by object_offset_m, so that both fingertips meet a flat side.",
        )
    if pad_length_m > 0:
        refuse_flat_pad(
            finger,
            float(facing_pad(finger, outline_angle_rad).angle_at(q[None], pose[None])[0]) - contact.side.angle_rad,
        )
    return contact


def refuse_flat_pad(finger: FingerModel, past_side_rad: float) -> None:
    """MechanicsError when the pad, whose opposite normal is `past_side_rad` past the side's, does not lean so that
    the arc touches."""
    leaning = finger.links[1].inner_side * math.remainder(past_side_rad, 2 * np.pi)
    if abs(leaning) < FLAT_RAD:
        raise MechanicsError(
            "finger.tip.pad_length_m",
            "the fingertip's flat pad would lie on a flat side of the object: a surface contact, not a point.",
            help="Turn the object, take another size, or a fingertip without a pad (pad_length_m = 0).",
        )
    if leaning < 0:
        raise MechanicsError(
            "finger.tip.pad_length_m",
            f"the pad leans {math.degrees(-leaning):.1f}° outwards, so that its far end would meet the object's flat "
            "side before the fingertip's arc.",
            help="Turn the object, take a narrower one, or a fingertip without a pad (pad_length_m = 0).",
        )
