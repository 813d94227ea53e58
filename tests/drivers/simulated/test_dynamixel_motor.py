"""The simulated motors' physics and protection, against the manuals' stall and no-load points and analytic results."""

import math

import pytest
from scipy.integrate import quad

from drivers.dynamixel.control_tables import (
    MODELS,
    MX_28,
    MX_28_2,
    RX_28,
    XL430_W250,
    XM430_W210,
    XM430_W350,
    MotorModel,
)
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.dynamixel_drive import Trajectory
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.dynamixel_stress import MotorStress
from drivers.simulated.spring_tendons import SpringTendons
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench, HeldShafts

RPM = 2 * math.pi / 60
ALL = [pytest.param(model, id=model.name) for model in MODELS.values()]


def _full_output(bench: Bench) -> None:
    """Push counter-clockwise with all there is."""
    if bench.model.protocol == 2:
        bench.drive(1, 16, goal_pwm=885)
    else:
        bench.control()
        bench.write(1, "goal_position", 1000)


@pytest.mark.parametrize(
    ("model", "supply_V", "torque_Nm", "speed_rpm"),
    [
        (RX_28, 18.5, 3.7, 85.0),
        (MX_28, 12.0, 2.5, 55.0),
        (MX_28_2, 12.0, 2.5, 55.0),
        (XM430_W350, 12.0, 4.1, 46.0),
        (XM430_W210, 12.0, 3.0, 77.0),
        (XL430_W250, 12.0, 1.5, 61.0),
    ],
)
def test_stall_and_no_load_are_the_manual_s(
    model: MotorModel, supply_V: float, torque_Nm: float, speed_rpm: float
) -> None:
    """Reference 2.1: blocked at full output, stall torque within 1 %; at no-load speed just what the gear takes."""
    bench = Bench(model, supply_V=supply_V)
    _full_output(bench)
    bench.control()
    assert bench.shafts.torque_Nm[0] == pytest.approx(torque_Nm, rel=0.01)
    bench.shafts.velocity_rad_s[0] = speed_rpm * RPM
    bench.control()
    assert bench.shafts.torque_Nm[0] == pytest.approx(electrics_of(model).gear_friction_Nm, rel=1e-6)


@pytest.mark.parametrize("model", ALL)
def test_torque_grows_with_the_supply(model: MotorModel) -> None:
    """A stalled motor at 11.1 V gives 11.1/12 of what it gives at 12 V, and shows its supply."""
    torque_Nm = []
    for supply_V in (12.0, 11.1):
        bench = Bench(model, supply_V=supply_V)
        _full_output(bench)
        bench.control()
        torque_Nm.append(bench.shafts.torque_Nm[0])
    assert torque_Nm[1] == pytest.approx(torque_Nm[0] * 11.1 / 12)
    assert bench.read(1, "present_input_voltage") == 111


@pytest.mark.parametrize("model", ALL)
def test_every_model_pulls_a_spring_to_balance(model: MotorModel) -> None:
    """Goal 6 mm of tendon on 3 N/mm: at rest motor and spring differ by the gear's friction at most."""
    electrics = electrics_of(model)
    springs = SpringTendons((3000.0,), (0.0,), friction_Nm=electrics.gear_friction_Nm)
    sim = SimulatedMotors(springs, [SimulatedMotorSettings(1, 100, model=model)])
    motor = sim.motors[0]
    goal = 100 + round(0.006 / 0.0105 / model.tick_rad)
    writes = {"goal_position": goal}
    if model.protocol == 2:
        writes = {"operating_mode": 4, "torque_enable": 1, "goal_position": goal}
    for name, value in writes.items():
        register = model.registers[name]
        assert motor.write(register.address, register.encode(value)) == 0
    for step in range(6000):
        sim.control(step * 500_000, 0.0005)
        springs.step(0.0005)
    assert springs.shaft_velocity_rad_s(0) == 0.0
    motor_Nm = electrics.torque_constant_Nm_per_A * motor.current_A
    assert abs(motor_Nm - springs.tension_N(0) * 0.0105) <= electrics.gear_friction_Nm + 1e-9
    assert springs.tension_N(0) > 6.0
    assert motor.value("present_position") <= goal + 1


@pytest.mark.parametrize("model", [MX_28, MX_28_2, XL430_W250, RX_28])
def test_load_in_motion_contains_the_speed(model: MotorModel) -> None:
    """Reference 2.4: load is output; the same output drives less current through a turning motor."""
    bench = Bench(model)
    _full_output(bench)
    bench.control()
    still_A, load = bench.sim.motors[0].current_A, bench.read(1, "present_load")
    bench.shafts.velocity_rad_s[0] = 2.0
    bench.control()
    assert bench.read(1, "present_load") == load
    assert bench.sim.motors[0].current_A < 0.8 * still_A


