"""What a simulated motor tells of its effort, and how wrong that is: noise, and an offset that drifts.

A current (XM430) is measured by a sensor: its error is in what the host reads and in what the motor's own current
limits act on. A load (the others) is the motor's own output, which has no sensor and so by nature no offset; given one,
only the reading shows it. Effort in the model's unit: A, or part of full output; positive = counter-clockwise.
Source: dynamixel reference 2.4.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

from drivers.dynamixel.control_tables import MotorModel
from drivers.errors import InputError

LARGEST_OFFSET = 3.0
LARGEST_DRIFT_PER_S = 1.0


@dataclass(frozen=True, slots=True)
class EffortErrors:
    """Of one motor: standard deviation of the noise in counts, offset in the model's unit, and its change a second.

    InputError for what is not finite or absurdly large.
    """

    noise_counts: float = 0.0
    offset: float = 0.0
    drift_per_s: float = 0.0

    def __post_init__(self) -> None:
        if (
            not (0.0 <= self.noise_counts <= 1000.0)
            or not abs(self.offset) <= LARGEST_OFFSET
            or not abs(self.drift_per_s) <= LARGEST_DRIFT_PER_S
        ):
            raise InputError(
                f"effort noise {self.noise_counts} counts, offset {self.offset}, drift {self.drift_per_s}/s; expected "
                f"0 to 1000 counts, at most {LARGEST_OFFSET:g} and {LARGEST_DRIFT_PER_S:g}/s either way."
            )


NO_ERRORS = EffortErrors()


class EffortSense:
    """Effort as the host reads it."""

    def __init__(self, model: MotorModel, errors: EffortErrors, seed: str) -> None:
        register = model.registers[model.effort_register]
        self._range = register.minimum, register.maximum
        self._model = model
        self._errors = errors
        self._random = random.Random(seed)
        self._offset = errors.offset
        self._told = 0
        self.stuck = False
        """It goes on telling what it told."""
        self.extra_counts = 0
        """It tells so much more."""

    @property
    def current_error_A(self) -> float:
        """Measured less true current; 0 without a sensor."""
        return self._offset if self._model.effort == "current" else 0.0

    def pass_time(self, period_s: float) -> None:
        """The offset drifts."""
        self._offset += self._errors.drift_per_s * period_s

    def counts(self, current_A: float, output: float, powered: bool) -> int:
        """The effort register's value; `output` in counts of full output."""
        if self.stuck:
            return self._told
        model, errors = self._model, self._errors
        effort = current_A if model.effort == "current" else output / model.full_pwm
        counts = (effort + self._offset if powered else effort) / model.effort_unit
        if errors.noise_counts and powered:
            counts += self._random.gauss(0.0, errors.noise_counts)
        lowest, highest = self._range
        self._told = max(lowest, min(highest, round(counts) + self.extra_counts))
        return self._told
