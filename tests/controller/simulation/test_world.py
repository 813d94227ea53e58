"""The world against Pinocchio, spring laws, Coulomb's law and itself."""

from __future__ import annotations

from importlib.resources import as_file, files

import msgspec
import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from calibration.hand.parameters import Hand, PinJoint, load_hand
from calibration.objects.parameters import GraspObject, Support, load_object
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.world import World
from controller.simulation.world_model import Imperfections
from drivers.errors import InputError, MechanicsError
from drivers.wam.parameters import load_wam_parameters

SECOND = 1_000_000_000
ELBOW_UP_RAD = np.array([0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4])
SPOOL_RADIUS_M = 0.0105
T_WRIST_HAND = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0.08], [0, 0, 0, 1]])


def make_world(
    hand: Hand | None = None,
    grasp_object: GraspObject | None = None,
    imperfections: Imperfections | None = None,
    T_world_object: NDArray[np.float64] | None = None,
    joint_rad: NDArray[np.float64] = ELBOW_UP_RAD,
    T_wrist_hand: NDArray[np.float64] = T_WRIST_HAND,
    seed: int = 0,
    hand_only: bool = False,
) -> World:
    far = np.eye(4)
    far[:3, 3] = (2.0, 0.0, 0.0)
    return World(
        hand or load_hand("t42pp"),
        grasp_object or load_object("cylinder40"),
        load_wam_parameters(),
        T_world_base=np.eye(4),
        T_wrist_hand=T_wrist_hand,
        T_world_object=far if T_world_object is None else T_world_object,
        joint_rad=joint_rad,
        seed=seed,
        imperfections=imperfections,
        hand_only=hand_only,
    )


def observed(world: World, hand: Hand | None = None) -> WorldTruth:
    return WorldObserver(world, hand or load_hand("t42pp")).truth()


def hand_with(**changes: PinJoint | float) -> Hand:
    """The fitted hand with both fingers changed alike."""
    hand = load_hand("t42pp")
    right = msgspec.structs.replace(hand.right, **changes)
    return msgspec.structs.replace(hand, right=right, left=right)


def pinocchio_arm(hand: Hand) -> tuple[pinocchio.Model, pinocchio.Data]:
    """The same URDF in another library, with the hand's parts as one rigid body each in their rest pose."""
    with as_file(files("drivers.wam").joinpath("wam7.urdf")) as path:
        model = pinocchio.buildModelFromUrdf(str(path))
    model.armature = load_wam_parameters().rotor_inertia_kgm2.copy()
    wrist = model.frames[model.getFrameId("tool")]
    pose = wrist.placement * pinocchio.SE3(T_WRIST_HAND)
    body = hand.body
    model.appendBodyToJoint(
        wrist.parentJoint, pinocchio.Inertia(body.mass_kg, np.array(body.com_m), body.inertia_matrix_kgm2), pose
    )
    for finger, mirror in zip(hand.fingers, (1.0, -1.0), strict=True):
        point = np.array([mirror * hand.root_half_distance_m, 0.0, 0.0])
        angle = 0.0
        parts = zip(
            (finger.proximal_link_m, finger.distal_link_m),
            (finger.proximal_mass_kg, finger.distal_mass_kg),
            finger.rest_angle_rad,
            strict=True,
        )
        for length_m, mass_kg, turn_rad in parts:
            angle += turn_rad
            direction = np.array([mirror * np.cos(angle), np.sin(angle), 0.0])
            centre = point + direction * length_m / 2
            model.appendBodyToJoint(wrist.parentJoint, pinocchio.Inertia(mass_kg, centre, np.zeros((3, 3))), pose)
            point = point + direction * length_m
    return model, model.createData()


