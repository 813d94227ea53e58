"""Flexures of the world against the exact beam: uniform bending, dead loads, stops."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from calibration.hand.parameters import (
    ConstantTendon,
    FlexureJoint,
    Hand,
    PinJoint,
    StraightTendonAtFlexure,
    StraightTendonAtPin,
    Tip,
    load_hand,
)
from calibration.objects.parameters import load_object
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.world import World
from drivers.errors import MechanicsError
from drivers.wam.parameters import load_wam_parameters

SECOND = 1_000_000_000
SPOOL_RADIUS_M = 0.0105
LENGTH_M = 0.010
BENDING_NM2 = (2.9e-4, 7.26e-4)
"""Proximal and distal flexure (hand-mechanics reference 2)."""
LIMIT_DEG = (0.0, 71.6)


def flexure(bending_stiffness_Nm2: float) -> FlexureJoint:
    return FlexureJoint(length_m=LENGTH_M, bending_stiffness_Nm2=bending_stiffness_Nm2, flexion_limit_deg=LIMIT_DEG)


def flexure_hand(**changes: FlexureJoint | PinJoint | Tip | float) -> Hand:
    """Two fingers with two flexures each."""
    hand = load_hand("t42pp", "nominal")
    flexures = {"proximal_joint": flexure(BENDING_NM2[0]), "distal_joint": flexure(BENDING_NM2[1])}
    right = msgspec.structs.replace(hand.right, **(flexures | changes))
    return msgspec.structs.replace(hand, right=right, left=right)


def make_world(hand: Hand, T_wrist_hand: NDArray[np.float64] | None = None) -> World:
    """A welded hand, by default with the world's axes, far from the object."""
    far = np.eye(4)
    far[:3, 3] = (2.0, 0.0, 0.0)
    return World(
        hand,
        load_object("cylinder40"),
        load_wam_parameters(),
        T_world_base=np.eye(4),
        T_wrist_hand=np.eye(4) if T_wrist_hand is None else T_wrist_hand,
        T_world_object=far,
        joint_rad=np.zeros(7),
        hand_only=True,
        spool_radius_m=SPOOL_RADIUS_M,
    )


def wound(hand: Hand, spool_rad: tuple[float, float]) -> WorldTruth:
    """The hand at rest with its spools turned by these angles."""
    world = make_world(hand)
    world.wind_spools(spool_rad)
    world.advance_to(SECOND)
    world.wind_spools((0.0, 0.0))
    world.advance_to(2 * SECOND)
    return WorldObserver(world, hand).truth()


def arc_m(angle_rad: float) -> complex:
    """Chord of a beam of `LENGTH_M` that starts along x and bends uniformly by an angle."""
    return complex(LENGTH_M * (np.exp(1j * angle_rad) - 1) / (1j * angle_rad))


def test_free_closing_bends_flexures_to_circles() -> None:
    """A tendon of constant arm bends a free flexure uniformly by T·r·L/EI, and the fingertip is where arcs and links
    lead (hand-mechanics reference 3, 4); rest angles sit half at each end. Both fingers, unlike loads."""
    hand = flexure_hand()
    truth = wound(hand, (0.9, 0.6))
    arms_m = np.array(hand.right.tendon_arm_m)
    stiffness = np.array(BENDING_NM2) / LENGTH_M
    for finger, spool_rad in enumerate((0.9, 0.6)):
        tension_N = SPOOL_RADIUS_M * spool_rad / np.sum(arms_m**2 / stiffness)
        flexion_rad = tension_N * arms_m / stiffness
        assert truth.tendon_tension_N[finger] == pytest.approx(tension_N, rel=1e-3)
        assert truth.finger_joint_rad[finger] == pytest.approx(flexion_rad, rel=1e-3)
        point, angle_rad = complex(hand.root_half_distance_m), 0.0
        links_m = (hand.right.proximal_link_m, hand.right.distal_link_m - hand.right.tip.radius_m)
        for part in range(2):
            half_rest_rad = hand.right.rest_angle_rad[part] / 2
            point += np.exp(1j * (angle_rad + half_rest_rad)) * arc_m(flexion_rad[part])
            angle_rad += 2 * half_rest_rad + flexion_rad[part]
            point += np.exp(1j * angle_rad) * links_m[part]
        mirrored = point if finger == 0 else -point.conjugate()
        assert complex(*truth.tip_m[finger]) == pytest.approx(mirrored, abs=3e-5)


