"""The compensating offset: against 4×4 matrices and finite differences, and Ruckig within its limits."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.cycle.compensation import (
    STILL,
    OffsetLimits,
    OffsetSmoother,
    PlanarMotion,
    Vector3,
    WristOffset,
    hand_offset,
)

Array = NDArray[np.float64]
PERIOD_S = 0.002
LIMITS = OffsetLimits()

places = st.tuples(st.floats(-0.1, 0.1), st.floats(0.0, 0.15), st.floats(-0.6, 0.6))
rates = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-1.0, 1.0))
turns = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


def planar(pose: Vector3) -> Array:
    x, y, angle = pose
    T = np.eye(4)
    T[:3, :3] = pinocchio.exp3(np.array([0.0, 0.0, angle]))
    T[:2, 3] = x, y
    return T


def along(start: Vector3, rate: Vector3, acceleration: Vector3, time_s: float) -> Vector3:
    x, y, angle = (p + v * time_s + 0.5 * a * time_s**2 for p, v, a in zip(start, rate, acceleration, strict=True))
    return x, y, angle


def mount(turn: Vector3) -> Array:
    T = np.eye(4)
    T[:3, :3] = pinocchio.exp3(np.array(turn))
    T[:3, 3] = 0.02, -0.03, 0.08
    return T


@given(places, places, rates, rates)
def test_hand_offset_is_the_rigid_motion_and_its_derivatives(
    contact: Vector3, pose: Vector3, rate: Vector3, acceleration: Vector3
) -> None:
    """D = T_HO(0)·T_HO(t)⁻¹ exactly, with rate and acceleration that a central difference agrees with."""

    def offset(time_s: float) -> Array:
        return planar(contact) @ np.linalg.inv(planar(along(pose, rate, acceleration, time_s)))

    def as_vector(T: Array) -> Array:
        return np.array([*T[:2, 3], contact[2] - pose[2] + pinocchio.log3(T[:3, :3] @ T_now[:3, :3].T)[2]])

    motion = hand_offset(contact, pose, rate, acceleration)
    T_now = offset(0.0)
    np.testing.assert_allclose(planar(motion.pose), T_now, atol=1e-12)
    step_s = 1e-3
    before, now, after = (as_vector(offset(time_s)) for time_s in (-step_s, 0.0, step_s))
    np.testing.assert_allclose(motion.rate, (after - before) / (2 * step_s), atol=3e-6)
    np.testing.assert_allclose(motion.acceleration, (after - 2 * now + before) / step_s**2, atol=3e-5)


@given(places)
def test_no_motion_needs_no_offset(contact: Vector3) -> None:
    """At first contact the wrist is where it was planned."""
    assert hand_offset(contact, contact, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).pose == pytest.approx((0, 0, 0), abs=1e-15)


def laid_on(wrist: WristOffset, plan: Array, offset: PlanarMotion) -> tuple[Array, Array]:
    """Target pose and twist on top of a planned wrist."""
    target, twist = np.eye(4), np.zeros(6)
    wrist.plan(plan)
    shift = wrist.lay_on(offset, target, twist)
    np.testing.assert_allclose(target[:3, 3] - plan[:3, 3], shift, atol=1e-12)
    return target, twist


@given(places, turns, turns)
def test_wrist_offset_is_the_conjugate_by_the_mount(offset: Vector3, turn: Vector3, plan_turn: Vector3) -> None:
    """X = T_WH·D·T_WH⁻¹, whatever the hand's mounting and the planned wrist, built or laid on."""
    T_wrist_hand, plan = mount(turn), mount(plan_turn)
    motion = PlanarMotion(offset, STILL.rate, STILL.acceleration)
    X = T_wrist_hand @ planar(offset) @ np.linalg.inv(T_wrist_hand)
    wrist = WristOffset(T_wrist_hand)
    np.testing.assert_allclose(wrist.matrix(motion), X, atol=1e-12)
    np.testing.assert_allclose(laid_on(wrist, plan, motion)[0], plan @ X, atol=1e-12)


@given(places, places, rates, turns)
def test_compensated_object_stands_still(contact: Vector3, pose: Vector3, rate: Vector3, turn: Vector3) -> None:
    """The whole law of the project: T_plan·X·T_WH·T_HO(t) is the same for every t."""
    T_wrist_hand = mount(turn)
    X = WristOffset(T_wrist_hand).matrix(hand_offset(contact, pose, rate, rate))
    np.testing.assert_allclose(X @ T_wrist_hand @ planar(pose), T_wrist_hand @ planar(contact), atol=1e-12)


@given(places, rates, turns, turns)
def test_wrist_twist_is_the_rate_of_the_wrist_offset(
    offset: Vector3, rate: Vector3, turn: Vector3, plan_turn: Vector3
) -> None:
    """The feed-forward of the inverse kinematics agrees with a central difference of the pose it leads to."""
    wrist, plan = WristOffset(mount(turn)), mount(plan_turn)
    still: Vector3 = (0.0, 0.0, 0.0)
    _, twist = laid_on(wrist, plan, PlanarMotion(offset, rate, still))
    step_s = 1e-5
    before, after = (
        laid_on(wrist, plan, PlanarMotion(along(offset, rate, still, time_s), rate, still))[0]
        for time_s in (-step_s, step_s)
    )
    np.testing.assert_allclose(twist[:3], (after[:3, 3] - before[:3, 3]) / (2 * step_s), atol=1e-8)
    turned = pinocchio.log3(after[:3, :3] @ before[:3, :3].T)
    np.testing.assert_allclose(twist[3:], turned / (2 * step_s), atol=1e-8)


targets = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-0.5, 0.5))
shares = st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))


