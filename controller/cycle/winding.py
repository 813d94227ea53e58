"""Winding the tendons: the profile, the governor's throttle, and the observer that tells how far they are.

The cycle owns the winding. A jerk-limited one-dimensional profile runs over the *mean excursion since first contact*
(negative before it); the hand process only follows. Time along the profile is the profile's own: the governor slows it
down, up to a standstill, without a corner in position, velocity or acceleration.

Sampled motor data are never differentiated into targets. The observer takes the commanded profile through the
identified motor lag and corrects it slowly by the measured index, so index, rate and acceleration are smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import ruckig

from controller.cycle.path_planning import Trajectory, planned
from controller.cycle.path_time import ThrottledTime
from drivers.errors import InputError


@dataclass(frozen=True)
class WindingLimits:
    """Limits of the mean excursion."""

    rate_m_s: float = 0.020
    acceleration_m_s2: float = 0.10
    jerk_m_s3: float = 2.0


class WindingState(NamedTuple):
    """Mean excursion since first contact with its rate and acceleration."""

    position_m: float
    rate_m_s: float
    acceleration_m_s2: float


class WindingProfile:
    """A jerk-limited move of the mean excursion that can be slowed down along its way."""

    def __init__(self, period_s: float, limits: WindingLimits, throttle_time_s: float = 0.03) -> None:
        self._limits = limits
        self._time = ThrottledTime(period_s, throttle_time_s)
        self._trajectory: Trajectory | None = None
        self.state = WindingState(0.0, 0.0, 0.0)

    @property
    def finished(self) -> bool:
        """Whether the profile has come to its end (or there is none)."""
        return self._trajectory is None

    @property
    def speed(self) -> float:
        """The fraction of the profile's own rate at which it runs now, 0 to 1."""
        return self._time.speed

    def place(self, position_m: float) -> None:
        """Stand at `position_m`; forget any move."""
        self._trajectory = None
        self.state = WindingState(position_m, 0.0, 0.0)

    def move(
        self,
        target_m: float,
        *,
        rate_m_s: float | None = None,
        end_rate_m_s: float = 0.0,
        duration_s: float | None = None,
    ) -> None:
        """Start a move from here to `target_m`, lasting at least `duration_s`.

        With an `end_rate_m_s` it does not stop there: the next move must follow in the same period.
        Raises InputError if a value is not finite or a move is still under way.
        """
        rate_limit = self._limits.rate_m_s if rate_m_s is None else min(rate_m_s, self._limits.rate_m_s)
        if not (math.isfinite(target_m) and rate_limit > 0.0):
            raise InputError(f"winding to {target_m} m at {rate_m_s} m/s is not possible; expected finite values > 0.")
        if self._trajectory is not None:
            raise InputError("a winding move is under way; stop it before the next.")
        request = ruckig.InputParameter(1)
        request.current_position = [self.state.position_m]
        request.current_velocity = [self.state.rate_m_s]
        request.target_position = [target_m]
        request.target_velocity = [end_rate_m_s]
        request.max_velocity = [rate_limit]
        request.max_acceleration = [self._limits.acceleration_m_s2]
        request.max_jerk = [self._limits.jerk_m_s3]
        if duration_s is not None:
            request.minimum_duration = duration_s
        self._trajectory = planned(request, 1)
        self._time.start()

    def step(self, throttle: float) -> WindingState:
        """One period further. `throttle` in [0, 1] is the fraction of the profile's own speed that the arm can bear."""
        if self._trajectory is None:
            return self.state
        time_s, speed, speed_rate = self._time.step(throttle)
        position, rate, acceleration = self._trajectory.at_time(min(time_s, self._trajectory.duration))
        if time_s >= self._trajectory.duration:
            self._trajectory = None
            self.state = WindingState(position[0], rate[0] * speed, 0.0)
        else:
            self.state = WindingState(
                position[0], rate[0] * speed, acceleration[0] * speed * speed + rate[0] * speed_rate
            )
        return self.state

    def end_if_standing(self) -> bool:
        """Forget what is left of a move that the throttle has brought to rest; True if nothing moves any more."""
        if self._trajectory is not None and self._time.standing:
            self.place(self.state.position_m)
        return self._trajectory is None


