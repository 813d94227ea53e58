"""The hand as bodies of the simulated world: palm, fingers (`world_finger.py`), tendons (`world_tendon.py`) and motor
spools, two of each.

Frame: hand frame H (x right, y out of the palm, z = x × y along the pins, origin midway between the roots). Order
right, left.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from calibration.hand.parameters import SIDES, Hand
from controller.simulation.world_arm import text
from controller.simulation.world_finger import add_finger
from controller.simulation.world_tendon import add_tendon

SPOOL_INERTIA_KGM2 = 0.01
"""Motor rotor through the 353:1 gear [assumed]: with the motor's resistance and constant a time constant of 12 ms."""
SPOOL_VISCOUS_NMS_PER_RAD = 0.005
_PRESCRIBED_SPOOL_INERTIA_KGM2 = 1e6  # no tendon can change the speed of such a spool


def add_hand(
    parent: ElementTree.Element,
    tendons: ElementTree.Element,
    equalities: ElementTree.Element,
    hand: Hand,
    *,
    pose: tuple[str, str],
    spool_radius_m: float,
    gear_friction_Nm: float,
    hard: dict[str, str],
    prescribed_spools: bool,
) -> None:
    """Append the hand to `parent` at `pose` (position and quaternion as MJCF writes them), its tendons to `tendons`
    and what couples them to `equalities`.

    `hard` are the constraint attributes of hard stops and tendons. Names: body `hand`, joint `spool_right`, the
    same for left, and those of `world_finger.py` and `world_tendon.py`. Raises MechanicsError for a hand that cannot be
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
        add_tendon(palm, tendons, equalities, finger, side, spool_radius_m, hard)


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