def of(limits: Vector3, share: Vector3) -> Vector3:
    return (limits[0] * share[0], limits[1] * share[1], limits[2] * share[2])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(targets, shares, shares), min_size=1, max_size=12), st.booleans())
def test_smoother_stays_within_its_limits(jumps: list[tuple[Vector3, Vector3, Vector3]], standing: bool) -> None:
    """However the target jumps the wrist moves on without a jump of its own: jerk and acceleration within their limits,
    and speed too as long as the target jumps in place only."""
    smoother = OffsetSmoother(PERIOD_S, LIMITS)
    previous = STILL
    for (x, y, angle), rate, acceleration in jumps:
        pose = (0.987 * x, 0.987 * y, 0.987 * angle)  # round numbers meet Ruckig's own corners, see below
        target = PlanarMotion(pose, of(LIMITS.velocity, rate), of(LIMITS.acceleration, acceleration))
        if standing:
            target = PlanarMotion(pose, STILL.rate, STILL.acceleration)
        for _ in range(15):
            now = smoother.step(target)
            jerk = (np.array(now.acceleration) - previous.acceleration) / PERIOD_S
            assert not standing or np.all(np.abs(now.rate) <= 1.001 * np.array(LIMITS.velocity))
            assert np.all(np.abs(now.acceleration) <= 1.001 * np.array(LIMITS.acceleration))
            assert np.all(np.abs(jerk) <= 1.001 * np.array(LIMITS.jerk))
            mean_rate = 0.5 * (np.array(now.rate) + previous.rate)
            moved = np.array(now.pose) - previous.pose
            np.testing.assert_allclose(moved, mean_rate * PERIOD_S, atol=2 * max(LIMITS.jerk) * PERIOD_S**3)
            previous = now


def test_smoother_survives_where_two_kinds_of_profile_meet() -> None:
    """A step that just reaches the acceleration limit, to the last bit, is smoothed like its neighbours."""
    meeting_rad = 2 * LIMITS.acceleration[2] ** 3 / LIMITS.jerk[2] ** 2
    smoother = OffsetSmoother(PERIOD_S, LIMITS)
    for _ in range(300):
        smoother.step(PlanarMotion((0.0, 0.0, meeting_rad), STILL.rate, STILL.acceleration))
    assert smoother.motion.pose[2] == pytest.approx(meeting_rad, abs=1e-9)


def follow(smoother: OffsetSmoother, path: Callable[[float], PlanarMotion], duration_s: float) -> float:
    """Largest distance, m, behind a moving target."""
    worst_m = 0.0
    for step in range(1, round(duration_s / PERIOD_S)):
        target = path(step * PERIOD_S)
        motion = smoother.step(target)
        worst_m = max(worst_m, math.dist(motion.pose[:2], target.pose[:2]))
    return worst_m


def test_smoother_survives_a_target_that_jumps_while_it_moves_fast() -> None:
    """An index that jumps, as by an encoder that wraps, gave Ruckig a duration beyond its range and ended the cycle."""
    smoother = OffsetSmoother(PERIOD_S, LIMITS)
    jumped = PlanarMotion(
        (-0.010229972066868607, 0.04395641872207421, -0.196535360997101),
        (-0.002336238145483671, -0.20391553346345048, 1.2688591299115668),
        (-0.6671091907562889, -102.04921112167067, 634.4295649557833),
    )
    offset = smoother.step(jumped)
    assert smoother.failures == 1
    assert offset.pose == (0.0, 0.0, 0.0)


def test_smoother_follows_a_squeeze_without_lag() -> None:
    """A target that moves as a squeeze does, with its own rate and acceleration, is met within a micrometre."""

    def path(time_s: float) -> PlanarMotion:
        phase, pace = min(time_s / 1.2, 1.0), 1.0 / 1.2 if time_s < 1.2 else 0.0
        s = phase**3 * (10 - 15 * phase + 6 * phase**2)
        ds = 30 * phase**2 * (1 - phase) ** 2 * pace
        dds = 60 * phase * (1 - phase) * (1 - 2 * phase) * pace**2
        scale = (0.004, 0.018, 0.12)
        x, y, angle = ((k * s, k * ds, k * dds) for k in scale)
        return PlanarMotion((x[0], y[0], angle[0]), (x[1], y[1], angle[1]), (x[2], y[2], angle[2]))

    smoother = OffsetSmoother(PERIOD_S, LIMITS)
    assert follow(smoother, path, 1.4) < 1e-6
    assert smoother.motion.pose == pytest.approx((0.004, 0.018, 0.12), abs=1e-9)


def test_smoother_catches_up_with_a_moving_target() -> None:
    """Begun 5 mm behind, it meets a target that goes on at constant speed, and then stays with it."""
    smoother, speed = OffsetSmoother(PERIOD_S, LIMITS), 0.03

    def path(time_s: float) -> PlanarMotion:
        return PlanarMotion((0.005 + speed * time_s, 0.0, 0.0), (speed, 0.0, 0.0), STILL.acceleration)

    assert follow(smoother, path, 0.5) > 0.0045
    assert follow(smoother, lambda time_s: path(0.5 - PERIOD_S + time_s), 0.5) < 1e-6


def test_smoother_forgets_on_reset() -> None:
    """The next grasp does not begin with the offset of the last."""
    smoother = OffsetSmoother(PERIOD_S, LIMITS)
    for _ in range(20):
        smoother.step(PlanarMotion((0.01, 0.02, 0.1), STILL.rate, STILL.acceleration))
    assert smoother.motion.pose[0] > 0.0
    smoother.reset()
    assert smoother.motion is STILL
    assert smoother.step(STILL).pose == (0.0, 0.0, 0.0)