@pytest.mark.parametrize(("register", "value", "share"), [("goal_pwm", 354, 0.4), ("pwm_limit", 177, 0.2)])
def test_output_limits_of_protocol_2(register: str, value: int, share: float) -> None:
    """Goal PWM in position mode, and PWM Limit above it."""
    bench = Bench()
    order = ("pwm_limit", "operating_mode") if register == "pwm_limit" else ("operating_mode", "goal_pwm")
    for name in order:
        assert bench.write(1, name, value if name == register else 4) == 0
    bench.write(1, "torque_enable", 1)
    bench.write(1, "goal_position", 4000)
    bench.control()
    assert bench.read(1, "present_pwm") == value
    assert bench.shafts.torque_Nm[0] == pytest.approx(share * 4.1, rel=0.01)


def test_profile_takes_the_time_of_a_trapezium() -> None:
    """Trajectory of 1000 ticks at 500 ticks/s and 1000 ticks/s²: d/v + v/a = 2.5 s, never faster, and ends there."""
    trajectory, fastest, duration_s = Trajectory(), 0.0, 0.0
    while trajectory.position != 1000.0:
        before = trajectory.position
        trajectory.step(1000.0, 500.0, 1000.0, 0.001)
        fastest = max(fastest, (trajectory.position - before) / 0.001)
        duration_s += 0.001
        assert duration_s < 3.0
    assert fastest == pytest.approx(500.0, rel=0.01)
    assert duration_s == pytest.approx(2.5, abs=0.05)


@pytest.mark.parametrize(
    ("drive_mode", "velocity", "acceleration", "half_s"), [(0, 100, 0, 0.427), (4, 1000, 0, 0.5), (4, 1000, 400, 0.5)]
)
def test_profile_registers(drive_mode: int, velocity: int, acceleration: int, half_s: float) -> None:
    """Half of 1334 ticks: by speed (100 × 0.229 rpm = 1563 ticks/s), or half of the time that was asked for."""
    bench = Bench()
    assert bench.write(1, "drive_mode", drive_mode) == 0
    bench.drive(1, 4, profile_velocity=velocity, profile_acceleration=acceleration)
    bench.control()
    bench.write(1, "goal_position", 1334)
    bench.control_for(half_s)
    assert bench.read(1, "position_trajectory") == pytest.approx(667, abs=20)


def test_velocity_mode_reaches_its_speed() -> None:
    """A free spool with friction turns at the goal velocity; the integral makes up for friction and back-EMF."""
    springs = SpringTendons((0.0,), (0.0,))
    sim = SimulatedMotors(springs, [SimulatedMotorSettings(1)])
    motor = sim.motors[0]
    for name, value in {"operating_mode": 1, "torque_enable": 1, "goal_velocity": -100}.items():
        register = XM430_W350.registers[name]
        assert motor.write(register.address, register.encode(value)) == 0
    for step in range(6000):
        sim.control(step * 500_000, 0.0005)
        springs.step(0.0005)
    assert springs.shaft_velocity_rad_s(0) == pytest.approx(-100 * 0.229 * RPM, rel=0.02)


def test_reverse_mode_turns_everything_round() -> None:
    """Drive Mode bit 0: position, speed, current and torque change sign together."""
    bench = Bench()
    bench.write(1, "drive_mode", 1)
    bench.drive(1, 5, goal_current=100, goal_position=2000)
    bench.shafts.angle_rad[0], bench.shafts.velocity_rad_s[0] = 1.0, 0.1
    bench.control()
    assert bench.read(1, "present_position") < 0
    assert bench.read(1, "present_velocity") < 0
    assert bench.read(1, "present_current") > 0
    assert bench.shafts.torque_Nm[0] < 0.0


def test_torque_on_by_goal() -> None:
    """Drive Mode bit 3."""
    bench = Bench()
    bench.write(1, "drive_mode", 8)
    bench.write(1, "goal_position", 5)
    assert bench.read(1, "torque_enable") == 1


def test_noise_has_its_deviation_and_its_seed() -> None:
    """Current noise: mean and deviation as asked, the same twice, another with another seed."""

    def currents(seed: int) -> list[int]:
        bench = Bench(noise_counts=4.0, seed=seed)
        bench.drive(1, 0, goal_current=200)
        values = []
        for _ in range(2000):
            bench.control()
            values.append(bench.sim.motors[0].value("present_current"))
        return values

    first = currents(1)
    mean = sum(first) / len(first)
    deviation = math.sqrt(sum((value - mean) ** 2 for value in first) / len(first))
    assert mean == pytest.approx(200.0, abs=0.5)
    assert deviation == pytest.approx(4.0, rel=0.08)
    assert currents(1) == first
    assert currents(2) != first


