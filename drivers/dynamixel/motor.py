"""One tendon motor of any model: who it is, how it is brought to hold a position, and how it is adopted.

Bringing up (dynamixel reference 8): model, hardware error, torque state, mode, Drive Mode, Shutdown and position are
read first and nothing is written until all of them are good (`inspect`, `check_mounting`; what makes them good is in
`startup_checks.py`). Then, in `bring_up`,

* a motor without torque gets return delay 0, Drive Mode 0, what has to be in Shutdown, every write acknowledged, its
  mode, gains, a small ceiling and its *present* position as goal, in this order, and only then torque: it never moves
  on being switched on. The ceiling comes before the goal because protocol 1.0 motors switch torque on by themselves
  when a goal is written;
* a motor that already holds is **adopted**: torque stays on, goal and ceiling stay what they are, and an object in
  the hand stays in it; `MotorIdentity.warnings` says what would have been refused. In a mode that winds no tendon, or
  where sign or zero are not the calibrated ones, it is left as it is, and `MotorIdentity.refusal` says why.

The position loop is the tendon's stiffness: an XM430 at gain 800 has about 170 N/mm. The ceiling is Goal Current
(XM430, current-based position mode), Goal PWM (MX-28(2.0), XL430) or Torque Limit (protocol 1.0). EEPROM is
written only where it differs (wear).
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.clock import Clock
from drivers.dynamixel.bus import MotorBus, motor_name, persistently
from drivers.dynamixel.control_tables import (
    EXTENDED_POSITION_MODE,
    POSITION_MODE,
    MotorModel,
    model_by_number,
)
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.startup_checks import (
    TORQUE_BY_GOAL,
    Consequence,
    Finding,
    check_calibration,
    check_drive_mode,
    check_return_delay,
    check_shutdown,
    check_travel,
    check_zero,
    error_names,
    shutdown_to_be,
    shuts_down_on,
)
from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError

STILL_RAD = 0.08
"""Two position reads one after the other may differ by this much (0.8 mm of tendon) while a motor is brought up."""

REBOOT_PATIENCE_NS = 2_000_000_000
_POLL_NS = 20_000_000
_CLEAN_READS = 4


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """What answered: for the log and for the calibration's provenance."""

    motor_id: int
    model_number: int
    model_name: str
    protocol: int
    firmware: int
    adopted: bool
    """True if it held already when it was found."""
    refusal: str = ""
    """Why it takes no set-points, though it holds: its mode winds no tendon, or its sign or zero are not known."""
    warnings: tuple[str, ...] = ()
    """What the operator should know; each reads after the motor's name."""
    shuts_down_on: str = ""
    """For which hardware errors it lets go."""


@dataclass(frozen=True, slots=True)
class Inspection:
    """What `inspect` found; nothing was written."""

    identity: MotorIdentity
    position_ticks: int
    ceiling_limit: int
    """Highest value of the ceiling register, counts."""
    goal_range: tuple[int, int]
    """Goal positions that the motor takes."""
    may_pay_out: bool
    """It follows goals; a motor with a refusal may at least be loosened."""
    supply_V: float = 12.0
    goal_switches_on: bool = False
    """A goal that is written to it switches its torque on."""
    wraps_ticks: int = 0
    """Its position begins anew after so many; 0: never."""


