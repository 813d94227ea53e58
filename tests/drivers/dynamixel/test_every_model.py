"""Tendons on motors of every model and protocol: the simulated motors pull springs, on virtual time.

What is held to: the springs' own tension and angle, not what the driver says of them.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MODELS, MX_28, RX_28, XL430_W250, XM430_W350, MotorModel
from drivers.dynamixel.load_law import LoadLaw
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.sample import Pair, TendonSample
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import DeviceError, InputError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.faults import Fault
from drivers.simulated.serial_fault_actions import Drop, SerialAction
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

STEP_NS = 1_000_000
EXCHANGE_NS = 10_000_000
RADIUS_M = 0.0105
STIFFNESS_N_PER_M = 3000.0
EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


class Rig:
    """Springs, simulated motors and a driver, mounted both ways round; `run` keeps them in step."""

    def __init__(self, model: MotorModel) -> None:
        electrics = electrics_of(model)
        self.model = model
        self.friction_N = electrics.gear_friction_Nm / RADIUS_M
        full_A = 12.0 / electrics.resistance_ohm  # of a motor at a standstill at full output
        law = LoadLaw(electrics.torque_constant_Nm_per_A, electrics.friction_current_A)
        if model.effort == "load":
            law = LoadLaw(electrics.torque_constant_Nm_per_A * full_A, electrics.friction_current_A / full_A)
        zeros = (97, 926) if model is RX_28 else (600, 3500)  # all of the travel within one turn
        right = MotorSettings(3, 1, zeros[0], load_law=law, model=model.name)
        self.settings = (right, MotorSettings(1, -1, zeros[1], load_law=law, model=model.name))
        self.springs = SpringTendons(
            (STIFFNESS_N_PER_M, STIFFNESS_N_PER_M),
            friction_Nm=electrics.gear_friction_Nm,
            inertia_kgm2=electrics.inertia_kgm2,
        )
        mounted = (SimulatedMotorSettings(3, zeros[0], 1, model), SimulatedMotorSettings(1, zeros[1], -1, model))
        self.motors = SimulatedMotors(self.springs, mounted)
        self.clock = VirtualClock()
        self.plant_ns = 0
        self.line = MemoryLine(self.motors, self.clock)
        self.pair = self.new_pair()

    def new_pair(self, **change: object) -> TendonPair:
        """A driver as after a restart of its process; the motors know nothing of it."""
        right, left = (replace(settings, **change) for settings in self.settings)  # type: ignore[arg-type]  # by name
        return TendonPair(WaitingPort(self.line, self.clock), self.clock, (right, left))

    def run(self, duration_s: float) -> TendonSample:
        """Exchange every 10 ms; the last sample."""
        end_ns = self.clock.now_ns() + round(duration_s * 1e9)
        while True:
            sample = self.pair.exchange()
            self.clock.advance_to_ns(self.clock.now_ns() // EXCHANGE_NS * EXCHANGE_NS + EXCHANGE_NS)
            self.catch_up()
            if self.clock.now_ns() >= end_ns:
                return sample

    def catch_up(self) -> None:
        while self.plant_ns < self.clock.now_ns():
            self.motors.control(self.plant_ns, STEP_NS * 1e-9)
            self.springs.step(STEP_NS * 1e-9)
            self.plant_ns += STEP_NS

    def wind(self, excursion_m: float, cap_N: Pair = (60.0, 60.0), duration_s: float = 0.8) -> TendonSample:
        self.pair.set_excursion(excursion_m, excursion_m, cap_N)
        return self.run(duration_s)

    @property
    def tension_N(self) -> list[float]:
        return [self.springs.tension_N(motor) for motor in (0, 1)]

    @property
    def true_m(self) -> list[float]:
        return [RADIUS_M * self.springs.shaft_angle_rad(motor) for motor in (0, 1)]

    def torque_on(self) -> list[int]:
        return [motor.value("torque_enable") for motor in self.motors.motors]


@EVERY
def test_the_life_of_a_grasp(model: MotorModel) -> None:
    """Switched on without a jolt, wound, frozen, taken over by another process, and opened only when asked."""
    rig = Rig(model)
    identities = rig.pair.start()
    assert [(i.model_name, i.adopted, i.refusal) for i in identities] == [(model.name, False, "")] * 2
    assert rig.run(0.2).excursion_m == pytest.approx((0.0, 0.0), abs=1.5 * model.tick_rad * RADIUS_M)

    sample = rig.wind(0.010, duration_s=2.0)
    assert sample.excursion_m == pytest.approx(rig.true_m, abs=1.1 * model.tick_rad * RADIUS_M)
    assert min(rig.true_m) > 0.0085
    for index in (0, 1):
        error_N = abs(sample.tension_N[index] - rig.tension_N[index])
        assert error_N <= sample.tension_uncertainty_N[index]

    rig.pair.freeze()
    rig.run(0.2)
    frozen_N = rig.tension_N
    rig.run(0.3)
    assert rig.tension_N == pytest.approx(frozen_N, rel=0.02)

    rig.pair.stop()
    rig.pair = rig.new_pair()
    rig.motors.heard.clear()
    assert [identity.adopted for identity in rig.pair.start()] == [True, True]
    rig.run(0.3)
    assert rig.tension_N == pytest.approx(frozen_N, rel=0.03)
    assert rig.torque_on() == [1, 1]

    rig.pair.open()
    rig.run(2.0)
    assert rig.true_m == pytest.approx([0.0, 0.0], abs=1.2e-3)
    rig.pair.stop(release=True)
    assert rig.torque_on() == [0, 0]


@EVERY
def test_the_load_cap_is_never_exceeded(model: MotorModel) -> None:
    """Wound slowly far beyond what the caps allow, each tendon stalls just below its own."""
    rig = Rig(model)
    rig.pair.start()
    for step in range(120):
        rig.pair.set_excursion(2e-4 * step, 2e-4 * step, (30.0, 18.0))
        rig.run(0.01)
    rig.run(2.5)
    # the momentum of rotor and gear adds v·sqrt(k·J)/r while winding at 20 mm/s
    momentum_N = 0.02 * (STIFFNESS_N_PER_M * electrics_of(model).inertia_kgm2) ** 0.5 / RADIUS_M
    for tension_N, cap_N in zip(rig.tension_N, (30.0, 18.0), strict=True):
        assert cap_N - 6.0 < tension_N < cap_N + momentum_N + 0.5


@EVERY
def test_loads_are_pulled_and_paid_out_to(model: MotorModel) -> None:
    """Position steps under the ceiling with load feedback: to 40 N and 25 N, then back to 15 N against the friction."""
    rig = Rig(model)
    rig.pair.start()
    rig.pair.set_load(40.0, 25.0)
    rig.run(4.0)
    momentum_N = 12.0
    for tension_N, load_N in zip(rig.tension_N, (40.0, 25.0), strict=True):
        assert load_N - 6.0 < tension_N < load_N + momentum_N
    rig.pair.set_load(15.0, 15.0)
    rig.run(3.0)
    assert max(rig.tension_N) < 15.0 + 0.35 * rig.friction_N + 4.0


@EVERY
def test_a_tripped_motor_is_told_within_100_ms_and_not_switched_on_again(model: MotorModel) -> None:
    """Overload lets the tendon go; ceilings and goals that still come must not start it again (protocol 1.0 would)."""
    rig = Rig(model)
    rig.pair.start()
    rig.wind(0.010)
    rig.motors.trip(1, 0x20)
    sample = rig.run(0.1)
    assert sample.hardware_error == (0, 0x20)
    assert sample.torque_on == (True, False)
    held_N = rig.tension_N[0]
    rig.wind(0.010)
    rig.pair.freeze()
    rig.run(0.3)
    assert rig.springs.tension_N(1) < 1.2 * rig.friction_N
    assert rig.tension_N[0] == pytest.approx(held_N, rel=0.1)
    with pytest.raises(DeviceError, match="hardware error"):
        rig.pair.restore()


@EVERY
def test_a_restarted_motor_is_told_and_restored_on_demand(model: MotorModel) -> None:
    """A dip of the supply: silence, then a motor without torque and settings. Only `restore` brings it up, in place."""
    rig = Rig(model)
    rig.pair.start()
    rig.wind(0.008)
    rig.motors.motors[0].reboot(rig.clock.now_ns())
    assert rig.run(0.1).missed[0] > 3
    sample = rig.run(0.8)
    assert (sample.torque_on, sample.restarted, sample.missed) == ((False, True), (True, False), (0, 0))
    rig.wind(0.008, duration_s=0.2)
    assert rig.torque_on() == [0, 1]
    rig.pair.restore()
    assert rig.torque_on() == [1, 1]
    sample = rig.run(0.2)
    assert (sample.torque_on, sample.restarted) == ((True, True), (False, False))
    rig.wind(0.008)
    assert rig.true_m == pytest.approx([0.008, 0.008], abs=1.5e-3)


@EVERY
def test_a_lost_goal_is_sent_again(model: MotorModel) -> None:
    """Nobody acknowledges a sync write: both, goals and ceilings, are lost here, and nothing changes afterwards."""
    rig = Rig(model)
    rig.pair.start()
    rig.wind(0.004)
    before = [motor.value("goal_position") for motor in rig.motors.motors]
    lost = Fault[SerialAction](action=Drop(sender="host", request="sync_write"), for_frames=2)
    rig.motors.faults.add(lost, rig.clock.now_ns())
    rig.pair.set_excursion(0.005, 0.005, (50.0, 50.0))
    rig.run(0.005)
    assert rig.motors.faults.struck == 2
    assert [motor.value("goal_position") for motor in rig.motors.motors] == before
    rig.run(0.2)
    wanted = [settings.ticks(0.005, model) for settings in rig.settings]
    assert [motor.value("goal_position") for motor in rig.motors.motors] == wanted


@pytest.mark.parametrize("model", [XM430_W350, MX_28], ids=lambda model: model.name)
def test_one_dead_motor_leaves_the_other_in_hand(model: MotorModel) -> None:
    """It is still read at the full rate, still follows, and the dead one's last values stay, with their age."""
    rig = Rig(model)
    rig.pair.start()
    rig.wind(0.006)
    rig.motors.motors[0].silent_until_ns = 10**15
    before = rig.run(0.05)
    sample = rig.wind(0.010)
    assert sample.missed[0] > 60
    assert sample.missed[1] == 0
    assert rig.clock.now_ns() - sample.sample_ns[1] < 25_000_000
    assert sample.sample_ns[0] <= before.sample_ns[0]
    assert sample.excursion_m[0] == before.excursion_m[0]
    assert rig.true_m[1] == pytest.approx(0.010, abs=1.2e-3)


