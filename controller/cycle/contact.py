"""When a finger touches: where the free-closing line and the loaded line of load against excursion meet.

A compliant hand does not stall at contact: its load only grows more steeply. While a finger winds slowly, its samples
are averaged over stretches of winding that end with a motor tick: the saw-tooth of the position loop goes from tick to
tick, and whole teeth average out. With each stretch the meeting of the two lines is fitted anew (`contact_fit.py`).
Contact is known once the load stands clearly above the free line and enough of the loaded line was
seen; it is dated back to the meeting.

Contact during fast closing, or before the free line is known, is not the table's grasp: early. Where a tactile pad
watches the finger, the pad says when it touches; the load then only says so where it rises far, for contact beside the
pad. All excursions here are the spool's. Source: design 4 "Contact"; load and its saw-tooth: dynamixel reference 2.4,
3.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from controller.cycle.contact_fit import ContactFit, fit_contact


@dataclass(frozen=True)
class ContactSettings:
    """Thresholds of the contact search."""

    settle_m: float = 0.3e-3  # of slow winding before samples count: slowing down shakes the load
    stretch_m: float = 4.8e-5  # of winding to a mean: three ticks of 4096 a turn, one of an RX-28
    free_stretches: int = 3  # before the meeting, else the free line is not known
    rise_N: float = 2.0  # above the free line before a finger counts as touching
    window_m: float = 2e-4  # of the loaded line before it is believed
    evidence: float = 20.0  # of a bend: chance alone hardly makes 10
    largest_deviation_m: float = 5e-5  # of a meeting that is believed
    early_rise_N: float = 20.0  # the same while closing fast, where acceleration shakes the load
    smoothing_m: float = 6e-5  # of fast winding
    samples: int = 4  # above it in a row
    break_away_m: float = 1e-3  # of winding from the start, in which stiction is overcome
    gate_m: float = 1.5e-3  # contact earlier than this is not this grasp
    load_deviation_m: float = 2.5e-5  # standard deviation that the fit does not see: drag, ticks, acceleration
    pad_deviation_m: float = 3e-5  # of the contact that a tactile pad found


@dataclass(frozen=True)
class FingerExpectation:
    """What the motion table expects of one finger, spool-side: excursion of first contact, the two slopes, and the step
    of load at contact, by which the support's drag begins."""

    contact_wound_m: float
    free_slope_N_per_m: float
    loaded_slope_N_per_m: float
    contact_step_N: float = 0.0


class Touch(IntEnum):
    """What a finger's load says."""

    FREE = 0
    TOUCHING = 1
    EARLY = 2  # load rose long before the object was expected


