"""The mechanics against the simulated world, which shares none of them: bodies, springs, contacts and friction instead.

Both tendons are wound at equal rate from first contact, slowly, with the hand held fast; at equal finger-side
excursions the object must be where the table says. A table knows no friction but that of rolling contacts, so the
object stands on a support without any; paths with friction of support and fingertips are held against rough ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.build import build_table
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.friction import OnTable, sliding
from calibration.grasp.path import Path, trace
from calibration.grasp.preposition import first_contact
from calibration.grasp.slip import SlippingTips
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import FlexureJoint, Hand, PinJoint, StraightTendonAtFlexure, Tip, load_hand
from calibration.motion_table import Status
from calibration.objects.parameters import GraspObject, Support, load_object
from calibration.objects.shapes import Disc
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.world import World
from drivers.wam.parameters import load_wam_parameters

RATE_M_S = 2e-3
"""Of winding; the joints' damping then takes 1 % of the tension of a fitted hand, six times that of a nominal one."""
NOMINAL_RATE_M_S = 5e-4
COARSE_PERIOD_S = 1e-3
END_SHARE = 0.9
"""Of the domain: up to the first stop, where paths have a kink."""
POINTS = 12
NODES = 13
SPOOL_RADIUS_M = 0.0105
STANDING_HEIGHT_M = 0.02
"""Objects on rough supports are low, or the drag at the foot would tilt them."""
WRIST_HEIGHT_M = (
    0.9109  # of the arm pointing straight up (WAM reference 6.1): hand frame and world then share their axes
)


@dataclass(frozen=True, eq=False)
class Seen:
    """Object motion in the hand since first contact, (points, 3): x, y in m and θ in rad; finger-side excursions since
    then, (points, 2) m, right and left; and all else."""

    motion: NDArray[np.float64]
    excursion_m: NDArray[np.float64]
    truths: list[WorldTruth]
    world: World


def squeeze(
    hand: Hand,
    grasped: GraspObject,
    grasp: GraspSpec,
    end_m: float,
    *,
    support_friction: float = 0.0,
    tip_friction: float = 1.0,
    rate_m_s: float = RATE_M_S,
    physics_period_s: float = 5e-4,
) -> Seen:
    """Wind a hand without arm to the spool excursion `end_m` past first contact, in `POINTS` steps."""
    contact = first_contact(hand, grasped, grasp)
    T_world_object = np.eye(4)
    T_world_object[:3, 3] = (*contact.object_pose[:2], WRIST_HEIGHT_M)
    world = World(
        hand,
        msgspec.structs.replace(grasped, support=Support(friction=support_friction), height_m=STANDING_HEIGHT_M),
        load_wam_parameters(),
        T_world_base=np.eye(4),
        T_wrist_hand=np.eye(4),
        T_world_object=T_world_object,
        joint_rad=np.zeros(7),
        spool_radius_m=SPOOL_RADIUS_M,
        physics_period_s=physics_period_s,
        outline_angle_rad=contact.outline_angle_rad,
        tip_friction=(tip_friction, tip_friction),
        hand_only=True,
    )
    short_m = 2e-4  # close to this side of contact, let the fingers come to rest, then go on slowly
    stretch_m = contact.tendon_load_N / np.array([finger.tendon_stiffness_N_per_m for finger in hand.fingers])
    before_m = contact.tendon_excursion_m + stretch_m - short_m
    for speed_m_s, duration_s in ((before_m, 1.0), (np.zeros(2), 0.3), (np.full(2, rate_m_s), short_m / rate_m_s)):
        world.wind_spools(tuple(speed_m_s / SPOOL_RADIUS_M))
        world.advance_to(world.time_ns + round(duration_s * 1e9))
    observer = WorldObserver(world, hand)
    truths = []
    for _ in range(POINTS):
        world.advance_to(world.time_ns + round(end_m / POINTS / rate_m_s * 1e9))
        truths.append(observer.truth())
    poses = np.array([truth.T_hand_object for truth in truths])
    moved_m = poses[:, :2, 3] - contact.object_pose[:2]
    turned_rad = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])  # the axes of hand and object agree at first contact
    excursion_m = np.array([truth.tendon_excursion_m for truth in truths]) - contact.tendon_excursion_m
    return Seen(np.column_stack([moved_m, turned_rad]), excursion_m, truths, world)


