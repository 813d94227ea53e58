"""What the parts are told of the configured motors, against the reference's numbers and the models' own."""

from __future__ import annotations

import pytest

from controller.config import load_config
from controller.service.assembly import index_settings, motor_drives
from drivers.dynamixel.control_tables import MODELS, RX_28, XL430_W250, XM430_W350

EVERY = pytest.mark.parametrize("name", [model.name for model in MODELS.values()])


def test_the_drive_of_a_known_motor() -> None:
    """Gain 800, 12 V, 5.2 ohm, 1.79 N·m/A on the T42's spool: 170 N/mm; friction of 22 N (reference 3.2, 3.3)."""
    for drive in motor_drives(load_config(overrides={"tendons": {"model": XM430_W350.name}})):
        assert drive.compliance_m_per_N == pytest.approx(1.0 / 171e3, rel=0.01)
        assert drive.friction_N == pytest.approx(22.0, abs=0.3)
        assert drive.dead_m == 0.0


def test_measured_numbers_replace_the_models() -> None:
    """Who has measured the position loop knows better than the data sheet."""
    config = load_config(overrides={"tendons": {"compliance_m_per_N": 8e-6, "lag_s": 0.05}})
    assert [(drive.compliance_m_per_N, drive.lag_s) for drive in motor_drives(config)] == [(8e-6, 0.05)] * 2


def test_each_motor_is_led_by_its_own_gain() -> None:
    """One stiffer motor must not be wound further than the other."""
    right, left = motor_drives(load_config(overrides={"tendons": {"right": {"position_gain": 1600}}}))
    assert right.compliance_m_per_N == pytest.approx(left.compliance_m_per_N / 2.0)


def test_a_higher_supply_needs_less_lead() -> None:
    """At 14.8 V the same error drives more; a supply that was not told yet is taken for the law's."""
    drive, _ = motor_drives(load_config())
    at_12_m, at_14_8_m = (drive.lead_m(60.0, 0.002, 1.0, supply_V) for supply_V in (12.0, 14.8))
    assert at_14_8_m == pytest.approx(at_12_m * 12.0 / 14.8)
    assert (drive.supply_V(0.0), drive.supply_V(11.1)) == (12.0, 11.1)


@EVERY
def test_trust_follows_the_model(name: str) -> None:
    """One tick of a motor is worth so many newtons of its output, and less cannot be told."""
    config = load_config(overrides={"tendons": {"model": name}})
    trust, (drive, _) = index_settings(config), motor_drives(config)
    tick_m = trust.tick_m
    assert trust.noise_N == pytest.approx(max(tick_m / drive.compliance_m_per_N, 1.0))
    assert trust.contact_deviation_m >= tick_m / 12**0.5
    assert trust.tension_lag_s == config.tendons.effort_filter_s


def test_coarse_ticks_are_trusted_less() -> None:
    """An RX-28 has a third of the ticks of an XL430 in a turn, and a stiffer loop."""
    coarse, fine = (
        index_settings(load_config(overrides={"tendons": {"model": model.name}})) for model in (RX_28, XL430_W250)
    )
    assert coarse.noise_N > 5.0 * fine.noise_N
    assert coarse.tick_m == pytest.approx(5.38e-5, abs=1e-7)
    assert coarse.scale_deviation >= fine.scale_deviation >= 0.3
