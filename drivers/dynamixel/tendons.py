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

from drivers.clock import Clock, seconds
from drivers.dynamixel.bus import MotorBus
from drivers.dynamixel.control_tables import MotorModel, Register
from drivers.dynamixel.discovery import find_pair
from drivers.dynamixel.goal import TendonGoal
from drivers.dynamixel.motor import MotorIdentity, TendonMotor
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.reading import PairReader
from drivers.dynamixel.sample import Pair, TendonSample, TendonSetPoint
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendon import Tendon
from drivers.errors import BusError, DeviceError, InputError

__all__ = ["MotorSettings", "TendonPair", "TendonSample", "TendonSetPoint"]

SEND_AGAIN = 10
"""Exchanges after which goals and ceilings are sent though they did not change."""
_RATE_WEIGHT = 0.05
"""Of the newest interval in the measured read rate."""


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
        self._tendons: list[Tendon] = []
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
                "sheet's, or what `stillgrasp calibrate motor-load` measures.",
            )
        motors = [TendonMotor(found.bus, settings, found.model) for settings in self._settings]
        inspections = [motor.check_mounting(motor.inspect()) for motor in motors]
        goals = []
        for motor, inspection in zip(motors, inspections, strict=True):
            ticks, ceiling = motor.bring_up(inspection)
            goals.append(TendonGoal(motor.settings, found.model, inspection, ticks, ceiling))
        ids = (motors[0].motor_id, motors[1].motor_id)
        self._reader = PairReader(found.bus, ids, found.model)
        self._reader.prepare()
        now_ns = self._clock.now_ns()
        self._tendons = [
            Tendon(motor, inspection, goal, values, now_ns)
            for motor, inspection, goal, values in zip(motors, inspections, goals, self._reader.values, strict=True)
        ]
        self._sample = self._taken()
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
        for tendon in self._tendons:
            goal = tendon.goal
            goal.step(now_s, elapsed_s, ticks=tendon.ticks, effort=tendon.effort, rate_m_s=tendon.rate_m_s)
            goal.derate(tendon.derating, tendon.supply_V, tendon.temperature_C)
        self._round = (self._round + 1) % SEND_AGAIN
        self._send(model, everything=self._round == 0)
        sample_ns = self._clock.now_ns()
        errors = list(self._reader.read(sample_ns))
        for index, error in enumerate(errors):
            if error is None:
                errors[index] = self._believe(index, sample_ns)
        if not any(errors):
            weight = _RATE_WEIGHT if self._read_interval_s else 1.0
            self._read_interval_s += weight * (seconds(sample_ns - last.oldest_ns) - self._read_interval_s)
        self.last_miss = next((error for error in errors if error is not None), self.last_miss)
        self._sample = self._taken()
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
        self._started()
        loads_N = (right_N, left_N)
        for tendon, load_N in zip(self._tendons, loads_N, strict=True):
            tendon.goal.check_load(load_N)
        for tendon, load_N in zip(self._tendons, loads_N, strict=True):
            tendon.goal.pull(load_N, tendon.effort)

    def open(self, load_cap_N: Pair = (20.0, 20.0)) -> None:
        """Unwind both tendons to just taut, at full speed, pulling no more than the caps. InputError, BusError."""
        self.set_excursion(0.0, 0.0, load_cap_N)
        self._send_now()

    def freeze(self, load_cap_N: Pair | None = None) -> None:
        """Hold both excursions where they are, under the present ceilings or the given caps, and the holding caps.

        InputError, BusError.
        """
        self._started()
        if load_cap_N is not None:
            caps_N = _two(load_cap_N, "load caps")
            for tendon, cap_N in zip(self._tendons, caps_N, strict=True):
                tendon.goal.check_cap(cap_N)
            for tendon, cap_N in zip(self._tendons, caps_N, strict=True):
                tendon.goal.take_cap(cap_N)
        for tendon in self._tendons:
            tendon.goal.hold(tendon.ticks, tendon.effort)
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
            found = tendon.motor.check_mounting(tendon.motor.inspect())
            ticks, ceiling = tendon.motor.bring_up(found)
            tendon.begin(found, TendonGoal(tendon.settings, model, found, ticks, ceiling), found.position_ticks)
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
        _, model = self._started()
        for tendon in self._tendons:
            tendon.goal.derate(tendon.derating, tendon.supply_V, tendon.temperature_C)
        self._send(model, everything=True)

    def _send(self, model: MotorModel, *, everything: bool) -> None:
        """What is new, to the motors that pull and may be driven: ceilings first. One that does not answer may still
        hear: it is told to hold, and its watchdog kept from letting go of the lead that its load needs. Not if a goal
        would switch it on, as it may have restarted."""
        heard = zip(self._tendons, self._reader.missed, strict=True)
        holding = [tendon for tendon, missed in heard if tendon.torque_on and (not missed or tendon.hears_goals)]
        ceilings = {
            tendon.motor_id: tendon.goal.ceiling
            for tendon in holding
            if (everything or tendon.goal.ceiling != tendon.sent_ceiling) and tendon.goal.takes_ceilings
        }
        goals = {tendon.motor_id: tendon.wire_goal() for tendon in holding if tendon.goal.takes_goals}
        if ceilings:
            self._write(model.registers[model.ceiling], ceilings)
        if goals and (everything or any(goals[t.motor_id] != t.sent_goal for t in holding if t.motor_id in goals)):
            self._write(model.registers["goal_position"], goals)
        for tendon in holding:
            tendon.sent_ceiling = ceilings.get(tendon.motor_id, tendon.sent_ceiling)
            tendon.sent_goal = goals.get(tendon.motor_id, tendon.sent_goal)

    def _write(self, register: Register, values: Mapping[int, int]) -> None:
        self._bus.sync_write(register.address, {motor: register.encode(value) for motor, value in values.items()})

    def _believe(self, index: int, sample_ns: int) -> DeviceError | None:
        """Take over what a motor said, unless it cannot be; then why not."""
        tendon = self._tendons[index]
        if self._reader.values[index]["present_input_voltage"] == 0:
            try:  # the indirect map shows nothing: it restarted and lost it
                self._reader.read_anew(index)
            except BusError:
                raise
            except DeviceError as error:
                self._reader.miss(index)
                return error
            tendon.restarted = True
        doubt = tendon.believe(self._reader.values[index], sample_ns, self._reader.plan.mapped)
        if doubt is not None:
            self._reader.miss(index)
        return doubt

    def _taken(self) -> TendonSample:
        (right, left), reader = self._tendons, self._reader
        return TendonSample(
            sample_ns=(right.sample_ns, left.sample_ns),
            excursion_m=(right.excursion_m, left.excursion_m),
            rate_m_s=(right.rate_m_s, left.rate_m_s),
            effort=(right.effort, left.effort),
            tension_N=(right.tension_N, left.tension_N),
            tension_uncertainty_N=(right.uncertainty_N, left.uncertainty_N),
            hardware_error=(right.hardware_error, left.hardware_error),
            alert=(reader.alert[0], reader.alert[1]),
            torque_on=(right.torque_on, left.torque_on),
            restarted=(right.restarted, left.restarted),
            jumped=(right.jumped, left.jumped),
            watchdog_tripped=(right.watchdog_tripped, left.watchdog_tripped),
            stalled=(right.goal.stalled, left.goal.stalled),
            outside_turn=(right.outside_turn, left.outside_turn),
            derating=(right.derating, left.derating),
            voltage_V=(right.supply_V, left.supply_V),
            temperature_C=(right.temperature_C, left.temperature_C),
            missed=(reader.missed[0], reader.missed[1]),
            read_rate_hz=1.0 / self._read_interval_s if self._read_interval_s else 0.0,
        )


def _two(values: Sequence[float], what: str) -> Pair:
    if len(values) != 2:
        raise InputError(f"{what} {tuple(values)}; expected two, right and left.")
    return values[0], values[1]
