"""The hand as bodies of the simulated world: palm, two fingers (`world_finger.py`), two tendons, two motor spools.

Frame: hand frame H (x right, y out of the palm, z = x × y along the pins, origin midway between the roots). Joint
coordinates are flexion from rest, positive = closing; order right, left. Arms: hand-mechanics reference 4.

A tendon is a MuJoCo fixed tendon whose length is its stretch, spool radius × spool angle less the arms × flexions:
constant arms, as in the reference, and no force when that is negative. A tendon without elasticity is the unilateral
constraint stretch ≤ 0; one with elasticity is a spring that only pulls.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from math import isinf

from calibration.hand.parameters import SIDES, Finger, Hand
from controller.simulation.world_arm import text
from controller.simulation.world_finger import PARTS, add_finger, hinge_names
from drivers.errors import MechanicsError

SPOOL_INERTIA_KGM2 = 0.01
"""Motor rotor through the 353:1 gear [assumed]: with the motor's resistance and constant a time constant of 12 ms."""
SPOOL_VISCOUS_NMS_PER_RAD = 0.005
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

    `hard` are the constraint attributes of hard stops and tendons. Names: body `hand`, joint `spool_right`, tendon
    `tendon_right`, the same for left, and those of `world_finger.py`. Raises MechanicsError for a hand that cannot be
    simulated.
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
        add_finger(palm, tendons, finger, side, hand.root_half_distance_m, hard)
        _add_spool(palm, side, gear_friction_Nm, prescribed_spools)
        _add_tendon(tendons, finger, side, spool_radius_m, hard)


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
    if finger.routing_friction != 0.0:
        raise MechanicsError(f"finger.{side}.routing_friction", "cannot be simulated yet; expected 0.")
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
    for part, joint, arm_m in zip(PARTS, finger.joints, finger.tendon_arm_m, strict=True):
        for name in hinge_names(joint, part, side):
            ElementTree.SubElement(tendon, "joint", joint=name, coef=repr(-arm_m))
    ElementTree.SubElement(tendon, "joint", joint=f"spool_{side}", coef=repr(spool_radius_m))