@pytest.mark.parametrize("model", [XM430_W350, XL430_W250], ids=lambda model: model.name)
def test_a_stall_far_from_the_goal_is_no_overload(model: MotorModel) -> None:
    """Overload is judged by the output that the position loop asks for: the goal on the wire never leads so far."""
    rig = Rig(model)
    rig.pair.start()
    sample = rig.wind(0.045, (20.0, 20.0), duration_s=5.0)
    assert sample.hardware_error == (0, 0)
    assert rig.torque_on() == [1, 1]
    assert min(rig.tension_N) > 12.0


def test_a_hot_motor_pulls_less_and_holds() -> None:
    """From 65 °C on the cap shrinks, so that the motor does not come to 80 °C, where it would let go."""
    rig = Rig(XM430_W350)
    rig.pair.start()
    rig.wind(0.020, (40.0, 40.0))
    cool = [motor.value("goal_current") for motor in rig.motors.motors]
    rig.motors.motors[0].stress.held_at_C = 75.0
    sample = rig.run(0.3)
    assert sample.derating == pytest.approx((0.5, 1.0))
    hot = [motor.value("goal_current") for motor in rig.motors.motors]
    assert hot[0] < 0.8 * cool[0]
    assert hot[1] == cool[1]
    assert rig.tension_N[0] > 10.0


