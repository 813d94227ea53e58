"""Inverse kinematics against dense least squares and a bounded solver, and its limits as laws over long runs."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from controller.cycle.arm_model import ArmModel
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics, IkStep, TrackingSettings
from controller.cycle.joint_bounds import JointLimits
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

Array = npt.NDArray[np.float64]
Solver = Literal["qp", "pseudoinverse"]

PERIOD_S = 0.002
PARAMETERS = load_wam_parameters()
LIMITS = JointLimits.from_parameters(PARAMETERS)
ANYTHING = JointLimits(np.full(7, -9.0), np.full(7, 9.0), np.full(7, 1e6), np.full(7, 1e9))
START = np.array([0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4])
MODEL = ArmModel()


def kinematics(
    solver: Solver = "qp", limits: JointLimits = LIMITS, posture: Array = START
) -> DifferentialInverseKinematics:
    return DifferentialInverseKinematics(MODEL, limits, PERIOD_S, posture, solver=solver)


def moved(T: Array, shift: Array, turn: Array) -> Array:
    target = T.copy()
    target[:3, 3] += shift
    target[:3, :3] = pinocchio.exp3(turn) @ T[:3, :3]
    return target


@pytest.mark.parametrize("solver", ["qp", "pseudoinverse"])
def test_follows_a_compensating_motion(solver: Solver) -> None:
    """Protects the point of it all: a wrist moving as in compensation is followed to a micrometre, without bounds."""
    solving, q, v, T_start = kinematics(solver), START.copy(), np.zeros(7), MODEL.wrist_pose(START)
    axis = np.array([0.6, -0.64, 0.48])

    def target(step: int) -> tuple[Array, float]:
        phase = min(step * PERIOD_S / 1.5, 1.0)
        return moved(T_start, 0.0255 * phase**2 * (3 - 2 * phase) * axis, 0.1 * phase**2 * (3 - 2 * phase) * axis), 0

    worst_m = worst_rad = 0.0
    for step in range(1000):
        (now, _), (then, _) = target(step), target(step + 1)
        twist = np.concatenate([then[:3, 3] - now[:3, 3], pinocchio.log3(then[:3, :3] @ now[:3, :3].T)]) / PERIOD_S
        answer = solving.step(q, v, then, twist)
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
        assert not answer.bounded
        assert answer.scale == 1.0
        reached = MODEL.wrist_pose(q)
        worst_m = max(worst_m, float(np.linalg.norm(reached[:3, 3] - then[:3, 3])))
        worst_rad = max(worst_rad, float(np.linalg.norm(pinocchio.log3(reached[:3, :3].T @ then[:3, :3]))))
    assert worst_m < 1e-6
    assert worst_rad < 1e-5


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_unbounded_answer_is_dense_least_squares(seed: int) -> None:
    """Protects task, damping and posture: numpy's least squares on the stacked problem gives the same velocity."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.2, 1.2, 7)
    settings_ = TrackingSettings()
    J = MODEL.jacobian(q) * np.array([1.0] * 3 + [settings_.rotation_length_m] * 3)[:, None]
    if np.linalg.svd(J, compute_uv=False)[-1] < 2.5 * settings_.singular_threshold_m:
        return
    posture, twist = q + random.uniform(-0.5, 0.5, 7), random.normal(size=6) * 0.05
    away = posture - q
    lean = np.sign(away) * np.clip(settings_.posture_gain_per_s * (np.abs(away) - settings_.posture_band_rad), 0, 0.1)
    stacked = np.vstack([J, settings_.damping * np.eye(7)])
    wanted = twist * np.array([1.0] * 3 + [settings_.rotation_length_m] * 3)
    oracle = np.linalg.lstsq(stacked, np.concatenate([wanted, settings_.damping * lean]), rcond=None)[0]

    target = moved(MODEL.wrist_pose(q), PERIOD_S * twist[:3], PERIOD_S * twist[3:])
    answer = kinematics("qp", ANYTHING, posture).step(q, np.zeros(7), target, twist)

    np.testing.assert_allclose(answer.velocity, oracle, rtol=0, atol=1e-9)
    assert answer.position_error_m < 1e-12
    paper = kinematics("pseudoinverse", ANYTHING, posture).step(q, np.zeros(7), target, twist)
    np.testing.assert_allclose(paper.velocity, np.linalg.pinv(J) @ wanted, rtol=0, atol=1e-4)
    calm = kinematics("qp", ANYTHING, q).step(q, np.zeros(7), target, twist)
    np.testing.assert_allclose(calm.velocity, paper.velocity, rtol=0, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_bounded_answer_is_the_optimum(seed: int) -> None:
    """Protects the QP: no velocity and scale within the bounds fit the stated aim better, by another solver."""
    random = np.random.default_rng(seed)
    q, twist = START + random.uniform(-0.2, 0.2, 7), random.normal(size=6) * 0.3
    target = moved(MODEL.wrist_pose(q), PERIOD_S * twist[:3], PERIOD_S * twist[3:])
    unbounded = kinematics("qp", ANYTHING, q).step(q, np.zeros(7), target, twist).velocity
    v_previous = 0.3 * unbounded + random.uniform(-0.05, 0.05, 7)
    v_previous = np.clip(v_previous, -LIMITS.velocity_rad_s, LIMITS.velocity_rad_s)
    solving = kinematics("qp", LIMITS, q)
    answer = solving.step(q, v_previous, target, twist)
    if not answer.bounded:
        return
    settings_ = solving.settings
    J = MODEL.jacobian(q) * np.array([1.0] * 3 + [settings_.rotation_length_m] * 3)[:, None]
    root = np.linalg.cholesky(J.T @ J + settings_.bounded_damping**2 * np.eye(7)).T
    size = float(np.linalg.norm(root @ unbounded))
    weight = np.sqrt(settings_.slowing_weight) * size
    A = np.zeros((8, 8))
    A[:7, :7], A[:7, 7], A[7, 7] = root, -root @ unbounded, weight
    b = np.array([0.0] * 7 + [weight])
    lower, upper = solving.bounds.at(q.tolist(), v_previous.tolist())
    best = lsq_linear(A / size, b / size, (np.array([*lower, 0.0]) - 1e-12, np.array([*upper, 1.0]) + 1e-12), tol=1e-14)
    mine = np.sum((A @ np.array([*answer.velocity, answer.scale]) - b) ** 2) / size**2
    assert mine <= np.sum((A @ best.x - b) ** 2) / size**2 * (1 + 1e-6) + 1e-9


@pytest.mark.parametrize("solver", ["qp", "pseudoinverse"])
def test_hurried_target_is_approached_along_its_path(solver: Solver) -> None:
    """Protects the direction: where acceleration binds at the start, the wrist goes slower, not elsewhere."""
    shift = np.array([0.1, 0.0, 0.0])
    target = moved(MODEL.wrist_pose(START), shift, np.zeros(3))
    solving = kinematics(solver)
    answer = solving.step(START, np.zeros(7), target, np.zeros(6))
    twist = MODEL.jacobian(START) @ answer.velocity
    assert answer.bounded
    assert 0.0 < answer.scale < 0.2
    assert answer.position_error_m == pytest.approx(0.1)
    assert twist[0] > 0.005
    assert np.linalg.norm(twist[1:3]) < 0.01 * solving.settings.feedback_speed_m_s


@pytest.mark.parametrize("solver", ["qp", "pseudoinverse"])
def test_far_target_is_reached_without_overshoot_and_recovered_from(solver: Solver) -> None:
    """Protects recovery: after an unreachable target the wrist comes back and rests exactly where it is wanted."""
    solving, q, v, T_start = kinematics(solver), START.copy(), np.zeros(7), MODEL.wrist_pose(START)
    for _ in range(400):
        answer = solving.step(q, v, moved(T_start, np.array([2.0, 0.0, 0.0]), np.zeros(3)), np.zeros(6))
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
    along = []
    for _ in range(2500):
        answer = solving.step(q, v, T_start, np.zeros(6))
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
        along.append(MODEL.wrist_pose(q)[0, 3] - T_start[0, 3])
    assert max(along) > 0.08
    assert min(along) > -2e-4
    assert answer.position_error_m < 1e-5
    assert not answer.bounded


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), solver=st.sampled_from(["qp", "pseudoinverse"]))
def test_limits_are_laws(seed: int, solver: Solver) -> None:
    """Protects the arm over long runs of wild targets, from home outside its limits and from anywhere inside them."""
    random = np.random.default_rng(seed)
    solving = kinematics(solver)
    q = random.uniform(LIMITS.lower_rad, LIMITS.upper_rad)
    if seed % 2:
        q = PARAMETERS.home_rad.copy()
    lowest, highest = np.minimum(LIMITS.lower_rad, q), np.maximum(LIMITS.upper_rad, q)
    v = np.zeros(7)
    target, twist = MODEL.wrist_pose(q), np.zeros(6)
    for step in range(600):
        if step % 150 == 0:
            target = MODEL.wrist_pose(random.uniform(LIMITS.lower_rad, LIMITS.upper_rad))
            twist = random.normal(size=6) * random.choice([0.0, 0.5])
        answer = solving.step(q, v, target, twist)
        assert 0.0 <= answer.scale <= 1.0
        assert (np.abs(answer.velocity - v) <= LIMITS.acceleration_rad_s2 * PERIOD_S * (1 + 1e-9)).all()
        assert (np.abs(answer.velocity) <= LIMITS.velocity_rad_s * (1 + 1e-12)).all()
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
        assert (q >= lowest - 1e-12).all()
        assert (q <= highest + 1e-12).all()
        lowest, highest = (
            np.maximum(lowest, np.minimum(LIMITS.lower_rad, q)),
            np.minimum(highest, np.maximum(LIMITS.upper_rad, q)),
        )