def test_heat_is_the_analytic_exponential() -> None:
    """One time constant at 40 % of the stall current: 63 % of 50 K; and for ever: 80 °C."""
    stress = MotorStress(2.3, 4.8)
    for _ in range(40_000):
        stress.step(0.01, 0.92, 0.0, 0.0)
    assert stress.temperature_C == pytest.approx(30.0 + 50.0 * (1 - math.exp(-1)), abs=0.05)
    for _ in range(400):
        stress.step(10.0, 0.92, 0.0, 0.0)
    assert stress.temperature_C == pytest.approx(80.0, abs=0.1)


@pytest.mark.parametrize("model", [XM430_W350, MX_28])
def test_a_hot_motor_lets_go(model: MotorModel) -> None:
    """Stalled at full output it is above 80 °C in 90 s and shuts down, by its protocol's way; the heat rise follows
    x' = (312.5 K / (1 + 0.0039 x)² − x) / 400 s, as its current falls with its winding."""
    bench = Bench(model)
    bench.write(1, "shutdown", 0x04)
    _full_output(bench)
    bench.control()
    stalled_s = 0.0
    while bench.shafts.torque_Nm[0] > 0.0:
        bench.control(100 * MILLISECOND)
        stalled_s += 0.1
        assert stalled_s < 120.0
    expected_s, _ = quad(lambda x: 400.0 / (312.5 / (1 + 0.0039 * x) ** 2 - x), 0.0, 51.0)
    assert stalled_s == pytest.approx(expected_s, rel=0.02)
    assert bench.read(1, "present_temperature") in (80, 81)  # it cools at once
    told = bench.ask(1, 0x01)[8] & 0x80 if model.protocol == 2 else bench.ask(1, 0x01)[4] & 0x04
    assert told
    assert bench.read(1, "torque_enable" if model.protocol == 2 else "torque_limit") == 0


def test_overload_is_judged_by_output_not_by_current() -> None:
    """Reference 6.2: a low Goal Current with a far goal trips though the motor stays cool; a low Goal PWM does not."""
    bench = Bench()
    bench.drive(1, 5, goal_current=50, goal_position=4000)
    bench.drive(2, 5, goal_pwm=400, goal_position=4000)
    bench.control_for(2.9, 10 * MILLISECOND)
    assert bench.read(1, "torque_enable") == 1
    bench.control_for(0.2, 10 * MILLISECOND)
    assert bench.read(1, "hardware_error_status") == 0x20
    assert (bench.read(1, "torque_enable"), bench.read(2, "torque_enable")) == (0, 1)
    assert bench.read(1, "present_temperature") <= 31


def test_overload_can_be_masked() -> None:
    """Without bit 5 in Shutdown it is told, and nothing else happens."""
    bench = Bench()
    bench.write(1, "shutdown", 0x14)
    bench.drive(1, 5, goal_current=50, goal_position=4000)
    bench.control_for(3.1, 10 * MILLISECOND)
    assert bench.ask(1, 0x01)[8] == 0x80
    assert bench.read(1, "torque_enable") == 1


def test_turning_motors_are_not_overloaded() -> None:
    """Full output at speed is what a motor is for."""
    bench = Bench()
    bench.drive(1, 16, goal_pwm=885)
    bench.shafts.velocity_rad_s[0] = 3.0
    bench.control_for(5.0, 10 * MILLISECOND)
    assert bench.read(1, "hardware_error_status") == 0


def test_reboot_reduces_the_position_to_one_turn() -> None:
    """Reference 6.2, 7: a tendon wound more than a turn loses its reference; the goal is where it stands."""
    bench = Bench()
    bench.shafts.angle_rad[0] = 9000.5 * 2 * math.pi / 4096
    bench.control()
    assert bench.read(1, "present_position") == 9000
    bench.ask(1, 0x08)
    bench.control(400 * MILLISECOND)
    assert bench.read(1, "present_position") == 9000 - 2 * 4096
    assert bench.read(1, "goal_position") == 9000 - 2 * 4096


def test_old_firmware_shows() -> None:
    """The driver asks for it before it trusts the watchdog."""
    sim = SimulatedMotors(HeldShafts(), [SimulatedMotorSettings(1, firmware=37)])
    assert sim.receive(bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E"), 0)[11] == 37