@pytest.mark.parametrize(("mode", "opens"), [(3, True), (0, False)])
def test_a_motor_that_holds_in_another_mode_is_held_on_to(mode: int, opens: bool) -> None:
    """Some other program left it holding: it is read, not written, told, and at most paid out."""
    rig = Rig(XM430_W350)
    rig.pair.start()
    rig.wind(0.008)
    rig.pair.stop()
    motor = rig.motors.motors[1]
    motor._values["operating_mode"] = mode  # as if it had been switched on so
    motor._prepare()
    rig.pair = rig.new_pair()
    _, left = rig.pair.start()
    assert f"holds in operating mode {mode}" in left.refusal
    with pytest.raises(InputError, match=f"operating mode {mode}"):
        rig.pair.set_excursion(0.010, 0.010, (40.0, 40.0))
    rig.pair.freeze((40.0, 40.0))
    assert motor.value("operating_mode") == mode
    assert rig.torque_on() == [1, 1]
    if opens:
        rig.pair.open()
        rig.run(1.0)
        assert rig.true_m == pytest.approx([0.0, 0.0], abs=1.2e-3)
    else:
        with pytest.raises(InputError):
            rig.pair.open()


def test_the_read_rate_is_measured() -> None:
    """What comes of 10 ms between exchanges."""
    rig = Rig(MX_28)
    rig.pair.start()
    assert rig.run(1.0).read_rate_hz == pytest.approx(100.0, rel=0.05)


def test_a_load_law_of_unknown_unit_is_not_used() -> None:
    """A law in amperes would let an MX-28 pull several times its cap: who has such a hand must say so."""
    rig = Rig(MX_28)
    rig.pair = rig.new_pair(model=None)
    with pytest.raises(DeviceError, match=r'are MX-28s, which tell their load.*tendons.model = "MX-28"'):
        rig.pair.start()
    assert rig.torque_on() == [0, 0]
