"""One tendon motor of any model: who it is, how it is brought to hold a position, and how it is adopted.

Bringing up (dynamixel reference 8): model, hardware error, torque state, mode and position are read first and nothing
is written until all of them are good (`inspect`). Then, in `bring_up`,

* a motor without torque gets return delay 0, every write acknowledged, its mode, gains, a small ceiling and its
  *present* position as goal, in this order, and only then torque: it never moves on being switched on. The ceiling
  comes before the goal because protocol 1.0 motors switch torque on by themselves when a goal is written;
* a motor that already holds is **adopted**: torque stays on, goal and ceiling stay what they are, and an object in
  the hand stays in it. In a mode that winds no tendon it is left as it is, and `MotorIdentity.refusal` says why.

The position loop is the tendon's stiffness: an XM430 at gain 800 has about 170 N/mm. The ceiling is Goal Current
(XM430, current-based position mode), Goal PWM (MX-28(2.0), XL430) or Torque Limit (protocol 1.0). EEPROM is
written only where it differs (wear).
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.dynamixel.bus import MotorBus, motor_name
from drivers.dynamixel.control_tables import (
    EXTENDED_POSITION_MODE,
    HARDWARE_ERROR_NAMES,
    POSITION_MODE,
    MotorModel,
    model_by_number,
)
from drivers.dynamixel.settings import MotorSettings
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
    """Why it takes no set-points: it holds in a mode that winds no tendon, and changing it would let go."""


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


class TendonMotor:
    """Motor of `settings` on `bus`."""

    def __init__(self, bus: MotorBus, settings: MotorSettings, model: MotorModel) -> None:
        self.model = model
        self.settings = settings
        self.motor_id = settings.motor_id
        self._bus = bus

    def inspect(self) -> Inspection:
        """Read how the motor is. DeviceError if it cannot serve as a tendon motor; writes nothing."""
        answer = self._bus.ping(self.motor_id)
        self._check_model(answer.model_number)
        self._check_alone()
        holds = self.read("torque_enable") == 1
        self._check_hardware(holds)
        if self.model.watchdog_firmware and self.settings.watchdog_s > 0:
            self._check_firmware(answer.firmware, self.model.watchdog_firmware)
        if self.model.protocol == 2:
            refusal, goal_range, may_pay_out = self._mode(holds)
            limit = self.read("current_limit" if self.model.has_current_modes else "pwm_limit")
        else:
            refusal, goal_range, may_pay_out = self._angle_mode(holds)
            limit = self.read("max_torque")
        identity = MotorIdentity(
            self.motor_id, self.model.number, self.model.name, self.model.protocol, answer.firmware, holds, refusal
        )
        return Inspection(identity, self._steady_position(), limit, goal_range, may_pay_out)

    def bring_up(self, found: Inspection) -> tuple[int, int]:
        """Make the motor hold where it is (or go on holding). Its goal position, ticks, and its ceiling, counts."""
        if found.identity.refusal:
            return self.read("goal_position"), self.read(self.model.ceiling)
        self._acknowledge_all_writes()
        self.clear_watchdog()  # a tripped one would refuse the goals
        if not found.identity.adopted:
            self._write_if_different("return_delay_time", 0)
            self._choose_mode()
        for name, value in self._loop_settings():
            self._write_if_different(name, value)
        if found.identity.adopted:
            goal_ticks, ceiling = self.read("goal_position"), self.read(self.model.ceiling)
        else:
            goal_ticks = self._steady_position()
            ceiling = min(self._start_ceiling(), found.ceiling_limit)
            # a change of mode puts the ceiling to its limit: so after the mode, and before goal and torque
            self.write(self.model.ceiling, ceiling)
            self.write("goal_position", goal_ticks)
            self.write("torque_enable", 1)
        self.arm_watchdog()
        return goal_ticks, ceiling

    def arm_watchdog(self) -> None:
        """From now on a bus that stays silent for `watchdog_s` makes the motor stop and hold. Protocol 1.0 has none: it
        goes on to its last goal and holds there."""
        if self.settings.watchdog_s > 0 and self.model.watchdog_firmware:
            self.write("bus_watchdog", round(self.settings.watchdog_s / self.model.watchdog_unit_s))

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
        return register.decode(self._bus.read(self.motor_id, register.address, register.size).parameters)

    def write(self, name: str, value: int) -> None:
        """Write a register and see it acknowledged."""
        register = self.model.registers[name]
        self._bus.write(self.motor_id, register.address, register.encode(value))

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
            status = self._bus.read(self.motor_id, register.address, register.size)
            error, tripped = status.alarms, register.decode(status.parameters) == 0
        if error and tripped:
            raise self._error(
                f"reports a hardware error: {hardware_error_text(error)}. It lets go of its tendon.",
                "Remove the cause and secure the object; then `stillgrasp calibrate motors --reboot "
                f"{self.motor_id}`, or switch its power off and on.",
            )

    def _check_firmware(self, firmware: int, needed: int) -> None:
        if firmware < needed:
            raise self._error(
                f"has firmware {firmware}; the bus watchdog needs {needed}.",
                "Update the firmware, or set the watchdog to 0.",
            )

    def _mode(self, holds: bool) -> tuple[str, tuple[int, int], bool]:
        if offset := self.read("homing_offset"):
            raise self._error(
                f"has Homing Offset {offset}; expected 0 (a tripped watchdog misplaces the goal with it).",
                "Set it to 0 and calibrate zero_ticks again.",
            )
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

    def _start_ceiling(self) -> int:
        """Counts of the ceiling for the first cap, at the supply that the motor has now."""
        supply_V = self.read("present_input_voltage") * self.model.voltage_unit_V
        cap_supply_V = self.settings.load_law.cap_supply_V(supply_V)
        return self.settings.ceiling_counts(self.settings.start_cap_N, self.model, cap_supply_V)

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
    damaged = 0
    for _ in range(_CLEAN_READS):
        try:
            bus.read(motor_id, register.address, register.size)
        except ProtocolError:
            damaged += 1
    return damaged <= 1 and not bus.surplus()


def hardware_error_text(bits: int) -> str:
    """Names of the error's bits."""
    return ", ".join(name for bit, name in HARDWARE_ERROR_NAMES.items() if bits & bit) or str(bits)
