"""A motor's load law from what it told while it wound and unwound against known tensions.

    winding, unwinding (s = ±1), at the tendon rate v:   effort = a·tension + s·I0 + b·v,   a = spool radius / K

fitted by robust least squares over both branches at once, in the units of `load_law.py`: a load is first scaled to the
law's voltage, and all to the mean temperature of the readings. b is that of a current, 0; of a load it is fitted where
the readings have two speeds, else it is the data sheet's.

Only the ratio of K and radius is seen, and it is what tension needs. Pure; SI. Offline: scipy.
Source: dynamixel reference 2.4, 3.1 to 3.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.dynamixel.control_tables import MotorModel
from drivers.dynamixel.load_law import LoadLaw, SpoolMotion, published_law, torque_at_heat
from drivers.errors import InputError

Vector = NDArray[np.float64]

FEWEST_TENSIONS = 3
"""Different ones, on each branch."""
LEAST_SPAN_N = 15.0
"""Between the smallest and the largest; gear friction alone is some 20 N."""
SPEEDS_RATIO = 1.5
"""Fastest to slowest, from which on friction and back-EMF are told apart."""
OUTLIER_SIGMAS = 6.0
LEAST_SLOPE_UNCERTAINTY = 0.02
"""Weights, spool and a motor's mood are not known better than this."""
PLAUSIBLE_RATIO = 2.5
"""A slope farther from the published one is that of pounds, newtons typed as kilograms, or another spool."""
ACCEPTED_RMS, ACCEPTED_WORST = 0.05, 0.12
"""Residuals to accept, as parts of the span of tensions: in the mean and the largest."""
_CONFIDENCE = 2.0
_DIFFERENT = 0.05
"""Part of the span by which two tensions differ."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Means over one stroke at constant speed. Effort and rate: positive = pulling in."""

    motion: SpoolMotion
    tension_N: float
    effort: float
    """A, or part of full output at the supply there was."""
    rate_m_s: float
    voltage_V: float
    temperature_C: float
    place: str
    """Where it is from, for whoever has to look at it again: "line 7", "step 3, winding"."""

    def __post_init__(self) -> None:
        numbers = (self.tension_N, self.effort, self.rate_m_s, self.voltage_V, self.temperature_C)
        if not all(map(math.isfinite, numbers)) or self.tension_N < 0.0 or self.voltage_V <= 0.0:
            raise InputError(f"{self.place}: {self} is no reading; expected finite numbers, tension ≥ 0, voltage > 0.")
        if self.motion is SpoolMotion.HOLDING or self.rate_m_s * self.motion.value <= 0.0:
            raise InputError(
                f"{self.place}: a spool at {self.rate_m_s * 1e3:g} mm/s is not {self.motion.name.lower()}.",
                help="Read while it turns: a spool at rest tells nothing of its load.",
            )


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Largest residuals of a law that may be used, as parts of the span of tensions."""

    rms: float = ACCEPTED_RMS
    worst: float = ACCEPTED_WORST


@dataclass(frozen=True, slots=True)
class LoadFit:
    """A law and how well it explains its readings, in their order."""

    law: LoadLaw
    readings: tuple[Reading, ...]
    residual_N: Vector
    """What the law says less what hung there."""
    outliers: tuple[int, ...]
    """Readings that the others do not agree with."""
    span_N: float
    voltage_V: float
    temperature_C: float
    back_emf_fitted: bool

    @property
    def rms_N(self) -> float:
        """Of the residuals."""
        return float(np.sqrt(np.mean(self.residual_N**2)))

    @property
    def worst(self) -> int:
        """Index of the largest residual."""
        return int(np.argmax(np.abs(self.residual_N)))

    @property
    def worst_N(self) -> float:
        """The largest residual's size."""
        return float(abs(self.residual_N[self.worst]))

    def refusal(self, acceptance: Acceptance) -> str:
        """Why the law may not be used; empty if it may."""
        allowed_N = acceptance.worst * self.span_N
        off = [index for index in self.outliers if abs(self.residual_N[index]) > allowed_N]
        if off:
            told = "; ".join(self._told(index) for index in off[:3])
            return f"{told}: the other readings do not agree with it"
        if self.rms_N > acceptance.rms * self.span_N:
            return (
                f"{self.rms_N:.2f} N are left in the mean, {self.rms_N / self.span_N:.1%} of the span; accepted are "
                f"{acceptance.rms:.1%}"
            )
        if self.worst_N > allowed_N:
            return (
                f"{self._told(self.worst)}: {self.worst_N / self.span_N:.1%} of the span; accepted are "
                f"{acceptance.worst:.1%}"
            )
        return ""

    def _told(self, index: int) -> str:
        reading = self.readings[index]
        law_N = reading.tension_N + self.residual_N[index]
        return f"{reading.place} is off by {self.residual_N[index]:+.1f} N ({reading.tension_N:.1f} N, law {law_N:.1f})"


