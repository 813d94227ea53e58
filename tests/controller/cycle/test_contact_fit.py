"""The bend's place from load against excursion: against what was put in, and the laws of the weighing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from controller.cycle.contact_fit import TableTrust, fit_contact, weighed_with_table

RISE_N_PER_M = 16_000.0
STEP_N = 0.6
BLUR_M = 5e-5
TRUST = TableTrust()
metres = st.floats(-8e-4, 8e-4)


def bent(
    x: NDArray[np.float64], contact_m: float, rise: float = RISE_N_PER_M, offset_N: float = 0.0, step_N: float = STEP_N
) -> NDArray[np.float64]:
    return offset_N + rise * np.maximum(x - contact_m, 0.0) + step_N * np.clip((x - contact_m) / BLUR_M + 0.5, 0.0, 1.0)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.0118, 0.0124),
    st.floats(0.8, 1.2),
    st.floats(-20.0, 20.0),
    st.integers(0, 10_000),
)
def test_the_bend_is_found_within_its_own_deviation(contact_m: float, slope: float, offset_N: float, seed: int) -> None:
    """Whatever offset and rise, noise of 0.4 N, 0.2 mm of loaded line: right to 0.1 mm, and the deviation is honest."""
    x = np.arange(0.0115, contact_m + 2.3e-4, BLUR_M)
    noise = np.random.default_rng(seed).normal(0.0, 0.4, len(x))
    fit = fit_contact(x, bent(x, contact_m, slope * RISE_N_PER_M, offset_N) + noise, RISE_N_PER_M, STEP_N, BLUR_M)
    assert fit.contact_m == pytest.approx(contact_m, abs=1e-4)
    assert abs(fit.contact_m - contact_m) < 5.0 * math.hypot(fit.deviation_m, 1e-5)
    assert fit.offset_N == pytest.approx(offset_N, abs=0.8)
    assert fit.evidence > 20.0


def test_it_is_the_least_squares_fit_of_scipy() -> None:
    """An independent solver of the same model, its rise free, finds the same place on noisy samples."""
    x = np.arange(0.0115, 0.0126, 2.5e-5)
    y = bent(x, 0.01207, 1.1 * RISE_N_PER_M, 3.0) + np.random.default_rng(1).normal(0.0, 0.5, len(x))
    lower, upper = [0.0115, 1e3, -50.0], [0.0125, 1e5, 50.0]
    best, _ = curve_fit(bent, x, y, p0=(0.012, RISE_N_PER_M, 0.0), bounds=(lower, upper))
    fit = fit_contact(x, y, RISE_N_PER_M, STEP_N, BLUR_M)
    assert fit.contact_m == pytest.approx(best[0], abs=fit.deviation_m)
    assert fit.rise_N_per_m == pytest.approx(best[1], rel=0.05)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(-20.0, 20.0), st.integers(6, 40))
def test_noise_alone_has_no_evidence(seed: int, offset_N: float, count: int) -> None:
    """A straight line is no contact, however it is drawn from noise."""
    x = 0.0115 + BLUR_M * np.arange(count)
    y = offset_N + np.random.default_rng(seed).normal(0.0, 0.4, count)
    fit = fit_contact(x, y, RISE_N_PER_M, 0.0, BLUR_M)
    rise_N = fit.rise_N_per_m * (x[-1] - fit.contact_m)
    assert fit.evidence < 20.0 or rise_N < 2.0


def test_moved_along_both_axes_it_moves_along() -> None:
    """Neither the excursion's zero nor constant friction matters."""
    x = np.arange(0.0115, 0.0123, BLUR_M)
    y = bent(x, 0.01204) + np.random.default_rng(2).normal(0.0, 0.3, len(x))
    fit = fit_contact(x, y, RISE_N_PER_M, STEP_N, BLUR_M)
    moved = fit_contact(x + 0.003, y + 7.0, RISE_N_PER_M, STEP_N, BLUR_M)
    assert moved.contact_m == pytest.approx(fit.contact_m + 0.003, abs=2e-6)
    assert moved.offset_N == pytest.approx(fit.offset_N + 7.0, abs=0.05)
    assert moved.deviation_m == pytest.approx(fit.deviation_m, rel=0.05)


@given(metres, st.floats(1e-6, 2e-4))
def test_the_weighed_contact_lies_between_table_and_found(excess_m: float, deviation_m: float) -> None:
    """Never outside both, and odd: early is treated as late is."""
    later_m = weighed_with_table(excess_m, deviation_m, TRUST)
    earlier_m = weighed_with_table(-excess_m, deviation_m, TRUST)
    assert min(0.0, excess_m) - 1e-12 <= later_m <= max(0.0, excess_m) + 1e-12
    assert later_m == pytest.approx(-earlier_m, abs=1e-12)


def test_near_the_table_the_table_holds_and_far_from_it_what_was_found() -> None:
    """An exact table is not spoiled by 0.03 mm of noise; one that is 0.3 mm wrong does not pull."""
    assert 0.0 < weighed_with_table(3e-5, 3e-5, TRUST) < 1e-5
    assert weighed_with_table(3e-4, 3e-5, TRUST) == pytest.approx(3e-4, abs=3e-6)


@given(st.floats(-1e-3, 1e-3))
def test_wherever_contact_is_the_table_spoils_it_little(excess_m: float) -> None:
    """Between near and far too: never more than 0.07 mm away from what was found to 0.03 mm."""
    assert abs(weighed_with_table(excess_m, 3e-5, TRUST) - excess_m) < 7e-5
