"""Time along a path under any throttle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.path_time import ThrottledTime

PERIOD_S = 0.002
THROTTLE_TIME_S = 0.05


@given(st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=80))
def test_no_throttle_makes_a_corner(throttles: list[float]) -> None:
    """Time never runs backwards or ahead of itself, and its speed, of which it is the integral, has a limited slope."""
    time = ThrottledTime(PERIOD_S, THROTTLE_TIME_S)
    time.start()
    steps = [time.step(throttle) for throttle in throttles]
    speeds = np.array([1.0, *(step.speed for step in steps)])
    assert np.all((speeds >= 0.0) & (speeds <= 1.0))
    assert np.all(np.abs(np.diff(speeds)) <= PERIOD_S / THROTTLE_TIME_S + 1e-12)
    assert [step.speed_rate for step in steps] == pytest.approx(np.diff(speeds) / PERIOD_S, abs=1e-9)
    trapezoids = np.cumsum(0.5 * (speeds[1:] + speeds[:-1])) * PERIOD_S
    assert [step.time_s for step in steps] == pytest.approx(trapezoids, abs=1e-12)


def test_stops_within_the_throttle_time_and_goes_on() -> None:
    """A stop along the path comes to rest in time, half the distance further on; a later start is from zero again."""
    time = ThrottledTime(PERIOD_S, THROTTLE_TIME_S)
    time.start()
    for _ in range(round(THROTTLE_TIME_S / PERIOD_S)):
        assert not time.standing
        stopped = time.step(0.0)
    assert time.standing
    assert stopped.time_s == pytest.approx(0.5 * THROTTLE_TIME_S)
    assert time.step(0.0).time_s == stopped.time_s
    time.start()
    assert time.step(1.0) == pytest.approx((PERIOD_S, 1.0, 0.0))
