"""Objects of the world against the areas of their outlines, Coulomb's law and plane geometry."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.hand.parameters import Tip, load_hand
from calibration.objects.parameters import GraspObject, load_object
from calibration.objects.shapes import Curve, Disc, Polygon, Rectangle, Shape, Sphere
from controller.simulation.truth import WorldObserver
from controller.simulation.world import World
from controller.simulation.world_object import feet_m, mean_squares_m2
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

SECOND = 1_000_000_000
ARM_UP_M = 0.9109  # wrist over base with the arm pointing straight up (WAM reference 6.1): hand axes are the world's
SHAPES: list[Shape] = [
    Disc(diameter_m=0.04),
    Sphere(diameter_m=0.04),
    Rectangle(width_m=0.04, depth_m=0.06),
    Polygon(vertices_m=((0.03, -0.02), (0.0, 0.04), (-0.03, -0.02))),
    Curve(support_cos_m=(0.02, 0.0, 0.003), support_sin_m=(0.0, 0.001)),
]


def of_shape(shape: Shape, **changes: float | None) -> GraspObject:
    return msgspec.structs.replace(load_object("cylinder40"), shape=shape, **changes)


def make_world(
    grasp_object: GraspObject,
    xy_m: tuple[float, float] = (2.0, 0.0),
    outline_angle_rad: float = 0.0,
    weightless: bool = False,
    tip_friction: tuple[float, float] = (1.0, 1.0),
    pad_length_m: float = 0.0,
) -> World:
    hand = load_hand("t42pp")
    tip = Tip(radius_m=hand.right.tip.radius_m, pad_length_m=pad_length_m)
    right = msgspec.structs.replace(hand.right, tip=tip)
    T_world_object = np.eye(4)
    T_world_object[:3, 3] = (*xy_m, ARM_UP_M)
    return World(
        msgspec.structs.replace(hand, right=right, left=right),
        grasp_object,
        load_wam_parameters(),
        T_world_base=np.eye(4),
        T_wrist_hand=np.eye(4),
        T_world_object=T_world_object,
        joint_rad=np.zeros(7),
        hand_only=True,
        outline_angle_rad=outline_angle_rad,
        weightless=weightless,
        tip_friction=tip_friction,
    )


def object_pose(world: World) -> NDArray[np.float64]:
    return WorldObserver(world, load_hand("t42pp")).truth().T_world_object


def test_mean_squares_are_those_of_the_area() -> None:
    """Inertia rests on them: a rectangle's are a²/12, and turning it mixes them as a tensor."""
    half = np.array([[1.0, -0.5], [1.0, 0.5], [-1.0, 0.5], [-1.0, -0.5]])
    assert mean_squares_m2(half) == pytest.approx([4 / 12, 1 / 12, 0.0])
    angle = 0.4
    turned = half @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    xx = 4 / 12 * math.cos(angle) ** 2 + 1 / 12 * math.sin(angle) ** 2
    xy = (4 / 12 - 1 / 12) * math.cos(angle) * math.sin(angle)
    assert mean_squares_m2(turned) == pytest.approx([xx, 5 / 12 - xx, xy])


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_object_stands_still_and_upright(shape: Shape) -> None:
    """What moves in a report is moved by the robot, whatever the shape and however it is turned."""
    world = make_world(of_shape(shape), outline_angle_rad=0.3)
    before = object_pose(world)
    world.advance_to(SECOND // 2)
    settled = object_pose(world)
    world.advance_to(SECOND)
    assert np.abs(settled - before)[:3, 3].max() < 1e-5
    assert np.abs(object_pose(world) - settled).max() < 1e-8


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_feet_press_evenly(shape: Shape) -> None:
    """Drag against turning is friction times the mean distance of the feet: that of the pressed patch, except for a
    ball, which stands on a point."""
    distance_m = np.linalg.norm(feet_m(shape.outline_m(36_000), shape.mean_pressure_distance_m), axis=1).mean()
    if isinstance(shape, Sphere):
        assert distance_m == pytest.approx(2 * (shape.radius_m - 5e-4) / 3)
    else:
        assert distance_m == pytest.approx(shape.mean_pressure_distance_m)


@pytest.mark.parametrize(("share", "turns"), [(0.93, False), (1.07, True)])
def test_object_turns_when_twisted_beyond_support_friction(share: float, turns: bool) -> None:
    """The limit of the twist is µ·m·g·2R/3 for a disc (hand-mechanics reference 8). Once it turns, the faster feet
    lift it, carry more and drag more: see the impedance of contacts in `world_model.py`."""
    grasp_object = of_shape(Disc(diameter_m=0.08), height_m=0.03)
    assert grasp_object.support is not None
    world = make_world(grasp_object)
    limit_Nm = grasp_object.support.friction * grasp_object.mass_kg * 9.81 * 0.08 / 3
    world.advance_to(SECOND // 5)
    world.push_object((0.0, 0.0, 0.0), (0.0, 0.0, share * limit_Nm))
    world.advance_to(SECOND // 2)
    turned = object_pose(world)
    angle_rad = math.atan2(turned[1, 0], turned[0, 0])
    assert angle_rad > 5e-3 if turns else abs(angle_rad) < 1e-5


def test_object_without_support_falls_unless_weightless() -> None:
    """Nothing carries it but the hand, until it is said to float."""
    lifted = of_shape(Disc(diameter_m=0.04), support=None)
    for weightless, fallen_m in ((False, 0.5 * 9.81 * 0.1**2), (True, 0.0)):
        world = make_world(lifted, weightless=weightless)
        world.advance_to(SECOND // 10)
        assert ARM_UP_M - object_pose(world)[2, 3] == pytest.approx(fallen_m, abs=1e-3 * 9.81 * 0.1)


def touching_m(shape: Shape, outline_angle_rad: float, pad_length_m: float = 0.0, behind_m: float = 0.0) -> float:
    """Distance of an object's reference point from the open right finger's inner surface when they touch: beside the
    arc's centre, or `behind_m` further back along the link."""
    hand = load_hand("t42pp")
    finger = hand.right
    angles = np.cumsum(finger.rest_angle_rad)
    along = np.exp(1j * angles[1])
    place = hand.root_half_distance_m + finger.proximal_link_m * np.exp(1j * angles[0])
    place += (finger.distal_link_m - finger.tip.radius_m - behind_m) * along

    def touches(gap_m: float) -> bool:
        centre = place + (finger.tip.radius_m + gap_m) * 1j * along
        floating = of_shape(shape, support=None)
        world = make_world(floating, (centre.real, centre.imag), outline_angle_rad, True, pad_length_m=pad_length_m)
        return bool(WorldObserver(world, hand).truth().contact_force_N[0] > 0.0)

    touching, clear = 0.001, 0.08
    while clear - touching > 3e-7:
        middle = (clear + touching) / 2
        touching, clear = (middle, clear) if touches(middle) else (touching, middle)
    return clear


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_fingertip_meets_the_outline_where_it_is(shape: Shape) -> None:
    """The arc touches the turned outline where plane geometry has them touch."""
    outline_angle_rad, radius_m = 0.3, load_hand("t42pp").right.tip.radius_m
    link_rad = float(np.sum(load_hand("t42pp").right.rest_angle_rad))
    points = shape.outline_m(20_000) @ (1.0, 1j) * np.exp(1j * outline_angle_rad)
    points = points / (-1j * np.exp(1j * link_rad))  # real part: towards the finger
    points = points[np.abs(points.imag) < radius_m]
    expected_m = np.max(points.real + np.sqrt(radius_m**2 - points.imag**2)) - radius_m
    assert touching_m(shape, outline_angle_rad) == pytest.approx(expected_m, abs=2e-6)


@pytest.mark.parametrize("shape", [SHAPES[0], SHAPES[4]], ids=lambda shape: type(shape).__name__)
def test_pad_reaches_back_from_the_arc(shape: Shape) -> None:
    """The flat pad is tangent to the arc and touches the outline's outermost point beside it."""
    link_rad = float(np.sum(load_hand("t42pp").right.rest_angle_rad))
    towards_finger = -1j * np.exp(1j * link_rad)
    points = shape.outline_m(20_000) @ (1.0, 1j) / towards_finger
    outermost = points[np.argmax(points.real)]
    assert abs(outermost.imag) < 0.005
    assert touching_m(shape, 0.0, pad_length_m=0.012, behind_m=0.006) == pytest.approx(outermost.real, abs=2e-6)


def test_bad_objects_are_refused() -> None:
    """What is no angle and no friction does not get into the physics."""
    disc = of_shape(Disc(diameter_m=0.04))
    with pytest.raises(InputError, match="outline_angle_rad"):
        make_world(disc, outline_angle_rad=math.nan)
    for friction in ((0.0, 1.0), (1.0, 6.0), (math.nan, 1.0)):
        with pytest.raises(InputError, match="tip_friction"):
            make_world(disc, tip_friction=friction)
