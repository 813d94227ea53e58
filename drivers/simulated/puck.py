"""One simulated WAM puck: its power, boot monitor and properties; a motor puck also counts and takes torque.

Properties are kept by name; numbers depend on firmware and on whether the boot monitor runs. Motor angles in rad at the
motor shaft, torques in puck units. Built from WAM reference 3 and 4.7.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, pi

import can

from drivers.clock import nanoseconds
from drivers.wam.frames import position_reply, property_reply
from drivers.wam.properties import MOTOR_IDLE, MOTOR_TORQUE, STATUS_MONITOR, STATUS_READY, PuckKind, property_numbers

_MONITOR_FIRMWARE = 12
_WAKE_SILENCE_NS = nanoseconds(1.0)
_WIDE = frozenset({"P", "MECH", "CTS", "PEN", "DP", "E", "OT", "CT", "JP", "JOFST"})
_READ_ONLY = frozenset({"VERS", "ROLE", "SN", "ID", "STAT", "MECH", "TEMP", "THERM", "PTEMP", "VBUS", "PEN", "LOCK"})


class Puck:
    """Registers of a puck of any kind, behind its boot monitor."""

    def __init__(self, node: int, kind: PuckKind, firmware: int, factory: Mapping[str, int], *, booted: bool) -> None:
        self.node = node
        self.powered = True
        self.in_monitor = not booted
        self._numbers = property_numbers(firmware, kind)
        self._names = {number: name for name, number in self._numbers.items()}
        self._monitor_names = {number: name for name, number in property_numbers(0, "monitor").items()}
        self._factory = dict.fromkeys(self._numbers, 0) | {"VERS": firmware, "SN": 1000 + node, "ID": node, **factory}
        self._stored = dict(self._factory)
        self.values = dict(self._factory)
        """Properties of the main firmware, by name."""
        self._silent_until_ns = 0

    def hears(self, now_ns: int, group: int | None) -> bool:
        """Whether a frame to this node (`group` None) or to a group reaches it; the boot monitor knows no groups."""
        if not self.powered or now_ns < self._silent_until_ns:
            return False
        return group is None or (not self.in_monitor and group in self.groups())

    def groups(self) -> tuple[int, int, int]:
        """GRPA, GRPB, GRPC."""
        return self.values["GRPA"], self.values["GRPB"], self.values["GRPC"]

    def name(self, number: int) -> str | None:
        """Property of that number as things stand, None if there is none."""
        return (self._monitor_names if self.in_monitor else self._names).get(number)

    def number(self, name: str) -> int:
        """Number of a property in the main firmware."""
        return self._numbers[name]

    def read(self, name: str) -> int:
        """Value of a property."""
        if name == "STAT":
            return STATUS_MONITOR if self.in_monitor else STATUS_READY
        if name == "VERS" and self.in_monitor:
            return _MONITOR_FIRMWARE
        return self.values.get(name, 0)

    def reply(self, name: str, number: int) -> can.Message:
        """The frame that answers get-property."""
        value = self.read(name)
        return property_reply(self.node, number, value, wide=name in _WIDE or not -0x8000 <= value < 0x8000)

    def write(self, name: str, value: int, now_ns: int) -> None:
        """Set a property as the host asks; read-only ones stay."""
        if name == "STAT":
            self._start_or_reset(value, now_ns)
        elif self.in_monitor or name in _READ_ONLY:
            return
        elif name in ("SAVE", "LOAD", "DEF"):
            self._remember(name, value)
        else:
            self.values[name] = value

    def power(self, on: bool) -> None:
        """Switch the supply. A puck that gets power is in its boot monitor with what it had stored."""
        if on and not self.powered:
            self.in_monitor = True
            self.values = dict(self._stored)
        self.powered = on

    def _start_or_reset(self, value: int, now_ns: int) -> None:
        if value == STATUS_READY and self.in_monitor:
            self.in_monitor = False
            self.values = dict(self._stored)
            self._silent_until_ns = now_ns + _WAKE_SILENCE_NS
        elif value == STATUS_MONITOR:
            self.in_monitor = True

    def _remember(self, action: str, number: int) -> None:
        names = list(self._numbers) if number == -1 and action == "SAVE" else [self._names.get(number, "")]
        for name in names:
            if name not in self.values or name in _READ_ONLY:
                continue
            if action == "SAVE":
                self._stored[name] = self.values[name]
            elif action == "DEF":
                self._stored[name] = self._factory[name]
            else:
                self.values[name] = self._stored[name]


class MotorPuck(Puck):
    """A puck with an absolute encoder of one motor turn, a position counter and a torque register."""

    def __init__(self, node: int, firmware: int, factory: Mapping[str, int], *, booted: bool) -> None:
        super().__init__(node, "motor", firmware, {"ROLE": 0x01C0, "TEMP": 30, "THERM": 30, **factory}, booted=booted)
        self.counts_per_turn = factory["CTS"]
        self._encoder = 0
        self._mech_offset = 607 * node
        self._position_offset: int | None = None
        self.torque_units = 0

    def see_angle(self, motor_rad: float) -> None:
        """Sample the encoder. A counter that lost its value with the power begins at the angle within one turn."""
        self._encoder = floor(motor_rad * self.counts_per_turn / (2.0 * pi))
        if self._position_offset is None:
            self._position_offset = self.read("MECH") - self._encoder

    def zero_to_encoder(self) -> None:
        """Make the counter agree with the true motor angle, as after zeroing."""
        self._position_offset = 0

    def read(self, name: str) -> int:
        if name == "MECH":
            return (self._encoder + self._mech_offset) % self.counts_per_turn
        if name == "P":
            counts = self._encoder + (self._position_offset or 0)
            return ((counts & 0x3FFFFF) ^ 0x200000) - 0x200000
        return super().read(name)

    def reply(self, name: str, number: int) -> can.Message:
        """As any puck's, but a position has its own short frame."""
        return position_reply(self.node, self.read("P")) if name == "P" else super().reply(name, number)

    def write(self, name: str, value: int, now_ns: int) -> None:
        if name == "P" and not self.in_monitor:
            self._position_offset = value - self._encoder
        else:
            super().write(name, value, now_ns)
            if self.in_monitor:
                self._forget_position()

    def power(self, on: bool) -> None:
        super().power(on)
        if not on:
            self._forget_position()

    def take_torque(self, group: int, number: int, values: tuple[int, int, int, int]) -> bool:
        """Obey a packed torque frame, if it is for this puck and it is in torque mode: hold it until the next."""
        place = self.values["PIDX"]
        if number != self.number("T") or group not in self.groups() or not 1 <= place <= 4 or not self.driving:
            return False
        limit = abs(self.values["MT"])
        self.torque_units = max(-limit, min(limit, values[place - 1]))
        return True

    @property
    def driving(self) -> bool:
        """In torque mode, powered and awake."""
        return self.powered and not self.in_monitor and self.values["MODE"] == MOTOR_TORQUE

    def set_mode(self, mode: int) -> None:
        """Take the safety puck's order; with every change the torque starts from zero."""
        if self.powered and not self.in_monitor and self.values["MODE"] != mode:
            self.values["MODE"] = mode
            self.torque_units = 0

    def _forget_position(self) -> None:
        self._position_offset = None
        self.values["MODE"] = MOTOR_IDLE
        self.torque_units = 0
