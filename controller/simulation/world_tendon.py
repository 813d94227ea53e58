"""The tendons of the simulated world, from spool to finger; lengths in m, order of fingers right, left.

A tendon pulls when it is stretched, and never pushes: without elasticity it is the unilateral constraint stretch ≤ 0,
with elasticity a spring that only pulls. Its stretch is what the spool has wound up less what the joints have taken
up. Laws: hand-mechanics reference 4.

Where all its offsets are constant, that difference is linear in the joints: a MuJoCo fixed tendon, spool radius × spool
angle less the offsets × flexions. A run that is straight between two guides is a MuJoCo spatial tendon, which joints
cannot lengthen; so there the spool feeds a reel, a slide of next to no weight that is coupled to the spool and to the
joints with constant offsets, and draws the tendon's own end.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from math import isinf

from calibration.hand.parameters import (
    Finger,
    FlexureJoint,
    PinJoint,
    StraightTendonAtFlexure,
    StraightTendonAtPin,
)
from controller.simulation.world_arm import text
from controller.simulation.world_finger import PARTS, guide_names, hinge_names
from drivers.errors import MechanicsError

SLACK_M = 1.0  # as good as unbounded: no tendon travels that far
_REEL_M = 0.2
"""From the reel to where the tendon leaves it, at rest: farther than any tendon is let out."""
_REEL_INERTIA_KG = 1.0
"""Of the slide alone, nothing to gravity: a hundredth of what the motor's rotor is at the spool's rim."""


def add_tendon(
    palm: ElementTree.Element,
    tendons: ElementTree.Element,
    equalities: ElementTree.Element,
    finger: Finger,
    side: str,
    spool_radius_m: float,
    hard: dict[str, str],
) -> None:
    """Append `tendon_right` or `tendon_left` over the finger's hinges and guides; finger and spool are there already.

    A straight tendon comes with a fixed tendon `feed_right` and a joint `reel_right`. `hard`: constraint attributes.
    Raises MechanicsError for a tendon that cannot be simulated.
    """
    if finger.routing_friction != 0.0:
        raise MechanicsError(
            f"finger.{side}.routing_friction",
            "cannot be simulated: the physics has no friction that grows with a tendon's tension.",
            help="Set it to 0.",
        )
    straight = [part for part, joint in zip(PARTS, finger.joints, strict=True) if straight_rest_m(joint) is not None]
    if not straight:
        tendon = _tendon(tendons, "fixed", finger, side, hard)
        _add_constant_runs(tendon, finger, side, spool_radius_m)
        return
    reel = ElementTree.SubElement(palm, "body", name=f"reel_{side}")
    ElementTree.SubElement(
        reel, "joint", name=f"reel_{side}", type="slide", axis="1 0 0", armature=repr(_REEL_INERTIA_KG)
    )
    ElementTree.SubElement(reel, "inertial", pos="0 0 0", mass="1e-9", diaginertia="1e-12 1e-12 1e-12")
    ElementTree.SubElement(reel, "site", name=f"reel_{side}")
    ElementTree.SubElement(palm, "site", name=f"reel_end_{side}", pos=text((-_REEL_M, 0.0, 0.0)))
    feed = ElementTree.SubElement(tendons, "fixed", name=f"feed_{side}")
    _add_constant_runs(feed, finger, side, spool_radius_m)
    ElementTree.SubElement(feed, "joint", joint=f"reel_{side}", coef="-1")
    ElementTree.SubElement(equalities, "tendon", hard, tendon1=f"feed_{side}")
    tendon = _tendon(tendons, "spatial", finger, side, hard)
    for name in (f"reel_{side}", f"reel_end_{side}"):
        ElementTree.SubElement(tendon, "site", site=name)
    for part in straight:
        ElementTree.SubElement(tendon, "pulley", divisor="1")  # between the runs its length does not change
        for name in guide_names(part, side):
            ElementTree.SubElement(tendon, "site", site=name)


def straight_rest_m(joint: PinJoint | FlexureJoint) -> float | None:
    """Distance of the guides of a straight run at rest, m; None for a tendon at a constant offset."""
    if isinstance(joint.tendon, StraightTendonAtPin):
        return joint.tendon.before_m + joint.tendon.after_m
    if isinstance(joint, FlexureJoint) and isinstance(joint.tendon, StraightTendonAtFlexure):
        return joint.length_m
    return None


def tendon_rest_m(finger: Finger) -> float:
    """Length of the finger's MuJoCo tendon at rest, m."""
    straight = [rest_m for joint in finger.joints if (rest_m := straight_rest_m(joint)) is not None]
    return _REEL_M + sum(straight) if straight else 0.0


def _tendon(
    tendons: ElementTree.Element, kind: str, finger: Finger, side: str, hard: dict[str, str]
) -> ElementTree.Element:
    stiffness_N_per_m, rest_m = finger.tendon_stiffness_N_per_m, tendon_rest_m(finger)
    slackest_m = -SLACK_M if kind == "fixed" else 0.0
    if isinf(stiffness_N_per_m):
        action = {
            "limited": "true",
            "range": text((slackest_m, rest_m)),
            "solreflimit": hard["solref"],
            "solimplimit": hard["solimp"],
        }
    else:
        action = {"stiffness": repr(stiffness_N_per_m), "springlength": text((slackest_m, rest_m))}
    return ElementTree.SubElement(tendons, kind, action, name=f"tendon_{side}")


def _add_constant_runs(tendon: ElementTree.Element, finger: Finger, side: str, spool_radius_m: float) -> None:
    for part, joint, arm_m in zip(PARTS, finger.joints, finger.tendon_arm_m, strict=True):
        if straight_rest_m(joint) is None:
            for name in hinge_names(joint, part, side):
                ElementTree.SubElement(tendon, "joint", joint=name, coef=repr(-arm_m))
    ElementTree.SubElement(tendon, "joint", joint=f"spool_{side}", coef=repr(spool_radius_m))
