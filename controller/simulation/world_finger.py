"""One finger as bodies of the simulated world: pins or flexures, two rigid phalanges, an arc or pad at the tip.

Frame: hand frame H (x right, y out of the palm, z = x × y along the pins, origin midway between the roots). A link's
frame lies at its root, x along it. Joint coordinates are flexion from rest, positive = closing. Lengths, springs, rest
angles: hand-mechanics reference 1, 2, 4, 5.

A flexure is a chain of hinges, each in the middle of its share of the length, each with its share of the bending
stiffness: not the smooth curvature model but a beam cut into pieces (hand-mechanics reference 3.1 uses a long one as a
check). It carries half of the rest angle at each end and is straight at rest. Its stops act on its end angle, the sum
of its hinges.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from cmath import exp
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from calibration.hand.parameters import (
    Finger,
    FlexureJoint,
    PinJoint,
    StraightTendonAtFlexure,
    StraightTendonAtPin,
)
from controller.simulation.world_arm import text
from drivers.errors import MechanicsError

PARTS = ("proximal", "distal")
FLEXURE_HINGES = 16
"""The chain's end lies L·θ²/12n² short of the beam's: 3 µm for 10 mm bent by 1 rad."""
JOINT_DAMPING_NMS_PER_RAD = 0.003
"""Loss in the rubber [assumed]: 0.2 of critical at the proximal joint; under 1 % of the spring while squeezing."""
FINGER_WIDTH_M = 0.03175
"""Along the pins (openhand-t42 reference 3)."""
FINGER_THICKNESS_M = 0.018
_HINGE_INERTIA_KGM2 = 1e-6
"""Of each hinge of a chain, so that its pieces, which weigh next to nothing, do not ring faster than physics steps;
bending as a whole has a hundredth of that, less than 1 % of what a phalanx has about its joint."""
_PIECE_MASS_KG = 1e-6


@dataclass(frozen=True)
class _Place:
    """Where the next part begins: the body it hangs on, position m and angle rad in that body's frame."""

    body: ElementTree.Element
    along_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angle_rad: float = 0.0


def hinge_names(joint: PinJoint | FlexureJoint, part: str, side: str) -> list[str]:
    """Names of the hinges that make up one joint of a finger, from the root outwards."""
    if isinstance(joint, PinJoint):
        return [f"{part}_{side}"]
    return [f"{part}_{side}_{index}" for index in range(FLEXURE_HINGES)]


def guide_names(part: str, side: str) -> tuple[str, str]:
    """Names of the sites between which a straight tendon runs past a joint."""
    return f"before_{part}_{side}", f"after_{part}_{side}"


def add_finger(
    palm: ElementTree.Element,
    tendons: ElementTree.Element,
    finger: Finger,
    side: str,
    root_half_distance_m: float,
    hard: dict[str, str],
) -> None:
    """Append one finger to the body `palm`, and the stops of its flexures to `tendons`.

    Names: bodies `proximal_right`, `distal_right`, hinges as `hinge_names` says, sites as `guide_names` says where
    the tendon runs straight, geom `tip_right`; the same for left.
    `hard` are the constraint attributes of stops. Raises MechanicsError for a finger that cannot be simulated.
    """
    mirror = 1.0 if side == "right" else -1.0
    lengths_m = (finger.proximal_link_m, finger.distal_link_m)
    masses_kg = (finger.proximal_mass_kg, finger.distal_mass_kg)
    place = _Place(palm, (mirror * root_half_distance_m, 0.0, 0.0), 0.0 if side == "right" else pi)
    link = palm
    for index, part in enumerate(PARTS):
        joint, rest_rad = finger.joints[index], mirror * finger.rest_angle_rad[index]
        names = hinge_names(joint, part, side)
        if isinstance(joint, PinJoint):
            place = _Place(place.body, place.along_m, place.angle_rad + rest_rad)
            link = _body(place, f"{part}_{side}")
            _add_hinge(link, names[0], mirror, joint.stiffness_Nm_per_rad, JOINT_DAMPING_NMS_PER_RAD, joint, hard)
            if isinstance(joint.tendon, StraightTendonAtPin):
                offset_m, tendon = mirror * finger.tendon_arm_m[index], joint.tendon
                _add_guides(place, -tendon.before_m, _Place(link), tendon.after_m, offset_m, guide_names(part, side))
        else:
            root, end = _add_flexure(place, joint, names, mirror, rest_rad)
            link = _body(_Place(end.body, end.along_m, rest_rad / 2), f"{part}_{side}")
            if isinstance(joint.tendon, StraightTendonAtFlexure):
                offset_m = mirror * finger.tendon_arm_m[index]
                _add_guides(_Place(root), 0.0, end, 0.0, offset_m, guide_names(part, side))
            _add_stops(tendons, joint, names, f"stop_{part}_{side}", hard)
        _add_link_inertia(link, lengths_m[index], masses_kg[index])
        place = _Place(link, (lengths_m[index], 0.0, 0.0))
    _add_tip(link, finger, side)


