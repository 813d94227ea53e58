"""The winding profile under any throttle, and the index observer against the motor lag it assumes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.cycle.winding import IndexObserver, ObserverSettings, WindingLimits, WindingProfile, WindingState
from drivers.errors import InputError

PERIOD_S = 0.002
PERIOD_NS = 2_000_000
THROTTLE_TIME_S = 0.03
LIMITS = WindingLimits()
START_M = -0.004

targets = st.floats(-0.012, 0.012)


def profile_at(start_m: float = START_M) -> WindingProfile:
    profile = WindingProfile(PERIOD_S, LIMITS, THROTTLE_TIME_S)
    profile.place(start_m)
    return profile


def unthrottled(target_m: float, rate_m_s: float | None = None, duration_s: float | None = None) -> NDArray[np.float64]:
    """Position, rate and acceleration, (steps, 3), of a whole move from `START_M`."""
    profile = profile_at()
    profile.move(target_m, rate_m_s=rate_m_s, duration_s=duration_s)
    states = [profile.state]
    while not profile.finished:
        states.append(profile.step(1.0))
    return np.array(states)


@settings(max_examples=40)
@given(targets, st.floats(0.001, 0.05))
def test_a_move_is_jerk_limited_and_ends_on_its_target(target_m: float, rate_m_s: float) -> None:
    """The tendons are never pulled with a jolt, and rate and acceleration are the position's own derivatives."""
    states = unthrottled(target_m, rate_m_s)
    position, rate, acceleration = states.T
    assert position[-1] == pytest.approx(target_m, abs=1e-9)
    assert states[-1, 1:] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert np.max(np.abs(rate)) <= min(rate_m_s, LIMITS.rate_m_s) + 1e-9
    assert np.max(np.abs(acceleration)) <= LIMITS.acceleration_m_s2 + 1e-9
    inside = states[:-1]  # the last period holds the end
    assert np.max(np.abs(np.diff(inside[:, 2], axis=0)), initial=0.0) <= LIMITS.jerk_m_s3 * PERIOD_S + 1e-9
    worst = LIMITS.jerk_m_s3 * PERIOD_S**3
    np.testing.assert_allclose(np.diff(inside[:, 0]), 0.5 * PERIOD_S * (inside[1:, 1] + inside[:-1, 1]), atol=worst)


def test_a_move_lasts_as_long_as_asked() -> None:
    """A squeeze of 1.2 s takes 1.2 s, and one that cannot be so fast takes what it needs."""
    assert (len(unthrottled(0.0, duration_s=1.2)) - 1) * PERIOD_S == pytest.approx(1.2, abs=PERIOD_S)
    shortest = len(unthrottled(0.0))
    assert len(unthrottled(0.0, duration_s=0.01)) == shortest


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(1, 60)), min_size=1, max_size=12))
def test_no_throttle_leaves_the_path(throttles: list[tuple[float, int]]) -> None:
    """Slowed down as it may be, the profile is the unthrottled one in its own time, and ends where it should."""
    path = unthrottled(0.004)
    path_s = np.arange(len(path)) * PERIOD_S
    profile = profile_at()
    profile.move(0.004)
    speed, time_s, before = 1.0, 0.0, profile.state
    for throttle in [t for t, count in throttles for _ in range(count)] + [1.0] * len(path):
        slower = speed + min(max(throttle - speed, -PERIOD_S / THROTTLE_TIME_S), PERIOD_S / THROTTLE_TIME_S)
        time_s += 0.5 * (speed + slower) * PERIOD_S
        speed = slower
        now = profile.step(throttle)
        assert now.position_m == pytest.approx(np.interp(time_s, path_s, path[:, 0]), abs=2e-7)
        assert now.position_m >= before.position_m - 1e-12
        moved_m = 0.5 * PERIOD_S * (now.rate_m_s + before.rate_m_s)
        assert now.position_m - before.position_m == pytest.approx(moved_m, abs=1e-6)
        before = now
        if profile.finished:
            break
    assert profile.finished
    assert profile.state == pytest.approx((0.004, 0.0, 0.0), abs=1e-9)


def test_a_stopped_profile_stands_and_then_forgets() -> None:
    """Stopping is a throttle of 0: at rest the move is dropped where it is, and a new one may begin."""
    profile = profile_at()
    profile.move(0.004)
    for _ in range(100):
        profile.step(1.0)
    assert not profile.end_if_standing()
    for _ in range(round(THROTTLE_TIME_S / PERIOD_S)):
        profile.step(0.0)
    stands = profile.step(0.0)
    assert stands.rate_m_s == 0.0
    assert profile.end_if_standing()
    assert profile.state == (stands.position_m, 0.0, 0.0)
    profile.move(0.004)
    assert profile.step(1.0).position_m == pytest.approx(stands.position_m, abs=1e-8)


def test_moves_can_be_joined_without_a_stop() -> None:
    """Closing goes over into the slow search without standing: at rest, gear friction hides the load."""
    profile = profile_at(-0.010)
    profile.move(-0.002, rate_m_s=0.012, end_rate_m_s=0.0025)
    before = profile.state
    while not profile.finished:
        before = profile.step(1.0)
    assert before.rate_m_s == pytest.approx(0.0025)
    profile.move(0.001, rate_m_s=0.0025)
    now = profile.step(1.0)
    assert now.rate_m_s == pytest.approx(0.0025, rel=1e-6)
    assert now.position_m - before.position_m == pytest.approx(0.0025 * PERIOD_S, rel=1e-6)


