"""The filter that corrects the excursion by the load, against least squares over all samples at once, and its laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.load_correction import LoadCorrection, LoadTrust, SmoothConstant
from drivers.errors import InputError

SLOPE_N_PER_M = 18_000.0
EXCURSION_M = np.linspace(0.2e-3, 2.5e-3, 60)


def true_rise_N(excursion_m: float, contact_m: float, stretch_m_per_N: float) -> float:
    """Load rise on a table with one slope, at the index x = e + a + s · rise."""
    return SLOPE_N_PER_M * (excursion_m + contact_m) / (1.0 - stretch_m_per_N * SLOPE_N_PER_M)


def wind(
    correction: LoadCorrection, contact_m: float, stretch_m_per_N: float, errors_N: float | np.ndarray = 0.0
) -> None:
    """A squeeze in which the index lies beside the excursion; the load is measured with these errors."""
    for excursion_m, error_N in zip(EXCURSION_M.tolist(), np.broadcast_to(errors_N, 60).tolist(), strict=True):
        measured_N = true_rise_N(excursion_m, contact_m, stretch_m_per_N) + error_N
        expected_N = true_rise_N(excursion_m, correction.contact_m, correction.stretch_m_per_N)
        correction.take(measured_N, expected_N, SLOPE_N_PER_M)


def test_it_is_least_squares_over_all_samples_at_once() -> None:
    """All that was measured counts, with what was believed before as rows of their own. Small errors: linear."""
    trust = LoadTrust(contact_m=5e-7, stretch_m_per_N=5e-9, scale=2e-5, onset_N=0.013, noise_N=0.02)
    errors_N = np.random.default_rng(1).normal(0.004, 0.02, 60)
    correction = LoadCorrection(trust)
    wind(correction, 4e-7, 3e-9, errors_N)

    rise_N = SLOPE_N_PER_M * EXCURSION_M
    rows = np.column_stack([np.full(60, SLOPE_N_PER_M), SLOPE_N_PER_M * rise_N, rise_N, np.ones(60)])
    surprise_N = rows[:, :2] @ [4e-7, 3e-9] + errors_N
    prior = np.diag([1.0 / value for value in (5e-7, 5e-9, 2e-5, 0.013)])
    batch = np.linalg.lstsq(
        np.vstack([rows / 0.02, prior]), np.concatenate([surprise_N / 0.02, np.zeros(4)]), rcond=None
    )[0]
    assert correction.contact_m == pytest.approx(batch[0], rel=2e-3)
    assert correction.stretch_m_per_N == pytest.approx(batch[1], rel=2e-3)


@given(st.floats(-1.5e-4, 1.5e-4), st.floats(-8e-6, 8e-6))
def test_a_load_that_is_trusted_tells_the_index(contact_m: float, stretch_m_per_N: float) -> None:
    """Wherever contact was and whatever the tendons stretch, without errors the index is found."""
    correction = LoadCorrection(LoadTrust(2e-4, 2e-5, 0.0, 0.0, 0.5))
    wind(correction, contact_m, stretch_m_per_N)
    for excursion_m in (5e-4, 1.5e-3, 2.5e-3):
        rise_N = true_rise_N(excursion_m, contact_m, stretch_m_per_N)
        index_m = excursion_m + correction.contact_m + correction.stretch_m_per_N * rise_N
        assert index_m == pytest.approx(excursion_m + contact_m + stretch_m_per_N * rise_N, abs=1e-5)


@given(st.floats(-5.0, 5.0))
def test_excursions_that_are_known_are_left_alone(error_N: float) -> None:
    """Tendons without stretch and a contact beyond doubt: no error of the load moves the index."""
    correction = LoadCorrection(LoadTrust(0.0, 0.0, 0.2, 1.0, 1.0))
    wind(correction, 0.0, 0.0, error_N)
    assert (correction.contact_m, correction.stretch_m_per_N) == (0.0, 0.0)


@given(st.floats(1e-6, 5e-4), st.floats(0.0, 1e-5), st.floats(0.0, 0.3), st.floats(0.0, 5.0))
def test_what_is_measured_never_makes_it_less_well_known(
    contact_m: float, stretch_m_per_N: float, scale: float, onset_N: float
) -> None:
    """Each sample narrows what is believed of the index, at any load."""
    correction = LoadCorrection(LoadTrust(contact_m, stretch_m_per_N, scale, onset_N, 1.0))
    for excursion_m in EXCURSION_M.tolist():
        before = [correction.deviation_m(rise_N) for rise_N in (0.0, 20.0, 40.0)]
        rise_N = true_rise_N(excursion_m, correction.contact_m, correction.stretch_m_per_N)
        correction.take(rise_N, rise_N, SLOPE_N_PER_M)
        after = [correction.deviation_m(rise_N) for rise_N in (0.0, 20.0, 40.0)]
        assert all(now <= then * (1.0 + 1e-9) for now, then in zip(after, before, strict=True))


def test_the_better_known_decides() -> None:
    """Load and excursion disagree by a stretch: whichever is doubted more gives way."""
    doubted_tendon = LoadCorrection(LoadTrust(5e-5, 6e-6, 0.01, 0.5, 1.0))
    doubted_load = LoadCorrection(LoadTrust(5e-5, 3e-7, 0.3, 5.0, 1.0))
    for correction in (doubted_tendon, doubted_load):
        wind(correction, 0.0, 6e-6)
    assert doubted_tendon.stretch_m_per_N > 0.7 * 6e-6
    assert doubted_load.stretch_m_per_N < 0.1 * 6e-6


def test_one_wild_sample_counts_no_more_than_an_outlier() -> None:
    """A reading far off, as when a finger is knocked, shifts the index by little."""
    knocked, calm = (LoadCorrection(LoadTrust(5e-5, 5e-6, 0.02, 1.3, 2.0)) for _ in range(2))
    for correction in (knocked, calm):
        wind(correction, 0.0, 0.0)
    rise_N = true_rise_N(2e-3, knocked.contact_m, knocked.stretch_m_per_N)
    knocked.take(rise_N + 500.0, rise_N, SLOPE_N_PER_M)
    moved_m = knocked.contact_m - calm.contact_m + (knocked.stretch_m_per_N - calm.stretch_m_per_N) * rise_N
    assert abs(moved_m) < 2e-5


def test_free_closing_with_stretched_tendons_is_no_stronger_motor() -> None:
    """Softer tendons make free closing look weaker: told of that, the filter finds the stretch and not a weak motor."""
    free_N_per_m, stretch = 1943.0, -7e-6
    seen_scale = 1.0 + free_N_per_m * stretch
    linked = LoadCorrection(LoadTrust(0.0, 7e-6, 0.002, 0.0, 0.5, -free_N_per_m), seen_scale)
    wind(linked, 0.0, stretch)
    assert linked.stretch_m_per_N == pytest.approx(stretch, rel=0.1)


@pytest.mark.parametrize(
    "trust", [(math.nan, 0, 0, 0, 1), (0, -1e-6, 0, 0, 1), (0, 0, 0, 0, 0), (0, 0, math.inf, 0, 1)]
)
def test_trust_in_nonsense_is_refused(trust: tuple[float, float, float, float, float]) -> None:
    """A deviation that is none would make every sample count for nothing, or for all."""
    with pytest.raises(InputError, match="not a trust"):
        LoadTrust(*trust)


def test_a_smooth_constant_arrives_without_a_corner() -> None:
    """A step of the estimate becomes a motion that the arm can follow, and comes to rest on it."""
    smooth = SmoothConstant(0.002, 25.0)
    rates = []
    for _ in range(500):
        smooth.step(1e-4)
        rates.append(smooth.rate)
    assert smooth.value == pytest.approx(1e-4, rel=1e-4)
    assert max(rates) < 1.1e-4 * 25.0 / math.e
    assert abs(rates[-1]) < 1e-9