def _add_flexure(
    place: _Place, joint: FlexureJoint, names: list[str], mirror: float, rest_rad: float
) -> tuple[ElementTree.Element, _Place]:
    """The chain of one flexure; the body that it begins on and where it ends, both without its rest angle's half."""
    piece_m = joint.length_m / len(names)
    stiffness_Nm_per_rad = joint.bending_stiffness_Nm2 / piece_m
    root = _body(_Place(place.body, place.along_m, place.angle_rad + rest_rad / 2), f"{names[0]}_root")
    _add_piece_inertia(root)
    body = root
    for index, name in enumerate(names):
        body = _body(_Place(body, (piece_m if index else piece_m / 2, 0.0, 0.0)), name)
        _add_hinge(body, name, mirror, stiffness_Nm_per_rad, JOINT_DAMPING_NMS_PER_RAD * len(names), None, {})
        _add_piece_inertia(body)
    return root, _Place(body, (piece_m / 2, 0.0, 0.0))


def _add_guides(
    before: _Place, before_m: float, after: _Place, after_m: float, offset_m: float, names: tuple[str, str]
) -> None:
    """Sites `before_m` and `after_m` along x and `offset_m` along y of two places."""
    for place, along_m, name in ((before, before_m, names[0]), (after, after_m, names[1])):
        reach = complex(along_m, offset_m) * exp(1j * place.angle_rad)
        x_m, y_m, z_m = place.along_m
        ElementTree.SubElement(place.body, "site", name=name, pos=text((x_m + reach.real, y_m + reach.imag, z_m)))


def _body(place: _Place, name: str) -> ElementTree.Element:
    quaternion = (cos(place.angle_rad / 2), 0.0, 0.0, sin(place.angle_rad / 2))
    return ElementTree.SubElement(place.body, "body", name=name, pos=text(place.along_m), quat=text(quaternion))


def _add_hinge(
    body: ElementTree.Element,
    name: str,
    mirror: float,
    stiffness_Nm_per_rad: float,
    damping_Nms_per_rad: float,
    stops: PinJoint | None,
    hard: dict[str, str],
) -> None:
    action = {"armature": repr(_HINGE_INERTIA_KGM2)}
    if stops is not None:
        action = {
            "solreflimit": hard["solref"],
            "solimplimit": hard["solimp"],
            "range": text(stops.flexion_limit_rad),
        }
    ElementTree.SubElement(
        body,
        "joint",
        action,
        name=name,
        type="hinge",
        axis=text((0.0, 0.0, mirror)),
        stiffness=repr(stiffness_Nm_per_rad),
        damping=repr(damping_Nms_per_rad),
    )


def _add_stops(
    tendons: ElementTree.Element, joint: FlexureJoint, names: list[str], tendon_name: str, hard: dict[str, str]
) -> None:
    tendon = ElementTree.SubElement(
        tendons,
        "fixed",
        name=tendon_name,
        limited="true",
        range=text(joint.flexion_limit_rad),
        solreflimit=hard["solref"],
        solimplimit=hard["solimp"],
    )
    for name in names:
        ElementTree.SubElement(tendon, "joint", joint=name, coef="1")


def _add_link_inertia(body: ElementTree.Element, length_m: float, mass_kg: float) -> None:
    """A uniform box of the link's length and the T42's cross-section."""
    sides_m = np.array([length_m, FINGER_THICKNESS_M, FINGER_WIDTH_M])
    squares = sides_m**2
    ElementTree.SubElement(
        body,
        "inertial",
        pos=text((length_m / 2, 0.0, 0.0)),
        mass=repr(mass_kg),
        diaginertia=text(mass_kg / 12 * (squares.sum() - squares)),
    )


def _add_piece_inertia(body: ElementTree.Element) -> None:
    ElementTree.SubElement(body, "inertial", pos="0 0 0", mass=repr(_PIECE_MASS_KG), diaginertia="1e-12 1e-12 1e-12")


def _add_tip(link: ElementTree.Element, finger: Finger, side: str) -> None:
    radius_m, pad_m = finger.tip.radius_m, finger.tip.pad_length_m
    if radius_m <= 0.0:
        raise MechanicsError(
            f"finger.{side}.tip.radius_m", "a point tip cannot be simulated.", help="Give it 1 mm or more."
        )
    centre_m = finger.distal_link_m - radius_m
    shape = {"type": "sphere", "size": repr(radius_m), "pos": text((centre_m, 0.0, 0.0))}
    if pad_m > 0.0:  # the pad is tangent to the arc: the side of a capsule along the link that ends in the arc
        shape = {"type": "capsule", "size": repr(radius_m), "fromto": text((centre_m - pad_m, 0, 0, centre_m, 0, 0))}
    ElementTree.SubElement(link, "geom", shape, name=f"tip_{side}")
    ElementTree.SubElement(link, "site", name=f"tip_{side}", pos=text((centre_m, 0.0, 0.0)))
