"""The load's scale from free closing, against NumPy's fit and against loads that step as motors' do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.free_closing_scale import SYSTEMATIC, FreeClosingScale, Scale

SLOPE_N_PER_M = 1943.0
WAY_M = np.linspace(0.0, 0.011, 220)


def closed(loads_N: np.ndarray, way_m: np.ndarray = WAY_M) -> FreeClosingScale:
    scale = FreeClosingScale((SLOPE_N_PER_M, SLOPE_N_PER_M))
    for excursion_m, load_N in zip(way_m.tolist(), loads_N.tolist(), strict=True):
        scale.take(0, excursion_m, load_N)
        scale.take(1, excursion_m, load_N)
    return scale


@given(st.floats(0.7, 1.4), st.floats(-3.0, 8.0))
def test_a_wrong_torque_constant_is_seen_whatever_the_friction(true_scale: float, friction_N: float) -> None:
    """The load law may be a third off: what counts later is the load's rise, and that is told here."""
    scale = closed(true_scale * SLOPE_N_PER_M * WAY_M + friction_N).scale(believed=10.0)
    assert scale.value == pytest.approx(true_scale, abs=1e-4)
    assert scale.deviation == pytest.approx(SYSTEMATIC, rel=0.01)


def test_noise_is_answered_by_the_deviation() -> None:
    """The scale lies off by what its deviation says, for noise and for the steps of a coarse motor alike."""
    ticks_m = np.floor(WAY_M / 5.37e-5) * 5.37e-5
    errors = []
    for seed in range(60):
        noise_N = np.random.default_rng(seed).normal(0.0, 1.0, len(WAY_M))
        steps_N = (WAY_M - ticks_m) / 5.37e-5 * 7.0  # an RX-28's output rises by 7 N a tick
        scale = closed(SLOPE_N_PER_M * WAY_M + noise_N + steps_N).scale(believed=10.0)
        errors.append((scale.value - 1.0) / scale.deviation)
    assert 0.2 < float(np.sqrt(np.mean(np.square(errors)))) < 1.6


def test_it_agrees_with_a_plain_fit() -> None:
    """NumPy's straight line through the same noisy samples, where they count."""
    loads_N = 1.1 * SLOPE_N_PER_M * WAY_M + np.random.default_rng(5).normal(0.0, 0.5, len(WAY_M))
    count = SLOPE_N_PER_M * WAY_M > 6.0
    slope = np.polyfit(WAY_M[count], loads_N[count], 1)[0]
    assert closed(loads_N).scale(believed=10.0).value == pytest.approx(slope / SLOPE_N_PER_M, abs=0.005)


@pytest.mark.parametrize(
    "way_m", [np.linspace(0.0, 0.011, 20), np.linspace(0.008, 0.009, 200), np.linspace(0.0, 0.002, 200)]
)
def test_a_way_that_shows_nothing_leaves_what_was_believed(way_m: np.ndarray) -> None:
    """Too few samples, too short a way, too little load: the law counts as it stands."""
    assert closed(1.3 * SLOPE_N_PER_M * way_m, way_m).scale(believed=0.2) == Scale(1.0, 0.2)


@given(st.floats(0.0, 0.5))
def test_a_law_that_is_better_known_gives_way_less(believed: float) -> None:
    """A calibrated law is corrected by its own part only, and never becomes less well known."""
    scale = closed(1.2 * SLOPE_N_PER_M * WAY_M).scale(believed)
    assert 1.0 <= scale.value <= 1.2 + 1e-6
    assert scale.deviation <= min(believed, SYSTEMATIC) + 1e-6
