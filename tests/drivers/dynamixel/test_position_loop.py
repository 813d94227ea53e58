"""What is worked out of a position loop, against the simulated motors' inner loop."""

from __future__ import annotations

import pytest

from drivers.dynamixel.control_tables import MODELS, XM430_W350, MotorModel
from drivers.dynamixel.load_law import LoadLaw, nominal_law
from drivers.dynamixel.position_loop import position_loop
from drivers.dynamixel.settings import MotorSettings
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.dynamixel_motor import SimulatedMotor

RADIUS_M = 0.0105
MIDDLE_TICKS = 500
EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


def settings_of(model: MotorModel) -> MotorSettings:
    electrics = electrics_of(model)
    if model.effort == "load":
        return MotorSettings(1, 1, 0, load_law=nominal_law(model, RADIUS_M), model=model.name)
    law = LoadLaw(electrics.torque_constant_Nm_per_A, electrics.friction_current_A)
    return MotorSettings(1, 1, 0, load_law=law, model=model.name)


def force_N(model: MotorModel, error_ticks: int, rate_m_s: float) -> float:
    """What the simulated motor pulls with, before the gear's friction, this far behind its goal."""
    motor = SimulatedMotor(1, model)
    if model.position_modes:
        motor.put("operating_mode", model.position_modes[0])
    motor.put("goal_position", MIDDLE_TICKS + error_ticks)
    motor.put("torque_enable", 1)
    angle_rad = (MIDDLE_TICKS + 0.5) * model.tick_rad
    return motor.control(0, angle_rad, rate_m_s / RADIUS_M) / RADIUS_M


@EVERY
def test_standing_a_motor_is_as_far_behind_as_its_load_needs(model: MotorModel) -> None:
    """The lead that the grasp gives its goals: too little, and winding ends short of what was asked."""
    loop = position_loop(settings_of(model), model)
    for ticks in (20, 40):
        lead_m = ticks * loop.resolution_m - loop.dead_m
        if lead_m / loop.compliance_m_per_N < 150.0:
            assert force_N(model, ticks, 0.0) == pytest.approx(lead_m / loop.compliance_m_per_N, rel=0.03)


@EVERY
def test_moving_it_is_further_behind_by_its_lag(model: MotorModel) -> None:
    """At this lead the output just makes up for the back-EMF: nothing is left to pull with."""
    loop = position_loop(settings_of(model), model)
    ticks, rate_m_s = 20, 0.004
    at_rest_N, moving_N = force_N(model, ticks, 0.0), force_N(model, ticks, rate_m_s)
    assert at_rest_N - moving_N == pytest.approx(loop.lag_s * rate_m_s / loop.compliance_m_per_N, rel=0.03)


def test_a_higher_gain_stays_nearer() -> None:
    """The motor's own gain counts, not the model's default."""
    stiff = MotorSettings(1, 1, 0, position_gain=2 * XM430_W350.default_position_gain)
    usual, doubled = position_loop(MotorSettings(1, 1, 0), XM430_W350), position_loop(stiff, XM430_W350)
    assert doubled.compliance_m_per_N == pytest.approx(usual.compliance_m_per_N / 2)
    assert doubled.lag_s == pytest.approx(usual.lag_s / 2)
