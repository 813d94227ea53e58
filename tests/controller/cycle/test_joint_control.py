"""The joint control in front of another arm, MuJoCo's, with friction, encoder counts and wrong masses; its limits."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from itertools import pairwise
from math import pi, sin

import mujoco
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from controller.cycle.arm_model import ArmFriction, ArmModel
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics
from controller.cycle.joint_bounds import JointLimits
from controller.cycle.joint_control import JointControl
from controller.cycle.joint_gains import CALM_GAINS, LIBBARRETT_GAINS, STIFF_GAINS, JointGains, TorqueLimits
from controller.cycle.soft_limits import SoftLimits
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

Array = npt.NDArray[np.float64]

PARAMETERS = load_wam_parameters()
LIMITS = JointLimits.from_parameters(PARAMETERS)
PERIOD_NS = 2_000_000
PERIOD_S = 0.002
STEPS_PER_PERIOD = 8
DELAY_STEPS = 6  # 1.5 ms from sample to torque
VISCOUS = (0.9, 0.25, 0.75, 0.4, 0.25, 0.05, 0.05)
COULOMB = (1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05)
# WAM reference 5.2, joint to motor angles; counts are floored.
JOINT_TO_MOTOR = np.zeros((7, 7))
JOINT_TO_MOTOR[[0, 3, 6], [0, 3, 6]] = -42.0, -18.0, -14.93
JOINT_TO_MOTOR[1:3, 1:3] = [[28.25, -16.8155], [-28.25, -16.8155]]
JOINT_TO_MOTOR[4:6, 4:6] = [[9.7, -9.7], [9.7, 9.7]]
MOTOR_TO_JOINT = np.linalg.inv(JOINT_TO_MOTOR)
COUNT_RAD = 2 * np.pi / 4096
ELBOW_UP = np.array([0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4])
FORWARD = np.array([0.0, 0.6, 0.0, 1.8, 0.0, 0.75, 0.0])
joints = arrays(np.float64, 7, elements=st.floats(-1.0, 1.0, allow_subnormal=False))


class SimulatedArm:
    """MuJoCo's arm from the URDF: masses off by up to 3 %, Coulomb friction, encoder counts."""

    def __init__(self, q: Array, coulomb: tuple[float, ...] = COULOMB, viscous: tuple[float, ...] = VISCOUS) -> None:
        model = mujoco.MjModel.from_xml_string((files("drivers.wam") / "wam7.urdf").read_text(encoding="utf-8"))
        model.opt.timestep = PERIOD_S / STEPS_PER_PERIOD
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.jnt_limited[:] = 0
        model.dof_armature[:] = PARAMETERS.rotor_inertia_kgm2
        model.dof_damping[:] = viscous
        model.dof_frictionloss[:] = coulomb
        # MuJoCo's friction is soft; at its defaults a loaded joint would creep by radians.
        model.dof_solref[:] = 0.001, 1.0
        model.dof_solimp[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
        wrong = 1.0 + 0.03 * np.random.default_rng(1).uniform(-1.0, 1.0, model.nbody)
        model.body_mass[:] *= wrong
        model.body_inertia[:] *= wrong[:, None]
        self._model, self._data = model, mujoco.MjData(model)
        self._data.qpos[:] = q
        mujoco.mj_forward(model, self._data)
        self._last_torque = np.array(self._data.qfrc_bias)

    @property
    def q(self) -> Array:
        return np.array(self._data.qpos)

    def encoder(self) -> Array:
        counts: Array = MOTOR_TO_JOINT @ (np.floor(JOINT_TO_MOTOR @ self._data.qpos / COUNT_RAD) * COUNT_RAD)
        return counts

    def run_period(self, torque: Array) -> None:
        for step in range(STEPS_PER_PERIOD):
            self._data.qfrc_applied[:] = self._last_torque if step < DELAY_STEPS else torque
            mujoco.mj_step(self._model, self._data)
        self._last_torque = torque


def way_m(time_s: float, distance_m: float = 0.0255, duration_s: float = 1.5, ramp_s: float = 0.15) -> float:
    """A squeeze's wrist way: 17 to 19 mm/s with smooth ramps."""
    speed = distance_m / (duration_s - ramp_s)
    if time_s > duration_s / 2:
        return distance_m - way_m(duration_s - time_s, distance_m, duration_s, ramp_s)
    if time_s <= 0.0:
        return 0.0
    if time_s < ramp_s:
        return speed * (time_s / 2 - sin(pi * time_s / ramp_s) * ramp_s / (2 * pi))
    return speed * (time_s - ramp_s / 2)


@pytest.mark.parametrize(
    ("q_start", "direction"),
    [(ELBOW_UP, [0.0, 1.0, 0.0]), (FORWARD, [1.0, 0.0, 0.0]), (FORWARD, [0.0, 0.6, 0.8])],
)
def test_compensating_wrist_motion_is_followed_and_ends_at_rest(q_start: Array, direction: list[float]) -> None:
    """Protects the aim: ≤ 0.3 mm at the wrist while it compensates, friction known to 20 %; no hunting afterwards."""
    model = ArmModel(friction=ArmFriction(VISCOUS, tuple(0.8 * f for f in COULOMB)))
    control, arm = JointControl(model), SimulatedArm(q_start)
    solving = DifferentialInverseKinematics(model, JointLimits.from_parameters(PARAMETERS), PERIOD_S, q_start)
    truth, axis = ArmModel(), np.array(direction)
    q, v, target, T_start = q_start.copy(), np.zeros(7), truth.wrist_pose(q_start), truth.wrist_pose(q_start)
    twist, settle_s = np.zeros(6), 0.3
    control.reset(arm.encoder(), -PERIOD_NS)
    deviation, path, torques = [], [], []
    for period in range(1600):
        now_s = period * PERIOD_S - settle_s
        deviation.append(truth.wrist_pose(arm.q)[:3, 3] - T_start[:3, 3] - way_m(now_s) * axis)
        path.append(arm.q)
        ahead_m = way_m(now_s + PERIOD_S)
        target[:3, 3] = T_start[:3, 3] + ahead_m * axis
        twist[:3] = (ahead_m - way_m(now_s)) / PERIOD_S * axis
        answer = solving.step(q, v, target, twist)
        torque = control.torque(arm.encoder(), q, answer.velocity, (answer.velocity - v) / PERIOD_S, period * PERIOD_NS)
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
        torques.append(torque)
        arm.run_period(torque)
    from_start = np.linalg.norm(np.array(deviation) - deviation[round(settle_s / PERIOD_S)], axis=1)
    assert from_start[round(settle_s / PERIOD_S) :].max() < 0.3e-3
    assert np.ptp(path[-250:], axis=0).max() < 3e-5
    assert (np.ptp(torques[-250:], axis=0) < [1.0, 1.5, 0.5, 0.5, 0.05, 0.05, 0.02]).all()


@pytest.mark.parametrize("q", [ELBOW_UP, FORWARD, np.array([0.2, 1.5, 0.1, 0.1, 0.3, 0.8, 0.0])])
def test_default_gains_are_stable_twice_over_without_friction(q: Array) -> None:
    """Protects the margin: with twice the gains, no friction and the true delay a disturbance still dies out."""
    doubled = replace(
        STIFF_GAINS,
        kp=tuple(2 * k for k in STIFF_GAINS.kp),
        ki=tuple(2 * k for k in STIFF_GAINS.ki),
        kd=tuple(2 * k for k in STIFF_GAINS.kd),
    )
    control, arm, rest = JointControl(ArmModel(), doubled), SimulatedArm(q, (0.0,) * 7, (0.0,) * 7), np.zeros(7)
    control.reset(q, -PERIOD_NS)
    errors = []
    for period in range(500):
        push = np.array([3.0, 3.0, 1.0, 1.0, 0.1, 0.1, 0.02]) * (period == 20)
        arm.run_period(control.torque(arm.encoder(), q, rest, rest, period * PERIOD_NS) + push)
        errors.append(np.abs(arm.q - q).max())
    assert max(errors) < 5e-3
    assert max(errors[-100:]) < 3e-4


def test_torque_at_rest_is_gravity() -> None:
    """Protects the moment of activation: nothing jumps."""
    model = ArmModel()
    control = JointControl(model)
    control.reset(FORWARD, 0)
    torque = control.torque(FORWARD, FORWARD, np.zeros(7), np.zeros(7), PERIOD_NS)
    np.testing.assert_allclose(torque, model.gravity(FORWARD), rtol=0, atol=1e-12)
    np.testing.assert_allclose(control.feedback_Nm, np.zeros(7), rtol=0, atol=1e-12)
    assert not control.saturated


def test_vendor_gains_give_the_vendor_law() -> None:
    """Protects the law of the reference, 5.4, worked out by hand for one step of the error."""
    control = JointControl(ArmModel(), LIBBARRETT_GAINS, TorqueLimits((1e3,) * 7, (1e9,) * 7))
    control.reset(FORWARD, 0)
    error = 0.005
    rest = np.zeros(7)
    control.torque(FORWARD, FORWARD + error, rest, rest, PERIOD_NS)
    np.testing.assert_allclose(control.feedback_Nm, np.array(LIBBARRETT_GAINS.kp) * error, rtol=1e-9)
    control.torque(FORWARD, FORWARD + error, rest, rest, 2 * PERIOD_NS)
    integral = np.array(LIBBARRETT_GAINS.ki) * error * PERIOD_S
    np.testing.assert_allclose(control.feedback_Nm, np.array(LIBBARRETT_GAINS.kp) * error + integral, rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(joints, joints, joints)
def test_vendor_feedback_stays_within_its_output_limits(error: Array, v: Array, jump: Array) -> None:
    """Protects the vendor's law, 5.4: controller output is clipped before gravity is added."""
    control = JointControl(ArmModel(), LIBBARRETT_GAINS, TorqueLimits((1e3,) * 7, (1e9,) * 7))
    control.reset(FORWARD, 0)
    for period in (1, 2, 3):
        control.torque(FORWARD + period * jump, FORWARD + error, v, np.zeros(7), period * PERIOD_NS)
        assert (np.abs(control.feedback_Nm) <= np.array([25, 20, 15, 15, 5, 5, 5]) + 1e-9).all()


@settings(max_examples=25, deadline=None)
@given(joints, joints, st.sampled_from([STIFF_GAINS, CALM_GAINS, LIBBARRETT_GAINS]))
def test_soft_limits_push_inwards_only(beyond: Array, command: Array, gains: JointGains) -> None:
    """Protects the stops: a joint at rest beyond a limit is accelerated inwards, wherever the command is."""
    q = np.where(beyond > 0.0, LIMITS.upper_rad, LIMITS.lower_rad) + 0.02 * beyond
    outside = np.abs(beyond) > 1e-3
    if gains.scaled_by_inertia:  # an integral of torque would mix the joints' accelerations
        gains = replace(gains, ki=(0.0,) * 7)
    model, rest = ArmModel(), np.zeros(7)
    control = JointControl(model, gains, TorqueLimits((1e6,) * 7, (1e9,) * 7), SoftLimits(LIMITS, PERIOD_S))
    start = np.clip(q, LIMITS.lower_rad, LIMITS.upper_rad)
    control.reset(start, 0)
    for period in range(1, 120):  # the joint is pushed out at once; then its velocity filter settles
        goal = start + np.minimum(period / 20, 1.0) * 0.1 * command
        control.torque(q, goal, rest, rest, period * PERIOD_NS)
    pull: Array = control.feedback_Nm
    if gains.scaled_by_inertia:
        pull = np.asarray(np.linalg.solve(model.mass_matrix(q), pull), np.float64)
    assert (pull * np.sign(beyond))[outside].max(initial=-1.0) < 0.0


@pytest.mark.parametrize("gains", [STIFF_GAINS, CALM_GAINS, LIBBARRETT_GAINS])
@pytest.mark.parametrize("joint", range(7))
def test_a_command_that_runs_past_a_limit_does_not_take_the_arm_along(gains: JointGains, joint: int) -> None:
    """Protects the stops from a planner gone wrong: at the fastest allowed speed the joint stays within 0.04 rad."""
    q = FORWARD.copy()
    q[joint] = LIMITS.upper_rad[joint] - 0.3
    control, arm = JointControl(ArmModel(), gains, None, SoftLimits(LIMITS, PERIOD_S)), SimulatedArm(q)
    control.reset(arm.encoder(), -PERIOD_NS)
    v, a, furthest = np.zeros(7), np.zeros(7), -np.inf
    for period in range(750):
        speed = min(v[joint] + LIMITS.acceleration_rad_s2[joint] * PERIOD_S, LIMITS.velocity_rad_s[joint])
        speed = speed if q[joint] < LIMITS.upper_rad[joint] + 0.5 else 0.0
        a[joint], v[joint] = (speed - v[joint]) / PERIOD_S, speed
        q[joint] += PERIOD_S * speed
        arm.run_period(control.torque(arm.encoder(), q, v, a, period * PERIOD_NS))
        furthest = max(furthest, arm.q[joint])
    assert q[joint] > LIMITS.upper_rad[joint] + 0.4
    assert furthest < LIMITS.upper_rad[joint] + 0.04


def test_home_beyond_a_limit_does_not_kick() -> None:
    """Protects activation at home, where joint 4 lies 0.03 rad above its limit: the arm stays where it stands."""
    home = np.array(PARAMETERS.home_rad)
    assert home[3] > LIMITS.upper_rad[3] + 0.02
    model = ArmModel()
    control, arm, rest = JointControl(model, None, None, SoftLimits(LIMITS, PERIOD_S)), SimulatedArm(home), np.zeros(7)
    start = arm.encoder()
    control.reset(start, -PERIOD_NS)
    for period in range(250):
        torque = control.torque(arm.encoder(), start, rest, rest, period * PERIOD_NS)
        if period == 0:
            np.testing.assert_allclose(torque, model.gravity(start), rtol=0, atol=1e-9)
        arm.run_period(torque)
    assert np.abs(arm.q - home).max() < 5e-4


def test_stiff_gains_accelerate_the_arm_alike_in_every_pose() -> None:
    """Protects the scaling: an error asks for kp times itself as acceleration, whatever the pose and the coupling."""
    model, error, rest = ArmModel(), np.full(7, 1e-3), np.zeros(7)
    for q in (ELBOW_UP, FORWARD):
        control = JointControl(model, STIFF_GAINS, TorqueLimits((1e3,) * 7, (1e9,) * 7))
        control.reset(q, 0)
        control.torque(q, q + error, rest, rest, PERIOD_NS)
        np.testing.assert_allclose(
            np.linalg.solve(model.mass_matrix(q), control.feedback_Nm), STIFF_GAINS.kp * error, rtol=1e-6
        )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_torque_and_rate_limits_are_laws(seed: int) -> None:
    """Protects motors and cables whatever is measured and commanded, at uneven times, within soft limits or beyond."""
    random = np.random.default_rng(seed)
    limits = TorqueLimits.from_parameters(PARAMETERS)
    control = JointControl(ArmModel(), (STIFF_GAINS, LIBBARRETT_GAINS)[seed % 2], limits, SoftLimits(LIMITS, PERIOD_S))
    control.reset(random.uniform(-1.0, 1.0, 7), 0)
    now_ns, torques, times = 0, [], []
    for _ in range(200):
        now_ns += int(random.integers(1, 8_000_000))
        measured, q, v, a = random.normal(size=(4, 7)) * random.choice([0.01, 1.0, 30.0])
        torques.append(control.torque(measured, q, v, a, now_ns))
        times.append(now_ns)
    assert (np.abs(torques) <= np.array(limits.torque_Nm) + 1e-12).all()
    for (before, after), (began, ended) in zip(pairwise(torques), pairwise(times), strict=True):
        assert (np.abs(after - before) <= np.array(limits.rate_Nm_per_s) * (ended - began) * 1e-9 + 1e-9).all()


@settings(max_examples=20, deadline=None)
@given(gaps=st.lists(st.integers(500_000, 20_000_000), min_size=1, max_size=40))
def test_velocity_filter_is_exact_on_a_ramp_at_any_times(gaps: list[int]) -> None:
    """Protects the use of true time stamps: on a steady motion only Π 1 / (1 + ω T) of the start is left."""
    control = JointControl(ArmModel())
    speed = np.linspace(-1.0, 1.0, 7)
    control.reset(np.zeros(7), 0)
    now_ns, left = 0, 1.0
    for gap in gaps:
        now_ns += gap
        left /= 1.0 + 180.0 * gap * 1e-9
        q = speed * now_ns * 1e-9
        control.torque(q, q, speed, np.zeros(7), now_ns)
    np.testing.assert_allclose(control.velocity, speed * (1.0 - left), rtol=1e-6, atol=1e-9)


def test_stale_sample_changes_nothing() -> None:
    """Protects velocity and integral from a repeated sample: the last torque stands."""
    control, rest = JointControl(ArmModel()), np.zeros(7)
    control.reset(FORWARD, 0)
    first = control.torque(FORWARD + 1e-3, FORWARD, rest, rest, PERIOD_NS)
    velocity = control.velocity
    again = control.torque(FORWARD + 2e-3, FORWARD, rest, rest, PERIOD_NS)
    np.testing.assert_array_equal(again, first)
    np.testing.assert_array_equal(control.velocity, velocity)


def test_integral_does_not_wind_up_against_the_limit() -> None:
    """Protects the release after the arm was held: the integral has not grown while the torque was limited."""
    limits = TorqueLimits((40.0, 40.0, 20.0, 20.0, 5.0, 5.0, 1.0), (1e6,) * 7)
    control, rest = JointControl(ArmModel(), STIFF_GAINS, limits), np.zeros(7)
    control.reset(FORWARD, 0)
    held = FORWARD - 0.3
    for period in range(1, 500):
        control.torque(held, FORWARD, rest, rest, period * PERIOD_NS)
    assert control.saturated
    for period in range(500, 600):  # back at its goal, the velocity filter settled
        control.torque(FORWARD, FORWARD, rest, rest, period * PERIOD_NS)
    assert np.abs(control.feedback_Nm[:4]).max() < 1.0  # the wrist's torques never came to their limits


def test_bad_input_is_refused() -> None:
    """Protects the arm from torques of NaN, of no starting point and of gains that mean something else."""
    control, rest = JointControl(ArmModel()), np.zeros(7)
    with pytest.raises(InputError, match="starting point"):
        control.torque(FORWARD, FORWARD, rest, rest, PERIOD_NS)
    control.reset(FORWARD, 0)
    for position in range(4):
        vectors = [FORWARD, FORWARD, rest, rest]
        vectors[position] = np.full(7, np.nan)
        with pytest.raises(InputError, match="expected 7 finite"):
            control.torque(vectors[0], vectors[1], vectors[2], vectors[3], PERIOD_NS)
    with pytest.raises(InputError, match="velocity_filter_rad_s"):
        JointControl(ArmModel(), velocity_filter_rad_s=float("nan"))
