"""Joint bounds as laws, by driving joints as hard as they allow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cycle.joint_bounds import JointBounds, JointLimits
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

PERIOD_S = 0.002


def limits(acceleration_rad_s2: float = 4.0, velocity_rad_s: float = 1.0) -> JointLimits:
    return JointLimits(np.full(7, -1.0), np.full(7, 1.0), np.full(7, velocity_rad_s), np.full(7, acceleration_rad_s2))


def braking_distance(speed: float, change: float) -> float:
    """Way of one period at `speed` and of all periods in which it then falls by `change`."""
    way = 0.0
    while speed > 0.0:
        way += PERIOD_S * speed
        speed -= change
    return way


@settings(max_examples=60, deadline=None)
@given(room=st.floats(1e-6, 0.2), acceleration=st.floats(0.5, 50.0))
def test_bound_is_the_fastest_that_can_still_stop(room: float, acceleration: float) -> None:
    """Protects both sides of viability: stopping within the room, and using all of it."""
    bounds = JointBounds(limits(acceleration, velocity_rad_s=1e3), PERIOD_S)
    _, upper = bounds.at([1.0 - room] + [0.0] * 6, [1e3 if room > 1.0 else 5.0] * 7)
    wanted, change = upper[0], acceleration * PERIOD_S
    if wanted > 5.0 - change + 1e-12:
        assert braking_distance(wanted, change) == pytest.approx(room, rel=1e-9, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), eagerness=st.floats(0.0, 1.0))
def test_any_choice_within_the_bounds_keeps_all_limits(seed: int, eagerness: float) -> None:
    """Protects the arm whatever the solver wants: no choice leads to a state without a lawful next one."""
    random = np.random.default_rng(seed)
    lawful = JointLimits(*(np.asarray(x) for x in _random_limits(random)))
    bounds = JointBounds(lawful, PERIOD_S)
    q = random.uniform(lawful.lower_rad, lawful.upper_rad)
    v = np.zeros(7)
    side = 1.0
    for step in range(1500):
        if step % 400 == 0:
            side = random.choice([-1.0, 1.0])
        lower, upper = (np.array(bound) for bound in bounds.at(q.tolist(), v.tolist()))
        assert (lower <= upper).all()
        share = random.uniform(0.0, 1.0, 7)
        share = np.where(random.uniform(size=7) < eagerness, 0.5 + 0.5 * side, share)
        chosen = lower + share * (upper - lower)
        assert (np.abs(chosen - v) <= lawful.acceleration_rad_s2 * PERIOD_S * (1 + 1e-9)).all()
        assert (np.abs(chosen) <= lawful.velocity_rad_s * (1 + 1e-12)).all()
        q, v = q + PERIOD_S * chosen, chosen
        assert (q >= lawful.lower_rad - 1e-12).all()
        assert (q <= lawful.upper_rad + 1e-12).all()


def _random_limits(random: np.random.Generator) -> tuple[np.ndarray, ...]:
    lower = random.uniform(-3.0, 0.0, 7)
    return lower, lower + random.uniform(0.05, 3.0, 7), random.uniform(0.1, 3.0, 7), random.uniform(0.5, 30.0, 7)


def test_outside_a_limit_only_inwards() -> None:
    """Protects home, whose joint 4 lies above its limit: it may rest and come back, not go further."""
    parameters = load_wam_parameters()
    bounds = JointBounds(JointLimits.from_parameters(parameters), PERIOD_S)
    lower, upper = bounds.at(parameters.home_rad.tolist(), [0.0] * 7)
    assert upper[3] == 0.0
    assert lower[3] < 0.0


def test_too_fast_slows_at_the_acceleration_limit() -> None:
    """Protects the acceleration limit where others are already broken."""
    lower, upper = JointBounds(limits(), PERIOD_S).at([2.0] * 7, [1.5] * 7)
    np.testing.assert_allclose(upper, 1.5 - 4.0 * PERIOD_S)
    np.testing.assert_allclose(lower, 1.5 - 4.0 * PERIOD_S)


def test_bad_limits_are_refused() -> None:
    """Protects the cycle from limits that mean nothing."""
    seven = np.ones(7)
    with pytest.raises(InputError, match="below its upper"):
        JointLimits(seven, seven, seven, seven)
    with pytest.raises(InputError, match="positive"):
        JointLimits(-seven, seven, seven, 0.0 * seven)
    with pytest.raises(InputError, match="7 finite"):
        JointLimits(-seven, seven, seven[:6], seven)
    with pytest.raises(InputError, match="period_s"):
        JointBounds(limits(), 0.0)