@dataclass(frozen=True)
class ObserverSettings:
    """Identified motor lag, how fast measured samples correct the model, and how well the index is known at a stop."""

    lag_s: float = 0.02
    bandwidth_rad_s: float = 25.0
    stop_deviation_m: float = 5e-6  # where winding ends
    creep_m: float = 8e-6  # what gears and tendons may creep in the first second after it; grows with the root of time


class IndexObserver:
    """Index, rate and acceleration from the commanded profile, slowly corrected by measured samples.

    model     x_m = the commanded profile through a first-order lag
    residual  r   = measured − model: an α-β filter estimates it and its drift, so a steady drift (the motors' position
                    loop giving way under growing tension) leaves no error
    """

    def __init__(self, period_s: float, settings: ObserverSettings) -> None:
        self._period_s = period_s
        self._blend = 1.0 - math.exp(-period_s / settings.lag_s)
        self._alpha_rate = 2.0 * settings.bandwidth_rad_s
        self._beta_rate = settings.bandwidth_rad_s**2
        self._stop_variance_m2 = settings.stop_deviation_m**2
        self._creep_m2_per_s = settings.creep_m**2
        self._last_sample_ns: int | None = None
        self._stopped: tuple[float, int] | None = None
        """Residual at which winding ended, and when."""
        self.reset(0.0)

    def reset(self, measured_m: float) -> None:
        """Start standing at the measured index, m."""
        self._model_m = measured_m
        self._model_rate_m_s = 0.0
        self._model_acceleration_m_s2 = 0.0
        self._residual_m = 0.0
        self._residual_rate_m_s = 0.0
        self._last_sample_ns = None
        self._stopped = None

    def shift(self, by_m: float) -> None:
        """Move the index's zero: what was x is now x + `by_m`; rates stay."""
        self._model_m += by_m

    def advance(self, command: WindingState) -> WindingState:
        """The index one period later, for the commanded profile state of this period."""
        keep = 1.0 - self._blend
        self._model_m = keep * self._model_m + self._blend * command.position_m
        self._model_rate_m_s = keep * self._model_rate_m_s + self._blend * command.rate_m_s
        self._model_acceleration_m_s2 = keep * self._model_acceleration_m_s2 + self._blend * command.acceleration_m_s2
        self._residual_m += self._residual_rate_m_s * self._period_s
        return self.state

    @property
    def state(self) -> WindingState:
        """Index since contact m, its rate and acceleration, now."""
        return WindingState(
            self._model_m + self._residual_m,
            self._model_rate_m_s + self._residual_rate_m_s,
            self._model_acceleration_m_s2,
        )

    def correct(self, measured_m: float, sample_ns: int, now_ns: int, *, hidden_m: float = 0.0) -> None:
        """Take in a new sample, measured at `sample_ns`; a sample seen before changes nothing.

        `hidden_m`: what the ticks of motors that stand hide (standard deviation), 0 while they wind. A moving motor
        shows the truth on average; a standing one always the same tick, however often it is read: one measurement,
        weighed against the index as it was when the winding ended, which counts for less the longer that is ago.
        """
        if self._last_sample_ns is not None and sample_ns <= self._last_sample_ns:
            return
        interval_s = 0.0 if self._last_sample_ns is None else min((sample_ns - self._last_sample_ns) * 1e-9, 0.01)
        self._last_sample_ns = sample_ns
        index = self.state
        error_m = measured_m - (index.position_m - index.rate_m_s * (now_ns - sample_ns) * 1e-9)
        if hidden_m > 0.0:
            if self._stopped is None:
                self._stopped = self._residual_m, sample_ns
            residual_m, stop_ns = self._stopped
            stop_variance_m2 = self._stop_variance_m2 + self._creep_m2_per_s * (sample_ns - stop_ns) * 1e-9
            since_stop_m = residual_m - self._residual_m
            error_m += (since_stop_m - error_m) * hidden_m**2 / (hidden_m**2 + stop_variance_m2)
            self._residual_rate_m_s *= math.exp(-interval_s * self._alpha_rate)  # drift ends with the motion it was of
        else:
            self._stopped = None
        self._residual_m += min(self._alpha_rate * interval_s, 0.5) * error_m
        self._residual_rate_m_s += min(self._beta_rate * interval_s, 10.0) * error_m