@pytest.mark.parametrize(
    ("target_m", "rate_m_s"), [(math.nan, 0.01), (math.inf, 0.01), (0.0, math.nan), (0.0, 0.0), (0.0, -0.01)]
)
def test_impossible_moves_are_refused(target_m: float, rate_m_s: float) -> None:
    """No such number reaches the motors, and the state stays."""
    profile = profile_at()
    with pytest.raises(InputError, match="expected finite"):
        profile.move(target_m, rate_m_s=rate_m_s)
    assert profile.finished
    assert profile.step(1.0) == (START_M, 0.0, 0.0)


def test_a_second_move_must_wait() -> None:
    """Two moves at once would be a jump."""
    profile = profile_at()
    profile.move(0.0)
    with pytest.raises(InputError, match="under way"):
        profile.move(0.001)


LAG_S = 0.02
SAMPLE_EVERY = 3  # periods
DELAY_NS = 3_000_000


def lagged_ramp(rate_m_s: float, time_s: float) -> float:
    """A first-order lag's answer to a ramp from rest, solved by hand."""
    return rate_m_s * (time_s - LAG_S * (1.0 - math.exp(-time_s / LAG_S))) if time_s > 0.0 else 0.0


@pytest.mark.parametrize("drift_m_s", [0.0, 3e-4, -3e-4])
def test_observer_follows_a_lagging_drifting_motor(drift_m_s: float) -> None:
    """Samples that are old and rare correct a steady drift away: index within 10 µm, rate within 2 %."""
    rate_m_s = 0.003
    observer = IndexObserver(PERIOD_S, ObserverSettings(lag_s=LAG_S, bandwidth_rad_s=25.0))
    observer.reset(0.0)
    for step in range(1, 501):
        time_s, now_ns = step * PERIOD_S, step * PERIOD_NS
        if step % SAMPLE_EVERY == 0:
            sampled_s = time_s - DELAY_NS * 1e-9
            measured_m = lagged_ramp(rate_m_s, sampled_s) + drift_m_s * sampled_s
            observer.correct(measured_m, now_ns - DELAY_NS, now_ns)
        state = observer.advance(WindingState(rate_m_s * time_s, rate_m_s, 0.0))
        true_m = lagged_ramp(rate_m_s, time_s) + drift_m_s * time_s
        if time_s > 0.5:
            assert state.position_m == pytest.approx(true_m, abs=1e-5)
            assert state.rate_m_s == pytest.approx(rate_m_s + drift_m_s, rel=0.02)
            assert abs(state.acceleration_m_s2) < 1e-6


def test_observer_hears_each_sample_once() -> None:
    """A reader that finds the newest sample again, or an older one, learns nothing from it."""
    observer = IndexObserver(PERIOD_S, ObserverSettings())
    observer.reset(0.0)
    still = WindingState(0.0, 0.0, 0.0)
    for number in (1, 2):
        observer.correct(1e-4, number * 5_000_000, number * 5_000_000)
    once = observer.advance(still)
    for sample_ns in (10_000_000, 9_000_000):
        observer.correct(5e-3, sample_ns, 12_000_000)
    assert observer.state == once
    assert once.position_m > 0.0


def test_observer_is_quiet_between_quantised_samples() -> None:
    """A motor that flickers between two ticks of 16 µm moves the index by less than half of it a period."""
    observer = IndexObserver(PERIOD_S, ObserverSettings())
    observer.reset(0.0)
    generator = np.random.default_rng(1)
    positions = []
    for step in range(1, 1000):
        if step % SAMPLE_EVERY == 0:
            observer.correct(16e-6 * float(generator.integers(0, 2)), step * PERIOD_NS, step * PERIOD_NS)
        positions.append(observer.advance(WindingState(0.0, 0.0, 0.0)).position_m)
    assert np.max(np.abs(np.diff(positions))) < 8e-6
    assert np.max(np.abs(positions)) < 32e-6


def standing_after(seconds: float, measured_m: float, settings: ObserverSettings, hidden_m: float) -> float:
    """Index so long after a stop at zero, if the standing motor shows `measured_m` all the time."""
    observer = IndexObserver(PERIOD_S, settings)
    observer.reset(0.0)
    for step in range(1, round(seconds / PERIOD_S) + 1):
        now_ns = step * PERIOD_NS
        observer.correct(measured_m, now_ns, now_ns, hidden_m=hidden_m)
        observer.advance(WindingState(0.0, 0.0, 0.0))
    return observer.state.position_m


def test_a_standing_tick_is_one_measurement_however_often_it_is_read() -> None:
    """Without creep the index ends at the mean of stop and tick, weighed by their variances, and stays there."""
    settings = ObserverSettings(stop_deviation_m=4e-6, creep_m=0.0)
    weighed_m = 16e-6 * 4.0**2 / (4.0**2 + 6.0**2)
    for seconds in (1.0, 30.0):
        assert standing_after(seconds, 16e-6, settings, hidden_m=6e-6) == pytest.approx(weighed_m, rel=1e-3)


def test_what_creeps_is_believed_of_the_tick_in_the_end() -> None:
    """A minute after the stop the tick says more than the end of winding; a tick that tells all says it at once."""
    settings = ObserverSettings()
    assert standing_after(60.0, 16e-6, settings, hidden_m=6e-6) == pytest.approx(16e-6, rel=0.02)
    assert standing_after(1.0, 16e-6, settings, hidden_m=1e-9) == pytest.approx(16e-6, rel=1e-3)


def test_shifting_the_zero_keeps_the_rates() -> None:
    """Finding contact moves the index's zero, not the hand."""
    observer = IndexObserver(PERIOD_S, ObserverSettings())
    observer.reset(0.001)
    before = observer.advance(WindingState(0.002, 0.003, 0.0))
    observer.shift(-2.5e-4)
    assert observer.state == pytest.approx((before.position_m - 2.5e-4, before.rate_m_s, before.acceleration_m_s2))
