"""The effort's low-pass against the analytic response of a first-order system, whatever the samples' times."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim

from drivers.dynamixel.control_tables import MX_28
from drivers.dynamixel.effort_filter import EffortFilter
from drivers.dynamixel.load_law import SpoolMotion, nominal_law
from drivers.errors import InputError

intervals_ms = st.lists(st.floats(0.5, 40.0), min_size=2, max_size=40)


@given(intervals_ms, st.floats(0.005, 0.02), st.floats(-1.0, 1.0))
def test_a_ramp_is_followed_as_a_first_order_system_does(
    intervals: list[float], time_constant_s: float, slope: float
) -> None:
    """y = a (t − T (1 − e^(−t/T))) at every sample, be the bus fast, slow or uneven."""
    effort_filter, time_ns = EffortFilter(time_constant_s), 7_000_000
    effort_filter.step(time_ns, 0.0, 0.0)
    for interval_ms in intervals:
        time_ns += round(interval_ms * 1e6)
        elapsed_s = (time_ns - 7_000_000) * 1e-9
        effort, rate_m_s = effort_filter.step(time_ns, slope * elapsed_s, -slope * elapsed_s)
        expected = slope * (elapsed_s + time_constant_s * math.expm1(-elapsed_s / time_constant_s))
        assert effort == pytest.approx(expected, abs=1e-12)
        assert rate_m_s == pytest.approx(-expected, abs=1e-12)


def test_any_signal_is_filtered_as_scipy_does_it() -> None:
    """Another solver, which also takes the input to be straight between samples."""
    signal = np.random.default_rng(5).normal(size=60)
    times_s = 0.005 * np.arange(60)
    _, expected, _ = lsim(([1.0], [0.01, 1.0]), signal - signal[0], times_s)
    effort_filter = EffortFilter(0.01)
    filtered = [
        effort_filter.step(round(time_s * 1e9), float(value), 0.0)[0]
        for time_s, value in zip(times_s, signal, strict=True)
    ]
    assert filtered == pytest.approx(expected + signal[0], abs=1e-9)


@pytest.mark.parametrize(("time_constant_s", "interval_s"), [(0.01, 0.005), (0.02, 0.005), (0.005, 0.0025)])
def test_noise_shrinks_as_it_should(time_constant_s: float, interval_s: float) -> None:
    """White noise through y₁ = a y₀ + b x₁ + c x₀ keeps (b² + c² + 2abc) / (1 − a²) of its variance."""
    noise = np.random.default_rng(3).normal(size=20_000)
    effort_filter = EffortFilter(time_constant_s)
    filtered = [effort_filter.step(round(k * interval_s * 1e9), x, 0.0)[0] for k, x in enumerate(noise.tolist())]
    ratio = interval_s / time_constant_s
    a = math.exp(-ratio)
    b = 1.0 - (1.0 - a) / ratio
    c = 1.0 - a - b
    expected = math.sqrt((b * b + c * c + 2.0 * a * b * c) / (1.0 - a * a))
    assert float(np.std(filtered[100:])) == pytest.approx(expected, rel=0.03)
    assert expected < 0.5


@given(st.lists(st.tuples(st.floats(0.1, 60.0), st.floats(-2.0, 2.0)), min_size=1, max_size=30))
def test_what_is_filtered_never_leaves_what_was_told(samples: list[tuple[float, float]]) -> None:
    """No overshoot: a cap that was never read is never seen."""
    effort_filter, time_ns = EffortFilter(0.01), 0
    told: list[float] = []
    for interval_ms, effort in samples:
        time_ns += round(interval_ms * 1e6)
        told.append(effort)
        filtered, _ = effort_filter.step(time_ns, effort, 0.0)
        assert min(told) - 1e-12 <= filtered <= max(told) + 1e-12


def test_after_a_gap_and_a_reset_it_starts_anew() -> None:
    """What a motor told before it was silent says nothing of now."""
    effort_filter = EffortFilter(0.01)
    effort_filter.step(0, 1.0, 0.01)
    assert effort_filter.step(5_000_000, 0.0, 0.0)[0] > 0.5
    assert effort_filter.step(5_000_000, 9.0, 9.0)[0] < 1.0  # no newer: a sample that was missed
    assert effort_filter.step(200_000_000, 0.2, 0.002) == (0.2, 0.002)
    effort_filter.reset()
    assert effort_filter.step(201_000_000, -0.3, 0.0) == (-0.3, 0.0)


def test_off_lets_all_through() -> None:
    """A time constant of 0 is no filter."""
    effort_filter = EffortFilter(0.0)
    assert [effort_filter.step(k, float(k), -float(k)) for k in range(4)] == [(float(k), -float(k)) for k in range(4)]


@pytest.mark.parametrize("time_constant_s", [-0.001, 0.2, math.nan, math.inf])
def test_no_time_constant_that_hides_the_motor(time_constant_s: float) -> None:
    """A tenth of a second behind, contact would be found too late."""
    with pytest.raises(InputError, match="effort filter"):
        EffortFilter(time_constant_s)


@given(st.lists(st.tuples(st.floats(1.0, 30.0), st.floats(0.002, 0.05)), min_size=1, max_size=30))
def test_a_load_tells_the_same_tension_whatever_the_speed_does(samples: list[tuple[float, float]]) -> None:
    """Effort and rate are filtered alike: back-EMF that lagged behind its rate would look like tension."""
    law, effort_filter, time_ns = nominal_law(MX_28, 0.0105), EffortFilter(0.02), 0
    for interval_ms, rate_m_s in samples:
        time_ns += round(interval_ms * 1e6)
        told = 30.0 * 0.0105 / law.torque_per_effort_Nm + law.friction_effort + law.back_emf_effort_s_per_m * rate_m_s
        effort, rate_m_s = effort_filter.step(time_ns, told, rate_m_s)
        tension_N = law.tension(effort, SpoolMotion.WINDING, rate_m_s=rate_m_s).tension_N
        assert tension_N == pytest.approx(30.0, abs=1e-9)
