"""Contact of one finger from its force: hysteresis, disturbed frames, and when it began, on ramps of known start."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import nanoseconds, seconds
from drivers.errors import InputError
from drivers.takktile.touch import PadTouch, TouchSettings

PERIOD_NS = nanoseconds(0.008)
DEVIATION_N = 0.03


@settings(max_examples=40, deadline=None)
@given(st.floats(1.0, 20.0), st.floats(0.3, 0.7), st.integers(0, 1000))
def test_contact_is_dated_back_to_where_it_began(rise_N_per_s: float, start_s: float, seed: int) -> None:
    """From 1 N/s upwards, under a strip's noise: found, never before it was, and dated to within 80 ms at the slowest
    rise, which is 80 µm of excursion at the rate of the search, and 25 ms at a fast one."""
    generator, touch = np.random.default_rng(seed), PadTouch(TouchSettings())
    for index in range(400):
        now_ns = index * PERIOD_NS
        force_N = max(0.0, seconds(now_ns) - start_s) * rise_N_per_s + DEVIATION_N * generator.standard_normal()
        if touch.take(now_ns, force_N, DEVIATION_N):
            break
    assert touch.touching
    assert seconds(now_ns) > start_s
    assert seconds(touch.onset_ns) == pytest.approx(start_s, abs=0.02 + 0.06 / rise_N_per_s)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_never_touches(seed: int) -> None:
    """Three minutes of a free pad."""
    noise_N = DEVIATION_N * np.random.default_rng(seed).standard_normal(22_500)
    touch = PadTouch(TouchSettings())
    assert not any(touch.take(i * PERIOD_NS, float(force_N), DEVIATION_N) for i, force_N in enumerate(noise_N))


def test_a_held_force_does_not_flicker() -> None:
    """At the threshold itself, under noise, contact stays: release is lower. Gone, it is told at once."""
    touch, generator = PadTouch(TouchSettings()), np.random.default_rng(0)
    told = [touch.take(i * PERIOD_NS, 0.2 + 0.02 * generator.standard_normal(), 0.02) for i in range(1000)]
    assert all(told[2:])
    assert not touch.take(1000 * PERIOD_NS, 0.0, 0.02)


def test_one_disturbed_frame_is_no_contact() -> None:
    """A single large value, as a bus fault makes."""
    touch = PadTouch(TouchSettings())
    forces_N = [0.0, 0.0, 5.0, 0.0, 0.0]
    assert not any(touch.take(i * PERIOD_NS, force_N, 0.01) for i, force_N in enumerate(forces_N))


def test_a_noisy_pad_gets_a_higher_threshold() -> None:
    """0.2 N is contact on a quiet pad and noise on one of 0.1 N."""
    quiet, noisy = PadTouch(TouchSettings()), PadTouch(TouchSettings())
    for index in range(5):
        quiet.take(index * PERIOD_NS, 0.2, 0.01)
        noisy.take(index * PERIOD_NS, 0.2, 0.1)
    assert quiet.touching
    assert not noisy.touching


@pytest.mark.parametrize(("touch_N", "release_N"), [(0.1, 0.1), (0.1, 0.2), (0.1, 0.0), (float("nan"), 0.1)])
def test_thresholds_in_the_wrong_order_are_refused(touch_N: float, release_N: float) -> None:
    """Without hysteresis contact would flicker."""
    with pytest.raises(InputError, match="release_N"):
        TouchSettings(touch_N=touch_N, release_N=release_N)
