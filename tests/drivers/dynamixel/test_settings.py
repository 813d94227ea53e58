"""What belongs to a motor's calibration is checked where it enters."""

from __future__ import annotations

import math
from typing import Any

import pytest

from drivers.dynamixel.settings import Calibration, MotorSettings
from drivers.errors import InputError

GOOD: dict[str, Any] = {
    "model": "XM430-W350",
    "firmware": 45,
    "voltage_V": 12.0,
    "temperature_C": 31.0,
    "scatter_N": 0.5,
}


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("model", "AX-12", "'AX-12' is not known"),
        ("firmware", 256, "firmware = 256; expected 0…255"),
        ("voltage_V", math.nan, "voltage_V = nan; expected 5…30"),
        ("voltage_V", 120.0, "voltage_V = 120.0"),
        ("temperature_C", 300.0, "temperature_C = 300.0; expected -20…120"),
        ("scatter_N", -0.1, "scatter_N = -0.1; expected 0…100"),
        ("scatter_N", math.inf, "scatter_N = inf"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused(key: str, value: object, told: str) -> None:
    """It decides whether a motor is started: a slip in its file must not be believed."""
    with pytest.raises(InputError) as refused:
        Calibration(**{**GOOD, key: value})
    assert told in str(refused.value)


def test_a_calibration_stays_with_its_motor() -> None:
    """The date is for people; without one a calibration holds too."""
    calibrated = Calibration(**GOOD)
    assert calibrated.date is None
    assert MotorSettings(1, 1, 0, calibrated=calibrated).calibrated is calibrated
    assert MotorSettings(1, 1, 0).calibrated is None


@pytest.mark.parametrize("effort_filter_s", [-0.001, 0.2, math.nan])
def test_no_filter_that_hides_the_motor(effort_filter_s: float) -> None:
    """Told as the setting it is."""
    with pytest.raises(InputError, match="effort_filter_s = "):
        MotorSettings(1, 1, 0, effort_filter_s=effort_filter_s)