class TendonMotor:
    """Motor of `settings` on `bus`."""

    def __init__(self, bus: MotorBus, settings: MotorSettings, model: MotorModel) -> None:
        self.model = model
        self.settings = settings
        self.motor_id = settings.motor_id
        self._bus = bus
        self._watchdog_s = settings.watchdog_s

    def inspect(self) -> Inspection:
        """Read how the motor is. DeviceError if it cannot serve as a tendon motor; writes nothing."""
        answer = persistently(lambda: self._bus.ping(self.motor_id))
        self._check_model(answer.model_number)
        self._check_alone()
        holds = self.read("torque_enable") == 1
        self._check_hardware(holds)
        model, shutdown = self.model, self.read("shutdown")
        findings = check_shutdown(model, shutdown, holds)
        findings += check_return_delay(model, self.read("return_delay_time"), holds)
        goal_switches_on = model.protocol == 1
        wraps_ticks = 0
        if model.protocol == 2:
            drive_mode = self.read("drive_mode")
            findings += [*check_drive_mode(drive_mode, holds), *self._check_watchdog(answer.firmware)]
            goal_switches_on = holds and bool(drive_mode & TORQUE_BY_GOAL)
            refusal, goal_range, may_pay_out = self._mode(holds)
            limit = self.read("current_limit" if model.has_current_modes else "pwm_limit")
        else:
            refusal, goal_range, may_pay_out = self._angle_mode(holds)
            limit = self.read("max_torque")
            if "multi_turn_offset" in model.registers and goal_range[0] >= 0:
                wraps_ticks = model.ticks_per_revolution
        identity = MotorIdentity(
            self.motor_id,
            model.number,
            model.name,
            model.protocol,
            answer.firmware,
            holds,
            refusal,
            shuts_down_on=shuts_down_on(model, shutdown if holds else shutdown_to_be(model, shutdown)),
        )
        found = Inspection(
            identity,
            self._steady_position(),
            limit,
            goal_range,
            may_pay_out,
            self.read("present_input_voltage") * model.voltage_unit_V,
            goal_switches_on,
            wraps_ticks,
        )
        return self._admitted(found, findings)

    def check_mounting(self, found: Inspection) -> Inspection:
        """Whether zero, travel and load law are this motor's; with what was found in `refusal` and `warnings`.

        DeviceError for a motor that does not hold yet.
        """
        settings, model = self.settings, self.model
        findings = check_zero(settings, model, found.position_ticks)
        if not findings:
            findings = check_travel(settings, model, found.goal_range)
        findings += check_calibration(settings, model, found.identity.firmware, found.supply_V)
        return self._admitted(found, findings)

    def bring_up(self, found: Inspection) -> tuple[int, int]:
        """Make the motor hold where it is (or go on holding). Its goal position, ticks, and its ceiling, counts."""
        if found.identity.refusal:
            return self.read("goal_position"), self.read(self.model.ceiling)
        self._acknowledge_all_writes()
        self.clear_watchdog()  # a tripped one would refuse the goals
        if not found.identity.adopted:
            self._write_if_different("return_delay_time", 0)
            if self.model.protocol == 2:
                self._write_if_different("drive_mode", 0)
            self._write_if_different("shutdown", shutdown_to_be(self.model, self.read("shutdown")))
            self._choose_mode()
        for name, value in self._loop_settings():
            self._write_if_different(name, value)
        if found.identity.adopted:
            goal_ticks, ceiling = self.read("goal_position"), self.read(self.model.ceiling)
        else:
            goal_ticks = self._steady_position()
            cap_supply_V = self.settings.load_law.cap_supply_V(found.supply_V)
            ceiling = self.settings.ceiling_counts(self.settings.start_cap_N, self.model, cap_supply_V)
            ceiling = min(ceiling, found.ceiling_limit)
            # a change of mode puts the ceiling to its limit: so after the mode, and before goal and torque
            self.write(self.model.ceiling, ceiling)
            self.write("goal_position", goal_ticks)
            self.write("torque_enable", 1)
        self.arm_watchdog()
        return goal_ticks, ceiling

    def arm_watchdog(self) -> None:
        """From now on a bus that stays silent for `watchdog_s` makes the motor stop and hold. Protocol 1.0 has none: it
        goes on to its last goal and holds there."""
        if self._watchdog_s > 0 and self.model.watchdog_firmware:
            self.write("bus_watchdog", round(self._watchdog_s / self.model.watchdog_unit_s))

    def clear_watchdog(self) -> None:
        """Switch the watchdog off; one that tripped takes goals again."""
        if self.model.watchdog_firmware:
            self._write_if_different("bus_watchdog", 0)

    def reboot(self, clock: Clock) -> None:
        """Clear a hardware error; the motor lets go and stays without torque. DeviceError if the error remains.

        Protocol 2.0: the reboot instruction, some 0.3 s of silence. Protocol 1.0 has none: torque off, and the Torque
        Limit that the shutdown took away is given back.
        """
        if self.model.protocol == 1:
            self.write("torque_enable", 0)
            self.write("torque_limit", self.read("max_torque"))
        else:
            with contextlib.suppress(NoReplyError, ProtocolError):  # whether it comes back is what counts
                self._bus.reboot(self.motor_id)
            self._wait_for_answer(clock)
        self._check_hardware(holds=False)

    def read(self, name: str) -> int:
        """A register's value."""
        register = self.model.registers[name]
        status = persistently(lambda: self._bus.read(self.motor_id, register.address, register.size))
        return register.decode(status.parameters)

    def write(self, name: str, value: int) -> None:
        """Write a register and see it acknowledged."""
        register = self.model.registers[name]
        persistently(lambda: self._bus.write(self.motor_id, register.address, register.encode(value)))

    # inspection

    def _check_model(self, number: int) -> None:
        if number != self.model.number:
            found = model_by_number(number).name
            raise self._error(
                f"is a {found}; expected a {self.model.name}.",
                "Both motors must be of one model, and of the one that was calibrated: see tendons in robot.toml.",
            )

    def _check_alone(self) -> None:
        if not is_alone(self._bus, self.motor_id, self.model):
            raise self._error(
                "does not seem to be alone: its answers are damaged, or come twice.",
                "Two motors have this id, or the cable is bad. Connect one motor at a time and give each its own id.",
            )

    def _check_hardware(self, holds: bool) -> None:
        if self.model.protocol == 2:
            error, tripped = self.read("hardware_error_status"), not holds
        else:
            register = self.model.registers["torque_limit"]
            status = persistently(lambda: self._bus.read(self.motor_id, register.address, register.size))
            error, tripped = status.alarms, register.decode(status.parameters) == 0
        if error and tripped:
            raise self._error(
                f"reports a hardware error: {hardware_error_text(error)}. It lets go of its tendon.",
                "Remove the cause and secure the object; then `stillgrasp calibrate motors --reboot "
                f"{self.motor_id}`, or switch its power off and on.",
            )

    def _check_watchdog(self, firmware: int) -> list[Finding]:
        """Firmware without a watchdog, or with one that is no good: an adopted motor then goes without."""
        needed, findings = self.model.watchdog_firmware, []
        if needed and firmware < needed and self.settings.watchdog_s > 0:
            text = f"has firmware {firmware}; the bus watchdog needs {needed}."
            findings.append(Finding(Consequence.REFUSED, text, "Update the firmware, or set the watchdog to 0."))
        if offset := self.read("homing_offset"):
            text = f"has Homing Offset {offset}; expected 0 (a tripped watchdog misplaces the goal with it)."
            findings.append(Finding(Consequence.REFUSED, text, "Set it to 0 and calibrate zero_ticks again."))
        self._watchdog_s = 0.0 if findings else self.settings.watchdog_s
        return findings

    def _admitted(self, found: Inspection, findings: Sequence[Finding]) -> Inspection:
        """With the findings in the identity; DeviceError where the motor does not hold and may not be started."""
        identity, refusal, warnings = found.identity, found.identity.refusal, list(found.identity.warnings)
        may_pay_out = found.may_pay_out
        for finding in findings:
            if finding.consequence is not Consequence.WARNED and not identity.adopted:
                raise self._error(finding.text, finding.help)
            if finding.consequence is Consequence.UNDRIVEN:
                refusal, may_pay_out = refusal or finding.sentence, False
            else:
                warnings.append(finding.sentence)
        identity = replace(identity, refusal=refusal, warnings=tuple(warnings))
        return replace(found, identity=identity, may_pay_out=may_pay_out)

    def _mode(self, holds: bool) -> tuple[str, tuple[int, int], bool]:
        goal = self.model.registers["goal_position"]
        mode, wanted = self.read("operating_mode"), self.model.position_modes
        whole = (goal.minimum, goal.maximum)
        if not holds:
            return "", whole, True
        if mode == POSITION_MODE:
            whole = (self.read("min_position_limit"), self.read("max_position_limit"))
        if mode in wanted:
            return "", whole, True
        refusal = (
            f"holds in operating mode {mode}, and tendons are wound in mode {wanted[0]}; changing it would let go of "
            "what is held. Open the hand or secure the object, switch the motors off and start again."
        )
        return refusal, whole, mode in (POSITION_MODE, EXTENDED_POSITION_MODE)

    def _angle_mode(self, holds: bool) -> tuple[str, tuple[int, int], bool]:
        """Protocol 1.0 has no mode register: both limits 0 is a wheel, both at the end turns many times (MX)."""
        goal = self.model.registers["goal_position"]
        lower, upper = self.read("cw_angle_limit"), self.read("ccw_angle_limit")
        full = self.model.registers["ccw_angle_limit"].maximum
        if lower == upper == full and goal.minimum < 0:
            return "", (goal.minimum, goal.maximum), True
        if lower == upper == 0:
            if not holds:
                return "", (0, full), True
            refusal = (
                "holds as a wheel (both angle limits 0), and changing that would let go. Secure the object, switch the "
                "motors off and start again."
            )
            return refusal, (0, 0), False
        return "", (lower, upper), True

    def _steady_position(self) -> int:
        first, second = self.read("present_position"), self.read("present_position")
        allowed = round(STILL_RAD / self.model.tick_rad)
        if abs(second - first) > allowed:
            raise ProtocolError(
                motor_name(self.motor_id),
                f"read {first} and then {second} ticks while it should stand still (within {allowed}).",
                help="Let the hand come to rest; if it was at rest, check the wiring.",
            )
        return second

    # bringing up

    def _acknowledge_all_writes(self) -> None:
        if self.read("status_return_level") != 2:
            register = self.model.registers["status_return_level"]
            # as a sync write: below level 2 a plain write is not answered
            self._bus.sync_write(register.address, {self.motor_id: register.encode(2)})

    def _choose_mode(self) -> None:
        if self.model.protocol == 2:
            self._write_if_different("operating_mode", self.model.position_modes[0])
        elif self.read("cw_angle_limit") == self.read("ccw_angle_limit") == 0:
            self.write("ccw_angle_limit", self.model.registers["ccw_angle_limit"].maximum)

    def _loop_settings(self) -> list[tuple[str, int]]:
        """Registers of the position loop: our stiffness, no integral (it would wind on at the ceiling), no profile."""
        registers, gain = self.model.registers, self.settings.gain(self.model)
        settings = [(self.model.position_gain, gain), ("position_i_gain", 0)]
        if self.model.position_gain == "cw_compliance_slope":
            settings.append(("ccw_compliance_slope", gain))
        for name in ("position_d_gain", "feedforward_2nd_gain", "feedforward_1st_gain", "moving_speed"):
            settings.append((name, registers[name].default if name in registers else 0))
        settings += [(name, 0) for name in ("profile_acceleration", "profile_velocity", "goal_acceleration")]
        return [(name, value) for name, value in settings if name in registers]

    def _write_if_different(self, name: str, value: int) -> None:
        if self.read(name) != value:
            self.write(name, value)

    def _wait_for_answer(self, clock: Clock) -> None:
        end_ns = clock.now_ns() + REBOOT_PATIENCE_NS
        while True:
            clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
            try:
                self._bus.ping(self.motor_id)
                return
            except BusError:
                raise
            except DeviceError as error:
                if clock.now_ns() >= end_ns:
                    raise NoReplyError(
                        motor_name(self.motor_id), "did not come back from a reboot.", help="Check its supply."
                    ) from error

    def _error(self, message: str, help: str) -> DeviceError:
        return DeviceError(motor_name(self.motor_id), message, help=help)


def is_alone(bus: MotorBus, motor_id: int, model: MotorModel) -> bool:
    """Whether one motor answers to this id. Two answer a ping alike, but a position into each other's words; or one
    after the other, if their delays differ. NoReplyError, BusError."""
    register = model.registers["present_position"]
    damaged, silence = 0, []
    for _ in range(_CLEAN_READS):
        try:
            bus.read(motor_id, register.address, register.size)
        except NoReplyError as error:
            silence.append(error)
        except ProtocolError:
            damaged += 1
    if len(silence) == _CLEAN_READS:
        raise silence[0]
    return damaged <= 1 and not bus.surplus()


def hardware_error_text(bits: int) -> str:
    """Names of the error's bits."""
    return error_names(bits) or str(bits)
