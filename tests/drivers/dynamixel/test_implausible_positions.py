"""Positions that cannot be: a false one is passed over, a lasting jump is told. And who lost torque is not taken for
one that restarted."""

from __future__ import annotations

import pytest

from drivers.dynamixel.control_tables import MX_28, RX_28, XL430_W250, XM430_W350, MotorModel
from drivers.dynamixel.sample import TendonSample
from tests.drivers.dynamixel.test_every_model import Rig

JUMP_M = 0.0012
EXCHANGE_NS = 2_500_000
MODELS = pytest.mark.parametrize("model", [XM430_W350, XL430_W250, MX_28, RX_28], ids=lambda model: model.name)


def wound(model: MotorModel) -> Rig:
    rig = Rig(model)
    rig.pair.start()
    rig.catch_up()
    rig.wind(0.008)
    return rig


def exchanges(rig: Rig, count: int) -> list[TendonSample]:
    """As often as the hand process does."""
    samples = []
    for _ in range(count):
        rig.clock.advance_to_ns(rig.clock.now_ns() + EXCHANGE_NS)
        rig.catch_up()
        samples.append(rig.pair.exchange())
    return samples


@MODELS
def test_a_lasting_jump_is_told_within_10_ms(model: MotorModel) -> None:
    """An encoder that failed or a spool that slipped by a millimetre: its motor has pulled or let out by as much."""
    rig = wound(model)
    exchanges(rig, 2)
    rig.motors.motors[1].encoder.jump_ticks += round(JUMP_M / (model.tick_rad * 0.0105))
    assert exchanges(rig, 4)[-1].jumped == (False, True)
    assert rig.run(0.3).jumped == (False, True)


@MODELS
def test_one_false_position_is_passed_over(model: MotorModel) -> None:
    """For one sample only: nothing is told but a miss, and nothing of it is believed."""
    rig = wound(model)
    before = rig.run(0.01).excursion_m
    encoder = rig.motors.motors[1].encoder
    encoder.jump_ticks += 300
    rig.clock.advance_to_ns(rig.clock.now_ns() + EXCHANGE_NS)
    rig.catch_up()
    sample = rig.pair.exchange()
    encoder.jump_ticks -= 300
    seen = [sample, *exchanges(rig, 5)]
    assert all(sample.jumped == (False, False) for sample in seen)
    assert max(abs(sample.excursion_m[1] - before[1]) for sample in seen) < 1e-3


def test_torque_that_somebody_switched_off_is_no_restart() -> None:
    """The indirect map is still there: the supply is sound, and somebody else is on the bus."""
    rig = wound(XM430_W350)
    rig.motors.motors[0].put("torque_enable", 0)
    sample = rig.run(0.01)
    assert (sample.torque_on, sample.restarted) == ((False, True), (False, False))
