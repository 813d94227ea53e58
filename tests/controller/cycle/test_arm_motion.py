"""Where the arm is commanded to be: paths against straight lines, offsets against 4×4 matrices, stops on the path."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

from controller.cycle.arm_model import ArmModel
from controller.cycle.arm_motion import ArmMotion, ArmMotionLimits
from controller.cycle.compensation import STILL, PlanarMotion, WristOffset
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics
from controller.cycle.joint_bounds import JointLimits
from drivers.wam.parameters import load_wam_parameters

Array = NDArray[np.float64]
PERIOD_S = 0.002
START = np.array([0.1, 0.4, -0.2, 2.0, 0.3, -0.7, 0.2])
PARAMETERS = load_wam_parameters()
JOINT_LIMITS = JointLimits.from_parameters(PARAMETERS)
LIMITS = ArmMotionLimits()
MODEL = ArmModel()
T_WRIST_HAND = np.eye(4)
T_WRIST_HAND[:3, :3] = pinocchio.Quaternion(0.5, 0.5, -0.5, -0.5).matrix()
T_WRIST_HAND[:3, 3] = 0.0, 0.01, 0.08


@pytest.fixture
def motion() -> ArmMotion:
    kinematics = DifferentialInverseKinematics(MODEL, JOINT_LIMITS, PERIOD_S, PARAMETERS.home_rad)
    motion = ArmMotion(MODEL, kinematics, WristOffset(T_WRIST_HAND), PERIOD_S, LIMITS)
    motion.place(START)
    return motion


def run(motion: ArmMotion, throttle: float = 1.0, most: int = 3000) -> Iterator[ArmMotion]:
    """Step until the path is done."""
    for _ in range(most):
        if not motion.moving:
            return
        motion.step(STILL, throttle)
        yield motion


def sideways(shift: tuple[float, float, float], turn: tuple[float, float, float]) -> Array:
    T = MODEL.wrist_pose(START).copy()
    T[:3, 3] += shift
    T[:3, :3] = pinocchio.exp3(np.array(turn)) @ T[:3, :3]
    return T


def distance(one: Array, other: Array) -> tuple[float, float]:
    """Between two poses, m and rad."""
    turn = pinocchio.log3(one[:3, :3].T @ other[:3, :3])
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(np.linalg.norm(turn))


def test_stands_where_it_was_placed(motion: ArmMotion) -> None:
    """After activation the arm is commanded where it is: not a count further, for as long as nothing is asked."""
    np.testing.assert_array_equal(motion.T_world_wrist_plan, MODEL.wrist_pose(START))
    for _ in range(200):
        motion.step(STILL, 1.0)
    np.testing.assert_allclose(motion.joint_rad, START, atol=1e-9)
    assert not motion.moving


def test_wrist_moves_along_a_straight_line_and_a_single_axis(motion: ArmMotion) -> None:
    """The approach of a grasp is a line: what stands beside it is not touched. The joints follow to 0.1 mm."""
    start, goal = MODEL.wrist_pose(START).copy(), sideways((0.06, -0.08, 0.05), (0.2, -0.1, 0.3))
    line = goal[:3, 3] - start[:3, 3]
    axis = np.array([0.2, -0.1, 0.3])
    motion.move_wrist(goal, speed=1.0)
    before_v, before_fraction = np.zeros(7), 0.0
    for now in run(motion):
        shift = now.T_world_wrist_plan[:3, 3] - start[:3, 3]
        fraction = float(shift @ line / (line @ line))
        assert np.linalg.norm(shift - fraction * line) < 1e-12
        turn = pinocchio.log3(now.T_world_wrist_plan[:3, :3] @ start[:3, :3].T)
        np.testing.assert_allclose(turn, fraction * axis, atol=1e-9)
        assert (fraction - before_fraction) / PERIOD_S * np.linalg.norm(line) <= LIMITS.wrist_velocity_m_s + 1e-9
        assert max(distance(MODEL.wrist_pose(now.joint_rad), now.T_world_wrist_plan)) < 1e-4
        change = (now.joint_velocity_rad_s - before_v) / PERIOD_S
        assert np.all(np.abs(change) <= JOINT_LIMITS.acceleration_rad_s2 + 1e-6)
        before_v, before_fraction = now.joint_velocity_rad_s.copy(), fraction
    assert not motion.moving
    np.testing.assert_allclose(motion.T_world_wrist_plan, goal, atol=1e-12)


def test_joints_move_together_within_their_limits(motion: ArmMotion) -> None:
    """A joint path is a line in joint space: it passes nowhere that the two ends do not promise."""
    goal = START + np.array([0.3, -0.2, 0.4, -0.5, 0.6, 0.3, -0.8])
    motion.move_joints(goal, speed=0.8)
    assert motion.moving
    before = START.copy()
    for now in run(motion):
        fraction = (now.joint_rad[6] - START[6]) / (goal[6] - START[6])
        np.testing.assert_allclose(now.joint_rad, START + fraction * (goal - START), atol=1e-9)
        assert np.all(np.abs(now.joint_velocity_rad_s) <= 0.8 * np.array(LIMITS.joint_velocity_rad_s) + 1e-9)
        assert np.all(np.abs(now.joint_acceleration_rad_s2) <= 0.8 * np.array(LIMITS.joint_acceleration_rad_s2) + 1e-9)
        np.testing.assert_allclose((now.joint_rad - before) / PERIOD_S, now.joint_velocity_rad_s, atol=5e-3)
        before = now.joint_rad.copy()
    np.testing.assert_allclose(motion.joint_rad, goal, atol=1e-9)
    np.testing.assert_array_equal(motion.joint_velocity_rad_s, np.zeros(7))
    np.testing.assert_allclose(motion.T_world_wrist_plan, MODEL.wrist_pose(goal), atol=1e-9)


@pytest.mark.parametrize("kind", ["wrist", "joints"])
def test_a_stop_comes_to_rest_on_the_path(motion: ArmMotion, kind: str) -> None:
    """A stop neither jumps nor cuts the corner: rest within the stop time, on the line, and the path is forgotten."""
    goal_rad, T_goal = START + 0.4, sideways((0.1, 0.0, 0.05), (0.0, 0.0, 0.0))
    if kind == "wrist":
        motion.move_wrist(T_goal, speed=1.0)
    else:
        motion.move_joints(goal_rad, speed=1.0)
    for _ in range(200):
        motion.step(STILL, 1.0)
    assert not motion.stop()
    before_v = motion.joint_velocity_rad_s.copy()
    assert np.max(np.abs(before_v)) > 0.05
    stopping = round(LIMITS.stop_time_s / PERIOD_S) + 1
    for _ in range(stopping):
        motion.step(STILL, 0.0)
        assert np.max(np.abs(motion.joint_velocity_rad_s - before_v)) < 0.05
        before_v = motion.joint_velocity_rad_s.copy()
    assert motion.stop()
    assert not motion.moving
    at_rest = motion.T_world_wrist_plan.copy()
    for _ in range(100):
        motion.step(STILL, 1.0)
    assert max(distance(MODEL.wrist_pose(motion.joint_rad), at_rest)) < 1e-5  # the elbow may still lean home
    assert max(distance(motion.T_world_wrist_plan, at_rest)) < 1e-9
    if kind == "wrist":
        shift, line = at_rest[:3, 3] - MODEL.wrist_pose(START)[:3, 3], T_goal[:3, 3] - MODEL.wrist_pose(START)[:3, 3]
        np.testing.assert_allclose(np.cross(shift, line), 0.0, atol=1e-12)
    else:
        fraction = (motion.joint_rad - START) / 0.4
        np.testing.assert_allclose(fraction, fraction[0], atol=1e-5)


def planar_offset(time_s: float) -> PlanarMotion:
    """A smooth hand offset of up to 12 mm and 0.1 rad, with its derivatives."""
    w = 2.5
    sin, cos = np.sin(w * time_s), np.cos(w * time_s)
    size = (0.004, -0.012, 0.1)
    pose, rate, change = (
        tuple(float(k * f) for k in size) for f in (0.5 * (1 - cos), 0.5 * w * sin, 0.5 * w * w * cos)
    )
    return PlanarMotion((pose[0], pose[1], pose[2]), (rate[0], rate[1], rate[2]), (change[0], change[1], change[2]))


@pytest.mark.parametrize("carrying", [False, True])
def test_the_offset_lies_on_top_of_the_plan(motion: ArmMotion, carrying: bool) -> None:
    """T_wrist = T_plan·X, standing and carried: the joints follow to 20 µm, so the twist they are fed is right."""
    if carrying:
        motion.move_wrist(sideways((-0.05, 0.08, 0.06), (0.3, 0.2, -0.3)), speed=0.6)
    for step in range(1, 700):
        offset = planar_offset(step * PERIOD_S)
        motion.step(offset, 1.0)
        D = np.eye(4)
        D[:3, :3] = pinocchio.exp3(np.array([0.0, 0.0, offset.pose[2]]))
        D[:2, 3] = offset.pose[:2]
        T_expected = motion.T_world_wrist_plan @ T_WRIST_HAND @ D @ np.linalg.inv(T_WRIST_HAND)
        np.testing.assert_allclose(motion.wrist_target_xyz_m, T_expected[:3, 3], atol=1e-12)
        behind_m, behind_rad = distance(MODEL.wrist_pose(motion.joint_rad), T_expected)
        if step > 50:
            assert behind_m < 2e-5
            assert behind_rad < 2e-4
    assert motion.scale == 1.0


def test_placing_forgets_the_path(motion: ArmMotion) -> None:
    """An arm that went idle under way does not go on by itself when it is activated again."""
    motion.move_wrist(sideways((0.1, 0.0, 0.0), (0.0, 0.0, 0.0)), speed=1.0)
    for _ in range(100):
        motion.step(STILL, 1.0)
    elsewhere = START + 0.05
    motion.place(elsewhere)
    assert not motion.moving
    for _ in range(50):
        motion.step(STILL, 1.0)
    np.testing.assert_allclose(motion.joint_rad, elsewhere, atol=1e-9)
