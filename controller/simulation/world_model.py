"""The MuJoCo model of the simulated world: arm, hand, object and support in one MJCF document.

World frame: z up, gravity 9.81 m/s². Bodies: `base` (DH frame 0) … `tool` (wrist W) → `hand` (hand frame H) → fingers
and spools; `object` free. Parts: `world_arm.py`, `world_hand.py`, `world_finger.py`, `world_object.py`. Only named
pairs touch: each fingertip and the object, the object and the support; so friction is what is stated there, and no
default of MuJoCo's mixes in.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from calibration.hand.parameters import SIDES, Finger, Hand
from controller.simulation.world_arm import ArmImperfections, add_arm, text
from controller.simulation.world_finger import PARTS, hinge_names
from controller.simulation.world_hand import add_hand
from controller.simulation.world_object import ObjectSetting, add_object
from controller.simulation.world_tendon import tendon_rest_m
from drivers.errors import InputError
from drivers.wam.parameters import JOINTS, WamParameters

GRAVITY_M_S2 = 9.81
CONTACT_IMPEDANCE = "0.3 0.999 1e-5 0.5 2"
"""Soft at first touch, hard within 10 µm. MuJoCo's convex friction lifts a sliding contact, here by 4 µm at a tip speed
of 8 mm/s; a contact that is hard from the start would lose touch over and over, and hammer."""


@dataclass(frozen=True)
class Imperfections:
    """How the world differs from the nominal models: rough hardware by default, ideal with `Imperfections.none()`."""

    arm_coulomb_Nm: tuple[float, ...] = (1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05)
    arm_viscous: bool = True
    link_mass_spread: float = 0.03
    """Largest relative error of a link's mass and inertia; drawn uniformly from the seed."""
    gear_friction_Nm: float = 0.233
    """Friction at a tendon motor's output shaft: 0.13 A × 1.79 N·m/A (dynamixel reference 3.1, 3.3)."""

    @classmethod
    def none(cls) -> Imperfections:
        """No friction in arm and gears, exact masses."""
        return cls((0.0,) * JOINTS, arm_viscous=False, link_mass_spread=0.0, gear_friction_Nm=0.0)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where things are when the world begins; 4×4 poses, joint angles of shape (7,) in rad."""

    T_world_base: NDArray[np.float64]
    T_wrist_hand: NDArray[np.float64]
    T_world_object: NDArray[np.float64]
    joint_rad: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WorldModel:
    """A compiled model and where its parts are: indices into MuJoCo's arrays, fingers in the order right, left."""

    model: mujoco.MjModel
    arm: slice
    """Arm coordinates, the same in position and velocity; empty when the arm is welded."""
    finger: tuple[tuple[NDArray[np.intp], NDArray[np.intp]], tuple[NDArray[np.intp], NDArray[np.intp]]]
    """Hinges of each finger's proximal and distal joint; a joint's flexion is the sum over its hinges."""
    spool: NDArray[np.intp] = field(repr=False)
    tendon: NDArray[np.intp] = field(repr=False)
    spool_radius_m: float
    tendon_feed: tuple[int | None, int | None]
    """Of a tendon that a reel draws: the tendon that couples the reel, whose length is how far it lags."""
    tendon_rest_m: NDArray[np.float64] = field(repr=False)
    """Length of each tendon when the hand rests, (2,)."""
    tip_geom: NDArray[np.intp] = field(repr=False)
    tip_site: NDArray[np.intp] = field(repr=False)
    """Centres of the fingertip arcs."""
    support_geom: int | None
    wrist_body: int
    hand_body: int
    object_body: int


