"""Two tendon motors as two tendons: excursions, rates and tensions in SI, right finger first.

One `exchange` is a sync write of goals and ceilings that changed (every tenth time of all, as a sync write has no
answer) and one read of everything that matters, see `reading.py`.

A motor that dropped its torque, or restarted, gets neither goals nor ceilings any more: protocol 1.0 motors would
switch themselves on again, into whatever tripped them. `restore` brings it up again, where it then stands. Nothing here
opens the hand by itself: `stop` leaves both motors holding, `start` adopts motors that hold.

Source: design 4 "Drive"; dynamixel reference 1.3, 1.4, 2.3, 6, 8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.clock import Clock, seconds
from drivers.dynamixel.bus import MotorBus, motor_name
from drivers.dynamixel.control_tables import MotorModel, Register
from drivers.dynamixel.discovery import find_pair
from drivers.dynamixel.effort_filter import EffortFilter
from drivers.dynamixel.goal import TendonGoal
from drivers.dynamixel.load_law import SpoolMotion
from drivers.dynamixel.motor import Inspection, MotorIdentity, TendonMotor
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.reading import PairReader
from drivers.dynamixel.sample import Pair, TendonSample, TendonSetPoint
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import BusError, DeviceError, InputError, ProtocolError

__all__ = ["MotorSettings", "TendonPair", "TendonSample", "TendonSetPoint"]

SEND_AGAIN = 10
"""Exchanges after which goals and ceilings are sent though they did not change."""
_RATE_WEIGHT = 0.05
"""Of the newest interval in the measured read rate."""


@dataclass(slots=True)
class _Tendon:
    """One motor with what is known of it and what it is told."""

    settings: MotorSettings
    motor: TendonMotor
    goal: TendonGoal
    values: Mapping[str, int]
    """The newest of its registers that was believed, by name."""
    ticks: int
    sample_ns: int
    sent_ticks: int
    sent_ceiling: int
    effort_filter: EffortFilter
    acting: tuple[float, float] = (0.0, 0.0)
    """Effort, filtered, and tendon rate, m/s, filtered alike: what the tension is worked out of."""
    restarted: bool = False
    motion: SpoolMotion = SpoolMotion.HOLDING

    @property
    def torque_on(self) -> bool:
        """Also false after a shutdown in protocol 1.0, which takes the Torque Limit away."""
        return self.values["torque_enable"] == 1 and self.values.get("torque_limit", 1) > 0


class TendonPair:
    """The hand's two motors, right and left, on one bus."""

    def __init__(self, port: WaitingPort, clock: Clock, motors: tuple[MotorSettings, MotorSettings]) -> None:
        if len(motors) != 2 or motors[0].motor_id == motors[1].motor_id:
            raise InputError("a tendon pair needs two motors with different ids, right and left.")
        self.last_miss: DeviceError | None = None
        """Why the newest missed exchange was missed."""
        self.model: MotorModel | None = None
        """What both motors are; known from `start` on."""
        self.identities: list[MotorIdentity] = []
        self._settings = motors
        self._port = port
        self._clock = clock
        self._bus: MotorBus
        self._reader: PairReader
        self._tendons: list[_Tendon] = []
        self._sample: TendonSample | None = None
        self._round = 0
        self._read_interval_s = 0.0

    def start(self) -> list[MotorIdentity]:
        """Find both motors, then make both hold where they are; motors that hold already are adopted as they are.

        Nothing is written before both have passed inspection. DeviceError: which motor, what is wrong, what to do.
        """
        self._sample = None
        found = find_pair(self._port, self._settings)
        self._bus, self.model = found.bus, found.model
        if found.model.effort == "load" and not all(settings.model for settings in self._settings):
            raise DeviceError(
                "tendon motors",
                f"are {found.model.name}s, which tell their load and not a current; the load law's unit is not known.",
                help=f'State it in robot.toml: tendons.model = "{found.model.name}". Its load law is then its data '
                "sheet's, or stall_torque_12V_Nm and friction_load of each motor.",
            )
        motors = [TendonMotor(found.bus, settings, found.model) for settings in self._settings]
        inspections = [motor.inspect() for motor in motors]
        for motor, inspection in zip(motors, inspections, strict=True):
            _check_zero(motor, inspection)
        goals = []
        for motor, inspection in zip(motors, inspections, strict=True):
            ticks, ceiling = motor.bring_up(inspection)
            goals.append(TendonGoal(motor.settings, found.model, inspection, ticks, ceiling))
        ids = (motors[0].motor_id, motors[1].motor_id)
        self._reader = PairReader(found.bus, ids, found.model)
        self._reader.prepare()
        now_ns = self._clock.now_ns()
        self._tendons = [
            _Tendon(
                motor.settings,
                motor,
                goal,
                values,
                ticks=values["present_position"],
                sample_ns=now_ns,
                sent_ticks=goal.ticks,
                sent_ceiling=goal.ceiling,
                effort_filter=EffortFilter(motor.settings.effort_filter_s),
            )
            for motor, goal, values in zip(motors, goals, self._reader.values, strict=True)
        ]
        for tendon in self._tendons:
            _filter(tendon, found.model)
        self._sample = self._decoded(found.model)
        self.identities = [inspection.identity for inspection in inspections]
        return self.identities

    def exchange(self, set_point: TendonSetPoint | None = None) -> TendonSample:
        """Send the set-point (None: leave the goals as they are), read both motors; values of one request.

        InputError, and nothing sent, for a set-point that is not finite, out of travel or above what the motor may
        give. A missing, damaged or implausible answer gives that motor's previous values, its `missed` counted up.
        BusError: line gone.
        """
        last, model = self._started()
        if set_point is not None:
            self.set_excursion(*_two(set_point.excursion_m, "tendon excursions"), set_point.load_cap_N)
        now_ns = self._clock.now_ns()
        now_s, elapsed_s = seconds(now_ns), seconds(now_ns - last.oldest_ns)
        for index, tendon in enumerate(self._tendons):
            effort, rate_m_s = last.effort[index], last.rate_m_s[index]
            tendon.goal.step(now_s, elapsed_s, ticks=tendon.ticks, effort=effort, rate_m_s=rate_m_s)
            tendon.goal.derate(last.derating[index], last.voltage_V[index])
        self._round = (self._round + 1) % SEND_AGAIN
        self._send(model, everything=self._round == 0)
        sample_ns = self._clock.now_ns()
        errors = list(self._reader.read(sample_ns))
        for index, error in enumerate(errors):
            if error is None:
                errors[index] = self._believe(index, model, sample_ns)
        if not any(errors):
            weight = _RATE_WEIGHT if self._read_interval_s else 1.0
            self._read_interval_s += weight * (seconds(sample_ns - last.oldest_ns) - self._read_interval_s)
        self.last_miss = next((error for error in errors if error is not None), self.last_miss)
        self._sample = self._decoded(model)
        return self._sample

    def set_excursion(self, right_m: float, left_m: float, load_cap_N: Pair) -> None:
        """Where the tendons shall be and how hard they may pull: from the next exchange on. InputError."""
        self._started()
        wanted = list(zip((right_m, left_m), _two(load_cap_N, "load caps"), strict=True))
        ticks = [tendon.goal.check(*excursion) for tendon, excursion in zip(self._tendons, wanted, strict=True)]
        for tendon, goal, (_, cap_N) in zip(self._tendons, ticks, wanted, strict=True):
            tendon.goal.take(goal, cap_N)

    def set_load(self, right_N: float, left_N: float) -> None:
        """Pull with these loads, within the travel: from the next exchange on. InputError: nothing taken."""
        sample, _ = self._started()
        loads_N = (right_N, left_N)
        for tendon, load_N in zip(self._tendons, loads_N, strict=True):
            tendon.goal.check_load(load_N)
        for tendon, load_N, effort in zip(self._tendons, loads_N, sample.effort, strict=True):
            tendon.goal.pull(load_N, effort)

    def open(self, load_cap_N: Pair = (20.0, 20.0)) -> None:
        """Unwind both tendons to just taut, at full speed, pulling no more than the caps. InputError, BusError."""
        self.set_excursion(0.0, 0.0, load_cap_N)
        self._send_now()

    def freeze(self, load_cap_N: Pair | None = None) -> None:
        """Hold both excursions where they are, under the present ceilings or the given caps, and the holding caps.

        InputError, BusError.
        """
        sample, _ = self._started()
        if load_cap_N is not None:
            caps_N = _two(load_cap_N, "load caps")
            for tendon, cap_N in zip(self._tendons, caps_N, strict=True):
                tendon.goal.check_cap(cap_N)
            for tendon, cap_N in zip(self._tendons, caps_N, strict=True):
                tendon.goal.take_cap(cap_N)
        for tendon, effort in zip(self._tendons, sample.effort, strict=True):
            tendon.goal.hold(tendon.ticks, effort)
        self._send_now()

    def rearm(self) -> None:
        """After a tripped watchdog: go on with the goals of `freeze` at the present excursions, watchdog on again."""
        self._started()
        driven = [tendon for tendon in self._tendons if tendon.goal.takes_ceilings]
        for tendon in driven:
            tendon.motor.clear_watchdog()
        self.freeze()
        for tendon in driven:
            tendon.motor.arm_watchdog()
        self._reader.read_slow_next()

    def restore(self) -> None:
        """Bring motors up again that restarted or dropped their torque: RAM settings, torque on, where they now stand.

        DeviceError if one still has a hardware error (reboot it), or stands where its zero cannot be.
        """
        _, model = self._started()
        for index, tendon in enumerate(self._tendons):
            if tendon.torque_on and not tendon.restarted:
                continue
            found = tendon.motor.inspect()
            _check_zero(tendon.motor, found)
            ticks, ceiling = tendon.motor.bring_up(found)
            tendon.goal = TendonGoal(tendon.settings, model, found, ticks, ceiling)
            tendon.ticks, tendon.restarted = found.position_ticks, False
            tendon.effort_filter.reset()
            self._reader.read_anew(index)

    def stop(self, release: bool = False) -> None:
        """End. Both motors go on holding, with the watchdog off; with `release` their torque is switched off.

        Both motors are tried even if one fails; then the first failure is raised. The line stays open.
        """
        self._started()
        failure: DeviceError | None = None
        for tendon in self._tendons:
            try:
                tendon.motor.clear_watchdog()
                if release:
                    tendon.motor.write("torque_enable", 0)
            except DeviceError as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _started(self) -> tuple[TendonSample, MotorModel]:
        if self._sample is None or self.model is None:
            raise DeviceError("tendon motors", "were not started.", help="Call start() first.")
        return self._sample, self.model

    def _send_now(self) -> None:
        sample, model = self._started()
        for tendon, factor, supply_V in zip(self._tendons, sample.derating, sample.voltage_V, strict=True):
            tendon.goal.derate(factor, supply_V)
        self._send(model, everything=True)

    def _send(self, model: MotorModel, *, everything: bool) -> None:
        """What is new, to the motors that pull and may be driven: ceilings first. One that does not answer may still
        hear: it is told to hold, and its watchdog kept from letting go of the lead that its load needs. Not in protocol
        1.0: it may have restarted, and a goal would switch it on."""
        heard = zip(self._tendons, self._reader.missed, strict=True)
        holding = [tendon for tendon, missed in heard if tendon.torque_on and (model.protocol == 2 or not missed)]
        if everything or any(tendon.goal.ceiling != tendon.sent_ceiling for tendon in holding):
            driven = [tendon for tendon in holding if tendon.goal.takes_ceilings]
            self._write(model.registers[model.ceiling], {t.settings.motor_id: t.goal.ceiling for t in driven})
            for tendon in driven:
                tendon.sent_ceiling = tendon.goal.ceiling
        goals = [tendon.goal.commanded(tendon.ticks) for tendon in holding]
        if everything or any(goal != tendon.sent_ticks for goal, tendon in zip(goals, holding, strict=True)):
            wanted = {t.settings.motor_id: goal for goal, t in zip(goals, holding, strict=True) if t.goal.takes_goals}
            self._write(model.registers["goal_position"], wanted)
            for goal, tendon in zip(goals, holding, strict=True):
                tendon.sent_ticks = goal

    def _write(self, register: Register, values: Mapping[int, int]) -> None:
        if values:
            self._bus.sync_write(register.address, {motor: register.encode(value) for motor, value in values.items()})

    def _believe(self, index: int, model: MotorModel, sample_ns: int) -> DeviceError | None:
        """Take over what a motor said, unless it cannot be; then why not."""
        tendon, believed = self._tendons[index], self._tendons[index].values
        if (
            self._reader.values[index]["present_input_voltage"] == 0
        ):  # the indirect map shows nothing: it restarted and lost it
            try:
                self._reader.read_anew(index)
            except BusError:
                raise
            except DeviceError as error:
                self._reader.miss(index)
                return error
            tendon.restarted = True
        tendon.values = self._reader.values[index]
        ticks = tendon.values["present_position"]
        if not tendon.torque_on:
            tendon.restarted |= not tendon.values["hardware_error_status"]
        else:
            elapsed_s = seconds(sample_ns - tendon.sample_ns)
            allowed = 64 + 2.0 * model.no_load_speed_rad_s / model.tick_rad * elapsed_s
            if abs(ticks - tendon.ticks) > allowed:
                tendon.values = believed
                self._reader.miss(index)
                return ProtocolError(
                    motor_name(tendon.motor.motor_id),
                    f"position jumped from {tendon.ticks} to {ticks} ticks in {elapsed_s * 1e3:.1f} ms.",
                    help="The motor restarted or its encoder failed.",
                )
        tendon.ticks, tendon.sample_ns = ticks, sample_ns
        _filter(tendon, model)
        return None

    def _decoded(self, model: MotorModel) -> TendonSample:
        rows = [_row(tendon, model) for tendon in self._tendons]
        (right, right_values), (left, left_values) = ((tendon, tendon.values) for tendon in self._tendons)
        excursion_m, rate_m_s, effort, tension_N, uncertainty_N, voltage_V, temperature_C, derating = zip(
            *rows, strict=True
        )
        return TendonSample(
            sample_ns=(right.sample_ns, left.sample_ns),
            excursion_m=excursion_m,
            rate_m_s=rate_m_s,
            effort=effort,
            tension_N=tension_N,
            tension_uncertainty_N=uncertainty_N,
            hardware_error=(right_values["hardware_error_status"], left_values["hardware_error_status"]),
            alert=(self._reader.alert[0], self._reader.alert[1]),
            torque_on=(right.torque_on, left.torque_on),
            restarted=(right.restarted, left.restarted),
            watchdog_tripped=(right_values.get("bus_watchdog", 0) < 0, left_values.get("bus_watchdog", 0) < 0),
            stalled=(right.goal.stalled, left.goal.stalled),
            derating=derating,
            voltage_V=voltage_V,
            temperature_C=temperature_C,
            missed=(self._reader.missed[0], self._reader.missed[1]),
            read_rate_hz=1.0 / self._read_interval_s if self._read_interval_s else 0.0,
        )


