"""One tendon motor: who it is, how it is brought to current-based position mode, and how it is adopted.

Bringing up (dynamixel reference 8): ping, model, hardware error, torque state and position are read first and nothing
is written until all of them are good (`inspect`). Then, in `bring_up`,

* a motor without torque gets return delay 0, every write acknowledged, mode 5, gains, a small Goal Current and
  its *present* position as goal, in this order, and only then torque: it never moves on being switched on;
* a motor that already holds in mode 5 is **adopted**: torque stays on, goal and current ceiling stay what they
  are, and an object in the hand stays in it. A motor that holds in any other mode is refused, as changing the mode
  would let go.

In mode 5 the motor's position loop is the tendon's stiffness: current per tick = P gain/128/885 × stall current, so
that 800 is about 170 N/mm at the tendon. EEPROM is written only where it differs (wear).
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.control_tables import (
    CURRENT_BASED_POSITION_MODE,
    HARDWARE_ERROR_NAMES,
    MODELS,
    MotorModel,
)
from drivers.errors import DeviceError, ProtocolError

STILL_TICKS = 50
"""Two position reads one after the other may differ by this much (0.8 mm of tendon) while a motor is brought up."""


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """What answered: for the log and for the calibration's provenance."""

    motor_id: int
    model_number: int
    model_name: str
    firmware: int
    adopted: bool
    """True if it held already when it was found."""


@dataclass(frozen=True, slots=True)
class Inspection:
    """What `inspect` found; nothing was written."""

    identity: MotorIdentity
    position_ticks: int
    current_limit: int
    """Register counts."""


class TendonMotor:
    """Motor `motor_id` on `bus`. `watchdog_s` = 0 switches the bus watchdog off (reference 6.3)."""

    def __init__(
        self,
        bus: DynamixelBus,
        motor_id: int,
        *,
        position_p_gain: int = 800,
        start_current_A: float = 0.2,
        watchdog_s: float = 0.2,
    ) -> None:
        self.motor_id = motor_id
        self.model: MotorModel = next(iter(MODELS.values()))
        self._bus = bus
        self._position_p_gain = position_p_gain
        self._start_current_A = start_current_A
        self._watchdog_s = watchdog_s

    def inspect(self) -> Inspection:
        """Read who and how the motor is. DeviceError if it cannot serve as a tendon motor; writes nothing."""
        number, firmware, alert = self._bus.ping(self.motor_id)
        if number not in MODELS or CURRENT_BASED_POSITION_MODE not in MODELS[number].position_modes:
            known = ", ".join(f"{model.name} ({model.number})" for model in MODELS.values() if model.has_current_modes)
            raise self._error(
                f"is a {MODELS[number].name if number in MODELS else 'model'} ({number}); expected {known}.",
                "Fit a motor of this model, or add its control table.",
            )
        self.model = MODELS[number]
        hardware_error = self.read("hardware_error_status")
        if hardware_error or alert:
            names = [name for bit, name in HARDWARE_ERROR_NAMES.items() if hardware_error & bit]
            raise self._error(
                f"reports a hardware error: {', '.join(names) or hardware_error}.",
                "Remove the cause, then reboot the motor; it lets go of what it holds.",
            )
        if self._watchdog_s > 0 and firmware < (self.model.watchdog_firmware or 0):
            raise self._error(
                f"has firmware {firmware}; the bus watchdog needs {self.model.watchdog_firmware}.",
                "Update the firmware, or set the watchdog to 0.",
            )
        if offset := self.read("homing_offset"):
            raise self._error(
                f"has Homing Offset {offset}; expected 0 (a tripped watchdog misplaces the goal with it).",
                "Set it to 0 and calibrate zero_ticks again.",
            )
        holds = self.read("torque_enable") == 1
        mode = self.read("operating_mode")
        if holds and mode != CURRENT_BASED_POSITION_MODE:
            raise self._error(
                f"already holds, in operating mode {mode}; expected {CURRENT_BASED_POSITION_MODE}.",
                "Switching it off would drop what it holds: secure the object, switch torque off, start again.",
            )
        identity = MotorIdentity(self.motor_id, number, self.model.name, firmware, adopted=holds)
        return Inspection(identity, self._steady_position(), self.read("current_limit"))

    def bring_up(self, found: Inspection) -> tuple[int, int]:
        """Make the motor hold where it is (or go on holding). Its goal position, ticks, and goal current, counts."""
        self._acknowledge_all_writes()
        self.clear_watchdog()  # a tripped one would refuse the goals
        if not found.identity.adopted:
            self._write_if_different("return_delay_time", 0)
            self._write_if_different("operating_mode", CURRENT_BASED_POSITION_MODE)
        for name, value in (
            ("position_d_gain", 0),
            ("position_i_gain", 0),
            ("position_p_gain", self._position_p_gain),
            ("feedforward_2nd_gain", 0),
            ("feedforward_1st_gain", 0),
            ("profile_acceleration", 0),
            ("profile_velocity", 0),
        ):
            self._write_if_different(name, value)
        if found.identity.adopted:
            goal_ticks, goal_current = self.read("goal_position"), self.read("goal_current")
        else:
            goal_ticks = self._steady_position()
            goal_current = min(round(self._start_current_A / self.model.current_unit_A), found.current_limit)
            # mode changes put Goal Current to its limit: so after the mode, and before torque
            self.write("goal_current", goal_current)
            self.write("goal_position", goal_ticks)
            self.write("torque_enable", 1)
        self.arm_watchdog()
        return goal_ticks, goal_current

    def arm_watchdog(self) -> None:
        """From now on a bus that stays silent for `watchdog_s` makes the motor stop and hold."""
        if self._watchdog_s > 0:
            self.write("bus_watchdog", round(self._watchdog_s / self.model.watchdog_unit_s))

    def clear_watchdog(self) -> None:
        """Switch the watchdog off; one that tripped takes goals again."""
        self._write_if_different("bus_watchdog", 0)

    def read(self, name: str) -> int:
        """A register's value."""
        register = self.model.registers[name]
        return register.decode(self._bus.read(self.motor_id, register.address, register.size).parameters)

    def write(self, name: str, value: int) -> None:
        """Write a register and see it acknowledged."""
        register = self.model.registers[name]
        self._bus.write(self.motor_id, register.address, register.encode(value))

    def _acknowledge_all_writes(self) -> None:
        if self.read("status_return_level") != 2:
            register = self.model.registers["status_return_level"]
            # as a sync write: below level 2 a plain write is not answered
            self._bus.sync_write(register.address, {self.motor_id: register.encode(2)})

    def _write_if_different(self, name: str, value: int) -> None:
        if self.read(name) != value:
            self.write(name, value)

    def _steady_position(self) -> int:
        first, second = self.read("present_position"), self.read("present_position")
        if abs(second - first) > STILL_TICKS:
            raise ProtocolError(
                f"tendon motor {self.motor_id}",
                f"read {first} and then {second} ticks while it should stand still (within {STILL_TICKS}).",
                help="Let the hand come to rest; if it was at rest, check the wiring.",
            )
        return second

    def _error(self, message: str, help: str) -> DeviceError:
        return DeviceError(f"tendon motor {self.motor_id}", message, help=help)
