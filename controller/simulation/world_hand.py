"""The hand as bodies of the simulated world: two spring-loaded fingers, two tendons, two motor spools.

Frame: hand frame H (x right, y out of the palm, z = x × y along the pins, origin midway between the roots). Joint
coordinates are flexion from rest, positive = closing; order right, left. Lengths, springs and arms: hand-mechanics
reference 1, 2, 4.

A tendon is a MuJoCo fixed tendon whose length is its stretch, spool radius × spool angle less the arms × flexions:
constant arms, as in the reference, and no force when that is negative. A tendon without elasticity is the unilateral
constraint stretch ≤ 0; one with elasticity is a spring that only pulls.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from math import cos, isinf, pi, sin

import numpy as np

from calibration.hand.parameters import SIDES, Finger, Hand, PinJoint
from controller.simulation.world_arm import text
from drivers.errors import MechanicsError

SPOOL_INERTIA_KGM2 = 0.01
"""Motor rotor through the 353:1 gear [assumed]: with the motor's resistance and constant a time constant of 12 ms."""
SPOOL_VISCOUS_NMS_PER_RAD = 0.005
JOINT_DAMPING_NMS_PER_RAD = 0.003
"""Loss in the rubber [assumed]: 0.2 of critical at the proximal joint; under 1 % of the spring while squeezing."""
FINGER_WIDTH_M = 0.03175
"""Along the pins (openhand-t42 reference 3)."""
FINGER_THICKNESS_M = 0.018
_PRESCRIBED_SPOOL_INERTIA_KGM2 = 1e6  # no tendon can change the speed of such a spool
_SLACK_M = 1.0  # as good as unbounded: no tendon travels that far


def add_hand(
    parent: ElementTree.Element,
    tendons: ElementTree.Element,
    hand: Hand,
    *,
    pose: tuple[str, str],
    spool_radius_m: float,
    gear_friction_Nm: float,
    hard: dict[str, str],
    prescribed_spools: bool,
) -> None:
    """Append the hand to `parent` at `pose` (position and quaternion as MJCF writes them), its tendons to `tendons`.

    `hard` are the constraint attributes of hard stops and tendons. Names: bodies `hand`, `proximal_right`, …, joints
    `proximal_right`, `distal_right`, `spool_right`, tendons `tendon_right`, geoms `tip_right`, and the same for left.
    Raises MechanicsError for a joint that is not a pin.
    """
    position, quaternion = pose
    palm = ElementTree.SubElement(parent, "body", name="hand", pos=position, quat=quaternion)
    ElementTree.SubElement(
        palm,
        "inertial",
        pos=text(hand.body.com_m),
        mass=repr(hand.body.mass_kg),
        fullinertia=text(hand.body.inertia_kgm2),
    )
    for side, finger in zip(SIDES, hand.fingers, strict=True):
        _add_finger(palm, finger, side, hand.root_half_distance_m, hard)
        _add_spool(palm, side, gear_friction_Nm, prescribed_spools)
        _add_tendon(tendons, finger, side, spool_radius_m, hard)


def _add_finger(
    palm: ElementTree.Element, finger: Finger, side: str, half_distance_m: float, hard: dict[str, str]
) -> None:
    mirror = 1.0 if side == "right" else -1.0
    rest_rad = finger.rest_angle_rad
    root_rad = rest_rad[0] if side == "right" else pi - rest_rad[0]
    lengths_m = (finger.proximal_link_m, finger.distal_link_m)
    masses_kg = (finger.proximal_mass_kg, finger.distal_mass_kg)
    origins = (((mirror * half_distance_m, 0.0, 0.0), root_rad), ((lengths_m[0], 0.0, 0.0), mirror * rest_rad[1]))
    body = palm
    for index, part in enumerate(("proximal", "distal")):
        joint = finger.joints[index]
        if not isinstance(joint, PinJoint):
            key = f"finger.{side}.{part}_joint.kind"
            raise MechanicsError(key, "flexures cannot be simulated yet; expected a pin.", help="Use a hand with pins.")
        origin_m, angle_rad = origins[index]
        quaternion = (cos(angle_rad / 2), 0.0, 0.0, sin(angle_rad / 2))
        body = ElementTree.SubElement(body, "body", name=f"{part}_{side}", pos=text(origin_m), quat=text(quaternion))
        ElementTree.SubElement(
            body,
            "joint",
            {"solreflimit": hard["solref"], "solimplimit": hard["solimp"]},
            name=f"{part}_{side}",
            type="hinge",
            axis=text((0.0, 0.0, mirror)),
            stiffness=repr(joint.stiffness_Nm_per_rad),
            damping=repr(JOINT_DAMPING_NMS_PER_RAD),
            range=text(joint.flexion_limit_rad),
        )
        _add_link_inertia(body, lengths_m[index], masses_kg[index])
    radius_m = finger.tip.radius_m
    if radius_m <= 0.0:
        raise MechanicsError(
            f"finger.{side}.tip.radius_m", "a point tip cannot be simulated.", help="Give it 1 mm or more."
        )
    if finger.routing_friction != 0.0:
        raise MechanicsError(f"finger.{side}.routing_friction", "cannot be simulated yet; expected 0.")
    ElementTree.SubElement(
        body,
        "geom",
        name=f"tip_{side}",
        type="sphere",
        size=repr(radius_m),
        pos=text((lengths_m[1] - radius_m, 0.0, 0.0)),
    )


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


def _add_spool(palm: ElementTree.Element, side: str, friction_Nm: float, prescribed: bool) -> None:
    # Next to no mass of its own: the motors' belongs to the hand's body.
    body = ElementTree.SubElement(palm, "body", name=f"spool_{side}")
    ElementTree.SubElement(
        body,
        "joint",
        name=f"spool_{side}",
        type="hinge",
        axis="0 0 1",
        armature=repr(_PRESCRIBED_SPOOL_INERTIA_KGM2 if prescribed else SPOOL_INERTIA_KGM2),
        damping=repr(0.0 if prescribed else SPOOL_VISCOUS_NMS_PER_RAD),
        frictionloss=repr(0.0 if prescribed else friction_Nm),
    )
    ElementTree.SubElement(body, "inertial", pos="0 0 0", mass="1e-9", diaginertia="1e-12 1e-12 1e-12")


def _add_tendon(
    tendons: ElementTree.Element, finger: Finger, side: str, spool_radius_m: float, hard: dict[str, str]
) -> None:
    stiffness_N_per_m = finger.tendon_stiffness_N_per_m
    if isinf(stiffness_N_per_m):
        action = {
            "limited": "true",
            "range": text((-_SLACK_M, 0.0)),
            "solreflimit": hard["solref"],
            "solimplimit": hard["solimp"],
        }
    else:
        action = {"stiffness": repr(stiffness_N_per_m), "springlength": text((-_SLACK_M, 0.0))}
    tendon = ElementTree.SubElement(tendons, "fixed", action, name=f"tendon_{side}")
    for joint, arm_m in zip(("proximal", "distal"), finger.tendon_arm_m, strict=True):
        ElementTree.SubElement(tendon, "joint", joint=f"{joint}_{side}", coef=repr(-arm_m))
    ElementTree.SubElement(tendon, "joint", joint=f"spool_{side}", coef=repr(spool_radius_m))