def fit_load_law(readings: Sequence[Reading], model: MotorModel, spool_radius_m: float) -> LoadFit:
    """The law of one motor. InputError, naming the reading where there is one, for readings that hold no law."""
    span_N = _checked_span(readings)
    published = published_law(model, spool_radius_m)
    motion = np.array([float(reading.motion.value) for reading in readings])
    tension_N = np.array([reading.tension_N for reading in readings])
    rate_m_s = np.array([reading.rate_m_s for reading in readings])
    temperature_C = float(np.mean([reading.temperature_C for reading in readings]))
    by_load = published.voltage_V is not None
    effort = np.array([_at_law_voltage(reading, published.voltage_V) for reading in readings])
    warmth = np.array([torque_at_heat(one.temperature_C - temperature_C, by_load=by_load) for one in readings])
    speeds = np.abs(rate_m_s)
    fit_back_emf = by_load and float(speeds.max() / speeds.min()) >= SPEEDS_RATIO
    known = 0.0 if fit_back_emf else published.back_emf_effort_s_per_m
    columns = [tension_N, motion] + ([rate_m_s * warmth] if fit_back_emf else [])
    matrix, target = np.column_stack(columns), (effort - known * rate_m_s) * warmth
    solution, sigma = _solve(matrix, target)
    slope, friction = float(solution[0]), float(solution[1])
    nominal_slope = spool_radius_m / published.torque_per_effort_Nm
    _check_slope(slope, nominal_slope)
    residual_N = (target - matrix @ solution) / slope
    deviation = np.sqrt(np.diag(np.linalg.pinv(matrix.T @ matrix))) * sigma
    uncertainty = _CONFIDENCE * float(deviation[0]) / slope
    law = replace(
        published,
        torque_per_effort_Nm=spool_radius_m / slope,
        friction_effort=friction,
        slope_uncertainty=math.hypot(LEAST_SLOPE_UNCERTAINTY, uncertainty),
        friction_uncertainty=_CONFIDENCE * float(deviation[1]),
        back_emf_effort_s_per_m=float(solution[2]) if fit_back_emf else known,
        temperature_C=temperature_C,
        scatter_N=float(np.sqrt(np.mean(residual_N**2))),
    )
    return LoadFit(
        law=law,
        readings=tuple(readings),
        residual_N=residual_N,
        outliers=tuple(np.flatnonzero(np.abs(residual_N) > OUTLIER_SIGMAS * sigma / slope).tolist()),
        span_N=span_N,
        voltage_V=float(np.mean([reading.voltage_V for reading in readings])),
        temperature_C=temperature_C,
        back_emf_fitted=fit_back_emf,
    )


def _solve(matrix: Vector, target: Vector) -> tuple[Vector, float]:
    """Robust solution, none of it below 0, and the standard deviation of those rows that agree."""
    from scipy.optimize import least_squares  # a second to load, and most commands do without

    def residual(solution: Vector) -> Vector:
        return np.asarray(matrix @ solution - target, dtype=np.float64)

    def jacobian(solution: Vector) -> Vector:
        return matrix

    scale = 0.02 * float(np.ptp(target)) or 1.0
    lower = np.zeros(matrix.shape[1])
    start = np.maximum(np.linalg.lstsq(matrix, target, rcond=None)[0], 1e-9)
    sigma = scale
    for _ in range(4):
        found = least_squares(
            residual,
            start,
            jac=jacobian,
            bounds=(lower, np.inf),
            loss="soft_l1",
            f_scale=max(sigma, 1e-6 * scale),
            x_scale="jac",
        )
        start = np.maximum(found.x, 1e-12)
        spread = 1.4826 * float(np.median(np.abs(residual(found.x))))
        sigma = spread * math.sqrt(len(target) / max(1, len(target) - matrix.shape[1]))
    return np.asarray(found.x, dtype=np.float64), sigma


def _at_law_voltage(reading: Reading, law_V: float | None) -> float:
    return reading.effort if law_V is None else reading.effort * reading.voltage_V / law_V


def _checked_span(readings: Sequence[Reading]) -> float:
    tensions_N = [reading.tension_N for reading in readings]
    span_N = max(tensions_N) - min(tensions_N) if tensions_N else 0.0
    for motion in (SpoolMotion.WINDING, SpoolMotion.UNWINDING):
        own_N = sorted(reading.tension_N for reading in readings if reading.motion is motion)
        last_N, different = -math.inf, 0
        for tension_N in own_N:
            if tension_N - last_N > _DIFFERENT * span_N:
                last_N, different = tension_N, different + 1
        if different < FEWEST_TENSIONS:
            raise InputError(
                f"{different} different tensions while {motion.name.lower()}; expected {FEWEST_TENSIONS} or more.",
                help="Hang more different weights, and read each both winding and unwinding.",
            )
    if span_N < LEAST_SPAN_N:
        low, high = (min(readings, key=_tension), max(readings, key=_tension))
        raise InputError(
            f"all tensions lie within {span_N:.1f} N, {low.tension_N:.1f} ({low.place}) to {high.tension_N:.1f} N "
            f"({high.place}); expected {LEAST_SPAN_N:g} N or more.",
            help="Take lighter and heavier weights: gear friction alone is some 20 N.",
        )
    return span_N


def _check_slope(slope: float, nominal: float) -> None:
    if not nominal / PLAUSIBLE_RATIO <= slope <= nominal * PLAUSIBLE_RATIO:
        raise InputError(
            f"effort grows with tension by {slope:.3g} per newton; expected {nominal / PLAUSIBLE_RATIO:.3g} to "
            f"{nominal * PLAUSIBLE_RATIO:.3g} with this model and spool.",
            help="See that values are in the unit that was said (kg or N), and check spool_radius_m and "
            "tightening_sign.",
        )


def _tension(reading: Reading) -> float:
    return reading.tension_N
