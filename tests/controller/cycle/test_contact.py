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
EXPECTED = FingerExpectation(
    contact_wound_m=0.012, free_slope_N_per_m=1900.0, loaded_slope_N_per_m=18000.0, contact_step_N=0.6
)
TICK_M = 2 * math.pi / 4096 * 0.0105
RX_TICK_M = math.radians(300.0) / 1024 * 0.0105
COUNT_N = 2.69e-3 * 1.79 / 0.0105
LOOP_N = 2.8  # of load for one motor tick of position error: the position loop hunts between two ticks
SLOW_M = 0.0012  # before the expected contact
SEARCH_END_M = 0.0131


@dataclass(frozen=True)
class Finger:
    """A finger that winds in at 10, near the object at 1 mm/s, a sample every 5 ms."""

    contact_m: float | None
    friction_N: float = 0.0  # constant, left over by the load law
    seed: int = 0
    noise: bool = True
    tick_m: float = TICK_M
    rise: float = 1.0  # of the table's

    def wind(self, search: FingerContact, end_m: float = SEARCH_END_M) -> float | None:
        """Feed the search; the true excursion at which it knew."""
        generator = np.random.default_rng(self.seed)
        slow_from_m = EXPECTED.contact_wound_m - SLOW_M
        excursions_m = [*np.arange(0.0, slow_from_m, 5e-5), *np.arange(slow_from_m, end_m, 5e-6)]
        for excursion_m in excursions_m:
            load_N = EXPECTED.free_slope_N_per_m * excursion_m + self.friction_N
            if self.contact_m is not None and excursion_m > self.contact_m:
                difference = self.rise * EXPECTED.loaded_slope_N_per_m - EXPECTED.free_slope_N_per_m
                load_N += EXPECTED.contact_step_N + difference * (excursion_m - self.contact_m)
            seen_m = float(excursion_m)
            if self.noise:
                load_N += LOOP_N * generator.uniform(-0.5, 0.5) + LOOP_N * (0.5 - (excursion_m / self.tick_m) % 1.0)
                seen_m, load_N = round(seen_m / self.tick_m) * self.tick_m, round(load_N / COUNT_N) * COUNT_N
            if search.take(seen_m, seen_m, load_N, slow=excursion_m >= slow_from_m) is not Touch.FREE:
                return float(excursion_m)
        return None


def searching() -> FingerContact:
    return FingerContact(SETTINGS, EXPECTED)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-6e-4, 6e-4),
    st.floats(-10.0, 10.0),
    st.floats(0.85, 1.2),
    st.sampled_from([TICK_M, RX_TICK_M]),
    st.integers(0, 1000),
)
def test_contact_is_found_and_dated_back(
    later_m: float, friction_N: float, rise: float, tick_m: float, seed: int
) -> None:
    """Wherever the object stands, however firm it is, with fine ticks and coarse ones: found to 0.1 mm soon after,
    never before; constant friction cancels."""
    contact_m = EXPECTED.contact_wound_m + later_m
    search = searching()
    known_m = Finger(contact_m, friction_N, seed, tick_m=tick_m, rise=rise).wind(search)
    assert search.touch is Touch.TOUCHING
    assert known_m is not None
    assert contact_m < known_m < contact_m + 4.5e-4
    assert search.contact_wound_m == pytest.approx(contact_m, abs=1e-4)
    onset_N = EXPECTED.free_slope_N_per_m * search.contact_wound_m + friction_N
    assert search.onset_load_N == pytest.approx(onset_N, abs=1.0)


def test_without_noise_the_two_lines_meet_in_the_contact() -> None:
    """Back-dating is the geometry of two lines: right to some micrometres where the samples lie on them."""
    search = searching()
    Finger(EXPECTED.contact_wound_m + 3e-4, noise=False).wind(search)
    assert search.contact_wound_m == pytest.approx(EXPECTED.contact_wound_m + 3e-4, abs=1e-5)


