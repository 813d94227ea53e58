"""What belongs to a measured load law in a file: on which motor it was measured, how, and how well.

`stillgrasp calibrate motor-load` writes it into the motors' own file, keys beginning with `right_calibrated_` or
`left_calibrated_`; robot.toml has it as `[tendons.right.calibrated]`. Source: dynamixel reference 2.4, 3.4.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from calibration.toml_files import FieldError
from drivers.dynamixel.control_tables import MODELS, model_by_name
from drivers.dynamixel.settings import Calibration
from drivers.errors import InputError


class LoadCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Motor and conditions, and what they leave uncertain: `slope_uncertainty` relative, `scatter_N` the readings'
    standard deviation about the law. `date`: year-month-day."""

    model: str
    firmware: Annotated[int, Meta(ge=0, le=255)]
    voltage_V: Annotated[float, Meta(ge=5, le=30)]
    temperature_C: Annotated[float, Meta(ge=-20, le=120)]
    scatter_N: Annotated[float, Meta(ge=0, le=100)]
    slope_uncertainty: Annotated[float, Meta(ge=0, le=1)]
    friction_uncertainty_N: Annotated[float, Meta(ge=0, le=100)]
    date: str | None = None

    def __post_init__(self) -> None:
        check_model_name("model", self.model)

    def provenance(self) -> Calibration:
        """As the driver keeps it with the motor."""
        return Calibration(
            self.model, self.firmware, self.voltage_V, self.temperature_C, self.scatter_N, self.date or None
        )


def check_model_name(key: str, name: str) -> None:
    """FieldError for `key` unless this names a motor model."""
    try:
        model_by_name(name)
    except InputError as error:
        raise FieldError(key, f"one of {', '.join(model.name for model in MODELS.values())}") from error