def _row(tendon: _Tendon, model: MotorModel) -> tuple[float, ...]:
    """Excursion, rate, effort, tension, its uncertainty, voltage, temperature and derating of one tendon."""
    settings, values, law = tendon.settings, tendon.values, tendon.settings.load_law
    supply_V = values["present_input_voltage"] * model.voltage_unit_V
    temperature_C = float(values["present_temperature"])
    effort, rate_m_s = tendon.acting
    estimate = law.tension(effort, tendon.motion, rate_m_s=rate_m_s, supply_V=supply_V, temperature_C=temperature_C)
    return (
        settings.excursion_m(tendon.ticks, model),
        _rate_m_s(tendon, model),
        _effort(tendon, model),
        estimate.tension_N,
        estimate.uncertainty_N,
        supply_V,
        temperature_C,
        settings.derating(temperature_C),
    )


def _filter(tendon: _Tendon, model: MotorModel) -> None:
    """Take the newest values into what the tension is worked out of."""
    effort, rate_m_s = _effort(tendon, model), _rate_m_s(tendon, model)
    tendon.acting = tendon.effort_filter.step(tendon.sample_ns, effort, rate_m_s)
    tendon.motion = tendon.settings.load_law.motion(tendon.acting[1], tendon.motion)


def _effort(tendon: _Tendon, model: MotorModel) -> float:
    return tendon.settings.tightening_sign * tendon.values[model.effort_register] * model.effort_unit


def _rate_m_s(tendon: _Tendon, model: MotorModel) -> float:
    settings = tendon.settings
    counts = settings.tightening_sign * tendon.values["present_velocity"]
    return counts * model.velocity_unit_rad_s * settings.spool_radius_m


def _two(values: Sequence[float], what: str) -> Pair:
    if len(values) != 2:
        raise InputError(f"{what} {tuple(values)}; expected two, right and left.")
    return values[0], values[1]


def _check_zero(motor: TendonMotor, found: Inspection) -> None:
    excursion_m = motor.settings.excursion_m(found.position_ticks, motor.model)
    lower_m, upper_m = motor.settings.travel_m
    slack_m = 0.005
    if not lower_m - slack_m <= excursion_m <= upper_m + slack_m:
        raise DeviceError(
            motor_name(motor.motor_id),
            f"stands at {excursion_m * 1e3:.1f} mm of excursion; expected {lower_m * 1e3:.1f}…{upper_m * 1e3:.1f}.",
            help="It lost its turn or its zero is wrong: calibrate zero_ticks again.",
        )
