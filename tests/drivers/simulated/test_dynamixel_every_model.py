"""What the issue asks of the simulated motors, for every model: dead band, noise, quantisation, heat, overload."""

from __future__ import annotations

import statistics

import pytest

from drivers.dynamixel.control_tables import MODELS, RX_28, MotorModel
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings, taut_ticks
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.spring_tendons import SpringTendons
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench

EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


def push(bench: Bench, motor_id: int = 1) -> None:
    """All there is, towards a goal that is out of reach, with torque on."""
    if bench.model.protocol == 2:
        bench.drive(motor_id, 4, goal_position=100_000)
    else:
        assert bench.write(motor_id, "goal_position", 1000) == 0


@EVERY
def test_pushing_in_vain_is_overload(model: MotorModel) -> None:
    """Full output without turning for 3 s: told, and torque is gone, by each protocol's way; not a moment before."""
    bench = Bench(model)
    push(bench)
    bench.control_for(2.9, 10 * MILLISECOND)
    assert bench.shafts.torque_Nm[0] > 0.5
    bench.control_for(0.2, 10 * MILLISECOND)
    assert bench.sim.motors[0].alarms & 0x20
    assert bench.shafts.torque_Nm[0] == 0.0
    assert bench.sim.motors[1].alarms == 0


@EVERY
def test_pushing_makes_hot_and_rest_makes_cool(model: MotorModel) -> None:
    """A second at stall current warms by 50 K · (stall / 40 % of it)² / 400 s; then it cools towards 30 °C."""
    bench = Bench(model)
    push(bench)
    motor = bench.sim.motors[0]
    bench.control_for(1.0, 10 * MILLISECOND)
    part_of_stall = motor.current_A / motor.electrics.stall_current_A
    warmed_K = motor.stress.temperature_C - 30.0
    assert warmed_K == pytest.approx(50.0 * (part_of_stall / 0.4) ** 2 / 400.0, rel=0.05)
    off = "torque_enable"
    assert bench.write(1, off, 0) == 0
    bench.control_for(400.0, 100 * MILLISECOND)
    assert motor.stress.temperature_C - 30.0 == pytest.approx(0.37 * warmed_K, rel=0.05)


@EVERY
def test_effort_is_noisy_and_whole_counts(model: MotorModel) -> None:
    """Three counts of deviation about what is so; the host reads integers."""
    bench = Bench(model, noise_counts=3.0, seed=5)
    quiet = Bench(model)
    for one in (bench, quiet):
        push(one)
        if model.effort == "current":
            assert one.write(1, "goal_position", 40) == 0
        elif model.protocol == 2:
            assert one.write(1, "goal_pwm", 300) == 0
        else:
            assert one.write(1, "torque_limit", 300) == 0
    told = []
    for _ in range(1500):
        bench.control()
        told.append(bench.sim.motors[0].value(model.effort_register))
    quiet.control()
    true = quiet.sim.motors[0].value(model.effort_register)
    assert abs(true) > 20
    assert statistics.mean(told) == pytest.approx(true, abs=0.8)  # which is rounded itself
    assert statistics.stdev(told) == pytest.approx(3.0, rel=0.1)


@EVERY
def test_the_gear_holds_a_band_of_tensions(model: MotorModel) -> None:
    """Reference 3.3: wound up and then asked for less, a tendon stays until the motor has overcome friction twice."""
    electrics, zero = electrics_of(model), taut_ticks(model)
    friction_Nm = electrics.gear_friction_Nm
    springs = SpringTendons((3000.0,), (0.0,), friction_Nm=friction_Nm, inertia_kgm2=electrics.inertia_kgm2)
    sim = SimulatedMotors(springs, [SimulatedMotorSettings(1, zero, model=model)])
    motor, now_ns = sim.motors[0], 0

    def go(goal: int) -> tuple[int, float, float]:
        nonlocal now_ns
        register, start = model.registers["goal_position"], motor.value("goal_position")
        for step in range(3200):  # slowly, so that no momentum carries the spool farther
            on_the_way = start + round((goal - start) * min(1.0, step / 1600))
            assert motor.write(register.address, register.encode(on_the_way)) == 0
            sim.control(now_ns, 0.0005)
            springs.step(0.0005)
            now_ns += 500_000
        motor_Nm = electrics.torque_constant_Nm_per_A * motor.current_A
        return motor.value("present_position"), springs.tension_N(0), motor_Nm

    if model.protocol == 2:
        for name, value in {"operating_mode": 4, "torque_enable": 1}.items():
            register = model.registers[name]
            assert motor.write(register.address, register.encode(value)) == 0
    goal = zero + round(0.010 / 0.0105 / model.tick_rad)
    wound_ticks, tension_N, wound_Nm = go(goal)
    assert wound_Nm >= 0.0105 * tension_N  # winding, the motor gives friction too
    back = 1 if model is RX_28 else 4
    held_ticks, held_N, held_Nm = go(goal - back)
    assert held_ticks == wound_ticks
    assert held_N == tension_N
    assert held_Nm < wound_Nm
    paid_ticks, paid_N, paid_Nm = go(zero + round(0.004 / 0.0105 / model.tick_rad))
    assert paid_ticks < wound_ticks
    assert paid_Nm <= 0.0105 * paid_N + 1e-9  # paying out, friction helps it