def test_nearly_stretched_arm_stays_calm() -> None:
    """Protects an arm near a singularity from being thrown about: plain inversion asks for many times the speed."""
    stretched = np.array([0.0, 0.8, 0.0, 0.235, 0.0, 0.8, 0.0])
    twist = np.array([0.015, 0.0, 0.0125, 0.0, 0.0, 0.0])
    target = moved(MODEL.wrist_pose(stretched), PERIOD_S * twist[:3], np.zeros(3))
    damped = kinematics("qp", ANYTHING, stretched).step(stretched, np.zeros(7), target, twist).velocity
    plain = kinematics("pseudoinverse", ANYTHING, stretched).step(stretched, np.zeros(7), target, twist).velocity
    assert np.abs(plain).max() > 10.0
    assert np.abs(damped).max() < 1.0


def test_free_motion_leans_to_the_posture() -> None:
    """Protects the elbow: with the wrist at rest, free motion takes the arm towards its posture, where it rests."""
    posture, q, v = START + 0.6, START.copy(), np.zeros(7)
    solving, T = kinematics("qp", LIMITS, posture), MODEL.wrist_pose(START)
    answer: IkStep | None = None
    for _ in range(1500):
        answer = solving.step(q, v, T, np.zeros(6))
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
    assert answer is not None
    assert answer.position_error_m < 2e-5
    assert np.linalg.norm(posture - q) < np.linalg.norm(posture - START) - 0.02
    solving.set_posture(q)
    for _ in range(500):
        answer = solving.step(q, v, T, np.zeros(6))
        q, v = q + PERIOD_S * answer.velocity, answer.velocity
    assert np.abs(v).max() < 1e-5


def test_bad_targets_are_refused() -> None:
    """Protects the arm from NaN and wrong shapes, with nothing changed."""
    solving, T, rest = kinematics(), MODEL.wrist_pose(START), np.zeros(7)
    broken = T.copy()
    broken[0, 3] = np.nan
    with pytest.raises(InputError, match="not finite"):
        solving.step(START, rest, broken, np.zeros(6))
    with pytest.raises(InputError, match="not finite"):
        solving.step(START, rest, T, np.full(6, np.inf))
    with pytest.raises(InputError, match="shape"):
        solving.step(START, rest, T, np.zeros(3))
    with pytest.raises(InputError, match="velocities"):
        solving.step(START, np.full(7, np.nan), T, np.zeros(6))
    with pytest.raises(InputError, match="solver"):
        DifferentialInverseKinematics(MODEL, LIMITS, PERIOD_S, START, solver="transpose")  # type: ignore[arg-type]  # the point of the test
    with pytest.raises(InputError, match="damping"):
        TrackingSettings(damping=0.0)