def build_world_model(
    hand: Hand,
    setting: ObjectSetting,
    arm_parameters: WamParameters,
    placement: Placement,
    *,
    seed: int,
    physics_period_s: float,
    imperfections: Imperfections,
    spool_radius_m: float,
    hand_only: bool,
) -> WorldModel:
    """Write the MJCF document and compile it.

    Raises InputError for a pose that cannot be, MechanicsError for a hand or object that cannot be simulated.
    """
    # Twice the step is the stiffest that MuJoCo's constraints may be; 0.9999 the hardest.
    hard = {"solref": text((2 * physics_period_s, 1.0)), "solimp": "0.9999 0.9999 0.001 0.5 2"}
    touch = hard | {"solimp": CONTACT_IMPEDANCE, "solreffriction": text((8 * physics_period_s, 1.0))}
    root = ElementTree.Element("mujoco", model="stillgrasp")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    option = ElementTree.SubElement(
        root,
        "option",
        timestep=repr(physics_period_s),
        gravity=text((0.0, 0.0, -GRAVITY_M_S2)),
        integrator="discrete",  # forces of springs and contacts in one solve; the others chatter on stiff contacts
        solver="Newton",
        cone="elliptic",
        jacobian="dense",  # MuJoCo 4.0.0 factorises the sparse one wrongly (its issue 3767)
        impratio="10000",  # friction that holds: fingertips creep 0.1 µm/s under 2 N
        iterations="50",
        tolerance="1e-10",
    )
    ElementTree.SubElement(option, "flag", autoreset="disable")  # a world that diverges must say so, not start again
    default = ElementTree.SubElement(root, "default")
    ElementTree.SubElement(
        default, "joint", solreffriction=hard["solref"], solimpfriction=hard["solimp"], solreflimit=hard["solref"]
    )
    ElementTree.SubElement(default, "geom", contype="0", conaffinity="0", mass="0")
    asset = ElementTree.SubElement(root, "asset")
    worldbody = ElementTree.SubElement(root, "worldbody")
    tendons = ElementTree.SubElement(root, "tendon")
    equalities = ElementTree.SubElement(root, "equality")
    contact = ElementTree.SubElement(root, "contact")

    position, quaternion = mjcf_pose("T_world_base", placement.T_world_base)
    base = ElementTree.SubElement(worldbody, "body", name="base", pos=position, quat=quaternion)
    generator = np.random.default_rng(seed)
    factors = 1.0 + imperfections.link_mass_spread * generator.uniform(-1.0, 1.0, JOINTS)
    differences = ArmImperfections(
        imperfections.arm_coulomb_Nm, tuple(float(factor) for factor in factors), imperfections.arm_viscous
    )
    tool = add_arm(base, arm_parameters, differences, placement.joint_rad if hand_only else None)
    add_hand(
        tool,
        tendons,
        equalities,
        hand,
        pose=mjcf_pose("T_wrist_hand", placement.T_wrist_hand),
        spool_radius_m=spool_radius_m,
        gear_friction_Nm=imperfections.gear_friction_Nm,
        hard=hard,
        prescribed_spools=hand_only,
    )
    place = mjcf_pose("T_world_object", placement.T_world_object)
    add_object(worldbody, asset, contact, setting, placement.T_world_object, place, touch)
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    return _indexed(model, hand, spool_radius_m)


def mjcf_pose(name: str, pose: NDArray[np.float64]) -> tuple[str, str]:
    """Position and quaternion (wxyz) of a 4×4 pose as MJCF writes them. Raises InputError if it is not a rigid pose."""
    rotation = pose[:3, :3]
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)) or np.any(pose[3] != (0.0, 0.0, 0.0, 1.0)):
        raise InputError(f"{name} is not a pose: expected a finite 4×4 matrix whose last row is 0 0 0 1.")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0.0:
        raise InputError(f"{name} has no rotation in its upper left 3×3: expected orthonormal, right-handed axes.")
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return text(pose[:3, 3]), text(quaternion)


def _indexed(model: mujoco.MjModel, hand: Hand, spool_radius_m: float) -> WorldModel:
    def named(kind: mujoco.mjtObj, name: str) -> int:
        return int(mujoco.mj_name2id(model, kind, name))

    def degree_of_freedom(name: str) -> int:
        return int(model.jnt_dofadr[named(mujoco.mjtObj.mjOBJ_JOINT, name)])

    def feed(side: str) -> int | None:
        tendon = named(mujoco.mjtObj.mjOBJ_TENDON, f"feed_{side}")
        return tendon if tendon >= 0 else None

    def hinges(finger: Finger, side: str, part: int) -> NDArray[np.intp]:
        return np.array([degree_of_freedom(name) for name in hinge_names(finger.joints[part], PARTS[part], side)])

    fingers = [
        (hinges(finger, side, 0), hinges(finger, side, 1)) for finger, side in zip(hand.fingers, SIDES, strict=True)
    ]
    support = named(mujoco.mjtObj.mjOBJ_GEOM, "support")
    arm = slice(0, JOINTS if named(mujoco.mjtObj.mjOBJ_JOINT, "arm_1") >= 0 else 0)
    # Every joint before the object's free joint has one coordinate, so positions and velocities share their indices.
    return WorldModel(
        model=model,
        arm=arm,
        finger=(fingers[0], fingers[1]),
        spool=np.array([degree_of_freedom(f"spool_{side}") for side in SIDES]),
        tendon=np.array([named(mujoco.mjtObj.mjOBJ_TENDON, f"tendon_{side}") for side in SIDES]),
        spool_radius_m=spool_radius_m,
        tendon_feed=(feed("right"), feed("left")),
        tendon_rest_m=np.array([tendon_rest_m(finger) for finger in hand.fingers]),
        tip_site=np.array([named(mujoco.mjtObj.mjOBJ_SITE, f"tip_{side}") for side in SIDES]),
        tip_geom=np.array([named(mujoco.mjtObj.mjOBJ_GEOM, f"tip_{side}") for side in SIDES]),
        support_geom=support if support >= 0 else None,
        wrist_body=named(mujoco.mjtObj.mjOBJ_BODY, "tool"),
        hand_body=named(mujoco.mjtObj.mjOBJ_BODY, "hand"),
        object_body=named(mujoco.mjtObj.mjOBJ_BODY, "object"),
    )
