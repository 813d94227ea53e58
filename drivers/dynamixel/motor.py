"""One tendon motor of any model: who it is, how it is brought to hold a position, and how it is adopted.

Bringing up (dynamixel reference 8): model, hardware error, torque state, mode, Drive Mode, Shutdown and position are
read first and nothing is written until all of them are good (`inspect`, `check_mounting`; what makes them good is in
`startup_checks.py`). Then, in `bring_up`,

* a motor without torque gets return delay 0, Drive Mode 0, no Secondary Id, what has to be in Shutdown, every write
  acknowledged, its mode, gains, a small ceiling and its *present* position as goal, in this order, and only then
  torque: it never moves on being switched on. The ceiling comes before the goal because protocol 1.0 motors switch
  torque on by themselves when a goal is written;
* a motor that already holds is **adopted**: torque stays on, goal and ceiling stay what they are, and an object in
  the hand stays in it; `MotorIdentity.warnings` says what would have been refused. In a mode that winds no tendon, or
  where sign or zero are not the calibrated ones, it is left as it is, and `MotorIdentity.refusal` says why.

The position loop is the tendon's stiffness: an XM430 at gain 800 has about 170 N/mm. The ceiling is Goal Current
(XM430, current-based position mode), Goal PWM (MX-28(2.0), XL430) or Torque Limit (protocol 1.0). EEPROM is
written only where it differs (wear).
"""

from __future__ import annotations

import contextlib

from drivers.clock import Clock
from drivers.dynamixel.bus import MotorBus, motor_name
from drivers.dynamixel.control_tables import MotorModel
from drivers.dynamixel.inspection import (
    Inspection,
    MotorIdentity,
    check_hardware,
    check_mounting,
    hardware_error_text,
    inspect,
    is_alone,
)
from drivers.dynamixel.motor_access import MotorAccess
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.startup_checks import NO_SECONDARY_ID, shutdown_to_be
from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError

__all__ = ["Inspection", "MotorIdentity", "TendonMotor", "hardware_error_text", "is_alone"]

REBOOT_PATIENCE_NS = 2_000_000_000
_POLL_NS = 20_000_000


class TendonMotor(MotorAccess):
    """Motor of `settings` on `bus`."""

    def __init__(self, bus: MotorBus, settings: MotorSettings, model: MotorModel) -> None:
        super().__init__(bus, settings.motor_id, model)
        self.settings = settings
        self._watchdog_s = 0.0

    def inspect(self) -> Inspection:
        """Read how the motor is. DeviceError if it cannot serve as a tendon motor; writes nothing."""
        return inspect(self, self.settings)

    def check_mounting(self, found: Inspection) -> Inspection:
        """Whether zero, travel and load law are this motor's; with what was found in `refusal` and `warnings`.

        DeviceError for a motor that does not hold yet.
        """
        return check_mounting(self, self.settings, found)

    def bring_up(self, found: Inspection) -> tuple[int, int]:
        """Make the motor hold where it is (or go on holding). Its goal position, ticks, and its ceiling, counts."""
        self._watchdog_s = found.watchdog_s
        if found.identity.refusal:
            return self.read("goal_position"), self.read(self.model.ceiling)
        self._acknowledge_all_writes()
        self.clear_watchdog()  # a tripped one would refuse the goals
        if not found.identity.adopted:
            self.write_if_different("return_delay_time", 0)
            if self.model.protocol == 2:
                self.write_if_different("drive_mode", 0)
                if self.read("secondary_id") < NO_SECONDARY_ID:
                    self.write("secondary_id", self.model.registers["secondary_id"].default)
            self.write_if_different("shutdown", shutdown_to_be(self.model, self.read("shutdown")))
            self._choose_mode()
        for name, value in self._loop_settings():
            self.write_if_different(name, value)
        if found.identity.adopted:
            goal_ticks, ceiling = self.read("goal_position"), self.read(self.model.ceiling)
        else:
            goal_ticks = self.steady_position()
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
            self.write_if_different("bus_watchdog", 0)

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
                self.bus.reboot(self.motor_id)
            self._wait_for_answer(clock)
        check_hardware(self, holds=False)

    def _acknowledge_all_writes(self) -> None:
        if self.read("status_return_level") != 2:
            register = self.model.registers["status_return_level"]
            # as a sync write: below level 2 a plain write is not answered
            self.bus.sync_write(register.address, {self.motor_id: register.encode(2)})

    def _choose_mode(self) -> None:
        if self.model.protocol == 2:
            self.write_if_different("operating_mode", self.model.position_modes[0])
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

    def _wait_for_answer(self, clock: Clock) -> None:
        end_ns = clock.now_ns() + REBOOT_PATIENCE_NS
        while True:
            clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
            try:
                self.bus.ping(self.motor_id)
                return
            except BusError:
                raise
            except DeviceError as error:
                if clock.now_ns() >= end_ns:
                    raise NoReplyError(
                        motor_name(self.motor_id), "did not come back from a reboot.", help="Check its supply."
                    ) from error