class FingerContact:
    """Searches first contact of one finger while it winds in."""

    def __init__(self, settings: ContactSettings, expected: FingerExpectation) -> None:
        self._settings = settings
        self._expected = expected
        self._smoothed_N: float | None = None
        self._first_m = self._last_m = 0.0
        self._above = 0
        self._slow_from_m: float | None = None
        self._stretch_from_m: float | None = None
        self._sums = (0.0, 0.0, 0)
        self._excursions_m: list[float] = []
        self._residuals_N: list[float] = []
        self._fit: ContactFit | None = None
        self._found_m = expected.contact_wound_m
        self.deviation_m = math.inf
        """Standard deviation of the contact that was found."""
        self.by_pad = False
        """Whether the pad found it."""
        self.touch = Touch.FREE

    @property
    def contact_wound_m(self) -> float:
        """Spool's excursion at first contact, back-dated, m, as load or pad found it; the table's until then."""
        return self._found_m if self.touch is Touch.TOUCHING else self._expected.contact_wound_m

    @property
    def onset_load_N(self) -> float:
        """Measured load at contact, N: on the free line, so with the same constant friction as all winding samples."""
        return self._offset_N + self._expected.free_slope_N_per_m * self.contact_wound_m

    @property
    def _offset_N(self) -> float:
        if self._fit is not None:
            return self._fit.offset_N
        count = len(self._residuals_N)
        return sum(self._residuals_N) / count if count else 0.0

    def take_pad(self, wound_m: float) -> Touch:
        """The finger's pad touches, and did so first when this much was wound; returns what is known now."""
        if self.touch is Touch.FREE and math.isfinite(wound_m):
            self.by_pad = True
            self._settle_on(wound_m, self._settings.pad_deviation_m)
        return self.touch

    def take(self, wound_m: float, then_m: float, load_N: float, *, slow: bool, padded: bool = False) -> Touch:
        """One sample of a winding finger; returns what is known now.

        `wound_m`: the spool's excursion now, which goes from tick to tick; `then_m`: the one at which the load was
        `load_N`, as load is filtered. `slow`: the finger winds at the constant slow rate of the search; before that
        only a large rise counts, as early contact. `padded`: a pad watches the finger, so that again only a large rise
        counts. Samples that are not finite are ignored.
        """
        finite = math.isfinite(wound_m) and math.isfinite(then_m) and math.isfinite(load_N)
        if self.touch is not Touch.FREE or not finite:
            return self.touch
        residual_N = load_N - self._expected.free_slope_N_per_m * then_m
        if slow and self._slow_from_m is None:
            self._slow_from_m = wound_m
        if self._slow_from_m is not None and wound_m - self._slow_from_m >= self._settings.settle_m:
            if self._average(wound_m, then_m, residual_N):
                self._judge(self._settings.window_m, padded=padded)
        elif self._rises_far(wound_m, residual_N):
            self.touch = Touch.EARLY
        return self.touch

    def conclude(self, *, padded: bool = False) -> Touch:
        """Winding ends: what is known now, however little of the loaded line was seen."""
        if self.touch is Touch.FREE:
            self._judge(0.0, padded=padded)
        return self.touch

    def _rises_far(self, wound_m: float, residual_N: float) -> bool:
        """Whether the load stands far above free closing, with some samples in a row smoothed over winding."""
        settings = self._settings
        if self._smoothed_N is None:
            self._smoothed_N = residual_N
            self._first_m = self._last_m = wound_m
        travel_m = max(wound_m - self._last_m, 0.0)
        self._last_m += travel_m
        self._smoothed_N += travel_m / (travel_m + settings.smoothing_m) * (residual_N - self._smoothed_N)
        breaking_away = wound_m - self._first_m < settings.break_away_m
        above = self._smoothed_N >= settings.early_rise_N and not breaking_away
        self._above = self._above + 1 if above else 0
        return self._above >= settings.samples

    def _average(self, wound_m: float, then_m: float, residual_N: float) -> bool:
        """Take a sample into the mean of its stretch; True when one has ended, with the first sample of the next."""
        ended = False
        if self._stretch_from_m is None:
            self._stretch_from_m = wound_m
        elif wound_m - self._stretch_from_m >= self._settings.stretch_m:
            excursions_m, residuals_N, count = self._sums
            self._excursions_m.append(excursions_m / count)
            self._residuals_N.append(residuals_N / count)
            self._stretch_from_m, self._sums, ended = wound_m, (0.0, 0.0, 0), True
        excursions_m, residuals_N, count = self._sums
        self._sums = (excursions_m + then_m, residuals_N + residual_N, count + 1)
        return ended

    def _judge(self, window_m: float, *, padded: bool) -> None:
        """Fit the meeting; it is believed with `window_m` of the loaded line."""
        settings, expected, free = self._settings, self._expected, self._settings.free_stretches
        x, y = self._excursions_m, self._residuals_N
        rise_N = settings.early_rise_N if padded else settings.rise_N
        # below the least rise that can count there is nothing to fit
        if len(x) <= free + 1 or max(y[-2:]) - min(y[:free]) < 0.5 * rise_N:
            return
        slope = expected.loaded_slope_N_per_m - expected.free_slope_N_per_m
        self._fit = fit = fit_contact(x, y, slope, expected.contact_step_N, settings.stretch_m)
        beyond_m = x[-1] - fit.contact_m
        above_N = fit.rise_N_per_m * beyond_m + expected.contact_step_N
        if fit.evidence < settings.evidence or above_N < rise_N:
            return
        if fit.contact_m < x[free - 1]:
            # loaded from the first stretches on; twice the rise, as their own scatter bends so few
            self.touch = Touch.EARLY if above_N >= 2.0 * rise_N else Touch.FREE
        elif fit.deviation_m <= settings.largest_deviation_m and beyond_m >= window_m:
            self._settle_on(fit.contact_m, math.hypot(fit.deviation_m, settings.load_deviation_m))

    def _settle_on(self, found_m: float, deviation_m: float) -> None:
        early = found_m < self._expected.contact_wound_m - self._settings.gate_m
        self._found_m, self.deviation_m = found_m, deviation_m
        self.touch = Touch.EARLY if early else Touch.TOUCHING