def hanging_beam(weight_N: complex, lever_m: complex, bending_stiffness_Nm2: float) -> tuple[complex, float]:
    """End point (m, beam frame) and end angle of a clamped beam with a weight at `lever_m` in the frame of its end:
    the exact elastica by collocation."""

    def slope(_: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        direction = np.exp(1j * y[0])
        shear_N = (np.conj(direction) * weight_N).imag
        return np.array([y[1], -shear_N / bending_stiffness_Nm2, direction.real, direction.imag])

    def ends(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
        moment_Nm = (np.conj(lever_m * np.exp(1j * end[0])) * weight_N).imag
        return np.array([start[0], start[2], start[3], end[1] - moment_Nm / bending_stiffness_Nm2])

    s = np.linspace(0.0, LENGTH_M, 50)
    solution = solve_bvp(slope, ends, s, np.array([0 * s, 0 * s, s, 0 * s]), tol=1e-7, max_nodes=20_000)
    assert solution.success
    return complex(solution.y[2, -1], solution.y[3, -1]), float(solution.y[0, -1])


@pytest.mark.parametrize("mass_kg", [1.0, 4.0])
def test_flexure_gives_way_as_the_elastica_does(mass_kg: float) -> None:
    """A weight hung close behind a flexure bends it unevenly, by up to 58°: the chain must be a beam and not a pin."""
    held = PinJoint(stiffness_Nm_per_rad=100.0, flexion_limit_deg=(-10.0, 10.0))
    beam = msgspec.structs.replace(flexure(BENDING_NM2[1]), flexion_limit_deg=(-120.0, 120.0))
    hand = flexure_hand(
        proximal_joint=held, distal_joint=beam, distal_link_m=0.006, distal_mass_kg=mass_kg, tip=Tip(radius_m=0.001)
    )
    palm_down = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    world = make_world(hand, palm_down)
    world.advance_to(3 * SECOND)
    truth = WorldObserver(world, hand).truth()
    finger = hand.right
    link = np.exp(1j * (finger.rest_angle_rad[0] + truth.finger_joint_rad[0, 0]))
    beam_frame = link * np.exp(1j * finger.rest_angle_rad[1] / 2)
    behind = np.exp(1j * finger.rest_angle_rad[1] / 2)
    lever_m = complex(behind * finger.distal_link_m / 2)
    end, angle_rad = hanging_beam(complex(9.81j * mass_kg / beam_frame), lever_m, BENDING_NM2[1])
    tip = hand.root_half_distance_m + finger.proximal_link_m * link
    tip += beam_frame * (end + np.exp(1j * angle_rad) * behind * (finger.distal_link_m - finger.tip.radius_m))
    assert abs(angle_rad) > np.radians(20.0)
    assert truth.finger_joint_rad[0, 1] == pytest.approx(angle_rad, rel=2e-3)
    assert complex(*truth.tip_m[0]) == pytest.approx(tip, abs=2e-5)


def test_stops_act_on_the_end_angle() -> None:
    """The phalanges meet at the stop whatever the flexure's shape; the tendon then bends the other joint alone."""
    hand = flexure_hand()
    truth = wound(hand, (1.7, 1.7))
    assert truth.finger_joint_rad[:, 0] == pytest.approx(np.full(2, np.radians(LIMIT_DEG[1])), abs=1e-4)
    winding_m = 1.7 * SPOOL_RADIUS_M - hand.right.tendon_arm_m[0] * np.radians(LIMIT_DEG[1])
    assert truth.finger_joint_rad[:, 1] == pytest.approx(winding_m / hand.right.tendon_arm_m[1], abs=1e-4)
    assert truth.tendon_tension_N == pytest.approx(BENDING_NM2[1] / LENGTH_M * winding_m / 0.008**2, rel=1e-3)


def test_straight_tendon_past_a_pin_has_the_arm_of_its_chord() -> None:
    """Guides 5 mm before and 6 mm behind a pin: excursion, and tension against the spring, by plane geometry
    (hand-mechanics reference 4). One finger has it at both joints, the other at the distal joint alone."""
    offset_m, before_m, after_m = 0.008, 0.005, 0.006
    run = StraightTendonAtPin(before_m=before_m, after_m=after_m)
    stiffness = (0.05, 0.04)

    def pin(index: int, straight: bool) -> PinJoint:
        tendon = run if straight else ConstantTendon()
        return PinJoint(stiffness_Nm_per_rad=stiffness[index], flexion_limit_deg=(0.0, 60.0), tendon=tendon)

    hand = flexure_hand(proximal_joint=pin(0, True), distal_joint=pin(1, True))
    left = msgspec.structs.replace(hand.left, proximal_joint=pin(0, False))
    hand = msgspec.structs.replace(hand, left=left)
    truth = wound(hand, (1.0, 1.0))

    def chord_m(flexion_rad: float) -> float:
        return float(abs(complex(-before_m, offset_m) - np.exp(1j * flexion_rad) * complex(after_m, offset_m)))

    for flexion_rad, tension_N, excursion_m, straight_proximal in zip(
        truth.finger_joint_rad, truth.tendon_tension_N, truth.tendon_excursion_m, (True, False), strict=True
    ):
        expected_m = 0.0
        for index, straight in enumerate((straight_proximal, True)):
            q, step = float(flexion_rad[index]), 1e-6
            arm_m = (chord_m(q - step) - chord_m(q + step)) / (2 * step) if straight else offset_m
            assert tension_N * arm_m == pytest.approx(stiffness[index] * q, rel=1e-3)
            expected_m += chord_m(0.0) - chord_m(q) if straight else offset_m * q
        assert excursion_m == pytest.approx(expected_m, abs=1e-8)
        assert excursion_m == pytest.approx(SPOOL_RADIUS_M, abs=2e-5)


@pytest.mark.parametrize("stiffness_N_per_m", [np.inf, 4e4])
def test_straight_tendon_beside_a_flexure_shortens_with_its_chord(stiffness_N_per_m: float) -> None:
    """Guides at a flexure's ends: it bends unevenly, nearly to a circle, whose chord gives the excursion; virtual work
    gives the tension (hand-mechanics reference 4)."""
    straight = msgspec.structs.replace(
        flexure(BENDING_NM2[1]), tendon=StraightTendonAtFlexure(), flexion_limit_deg=(0.0, 60.0)
    )
    held = PinJoint(stiffness_Nm_per_rad=100.0, flexion_limit_deg=(0.0, 1.0))
    hand = flexure_hand(proximal_joint=held, distal_joint=straight, tendon_stiffness_N_per_m=stiffness_N_per_m)
    spools_rad = (0.5, 0.6)
    truth = wound(hand, spools_rad)
    offset_m = hand.right.tendon_arm_m[1]
    for flexion_rad, tension_N, excursion_m, spool_rad in zip(
        truth.finger_joint_rad[:, 1], truth.tendon_tension_N, truth.tendon_excursion_m, spools_rad, strict=True
    ):
        assert flexion_rad > 0.5
        radius_m, half_rad = LENGTH_M / flexion_rad, flexion_rad / 2
        taken_up_m = LENGTH_M - 2 * (radius_m - offset_m) * np.sin(half_rad)
        arm_m = (
            offset_m * np.cos(half_rad) + 2 * radius_m / flexion_rad * np.sin(half_rad) - radius_m * np.cos(half_rad)
        )
        assert excursion_m == pytest.approx(taken_up_m, rel=5e-3)
        assert tension_N * arm_m == pytest.approx(BENDING_NM2[1] / LENGTH_M * flexion_rad, rel=1e-2)
        assert spool_rad * SPOOL_RADIUS_M - excursion_m == pytest.approx(tension_N / stiffness_N_per_m, abs=1e-5)


def test_bad_fingers_are_refused() -> None:
    """What the physics cannot show is said before it starts."""
    with pytest.raises(MechanicsError, match="point tip"):
        make_world(flexure_hand(tip=Tip(radius_m=0.0)))
    with pytest.raises(MechanicsError, match="routing_friction"):
        make_world(flexure_hand(routing_friction=0.1))