def test_arm_without_imperfections_floats_under_pinocchio_gravity() -> None:
    """Gravity, masses and kinematics of the world are those of the URDF, to what the yielding fingers leave open."""
    hand = load_hand("t42pp")
    stiff = {
        name: msgspec.structs.replace(getattr(hand.right, name), stiffness_Nm_per_rad=50.0)
        for name in ("proximal_joint", "distal_joint")
    }
    hand = hand_with(**stiff)
    world = make_world(hand=hand, imperfections=Imperfections.none())
    model, data = pinocchio_arm(hand)
    gravity_Nm = pinocchio.computeGeneralizedGravity(model, data, ELBOW_UP_RAD)
    world.set_joint_torque_Nm(gravity_Nm, braking=False, at_ns=0)
    world.advance_to(SECOND // 2)
    assert np.abs(world.joint_position_rad() - ELBOW_UP_RAD).max() < 2e-5
    pinocchio.framesForwardKinematics(model, data, world.joint_position_rad())
    wrist = data.oMf[model.getFrameId("tool")].homogeneous
    assert observed(world).T_world_wrist == pytest.approx(wrist, abs=1e-9)


def test_arm_accelerates_as_pinocchio_with_rotor_inertia_says() -> None:
    """Inertias including the rotors: a torque step moves all joints by what forward dynamics predicts."""
    hand = load_hand("t42pp")
    world = make_world(hand=hand, imperfections=Imperfections.none())
    model, data = pinocchio_arm(hand)
    torque_Nm = pinocchio.computeGeneralizedGravity(model, data, ELBOW_UP_RAD)
    torque_Nm = torque_Nm + np.array([8.0, -6, 3, 2, 0.3, -0.3, 0.05])
    world.set_joint_torque_Nm(torque_Nm, braking=False, at_ns=0)
    q, v, step_s = ELBOW_UP_RAD.copy(), np.zeros(7), 1e-4
    for _ in range(300):
        v = v + step_s * pinocchio.aba(model, data, q, v, torque_Nm)
        q = q + step_s * v
    world.advance_to(30_000_000)
    moved_rad = np.abs(q - ELBOW_UP_RAD)
    assert np.abs(world.joint_position_rad() - q).max() < 0.03 * moved_rad.max()
    assert np.all(np.abs(world.joint_position_rad() - q) < 0.06 * moved_rad + 2e-5)


def test_free_arm_keeps_its_energy() -> None:
    """No friction, no torque: a falling arm exchanges energy but gains none and loses next to none."""
    world = make_world(imperfections=Imperfections.none(), joint_rad=np.array([0.3, 0.9, 0.2, 1.0, 0.1, 0.3, 0.0]))
    world.set_joint_torque_Nm(np.zeros(7), braking=False, at_ns=0)
    model, data = pinocchio_arm(load_hand("t42pp"))

    def energy_J() -> float:
        q, v = world.joint_position_rad(), world.joint_velocity_rad_s()
        kinetic_J = 0.5 * v @ pinocchio.crba(model, data, q) @ v
        return float(kinetic_J + pinocchio.computePotentialEnergy(model, data, q))

    start_J = energy_J()
    world.advance_to(300_000_000)
    q, v = world.joint_position_rad(), world.joint_velocity_rad_s()
    exchanged_J = 0.5 * v @ pinocchio.crba(model, data, q) @ v
    assert exchanged_J > 1.0
    assert abs(energy_J() - start_J) < 0.02 * exchanged_J


def test_coulomb_friction_holds_up_to_its_limit() -> None:
    """Imperfect joints stand still under a torque error below Coulomb friction, and give way above it."""
    world = make_world(imperfections=Imperfections(link_mass_spread=0.0))
    model, data = pinocchio_arm(load_hand("t42pp"))
    gravity_Nm = pinocchio.computeGeneralizedGravity(model, data, ELBOW_UP_RAD)
    friction_Nm = np.array(Imperfections().arm_coulomb_Nm)
    world.set_joint_torque_Nm(gravity_Nm + 0.8 * friction_Nm, braking=False, at_ns=0)
    world.advance_to(SECOND)
    assert np.abs(world.joint_position_rad() - ELBOW_UP_RAD).max() < 1e-4
    world.set_joint_torque_Nm(gravity_Nm + 1.2 * friction_Nm * np.eye(7)[0], braking=False, at_ns=SECOND)
    world.advance_to(2 * SECOND)
    assert world.joint_position_rad()[0] - ELBOW_UP_RAD[0] > 0.02


def test_torque_takes_effect_when_its_time_has_come() -> None:
    """A frame still on the wire must not move the arm early."""
    world = make_world(imperfections=Imperfections.none())
    at_ns = 10_200_000  # between two steps: applies from 10.5 ms
    world.set_joint_torque_Nm(np.zeros(7), braking=True, at_ns=0)
    world.advance_to(10_500_000)
    before = world.joint_velocity_rad_s()[0]
    world.set_joint_torque_Nm((20.0, 0, 0, 0, 0, 0, 0), braking=False, at_ns=at_ns + 500_000)
    world.advance_to(11_000_000)
    assert abs(world.joint_velocity_rad_s()[0] - before) < 1e-3
    world.advance_to(11_500_000)
    assert world.joint_velocity_rad_s()[0] - before > 4e-3


def test_time_passed_over_is_not_lived_through() -> None:
    """A world that waits for its controller: its clock goes on, arm and spools do not, and then it is as if not."""
    waiting, other = make_world(), make_world()
    for world in (waiting, other):
        world.advance_to(SECOND // 20)
    stood_rad = waiting.joint_position_rad()
    waiting.pass_over(SECOND)
    assert waiting.time_ns == other.time_ns + SECOND
    assert (waiting.joint_position_rad() == stood_rad).all()
    waiting.advance_to(SECOND + SECOND // 10)
    other.advance_to(SECOND // 10)
    assert (waiting.joint_position_rad() == other.joint_position_rad()).all()
    assert (other.joint_position_rad() != stood_rad).any()
    with pytest.raises(InputError, match="at least 0"):
        waiting.pass_over(-1)


def test_braking_lets_the_arm_sink_slowly() -> None:
    """Idle pucks short their motors: the arm sinks, it does not drop."""
    world = make_world()
    world.advance_to(SECOND)
    assert np.abs(world.joint_velocity_rad_s()).max() < 0.25
    world.set_joint_torque_Nm(np.zeros(7), braking=False, at_ns=SECOND)
    world.advance_to(SECOND + SECOND // 5)
    assert np.abs(world.joint_velocity_rad_s()).max() > 0.5


@pytest.mark.parametrize("stiffness_N_per_m", [np.inf, 4e4])
def test_free_closing_follows_the_springs(stiffness_N_per_m: float) -> None:
    """Pulled by one tendon, each joint flexes by T·r/k and the tendon shortens by r·ΣΔθ (hand-mechanics 4)."""
    hand = hand_with(tendon_stiffness_N_per_m=stiffness_N_per_m)
    world = make_world(
        hand=hand, imperfections=Imperfections.none(), T_wrist_hand=np.eye(4), joint_rad=np.zeros(7), hand_only=True
    )
    world.wind_spools((0.6, 0.4))
    world.advance_to(SECOND)
    world.wind_spools((0.0, 0.0))
    world.advance_to(2 * SECOND)
    truth = observed(world, hand)
    arms_m = np.array(hand.right.tendon_arm_m)
    stiffness = np.array([joint.stiffness_Nm_per_rad for joint in hand.right.joints])  # type: ignore[union-attr]  # pins
    for finger, spool_rad in enumerate((0.6, 0.4)):
        compliance = np.sum(arms_m**2 / stiffness) + 1.0 / stiffness_N_per_m
        tension_N = SPOOL_RADIUS_M * spool_rad / compliance
        assert truth.tendon_tension_N[finger] == pytest.approx(tension_N, rel=3e-4)
        assert truth.finger_joint_rad[finger] == pytest.approx(tension_N * arms_m / stiffness, rel=3e-4)
        assert truth.tendon_excursion_m[finger] == pytest.approx(arms_m @ (tension_N * arms_m / stiffness), rel=3e-4)


def test_slack_tendon_pulls_nothing() -> None:
    """A tendon paid out beyond the finger's reach has no tension and cannot push."""
    world = make_world(T_wrist_hand=np.eye(4), joint_rad=np.zeros(7), hand_only=True)
    world.wind_spools((0.5, -0.5))
    world.advance_to(SECOND)
    world.wind_spools((-0.7, 0.0))
    world.advance_to(2 * SECOND)
    truth = observed(world)
    assert truth.tendon_tension_N == pytest.approx(np.zeros(2), abs=0.0)
    assert np.abs(truth.finger_joint_rad).max() < 1e-4


def test_motor_winds_only_beyond_gear_friction() -> None:
    """The gear holds 0.233 N·m either way: below it the shaft stands, above it torque less friction is the tension."""
    world = make_world(T_wrist_hand=np.eye(4), joint_rad=np.zeros(7))

    def ramp(now_ns: int) -> None:
        world.set_shaft_torque_Nm(0, 0.22)
        damping_Nm = 0.1 * world.shaft_velocity_rad_s(1)  # or the rotor overshoots, and friction keeps it there
        world.set_shaft_torque_Nm(1, 0.50 * min(1.0, now_ns / SECOND) - damping_Nm)

    world.call_before_each_step(ramp)
    world.advance_to(3 * SECOND)
    tension_N = observed(world).tendon_tension_N
    assert abs(world.shaft_angle_rad(0)) < 1e-4
    assert tension_N[1] == pytest.approx((0.50 - 0.233) / SPOOL_RADIUS_M, rel=0.02)


@pytest.mark.parametrize(("share", "moves"), [(0.9, False), (1.1, True)])
def test_object_slides_when_pushed_beyond_support_friction(share: float, moves: bool) -> None:
    """Support friction is µ·m·g, as stated in the object's file: not combined with anything."""
    grasp_object = load_object("cylinder40")
    assert grasp_object.support is not None
    world = make_world(grasp_object=msgspec.structs.replace(grasp_object, height_m=0.03), hand_only=True)
    before = observed(world).T_world_object
    world.push_object((0.0, share * grasp_object.support.friction * grasp_object.mass_kg * 9.81, 0.0))
    world.advance_to(SECOND // 2)
    way_m = observed(world).T_world_object[1, 3] - before[1, 3]
    expected_m = 0.5 * (share - 1.0) * grasp_object.support.friction * 9.81 * 0.5**2
    assert way_m == pytest.approx(expected_m, rel=0.02) if moves else abs(way_m) < 2e-5


def test_untouched_object_stands_still() -> None:
    """What moves in a report is moved by the robot: alone, the object stays within a micrometre of where it was put."""
    world = make_world()
    before = observed(world).T_world_object
    world.advance_to(SECOND)
    middle = observed(world).T_world_object
    world.advance_to(2 * SECOND)
    after = observed(world).T_world_object
    assert np.abs(after - middle).max() < 1e-9
    assert np.abs(after[:3, 3] - before[:3, 3]).max() < 1e-5  # settles into its support once


def test_same_calls_same_bits_whether_watched_or_not() -> None:
    """Reports rest on repeatability, and looking at the truth must not change it."""

    def run(seed: int, watched: bool) -> bytes:
        world = make_world(seed=seed)
        calls: list[int] = []
        world.call_before_each_step(calls.append)
        for step in range(1, 101):
            world.set_joint_torque_Nm(np.sin(np.arange(7.0) + 0.1 * step), braking=False, at_ns=step * 2_000_000)
            world.set_shaft_torque_Nm(step % 2, 0.5)
            world.advance_to(step * 2_000_000)
            if watched:
                observed(world)
        assert calls == list(range(0, 200_000_000, world.physics_period_ns))
        return world.joint_position_rad().tobytes() + np.float64(world.shaft_angle_rad(0)).tobytes()

    assert run(1, watched=False) == run(1, watched=True)
    assert run(1, watched=False) != run(2, watched=False)


def test_link_masses_are_off_by_the_seed_and_within_their_spread() -> None:
    """The controller's model must be wrong by a known amount, the same each time."""

    def masses(seed: int, imperfections: Imperfections) -> NDArray[np.float64]:
        model = make_world(seed=seed, imperfections=imperfections)._parts.model
        return np.array([model.body(f"link_{index}").mass[0] for index in range(1, 8)])

    exact = masses(0, Imperfections.none())
    off = masses(3, Imperfections()) / exact - 1.0
    assert np.array_equal(masses(3, Imperfections()) / exact - 1.0, off)
    assert np.all(np.abs(off) <= 0.03)
    assert np.ptp(off) > 0.01


def test_bad_input_is_refused() -> None:
    """Nothing that is not a number, a pose or an upright object gets into the physics."""
    world = make_world()
    with pytest.raises(InputError, match="torque"):
        world.set_joint_torque_Nm([np.nan] * 7, braking=False, at_ns=0)
    with pytest.raises(InputError, match="shaft torque"):
        world.set_shaft_torque_Nm(0, np.inf)
    with pytest.raises(InputError, match="hand_only"):
        world.wind_spools((0.1, 0.1))
    with pytest.raises(InputError, match="T_world_object"):
        make_world(T_world_object=np.zeros((4, 4)))
    leaning = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    with pytest.raises(InputError, match="leans"):
        make_world(T_world_object=leaning)
    with pytest.raises(MechanicsError, match="routing_friction"):
        make_world(hand=hand_with(routing_friction=0.1))


def test_support_without_friction_is_possible() -> None:
    """An object file may say friction 0; the object then keeps its speed."""
    grasp_object = msgspec.structs.replace(load_object("cylinder40"), support=Support(friction=0.0))
    world = make_world(grasp_object=grasp_object, hand_only=True)
    world.push_object((0.1, 0.0, 0.0))
    world.advance_to(SECOND)
    assert observed(world).T_world_object[0, 3] - 2.0 == pytest.approx(0.5, rel=0.01)
