"""Two tendon motors as two tendons: excursions, rates and tensions in SI, right finger first.

Excursion is tendon pulled in, in metres: tightening sign · (ticks − zero ticks) · 2π/4096 · spool radius. It is the
spool's, not the finger's: the tendon's own stretch is not taken off here. Current is positive when it tightens.

One `exchange` is a sync write of the goals (goal positions always, current ceilings when they changed) and a sync read
of current, velocity and position; in turn, every tenth one also reads hardware error, torque enable, watchdog, and
voltage with temperature. A sync write has no answer, so the ceilings are sent again every tenth exchange too.

Nothing here opens the hand by itself: `stop` leaves both motors holding, `start` adopts motors that hold.

Source: design 4 "Drive"; dynamixel reference 1.3, 1.4, 2.3, 6, 8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from drivers.clock import Clock, seconds
from drivers.dynamixel.bus import DynamixelBus, Status
from drivers.dynamixel.control_tables import XM430_W350, MotorModel
from drivers.dynamixel.load_law import LoadLaw
from drivers.dynamixel.motor import Inspection, MotorIdentity, TendonMotor
from drivers.dynamixel.port import WaitingPort
from drivers.errors import DeviceError, InputError, NoReplyError, ProtocolError

Pair = tuple[float, float]

SLOW_ROUND = 10
"""Exchanges between two reads of the same slow register."""

_BLOCK = ("present_current", "present_velocity", "present_position")  # contiguous: one read
_SLOW_BLOCKS = {  # place in the round: contiguous registers
    2: ("hardware_error_status",),
    4: ("torque_enable",),
    6: ("bus_watchdog",),
    8: ("present_input_voltage", "present_temperature"),
}


@dataclass(frozen=True, slots=True)
class MotorSettings:
    """How one motor is mounted and run. ID, side, sign and zero come from calibration, never from the model."""

    motor_id: int
    tightening_sign: int
    """+1 if growing ticks tighten the tendon, −1 if they loosen it."""
    zero_ticks: int
    """Position at which the tendon is just taut on the open finger."""
    spool_radius_m: float = 0.0105
    load_law: LoadLaw = field(default_factory=LoadLaw)
    travel_m: Pair = (-0.005, 0.0495)
    """Excursions that may be commanded; the default is a little slack to three quarters of a turn."""
    position_p_gain: int = 800
    start_current_A: float = 0.2
    """Ceiling from start until the first command, if the motor did not hold yet."""
    watchdog_s: float = 0.2
    """Bus silence after which the motor stops and holds; 0 = never."""

    def __post_init__(self) -> None:
        lower_m, upper_m = self.travel_m
        for wrong, what in (
            (not 0 <= self.motor_id <= 252, f"motor_id = {self.motor_id}; expected 0…252"),
            (self.tightening_sign not in (1, -1), f"tightening_sign = {self.tightening_sign}; expected 1 or -1"),
            (
                abs(self.zero_ticks) > 1_000_000,
                f"zero_ticks = {self.zero_ticks}; expected at most 1 000 000 either way",
            ),
            (
                not 0.001 <= self.spool_radius_m <= 0.1,
                f"spool_radius_m = {self.spool_radius_m}; expected 0.001…0.1",
            ),
            (
                self.spool_radius_m != self.load_law.spool_radius_m,
                f"spool_radius_m = {self.spool_radius_m}; expected the load law's {self.load_law.spool_radius_m}",
            ),
            (not -0.1 <= lower_m < upper_m <= 0.5, f"travel_m = {self.travel_m}; expected lower < upper in -0.1…0.5"),
            (not 1 <= self.position_p_gain <= 16383, f"position_p_gain = {self.position_p_gain}; expected 1…16383"),
            (not 0.0 <= self.start_current_A <= 2.0, f"start_current_A = {self.start_current_A}; expected 0…2"),
            (
                self.watchdog_s != 0 and not 0.02 <= self.watchdog_s <= 2.54,
                f"watchdog_s = {self.watchdog_s}; expected 0 (off) or 0.02…2.54",
            ),
        ):
            if wrong:
                raise InputError(f"motor settings: {what}.", help="Correct the motor's settings.")

    def excursion_m(self, ticks: int, model: MotorModel) -> float:
        """Tendon pulled in at a position."""
        return self.tightening_sign * (ticks - self.zero_ticks) * model.tick_rad * self.spool_radius_m

    def ticks(self, excursion_m: float, model: MotorModel) -> int:
        """Nearest position for an excursion."""
        return self.zero_ticks + self.tightening_sign * round(excursion_m / (model.tick_rad * self.spool_radius_m))


@dataclass(frozen=True, slots=True)
class TendonSetPoint:
    """Where the tendons shall be, m, and how much they may pull to get there, N; right, left."""

    excursion_m: Pair
    load_cap_N: Pair


@dataclass(frozen=True, slots=True)
class TendonSample:
    """What both motors said at one request; right, left."""

    sample_ns: int
    """Time of the request; unchanged, like all measured values, when the exchange was missed."""
    excursion_m: Pair
    rate_m_s: Pair
    """Positive = pulling in."""
    current_A: Pair
    """Positive = tightening; not filtered."""
    tension_N: Pair
    """By the load law, on the branch of the momentary rate."""
    tension_uncertainty_N: Pair
    hardware_error: tuple[int, int]
    """Bits of Hardware Error Status; a tripped motor has let go."""
    alert: tuple[bool, bool]
    """Alert bit of the newest status."""
    torque_on: tuple[bool, bool]
    """False after a trip or an unnoticed restart of the motor."""
    watchdog_tripped: tuple[bool, bool]
    """The motor holds and takes no goals until `rearm`."""
    voltage_V: Pair
    temperature_C: Pair
    missed: int
    """Exchanges in a row without a good answer, 0 now."""


class TendonPair:
    """The hand's two motors, right and left, on one bus."""

    def __init__(self, port: WaitingPort, clock: Clock, motors: tuple[MotorSettings, MotorSettings]) -> None:
        if len(motors) != 2 or motors[0].motor_id == motors[1].motor_id:
            raise InputError("a tendon pair needs two motors with different ids, right and left.")
        self.last_miss: DeviceError | None = None
        """Why the newest missed exchange was missed."""
        self._settings = motors
        self._ids = (motors[0].motor_id, motors[1].motor_id)
        self._clock = clock
        self._bus = DynamixelBus(port)
        self._motors = tuple(
            TendonMotor(
                self._bus,
                settings.motor_id,
                position_p_gain=settings.position_p_gain,
                start_current_A=settings.start_current_A,
                watchdog_s=settings.watchdog_s,
            )
            for settings in motors
        )
        self._model = XM430_W350
        self._goal_ticks = [0, 0]
        self._goal_current = [0, 0]
        self._current_limit = [0, 0]
        self._ticks = [0, 0]
        self._slow = {name: [0, 0] for block in _SLOW_BLOCKS.values() for name in block}
        self._sample: TendonSample | None = None
        self._round = 0

    def start(self) -> list[MotorIdentity]:
        """Find both motors, then make both hold where they are; motors that hold already are adopted as they are.

        Nothing is written before both have passed inspection. DeviceError: which motor, what is wrong, what to do.
        """
        found = [motor.inspect() for motor in self._motors]
        self._model = self._motors[0].model
        if self._motors[1].model is not self._model:
            raise DeviceError(
                "tendon motors",
                f"are a {self._model.name} and a {self._motors[1].model.name}; expected two of one model.",
                help="A sync read needs the same registers in both: fit two motors of one model.",
            )
        for settings, inspection in zip(self._settings, found, strict=True):
            self._check_zero(settings, inspection)
        for index, (motor, inspection) in enumerate(zip(self._motors, found, strict=True)):
            self._current_limit[index] = inspection.current_limit
            self._goal_ticks[index], self._goal_current[index] = motor.bring_up(inspection)
            self._ticks[index] = inspection.position_ticks
            for name, values in self._slow.items():
                values[index] = motor.read(name)
        statuses = self._read_block(_BLOCK)
        self._sample = self._decode(self._clock.now_ns(), statuses)
        return [inspection.identity for inspection in found]

    def exchange(self, set_point: TendonSetPoint | None = None) -> TendonSample:
        """Send the set-point (None: leave the goals as they are), read both motors; values of one request.

        InputError, and nothing sent, for a set-point that is not finite, out of travel or above the current limit.
        A missing, damaged or implausible answer gives the previous values, `missed` counted up. BusError: line gone.
        """
        last = self._started()
        if set_point is not None:
            # both are worked out, and may be refused, before either is taken over
            self._goal_ticks, currents = self._encode(set_point)
            changed, self._goal_current = currents != self._goal_current, currents
        else:
            changed = False
        place = self._round = (self._round + 1) % SLOW_ROUND
        try:
            if changed or place == 0:
                self._write_pair("goal_current", self._goal_current)
            if set_point is not None or place == 0:
                self._write_pair("goal_position", self._goal_ticks)
            sample_ns = self._clock.now_ns()
            statuses = self._read_block(_BLOCK)
            self._check_jump(statuses, seconds(sample_ns - last.sample_ns))
            alert_is_new = any(s.alert for s in statuses) and not any(last.alert)
            slow = _SLOW_BLOCKS[2] if alert_is_new else _SLOW_BLOCKS.get(place)
            if slow is not None:
                self._read_slow(slow)
            self._sample = self._decode(sample_ns, statuses)
        except (NoReplyError, ProtocolError) as error:
            self.last_miss = error
            self._sample = replace(last, missed=last.missed + 1)
        return self._sample

    def freeze(self, load_cap_N: Pair | None = None) -> None:
        """Hold both excursions where they are, under the present current ceilings or the given load caps.

        The goal keeps the lead over the measured position that the present current needs, so that tension does not
        drop, and no more, so that a motor that stalled far from its goal does not go on pulling.
        """
        sample = self._started()
        currents = self._goal_current if load_cap_N is None else self._currents(load_cap_N)
        for index, settings in enumerate(self._settings):
            per_tick_A = self._model.holding_current_A_per_tick(settings.position_p_gain)
            lead_ticks = round(abs(sample.current_A[index]) / per_tick_A)
            lead = self._goal_ticks[index] - self._ticks[index]
            self._goal_ticks[index] = self._ticks[index] + max(-lead_ticks, min(lead_ticks, lead))
        self._goal_current = currents
        self._write_pair("goal_current", self._goal_current)
        self._write_pair("goal_position", self._goal_ticks)

    def relax(self, load_cap_N: Pair = (20.0, 20.0)) -> None:
        """Open: unwind both tendons to just taut, at full speed, pulling no more than the caps."""
        self._started()
        self._goal_current = self._currents(load_cap_N)
        self._goal_ticks = [settings.zero_ticks for settings in self._settings]
        self._write_pair("goal_current", self._goal_current)
        self._write_pair("goal_position", self._goal_ticks)

    def rearm(self) -> None:
        """After a tripped watchdog: go on with the goals of `freeze` at the present excursions, watchdog on again."""
        self._started()
        for motor in self._motors:
            motor.clear_watchdog()
        self.freeze()
        for motor in self._motors:
            motor.arm_watchdog()
        self._read_slow(_SLOW_BLOCKS[6])

    def stop(self, release: bool = False) -> None:
        """End. Both motors go on holding, with the watchdog off; with `release` their torque is switched off.

        Both motors are tried even if one fails; then the first failure is raised. The line stays open.
        """
        failure: DeviceError | None = None
        for motor in self._motors:
            try:
                motor.clear_watchdog()
                if release:
                    motor.write("torque_enable", 0)
            except DeviceError as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _started(self) -> TendonSample:
        if self._sample is None:
            raise DeviceError("tendon motors", "were not started.", help="Call start() first.")
        return self._sample

    def _check_zero(self, settings: MotorSettings, found: Inspection) -> None:
        excursion_m = settings.excursion_m(found.position_ticks, self._model)
        lower_m, upper_m = settings.travel_m
        slack_m = 0.005
        if not lower_m - slack_m <= excursion_m <= upper_m + slack_m:
            raise DeviceError(
                f"tendon motor {settings.motor_id}",
                f"stands at {excursion_m * 1e3:.1f} mm of excursion; expected {lower_m * 1e3:.1f}…{upper_m * 1e3:.1f}.",
                help="It lost its turn or its zero is wrong: calibrate zero_ticks again.",
            )

    def _encode(self, set_point: TendonSetPoint) -> tuple[list[int], list[int]]:
        if len(set_point.excursion_m) != 2:
            raise InputError(f"tendon excursions {set_point.excursion_m}; expected two, right and left.")
        for settings, excursion_m in zip(self._settings, set_point.excursion_m, strict=True):
            lower_m, upper_m = settings.travel_m
            if not lower_m <= excursion_m <= upper_m:  # also catches NaN and infinity
                raise InputError(
                    f"tendon excursion {excursion_m} m of motor {settings.motor_id} is out of travel; "
                    f"expected {lower_m}…{upper_m} m."
                )
        currents = self._currents(set_point.load_cap_N)
        ticks = [s.ticks(e, self._model) for s, e in zip(self._settings, set_point.excursion_m, strict=True)]
        return ticks, currents

    def _currents(self, load_cap_N: Pair) -> list[int]:
        if len(load_cap_N) != 2:
            raise InputError(f"load caps {load_cap_N}; expected two, right and left.")
        currents = []
        for settings, limit, cap_N in zip(self._settings, self._current_limit, load_cap_N, strict=True):
            cap_A = settings.load_law.current_cap_A(cap_N)
            counts = math.floor(cap_A / self._model.current_unit_A)
            if counts > limit:
                raise InputError(
                    f"load cap {cap_N} N of motor {settings.motor_id} needs {cap_A:.2f} A; its Current Limit is "
                    f"{limit * self._model.current_unit_A:.2f} A.",
                    help="Lower the load cap, or raise the motor's Current Limit (register 38).",
                )
            currents.append(counts)
        return currents

    def _write_pair(self, name: str, values: Sequence[int]) -> None:
        register = self._model.registers[name]
        data = {motor_id: register.encode(value) for motor_id, value in zip(self._ids, values, strict=True)}
        self._bus.sync_write(register.address, data)

    def _read_block(self, names: tuple[str, ...]) -> tuple[Status, ...]:
        registers = [self._model.registers[name] for name in names]
        return self._bus.sync_read(registers[0].address, sum(r.size for r in registers), self._ids)

    def _read_slow(self, names: tuple[str, ...]) -> None:
        for index, status in enumerate(self._read_block(names)):
            offset = 0
            for name in names:
                register = self._model.registers[name]
                self._slow[name][index] = register.decode(status.parameters[offset : offset + register.size])
                offset += register.size

    def _check_jump(self, statuses: tuple[Status, ...], elapsed_s: float) -> None:
        limit = 64 + 2.0 * self._model.no_load_speed_rad_s / self._model.tick_rad * elapsed_s
        for index, status in enumerate(statuses):
            ticks = int.from_bytes(status.parameters[6:10], "little", signed=True)
            if abs(ticks - self._ticks[index]) > limit:
                raise ProtocolError(
                    f"tendon motor {status.motor_id}",
                    f"position jumped from {self._ticks[index]} to {ticks} ticks in {elapsed_s * 1e3:.1f} ms.",
                    help="The motor restarted or its encoder failed.",
                )

    def _decode(self, sample_ns: int, statuses: tuple[Status, ...]) -> TendonSample:
        model, slow = self._model, self._slow
        excursion_m, rate_m_s, current_A, tension_N, uncertainty_N = [], [], [], [], []
        for index, (settings, status) in enumerate(zip(self._settings, statuses, strict=True)):
            data = status.parameters
            sign = settings.tightening_sign
            self._ticks[index] = ticks = int.from_bytes(data[6:10], "little", signed=True)
            excursion_m.append(settings.excursion_m(ticks, model))
            velocity_rad_s = int.from_bytes(data[2:6], "little", signed=True) * model.velocity_unit_rad_s
            rate_m_s.append(sign * velocity_rad_s * settings.spool_radius_m)
            current_A.append(sign * int.from_bytes(data[0:2], "little", signed=True) * model.current_unit_A)
            law = settings.load_law
            estimate = law.tension(current_A[index], law.motion(rate_m_s[index]))
            tension_N.append(estimate.tension_N)
            uncertainty_N.append(estimate.uncertainty_N)
        voltage, temperature = slow["present_input_voltage"], slow["present_temperature"]
        error, torque, watchdog = slow["hardware_error_status"], slow["torque_enable"], slow["bus_watchdog"]
        return TendonSample(
            sample_ns=sample_ns,
            excursion_m=(excursion_m[0], excursion_m[1]),
            rate_m_s=(rate_m_s[0], rate_m_s[1]),
            current_A=(current_A[0], current_A[1]),
            tension_N=(tension_N[0], tension_N[1]),
            tension_uncertainty_N=(uncertainty_N[0], uncertainty_N[1]),
            hardware_error=(error[0], error[1]),
            alert=(statuses[0].alert, statuses[1].alert),
            torque_on=(torque[0] == 1, torque[1] == 1),
            watchdog_tripped=(watchdog[0] < 0, watchdog[1] < 0),
            voltage_V=(voltage[0] * model.voltage_unit_V, voltage[1] * model.voltage_unit_V),
            temperature_C=(float(temperature[0]), float(temperature[1])),
            missed=0,
        )