@pytest.mark.parametrize("earlier_m", [0.001, 0.004])
@pytest.mark.parametrize("seed", range(3))
def test_an_object_met_far_too_early_is_not_this_grasp(seed: int, earlier_m: float) -> None:
    """Another object, or a hand in the wrong place, is told from the object of the table: met while closing fast, or
    before the free line is known."""
    search = searching()
    known_m = Finger(EXPECTED.contact_wound_m - earlier_m, seed=seed).wind(search)
    assert search.touch is Touch.EARLY
    assert known_m is not None
    assert known_m < EXPECTED.contact_wound_m - earlier_m + 1.5e-3
    assert search.contact_wound_m == EXPECTED.contact_wound_m


@pytest.mark.parametrize("tick_m", [TICK_M, RX_TICK_M])
@pytest.mark.parametrize("seed", range(4))
def test_an_absent_object_is_not_found(seed: int, tick_m: float) -> None:
    """Nothing is gripped where there is nothing: free closing alone never looks like contact."""
    search = searching()
    assert Finger(None, 6.0, seed, tick_m=tick_m).wind(search) is None
    assert search.conclude() is Touch.FREE
    assert search.contact_wound_m == EXPECTED.contact_wound_m


def test_contact_just_before_winding_ends_is_found_at_the_end() -> None:
    """With less of the loaded line than contact is otherwise believed on."""
    search = searching()
    contact_m = SEARCH_END_M - 2e-4
    assert Finger(contact_m).wind(search) is None
    assert search.conclude() is Touch.TOUCHING
    assert search.contact_wound_m == pytest.approx(contact_m, abs=1e-4)


def test_shaken_load_while_closing_fast_is_no_contact() -> None:
    """Acceleration and stiction shake the load by some newtons; only the slow search looks that closely."""
    search = searching()
    for step in range(200):
        wound_m, load_N = step * 5e-5, 4.0 + 1900.0 * step * 5e-5 + (12.0 if step % 40 < 8 else 0.0)
        assert search.take(wound_m, wound_m, load_N, slow=False) is Touch.FREE


@pytest.mark.parametrize(("excursion_m", "load_N"), [(math.nan, 5.0), (0.0119, math.inf), (0.0119, math.nan)])
def test_samples_that_are_not_finite_are_passed_over(excursion_m: float, load_N: float) -> None:
    """One broken sample neither finds contact nor spoils the fit."""
    search = searching()
    finger = Finger(0.01205, noise=False)
    assert finger.wind(search, end_m=0.0119) is None
    assert search.take(excursion_m, excursion_m, load_N, slow=True) is Touch.FREE
    finger.wind(search)
    assert search.touch is Touch.TOUCHING
    assert math.isfinite(search.contact_wound_m)
    assert math.isfinite(search.onset_load_N)


def test_a_pad_says_where_contact_was() -> None:
    """The pad's own excursion of first contact, whatever load says later."""
    search = searching()
    Finger(None).wind(search, end_m=0.0116)
    assert search.take_pad(0.0116) is Touch.TOUCHING
    assert search.contact_wound_m == pytest.approx(0.0116, abs=5e-6)
    known_m = search.contact_wound_m
    Finger(0.0119).wind(search)
    search.take_pad(0.0125)
    assert search.contact_wound_m == known_m


def test_a_pad_overrides_the_load() -> None:
    """A rise that is contact without a pad is none while the pad is silent; a rise far beyond is contact beside it."""
    contact_m, difference = 0.0117, EXPECTED.loaded_slope_N_per_m - EXPECTED.free_slope_N_per_m

    def wind(search: FingerContact, start_m: float, end_m: float, padded: bool) -> None:
        for excursion_m in np.arange(start_m, end_m, 5e-6).tolist():
            load_N = EXPECTED.free_slope_N_per_m * excursion_m + max(0.0, excursion_m - contact_m) * difference
            search.take(excursion_m, excursion_m, load_N, slow=True, padded=padded)

    for padded in (False, True):
        search = searching()
        wind(search, 0.0100, 0.0122, padded)
        assert search.touch is (Touch.FREE if padded else Touch.TOUCHING)
    wind(search, 0.0122, 0.0131, padded=True)
    assert search.touch is Touch.TOUCHING


def test_a_pad_that_touches_far_before_the_object_is_early() -> None:
    """Something else is between the fingers, or the pad touched already when closing began."""
    assert searching().take_pad(EXPECTED.contact_wound_m - 1.1 * SETTINGS.gate_m) is Touch.EARLY
    assert searching().take_pad(math.nan) is Touch.FREE