def assert_table_agrees(
    hand: Hand,
    grasped: GraspObject,
    grasp: GraspSpec,
    *,
    rate_m_s: float = RATE_M_S,
    physics_period_s: float = 5e-4,
    force_N: float = 0.1,
) -> None:
    """Build the table, wind the world, compare to 0.5 % of the motion and 0.2°, tensions to 2 %, contact forces to
    `force_N` or 3 %: the damping of the joints, that the table does not know, takes most of it."""
    grasp = msgspec.structs.replace(grasp, supported=False)
    table = build_table(hand, grasped, grasp, nodes=NODES)
    end_m = END_SHARE * table.mean_excursion_end_m(0.0)
    seen = squeeze(hand, grasped, grasp, end_m, rate_m_s=rate_m_s, physics_period_s=physics_period_s)
    total_m = np.linalg.norm(seen.motion[-1, :2])
    assert total_m > 0.013
    for motion, excursion_m, truth in zip(seen.motion, seen.excursion_m, seen.truths, strict=True):
        sample = table.at_excursion(float(excursion_m.mean()), float(excursion_m[0] - excursion_m[1]))
        assert sample.status is Status.INSIDE
        difference = motion - np.array(sample.planar_motion)
        assert np.linalg.norm(difference[:2]) <= 5e-3 * total_m
        assert abs(difference[2]) <= np.radians(0.2)
        assert truth.tendon_tension_N == pytest.approx(sample.tension, rel=0.02)
        assert truth.contact_force_N == pytest.approx(sample.contact_force, rel=0.03, abs=force_N)


@pytest.mark.parametrize("onset_split", [0.0, 0.1])
@pytest.mark.parametrize("grasped", ["cylinder40", "rubiks_cube", "pear"])
@pytest.mark.parametrize("hand", ["t42pp", "t42pf", "t42ff"])
def test_object_is_where_the_table_says(hand: str, grasped: str, onset_split: float) -> None:
    """The compensation is only as good as the table: every hand, a round, a flat-sided and a curved outline."""
    assert_table_agrees(load_hand(hand), load_object(grasped), GraspSpec(onset_split=onset_split))


@pytest.mark.parametrize("onset_split", [0.0, 0.1])
def test_nominal_hand_is_where_the_table_says(onset_split: float) -> None:
    """Soft joints, a larger arc: the other preset, wound four times slower for its weaker springs."""
    assert_table_agrees(
        load_hand("t42pf", "nominal"),
        load_object("strawberry"),
        GraspSpec(onset_split=onset_split),
        rate_m_s=NOMINAL_RATE_M_S,
        physics_period_s=COARSE_PERIOD_S,
    )


def with_right_finger(hand: Hand, *, both: bool = True, **changes: FlexureJoint | PinJoint | Tip | float) -> Hand:
    """The hand with keys of its right finger changed, or of both."""
    right = msgspec.structs.replace(hand.right, **changes)
    return msgspec.structs.replace(hand, right=right, left=right if both else hand.left)


def stiffer_on_the_right() -> Hand:
    hand = load_hand("t42pp")
    stiffer = msgspec.structs.replace(hand.right.joints[0], stiffness_Nm_per_rad=0.2)
    return with_right_finger(hand, both=False, proximal_joint=stiffer)


def with_elastic_tendons() -> Hand:
    return with_right_finger(load_hand("t42pf"), tendon_stiffness_N_per_m=4e4)


def with_straight_tendons() -> Hand:
    hand = load_hand("t42pf")
    distal = hand.right.joints[1]
    straight = msgspec.structs.replace(distal, tendon=StraightTendonAtFlexure(), flexion_limit_deg=(0.0, 68.0))
    return with_right_finger(hand, distal_joint=straight)


@pytest.mark.parametrize("changed", [stiffer_on_the_right, with_elastic_tendons, with_straight_tendons])
def test_changed_hand_is_where_the_table_says(changed: Callable[[], Hand]) -> None:
    """Fingers that differ, tendons that stretch, tendons that run straight: what no file of a hand has."""
    assert_table_agrees(changed(), load_object("cylinder40"), GraspSpec(onset_split=0.1))


def test_contact_passes_from_pad_to_arc_as_in_the_table() -> None:
    """A wide object first touches the pad of a finger that leans outwards, and rolls on to its arc."""
    hand = load_hand("t42pp")
    tip = Tip(radius_m=hand.right.tip.radius_m, pad_length_m=0.012)
    wide = msgspec.structs.replace(load_object("cylinder40"), shape=Disc(diameter_m=0.11))
    assert_table_agrees(with_right_finger(hand, tip=tip), wide, GraspSpec(onset_split=0.1))


