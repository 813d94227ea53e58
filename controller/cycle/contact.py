"""When a finger touches: where the free-closing line and the loaded line of load against excursion meet.

A compliant hand does not stall at contact: its load only grows more steeply. Per finger, a line is fitted to the
samples of free closing (its slope is known from the joint springs; its offset holds the constant part of the gear
friction). Once the load stands clearly above that line, every further sample points back along the loaded slope to
the meeting of the two lines, the excursion of first contact. The motion table gates the result: contact is expected
near its contact excursion. Where a tactile pad watches the finger, the pad says when it touches; the load then only
says so where it rises far, for contact beside the pad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum


@dataclass(frozen=True)
class ContactSettings:
    """Thresholds of the contact search."""

    smoothing_m: float = 6e-5  # of winding, some four motor ticks
    rise_N: float = 2.0  # above the free line before a finger counts as touching
    early_rise_N: float = 20.0  # the same while closing fast, where acceleration shakes the load
    break_away_m: float = 1e-3  # of winding from the start, in which stiction is overcome
    settle_m: float = 0.4e-3  # of slow winding before the free line is fitted: slowing down shakes the load too
    samples: int = 4  # above it in a row
    free_samples: int = 10  # of slow winding before the free line is known
    gate_m: float = 1.5e-3  # contact further than this from the table's is not this grasp
    table_deviation_m: float = 5e-5  # standard deviation of the table's own contact excursion (spool zero, object size)
    load_deviation_m: float = 1.5e-4  # of the one found: a support that drags on the object adds some 2 N of load
    pad_deviation_m: float = 3e-5  # of the one that a tactile pad found
    clear_m: float = 0.4e-3  # samples nearer to the table's contact than this are not fitted as free closing


@dataclass(frozen=True)
class FingerExpectation:
    """What the motion table expects of one finger: finger-side excursion of first contact and the two slopes."""

    contact_excursion_m: float
    free_slope_N_per_m: float
    loaded_slope_N_per_m: float


class Touch(IntEnum):
    """What a finger's load says."""

    FREE = 0
    TOUCHING = 1
    EARLY = 2  # load rose long before the object was expected
    MISSED = 3  # no load rise long after


class FingerContact:
    """Searches first contact of one finger while it winds in."""

    def __init__(self, settings: ContactSettings, expected: FingerExpectation) -> None:
        self._settings = settings
        self._expected = expected
        self._count = 0
        self._offset_N = 0.0
        self._above = 0
        self._start_m: float | None = None
        self._first_m = 0.0
        self._last_m = 0.0
        self._smoothed: tuple[float, float] | None = None
        self._meeting_sum_m = 0.0
        self._meetings = 0
        self._deviation_m = settings.load_deviation_m
        self._by_pad = False
        self.touch = Touch.FREE

    @property
    def contact_excursion_m(self) -> float:
        """Excursion of first contact, back-dated, m: table and load, or pad, weighed by their variances; the table's
        until contact was found."""
        expected_m = self._expected.contact_excursion_m
        if self.touch is not Touch.TOUCHING or self._meetings == 0:
            return expected_m
        table, found = self._settings.table_deviation_m**2, self._deviation_m**2
        return expected_m + table / (table + found) * (self._meeting_sum_m / self._meetings - expected_m)

    @property
    def onset_load_N(self) -> float:
        """Measured load at contact, N: on the free line, so with the same constant friction as all winding samples."""
        return self._offset_N + self._expected.free_slope_N_per_m * self.contact_excursion_m

    def take_pad(self, excursion_m: float) -> Touch:
        """The finger's pad touches, and did so first at this finger-side excursion; returns what is known now."""
        if not self._by_pad and math.isfinite(excursion_m):
            self._by_pad = True
            self._deviation_m = self._settings.pad_deviation_m
            self._meeting_sum_m, self._meetings = excursion_m, 1
            self._judge(excursion_m)
        return self.touch

    def take(self, excursion_m: float, load_N: float, *, slow: bool, padded: bool = False) -> Touch:
        """One sample of a winding finger (finger-side excursion, load); returns what is known now.

        `slow`: the finger winds at the constant slow rate of the search; before that only a large rise counts, as early
        contact. `padded`: a pad watches the finger, so that again only a large rise counts. Samples that are not finite
        are ignored.
        """
        if self._by_pad or not (math.isfinite(excursion_m) and math.isfinite(load_N)):
            return self.touch
        settings, expected = self._settings, self._expected
        to_contact_m = excursion_m - expected.contact_excursion_m
        residual_N = load_N - expected.free_slope_N_per_m * excursion_m
        if slow and self._start_m is None:
            self._start_m = excursion_m
        settling = self._start_m is None or excursion_m - self._start_m < settings.settle_m
        excursion_m, residual_N = self._smooth(excursion_m, residual_N)
        rise_N = residual_N - self._offset_N
        unknown = self._count < settings.free_samples
        threshold_N = settings.early_rise_N if settling or unknown or padded else settings.rise_N
        breaking_away = excursion_m - self._first_m < settings.break_away_m
        self._above = self._above + 1 if rise_N >= threshold_N and not breaking_away else 0
        if self._above >= settings.samples:
            self._point_back(excursion_m, rise_N)
        elif not settling and (unknown or (self._above == 0 and to_contact_m < -settings.clear_m)):
            self._fit(residual_N)
        if self.touch is Touch.FREE and to_contact_m > settings.gate_m:
            self.touch = Touch.MISSED
        return self.touch

    def _smooth(self, excursion_m: float, residual_N: float) -> tuple[float, float]:
        """Means over the last stretch of winding: one motor tick is 2.8 N of load, so a single sample says little. Both
        are smoothed alike, so a point on a line stays on it."""
        if self._smoothed is None:
            self._smoothed = (excursion_m, residual_N)
            self._first_m = self._last_m = excursion_m
        last_m, last_N = self._smoothed
        travel_m = max(excursion_m - self._last_m, 0.0)
        weight = travel_m / (travel_m + self._settings.smoothing_m)
        self._last_m = max(excursion_m, self._last_m)
        self._smoothed = (last_m + weight * (excursion_m - last_m), last_N + weight * (residual_N - last_N))
        return self._smoothed

    def _fit(self, residual_N: float) -> None:
        """The free line's offset: a mean that forgets the start of winding (stiction, slack) over some 30 samples."""
        self._count += 1
        self._offset_N += (residual_N - self._offset_N) / min(self._count, 30)

    def _point_back(self, excursion_m: float, rise_N: float) -> None:
        expected = self._expected
        meeting_m = excursion_m - rise_N / (expected.loaded_slope_N_per_m - expected.free_slope_N_per_m)
        self._meeting_sum_m += meeting_m
        self._meetings += 1
        self._judge(meeting_m)

    def _judge(self, meeting_m: float) -> None:
        early = meeting_m < self._expected.contact_excursion_m - self._settings.gate_m
        self.touch = Touch.EARLY if early else Touch.TOUCHING
