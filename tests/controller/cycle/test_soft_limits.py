"""The guard of the position limits: never past them, no jerk on the way, inert for a command that keeps them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cycle.joint_bounds import JointBounds, JointLimits
from controller.cycle.soft_limits import GUARD_ACCELERATION, SoftLimits
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

Array = npt.NDArray[np.float64]

PERIOD_S = 0.002
PARAMETERS = load_wam_parameters()
LIMITS = JointLimits.from_parameters(PARAMETERS)
CHANGE = GUARD_ACCELERATION * LIMITS.acceleration_rad_s2 * PERIOD_S
seeds = st.integers(0, 2**32 - 1)


def wandering(random: np.random.Generator, periods: int = 600) -> list[Array]:
    """Commands that run to and fro, at any speed up to the limit, far beyond both position limits."""
    q = random.uniform(LIMITS.lower_rad, LIMITS.upper_rad)
    speed = np.zeros(7)
    path = [q]
    for period in range(periods):
        if period % 50 == 0:
            speed = LIMITS.velocity_rad_s * random.choice([-1.0, -0.3, 0.0, 1.0], 7)
        path.append(path[-1] + PERIOD_S * speed)
    return path


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_no_command_leads_past_a_limit(seed: int) -> None:
    """Protects the stops: as long as a command keeps the speed limits, what is passed on keeps the position limits."""
    path = wandering(np.random.default_rng(seed))
    guard = SoftLimits(LIMITS, PERIOD_S)
    guard.reset(path[0].tolist())
    for before, q in pairwise(path):
        guarded, _, _ = guard.held(q, (q - before) / PERIOD_S, np.zeros(7))
        assert (guarded <= LIMITS.upper_rad + 1e-9).all()
        assert (guarded >= LIMITS.lower_rad - 1e-9).all()


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_what_is_passed_on_is_one_motion(seed: int) -> None:
    """Protects the arm from steps: position, speed and acceleration belong together, and it brakes no harder than
    said wherever it departs from the command."""
    path = wandering(np.random.default_rng(seed))
    guard = SoftLimits(LIMITS, PERIOD_S)
    guard.reset(path[0].tolist())
    last, last_speed = path[0], np.zeros(7)
    for before, q in pairwise(path):
        guarded, speed, acceleration = guard.held(q, (q - before) / PERIOD_S, np.zeros(7))
        apart = guarded != q
        np.testing.assert_allclose(guarded[apart], (last + PERIOD_S * speed)[apart], rtol=0, atol=1e-9)
        np.testing.assert_allclose(acceleration[apart], ((speed - last_speed) / PERIOD_S)[apart], rtol=1e-9, atol=1e-6)
        assert (np.abs(last_speed) - np.abs(speed) <= CHANGE + 1e-9)[apart].all()
        last, last_speed = guarded, speed


@settings(max_examples=5, deadline=None)
@given(seeds)
def test_a_command_that_keeps_the_limits_is_untouched(seed: int) -> None:
    """Protects tracking: whatever obeys the motion's own bounds, up to the very limit, passes bit by bit."""
    random = np.random.default_rng(seed)
    bounds, guard = JointBounds(LIMITS, PERIOD_S), SoftLimits(LIMITS, PERIOD_S)
    q, v = random.uniform(LIMITS.lower_rad, LIMITS.upper_rad), np.zeros(7)
    guard.reset(q.tolist())
    wish = np.zeros(7)
    for period in range(1500):
        if period % 300 == 0:
            wish = random.choice([-10.0, 10.0], 7)
        lower, upper = bounds.at(q.tolist(), v.tolist())
        speed = np.clip(wish, lower, upper)
        a, v = (speed - v) / PERIOD_S, speed
        q = q + PERIOD_S * v
        for passed, given_ in zip(guard.held(q, v, a), (q, v, a), strict=True):
            np.testing.assert_allclose(passed, given_, rtol=0, atol=1e-9)


def test_home_beyond_a_limit_is_held_and_left_inwards_only() -> None:
    """Protects activation at home: joint 4 rests 0.03 rad above its limit, may come in, and may not go further out."""
    home = np.array(PARAMETERS.home_rad)
    guard, rest = SoftLimits(LIMITS, PERIOD_S), np.zeros(7)
    guard.reset(home.tolist())
    np.testing.assert_array_equal(guard.held(home, rest, rest)[0], home)
    further = home + 1e-3
    assert guard.held(further, rest, rest)[0][3] == home[3]
    guard.reset(home.tolist())
    inwards = home.copy()
    for _ in range(100):
        inwards[3] -= 2e-4
        assert guard.held(inwards, rest, rest)[0][3] == pytest.approx(inwards[3], abs=1e-9)


def test_it_catches_up_with_a_command_that_has_come_back() -> None:
    """Protects whoever goes on after a command gone wrong: the guarded one meets it again, without overshoot."""
    guard, rest = SoftLimits(LIMITS, PERIOD_S), np.zeros(7)
    q = np.zeros(7)
    guard.reset(q.tolist())
    for _ in range(2000):
        q[0] = min(q[0] + 0.7 * PERIOD_S, 3.1)
        guarded = guard.held(q, rest, rest)[0]
    assert guarded[0] == pytest.approx(2.6, abs=1e-6)
    q[0], least = 2.5, np.inf
    for _ in range(500):
        guarded = guard.held(q, rest, rest)[0]
        least = min(least, guarded[0])
    np.testing.assert_array_equal(guarded, q)
    assert least > 2.5 - 1e-3


def test_a_period_that_is_none_is_refused() -> None:
    """Protects the braking distance from a period of nothing."""
    with pytest.raises(InputError, match="period_s"):
        SoftLimits(LIMITS, 0.0)