def assert_path_agrees(path: Path, seen: Seen, share: float, angle_deg: float) -> None:
    """Motion at equal mean excursion to a share of the whole and an angle; tensions to 4 %."""
    wound_m = path.excursion_m.mean(axis=1)

    def at(excursion_m: float, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([np.interp(excursion_m, wound_m, column) for column in columns.T])

    total_m = np.linalg.norm(seen.motion[-1, :2])
    for motion, excursion_m, truth in zip(seen.motion, seen.excursion_m, seen.truths, strict=True):
        difference = motion - at(float(excursion_m.mean()), path.motion)
        assert np.linalg.norm(difference[:2]) <= share * total_m
        assert abs(difference[2]) <= np.radians(angle_deg)
        assert truth.tendon_tension_N == pytest.approx(at(float(excursion_m.mean()), path.load_N), rel=0.04)


@pytest.mark.parametrize(
    ("hand", "grasped", "onset_split", "share", "angle_deg"),
    [
        ("t42pp", "cylinder40", 0.0, 0.002, 0.0),
        ("t42pp", "cylinder40", 0.1, 0.005, 0.3),
        ("t42pf", "mustard", 0.0, 0.004, 0.0),
    ],
)
def test_support_drags_as_the_friction_law_says(
    hand: str, grasped: str, onset_split: float, share: float, angle_deg: float
) -> None:
    """100 g and 600 g on friction 0.3, fingertips that hold: the path with the limit surface of the support."""
    model, standing = load_hand(hand), load_object(grasped)
    grasp = GraspSpec(onset_split=onset_split)
    system = grasp_system(model, standing, grasp)
    path = trace(system, rule=OnTable(system, sliding(standing)), past_stops=False)
    end_m = 0.8 * float(path.excursion_m[-1].mean())
    seen = squeeze(model, standing, grasp, end_m, support_friction=0.3, tip_friction=3.0)
    assert_path_agrees(path, seen, share, angle_deg + 0.01)


@pytest.mark.parametrize(
    ("hand", "grasped", "tip_friction", "share"),
    [("t42pp", "cylinder40", 1.0, 0.002), ("t42pf", "mustard", 0.5, 0.015)],
)
def test_fingertips_slip_as_far_as_the_friction_law_says(
    hand: str, grasped: str, tip_friction: float, share: float
) -> None:
    """On a rough support the tips slip until they press harder than it drags: 0.3 mm with 100 g, 3 mm with 600 g."""
    model, standing, grasp = load_hand(hand), load_object(grasped), GraspSpec()
    system = grasp_system(model, standing, grasp)
    rule = SlippingTips(system, tip_friction, sliding(standing))
    path = trace(system, rule=rule, past_stops=False, step_m=2e-5)
    holding = trace(system, rule=OnTable(system, sliding(standing)), past_stops=False)
    end_m = 0.8 * float(path.excursion_m[-1].mean())
    seen = squeeze(model, standing, grasp, end_m, support_friction=0.3, tip_friction=tip_friction)
    assert_path_agrees(path, seen, share, 0.01)
    held_m = np.interp(seen.excursion_m[-1].mean(), holding.excursion_m.mean(axis=1), holding.motion[:, 1])
    slipped_m = seen.motion[-1, 1] - held_m
    assert slipped_m > (1e-4 if grasped == "cylinder40" else 2e-3)


@pytest.mark.parametrize(("share", "held"), [(0.9, True), (1.1, False)])
def test_lifted_object_is_held_up_to_the_weight_that_minimal_effort_allows(share: float, held: bool) -> None:
    """Each contact carries m g / 2 across the hand plane: N* = m g / 2µ (hand-mechanics reference 7)."""
    hand, grasp, tip_friction = load_hand("t42pp"), GraspSpec(), 0.5
    end_m = 3e-3
    path = trace(grasp_system(hand, load_object("cylinder40"), grasp), past_stops=False)
    pressed_N = float(np.interp(end_m, path.excursion_m.mean(axis=1), path.contact_force_N[:, 0]))
    mass_kg = share * 2 * tip_friction * pressed_N / 9.81
    heavy = msgspec.structs.replace(load_object("cylinder40"), mass_kg=mass_kg)
    world = squeeze(hand, heavy, grasp, end_m, tip_friction=tip_friction).world
    world.wind_spools((0.0, 0.0))
    world.advance_to(world.time_ns + 300_000_000)
    observer = WorldObserver(world, hand)
    before_m = observer.truth().T_hand_object[2, 3]
    world.take_support_away()
    world.advance_to(world.time_ns + 200_000_000)
    fallen_m = before_m - observer.truth().T_hand_object[2, 3]
    assert fallen_m < 2e-5 if held else fallen_m > 5e-3
