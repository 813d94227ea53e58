"""What simulated motors tell of their effort, and what heat does to them, against hand-worked numbers."""

from __future__ import annotations

import math

import pytest

from drivers.dynamixel.control_tables import MODELS, XM430_W350, MotorModel
from drivers.errors import InputError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.dynamixel_effort import EffortErrors
from drivers.simulated.dynamixel_electrics import electrics_of
from tests.drivers.simulated.motor_bench import Bench, HeldShafts

EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


def two_motors(model: MotorModel, offset: float, drift_per_s: float = 0.0) -> SimulatedMotors:
    """Motor 1 mounted with, motor 2 against its shaft; both with the same error of effort towards pulling in."""
    settings = [
        SimulatedMotorSettings(number, 500, sign, model, effort_offset=offset, effort_drift_per_s=drift_per_s)
        for number, sign in ((1, 1), (2, -1))
    ]
    return SimulatedMotors(HeldShafts(), settings)


@EVERY
def test_an_offset_reads_as_pulling_in_whichever_way_the_motor_is_mounted(model: MotorModel) -> None:
    """0.05 of the unit at rest without torque, with the sign of the mounting; then it drifts by 0.01 a second."""
    sim = two_motors(model, 0.05, 0.01)
    sim.control(0, 0.001)
    counts = 0.05 / model.effort_unit
    told = [motor.value(model.effort_register) for motor in sim.motors]
    assert told == pytest.approx([counts, -counts], abs=0.51)
    for step in range(1, 101):
        sim.control(step * 100_000_000, 0.1)
    told = [motor.value(model.effort_register) for motor in sim.motors]
    assert told == pytest.approx([3 * counts, -3 * counts], abs=0.51)


def test_a_current_s_ceiling_acts_on_what_the_sensor_says() -> None:
    """Goal Current 1 A with a sensor that tells 0.1 A too much: 0.9 A flow while it pulls in, 1.1 A the other way."""
    for goal, true_A in ((4000, 0.9), (-4000, -1.1)):
        sim = two_motors(XM430_W350, 0.1)
        motor = sim.motors[0]
        for name, value in {"operating_mode": 5, "goal_current": round(1 / 2.69e-3), "torque_enable": 1}.items():
            register = XM430_W350.registers[name]
            assert motor.write(register.address, register.encode(value)) == 0
        goal_register = XM430_W350.registers["goal_position"]
        assert motor.write(goal_register.address, goal_register.encode(goal)) == 0
        sim.control(0, 0.001)
        assert motor.current_A == pytest.approx(true_A, abs=0.003)
        assert abs(motor.value("present_current")) == round(1 / 2.69e-3)


@EVERY
def test_heat_takes_torque_from_the_same_output(model: MotorModel) -> None:
    """40 K above the manual's 30 °C: winding resistance 15.6 % up, magnets 4 % down."""
    torque_Nm = []
    for celsius in (30.0, 70.0):
        bench = Bench(model)
        bench.sim.motors[0].stress.held_at_C = celsius
        if model.protocol == 2:
            bench.drive(1, 16, goal_pwm=885)
        else:
            bench.write(1, "goal_position", 1000)
        bench.control()
        bench.control_for(0.02)
        torque_Nm.append(bench.shafts.torque_Nm[0])
    assert torque_Nm[1] / torque_Nm[0] == pytest.approx(0.96 / 1.156, rel=1e-6)


def test_a_hot_motor_gives_less_torque_per_ampere() -> None:
    """At its current ceiling an XM430 keeps the current, and loses only what its magnets lose."""
    hot = electrics_of(XM430_W350).at(80.0)
    assert hot.torque_constant_Nm_per_A == pytest.approx(0.95 * 1.79)
    assert hot.back_emf_V_s == pytest.approx(0.95 * electrics_of(XM430_W350).back_emf_V_s)
    assert electrics_of(XM430_W350).at(30.0) == electrics_of(XM430_W350)


@pytest.mark.parametrize(
    ("noise_counts", "offset", "drift_per_s"),
    [(-1.0, 0.0, 0.0), (0.0, math.nan, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, math.inf)],
)
def test_impossible_errors_are_refused(noise_counts: float, offset: float, drift_per_s: float) -> None:
    """Not a number or absurd: never into the physics."""
    with pytest.raises(InputError, match="effort noise"):
        EffortErrors(noise_counts, offset, drift_per_s)
