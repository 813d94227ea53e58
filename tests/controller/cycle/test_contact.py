"""Finding first contact on synthetic lines of load against excursion, quantised as the motors' numbers are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cycle.contact import ContactSettings, FingerContact, FingerExpectation, Touch

SETTINGS = ContactSettings()
EXPECTED = FingerExpectation(contact_excursion_m=0.012, free_slope_N_per_m=1900.0, loaded_slope_N_per_m=15000.0)
TICK_M = 2 * math.pi / 4096 * 0.0105
COUNT_N = 2.69e-3 * 1.79 / 0.0105
LOOP_N = 2.8  # of load for one motor tick of position error: the position loop hunts between two ticks
SLOW_M = 0.0012  # before the expected contact
TABLE_SHARE = SETTINGS.table_deviation_m**2 / (SETTINGS.table_deviation_m**2 + SETTINGS.load_deviation_m**2)


@dataclass(frozen=True)
class Finger:
    """A finger that winds in at 10, near the object at 1 mm/s, a sample every 5 ms."""

    contact_m: float | None
    friction_N: float = 0.0  # constant, left over by the load law
    seed: int = 0
    noise: bool = True

    def wind(self, search: FingerContact, end_m: float = 0.0145) -> float | None:
        """Feed the search; the true excursion at which it knew."""
        generator = np.random.default_rng(self.seed)
        slow_from_m = EXPECTED.contact_excursion_m - SLOW_M
        excursions_m = [*np.arange(0.0, slow_from_m, 5e-5), *np.arange(slow_from_m, end_m, 5e-6)]
        for excursion_m in excursions_m:
            load_N = EXPECTED.free_slope_N_per_m * excursion_m + self.friction_N
            if self.contact_m is not None and excursion_m > self.contact_m:
                difference = EXPECTED.loaded_slope_N_per_m - EXPECTED.free_slope_N_per_m
                load_N += difference * (excursion_m - self.contact_m)
            seen_m = float(excursion_m)
            if self.noise:
                load_N += LOOP_N * generator.uniform(-0.5, 0.5)
                seen_m, load_N = round(seen_m / TICK_M) * TICK_M, round(load_N / COUNT_N) * COUNT_N
            if search.take(seen_m, load_N, slow=excursion_m >= slow_from_m) is not Touch.FREE:
                return float(excursion_m)
        return None


def searching() -> FingerContact:
    return FingerContact(SETTINGS, EXPECTED)


@settings(max_examples=25, deadline=None)
@given(st.floats(-3e-4, 4e-4), st.floats(-10.0, 0.5), st.integers(0, 1000))
def test_contact_is_found_and_dated_back(later_m: float, friction_N: float, seed: int) -> None:
    """Wherever the object stands: found soon after, never before, and dated back to it; constant friction cancels."""
    contact_m = EXPECTED.contact_excursion_m + later_m
    search = searching()
    known_m = Finger(contact_m, friction_N, seed).wind(search)
    assert search.touch is Touch.TOUCHING
    assert known_m is not None
    assert contact_m - 5e-5 < known_m < contact_m + 4e-4
    found_m = EXPECTED.contact_excursion_m + (search.contact_excursion_m - EXPECTED.contact_excursion_m) / TABLE_SHARE
    assert found_m == pytest.approx(contact_m, abs=2.0 * SETTINGS.load_deviation_m)
    onset_N = EXPECTED.free_slope_N_per_m * search.contact_excursion_m + friction_N
    assert search.onset_load_N == pytest.approx(onset_N, abs=1.0)


@pytest.mark.parametrize("friction_N", [3.0, 6.0, 10.0])
def test_constant_friction_is_no_contact(friction_N: float) -> None:
    """A gear that drags more than the load law assumes shifts the free line; it does not make an object."""
    search = searching()
    known_m = Finger(EXPECTED.contact_excursion_m, friction_N).wind(search)
    assert known_m == pytest.approx(EXPECTED.contact_excursion_m + 2e-4, abs=2e-4)
    assert search.onset_load_N == pytest.approx(1900.0 * EXPECTED.contact_excursion_m + friction_N, abs=1.0)


def test_without_noise_the_two_lines_meet_in_the_contact() -> None:
    """Back-dating is the geometry of two lines: exact to a micrometre where the samples lie on them."""
    later_m = 2e-4
    search = searching()
    Finger(EXPECTED.contact_excursion_m + later_m, noise=False).wind(search)
    expected_m = EXPECTED.contact_excursion_m + TABLE_SHARE * later_m
    assert search.contact_excursion_m == pytest.approx(expected_m, abs=5e-6)


@pytest.mark.parametrize("seed", range(5))
def test_an_object_met_far_too_early_is_not_this_grasp(seed: int) -> None:
    """Another object, or a hand in the wrong place, is told from the object of the table."""
    search = searching()
    Finger(EXPECTED.contact_excursion_m - 0.004, seed=seed).wind(search)
    assert search.touch is Touch.EARLY
    assert search.contact_excursion_m == EXPECTED.contact_excursion_m


@pytest.mark.parametrize("seed", range(5))
def test_an_absent_object_is_missed(seed: int) -> None:
    """Nothing is gripped where there is nothing: free closing alone never looks like contact."""
    search = searching()
    known_m = Finger(None, seed=seed).wind(search)
    assert search.touch is Touch.MISSED
    assert known_m == pytest.approx(EXPECTED.contact_excursion_m + SETTINGS.gate_m, abs=2e-5)
    assert search.contact_excursion_m == EXPECTED.contact_excursion_m


def test_shaken_load_while_closing_fast_is_no_contact() -> None:
    """Acceleration and stiction shake the load by some newtons; only the slow search looks that closely."""
    search = searching()
    for step in range(200):
        load_N = 4.0 + 1900.0 * step * 5e-5 + (12.0 if step % 40 < 8 else 0.0)
        assert search.take(step * 5e-5, load_N, slow=False) is Touch.FREE


@pytest.mark.parametrize(("excursion_m", "load_N"), [(math.nan, 5.0), (0.0119, math.inf), (0.0119, math.nan)])
def test_samples_that_are_not_finite_are_passed_over(excursion_m: float, load_N: float) -> None:
    """One broken sample neither finds contact nor spoils the fit."""
    search = searching()
    finger = Finger(0.01205, noise=False)
    assert finger.wind(search, end_m=0.0119) is None
    assert search.take(excursion_m, load_N, slow=True) is Touch.FREE
    finger.wind(search)
    assert search.touch is Touch.TOUCHING
    assert math.isfinite(search.contact_excursion_m)
    assert math.isfinite(search.onset_load_N)


def test_a_pad_says_where_contact_was() -> None:
    """The pad's own excursion of first contact, weighed with the table's by their variances; not that of the load."""
    search = searching()
    Finger(None).wind(search, end_m=0.0119)
    assert search.take_pad(0.0119) is Touch.TOUCHING
    share = SETTINGS.table_deviation_m**2 / (SETTINGS.table_deviation_m**2 + SETTINGS.pad_deviation_m**2)
    assert search.contact_excursion_m == pytest.approx(0.012 - share * 0.0001, abs=1e-9)
    known_m = search.contact_excursion_m
    Finger(0.0119).wind(search)
    search.take_pad(0.0125)
    assert search.contact_excursion_m == known_m


def test_a_pad_overrides_the_load() -> None:
    """A rise that is contact without a pad is none while the pad is silent; a rise far beyond is contact beside it."""
    contact_m, difference = 0.0117, EXPECTED.loaded_slope_N_per_m - EXPECTED.free_slope_N_per_m

    def wind(search: FingerContact, start_m: float, end_m: float, padded: bool) -> None:
        for excursion_m in np.arange(start_m, end_m, 5e-6).tolist():
            load_N = EXPECTED.free_slope_N_per_m * excursion_m + max(0.0, excursion_m - contact_m) * difference
            search.take(excursion_m, load_N, slow=True, padded=padded)

    for padded in (False, True):
        search = searching()
        wind(search, 0.0100, 0.0122, padded)
        assert search.touch is (Touch.FREE if padded else Touch.TOUCHING)
    wind(search, 0.0122, 0.01348, padded=True)
    assert search.touch is Touch.TOUCHING


def test_a_pad_that_touches_far_before_the_object_is_early() -> None:
    """Something else is between the fingers, or the pad touched already when closing began."""
    assert searching().take_pad(EXPECTED.contact_excursion_m - 1.1 * SETTINGS.gate_m) is Touch.EARLY
    assert searching().take_pad(math.nan) is Touch.FREE
