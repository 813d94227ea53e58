"""The plan of the gravity calibration, and which measurements are good enough to be fitted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibration.gravity_plan import POSES_RAD, GravityPlan, HeldPose, averaged, balanced, plan_gravity
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

ARM = load_wam_parameters()
LIMIT_NM = ARM.joint_effort_limit_Nm


def held_poses() -> list[HeldPose]:
    """What an arm without friction and weight would give."""
    return [
        HeldPose(one.pose, one.side, np.array(one.pose_rad), np.zeros(7), np.zeros(7), 100)
        for one in GravityPlan().approaches()
    ]


def test_the_plan_is_the_vendors() -> None:
    """Protects poses, offset and speed of WAM reference 6.6; on the arm's own limits no pose is moved."""
    plan = plan_gravity(ARM.joint_lower_rad, ARM.joint_upper_rad)
    assert plan.notes == ()
    assert plan.poses_rad == POSES_RAD
    assert len(plan.poses_rad) == 9
    assert plan.poses_rad[3] == (-0.7854, np.pi / 2, np.pi / 2, np.pi / 2, 0.0, 1.5, 0.0)
    assert (plan.offset_rad, plan.speed_rad_s, plan.sampling_s) == (0.03, 0.05, 4.0)


def test_each_pose_is_approached_from_both_sides() -> None:
    """Protects the cancelling of friction: eighteen ways, 0.03 rad on all joints, first down, then up."""
    ways = list(GravityPlan().approaches())
    assert [(way.pose, way.side) for way in ways] == [(pose, side) for pose in range(9) for side in (1, -1)]
    for way in ways:
        np.testing.assert_allclose(np.array(way.start_rad) - way.pose_rad, way.side * 0.03, atol=1e-12)


def test_poses_near_a_stop_are_moved_inwards_and_told() -> None:
    """Protects wrists with stops at ±1.5 rad, where the list of the vendor is too near (WAM reference 7)."""
    lower, upper = ARM.joint_lower_rad.copy(), ARM.joint_upper_rad.copy()
    lower[5], upper[5] = -1.5, 1.5
    plan = plan_gravity(lower, upper)
    assert [note.split(",")[0] for note in plan.notes] == [
        f"pose {number}: joint 6 at 1.440 instead of 1.500 rad" for number in (4, 6)
    ]
    for way in plan.approaches():
        assert (np.array(way.start_rad) <= upper - 0.03 + 1e-9).all()
        assert (np.array(way.start_rad) >= lower + 0.03 - 1e-9).all()


@pytest.mark.parametrize(("lower", "upper"), [(-2.0, 1.0), (1.57, 1.58)])
def test_limits_that_leave_no_room_are_refused(lower: float, upper: float) -> None:
    """Protects from a calibration with other poses than were thought of: joint and pose are named."""
    lowers, uppers = ARM.joint_lower_rad.copy(), ARM.joint_upper_rad.copy()
    lowers[1], uppers[1] = lower, upper
    with pytest.raises(InputError, match="joint 2"):
        plan_gravity(lowers, uppers)


def test_both_ways_are_put_together() -> None:
    """Protects the sign: friction takes torque on the way up and gives it on the way down."""
    held = [replace(one, torque_Nm=np.full(7, 0.5 - one.side * 0.2)) for one in held_poses()]
    both = balanced(GravityPlan(), held, LIMIT_NM)
    np.testing.assert_allclose(both.torque_Nm, 0.5)
    np.testing.assert_allclose(both.friction_Nm, 0.2)
    np.testing.assert_allclose(both.joint_rad, POSES_RAD)


def spoiled(change: Callable[[HeldPose], HeldPose]) -> list[HeldPose]:
    held = held_poses()
    held[11] = change(held[11])
    return held


def at(values: np.ndarray, joint: int, value: float) -> np.ndarray:
    changed = values.copy()
    changed[joint] = value
    return changed


@pytest.mark.parametrize(
    ("held", "told"),
    [
        (held_poses()[:-1], "missing: pose 9 from below"),
        ([*held_poses(), held_poses()[0]], "19 measurements"),
        (spoiled(lambda one: replace(one, torque_Nm=at(one.torque_Nm, 2, np.nan))), "pose 6 from below: .* not finite"),
        (spoiled(lambda one: replace(one, joint_rad=at(one.joint_rad, 2, -1.5))), "joint 3 had 0.0708 rad away"),
        (spoiled(lambda one: replace(one, range_rad=at(one.range_rad, 4, 0.01))), "joint 5 had 0.01 rad of motion"),
        (spoiled(lambda one: replace(one, torque_Nm=at(one.torque_Nm, 6, -1.36))), "joint 7 had 1.36 N·m, its limit"),
    ],
)
def test_bad_measurements_are_refused(held: list[HeldPose], told: str) -> None:
    """Protects the fit from a missing pose, NaN, an arm that was not there, moved, or had no more torque to give."""
    with pytest.raises(InputError, match=told):
        balanced(GravityPlan(), held, LIMIT_NM)


def test_samples_are_averaged_and_bad_ones_refused() -> None:
    """Protects from a mean over nothing, or over what is not a number."""
    way = next(iter(GravityPlan().approaches()))
    angles = [[0.001 * (sample % 2)] * 7 for sample in range(40)]
    one = averaged(way, angles, [[float(sample % 2)] * 7 for sample in range(40)])
    np.testing.assert_allclose(one.torque_Nm, 0.5)
    np.testing.assert_allclose(one.range_rad, 0.001)
    assert one.samples == 40
    with pytest.raises(InputError, match="19 samples"):
        averaged(way, angles[:19], angles[:19])
    with pytest.raises(InputError, match="pose 1 from above: 40 samples"):
        averaged(way, angles, angles[:30])
    with pytest.raises(InputError, match="not finite"):
        averaged(way, angles, [[np.nan] * 7] * 40)
