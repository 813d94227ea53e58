"""The supply that leads are reckoned with, played without motors."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.motor_drive import FLICKER_V, SUPPLY_RATE_V_S, MotorDrive, Supply

SAMPLE_NS = 2_500_000


@given(st.lists(st.floats(9.0, 14.8), min_size=1, max_size=50))
def test_the_supply_is_followed_slowly(measured_V: list[float]) -> None:
    """Protects the grip: whatever the motors tell, a goal never jumps by what its lead is reckoned with."""
    supply = Supply((MotorDrive(), MotorDrive()))
    supply.begin((12.0, 12.0))
    for number, volts in enumerate(measured_V, 1):
        before = supply.volts
        supply.follow((volts, 12.0), number * SAMPLE_NS)
        assert abs(supply.volts[0] - before[0]) <= SUPPLY_RATE_V_S * SAMPLE_NS * 1e-9 + 1e-12
        assert supply.volts[1] == 12.0


@pytest.mark.parametrize("sagged_V", [9.0, 11.0, 13.5])
def test_a_supply_that_stays_is_reached_up_to_its_flicker(sagged_V: float) -> None:
    """Then the lead is right to a fiftieth; a flickering last digit moves nothing."""
    supply = Supply((MotorDrive(), MotorDrive()))
    supply.begin((12.0, 12.0))
    for number in range(1, 2000):
        supply.follow((sagged_V, sagged_V), number * SAMPLE_NS)
    settled = supply.volts
    assert settled == pytest.approx((sagged_V, sagged_V), abs=FLICKER_V + 1e-9)
    nearer_V = sagged_V + math.copysign(0.1 * FLICKER_V, 12.0 - sagged_V)
    supply.follow((nearer_V, 0.0), 2001 * SAMPLE_NS)
    assert supply.volts[0] == settled[0]
    assert abs(supply.volts[1] - settled[1]) < 0.01  # one that tells nothing is taken at the law's, slowly
