"""One simulated WAM puck of any kind: its power, boot monitor and properties.

Properties are kept by name; numbers depend on firmware and on whether the boot monitor runs. Times in ns. Built from
the WAM reference 2.2, 3 and 4.7.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.clock import nanoseconds
from drivers.simulated.can_wire import Frame
from drivers.simulated.puck_frames import property_value
from drivers.wam.properties import (
    STATUS_ERROR,
    STATUS_MONITOR,
    STATUS_READY,
    PuckKind,
    property_bytes,
    property_numbers,
)

WAKE_SILENCE_NS = nanoseconds(1.0)
"""From SET STAT = 2 until the main firmware hears anything; what is sent meanwhile is lost."""
_MONITOR_FIRMWARE = 12
_MONITOR_ANSWERS = ("VERS", "ROLE", "STAT")
_READ_ONLY = frozenset({"VERS", "ROLE", "SN", "ID", "MECH", "TEMP", "THERM", "PTEMP", "VBUS", "PEN", "LOCK", "ERROR"})
_ALL_MOTORS = 0


class Puck:
    """Registers of a puck, behind its boot monitor."""

    def __init__(self, node: int, kind: PuckKind, firmware: int, factory: Mapping[str, int], *, booted: bool) -> None:
        """`factory`: its properties by name; STAT = 1 among them makes a puck that has failed."""
        self.node = node
        self.firmware = firmware
        self.powered = True
        self.in_monitor = not booted
        self.set_gap_ns = 0
        """A property set within this time of the last is lost; 0: none is."""
        self.lost_sets = 0
        self._failed = factory.get("STAT") == STATUS_ERROR
        self._numbers = property_numbers(firmware, kind)
        self._names = {number: name for name, number in self._numbers.items()}
        monitor_numbers = property_numbers(0, "monitor")
        self._monitor_names = {monitor_numbers[name]: name for name in _MONITOR_ANSWERS}
        self._factory = dict.fromkeys(self._numbers, 0) | {"VERS": firmware, "SN": 1000 + node, "ID": node, **factory}
        self._stored = dict(self._factory)
        self.values = dict(self._factory)
        """Properties of the main firmware, by name."""
        self.silent_until_ns = 0
        """Until then it starts, and hears nothing."""
        self._set_ns: int | None = None

    # --- addressing

    def hears(self, now_ns: int, group: int | None) -> bool:
        """Whether a frame to this node (`group` None) or to a group reaches it; the boot monitor knows group 0 only."""
        if not self.powered or now_ns < self.silent_until_ns:
            return False
        return group is None or group in ((_ALL_MOTORS,) if self.in_monitor else self.groups())

    def groups(self) -> tuple[int, int, int]:
        """GRPA, GRPB, GRPC."""
        return self.values["GRPA"], self.values["GRPB"], self.values["GRPC"]

    def is_waking(self, now_ns: int) -> bool:
        """Whether it starts its firmware, or gets its power back, and hears nothing."""
        return self.powered and now_ns < self.silent_until_ns

    def name(self, number: int) -> str | None:
        """Property of that number as things stand, None if there is none."""
        return (self._monitor_names if self.in_monitor or self._failed else self._names).get(number)

    def number(self, name: str) -> int:
        """Number of a property in the main firmware."""
        return self._numbers[name]

    def has(self, name: str) -> bool:
        """Whether the main firmware has such a property."""
        return name in self._numbers

    # --- properties

    def read(self, name: str) -> int:
        """Value of a property."""
        if name == "STAT":
            return STATUS_ERROR if self._failed else STATUS_MONITOR if self.in_monitor else STATUS_READY
        if name == "VERS" and self.in_monitor:
            return _MONITOR_FIRMWARE
        return self.values.get(name, 0)

    def reply(self, name: str, number: int) -> Frame:
        """The frame that answers get-property."""
        return property_value(self.node, number, self.read(name), property_bytes(name, self.firmware))

    def takes_set(self, now_ns: int) -> bool:
        """Whether a set-property frame finds room: one that follows the last too closely is lost."""
        early = self._set_ns is not None and now_ns - self._set_ns < self.set_gap_ns
        self._set_ns = now_ns
        self.lost_sets += early
        return not early

    def write(self, name: str, value: int, now_ns: int) -> None:
        """Set a property as the host asks; read-only ones stay."""
        if name == "STAT":
            self._start_or_reset(value, now_ns)
        elif self.in_monitor or name in _READ_ONLY:
            return
        elif name in ("SAVE", "LOAD", "DEF"):
            self._remember(name, value)
        else:
            bits = 8 * property_bytes(name, self.firmware)
            self.values[name] = ((value + (1 << bits - 1)) & ((1 << bits) - 1)) - (1 << bits - 1)

    def power(self, on: bool, now_ns: int, *, starts_after_ns: int = 0) -> None:
        """Switch the supply. A puck that gets power is, after a while, in its boot monitor with what it had stored."""
        if on and not self.powered:
            self.in_monitor = True
            self.values = dict(self._stored)
            self.silent_until_ns = now_ns + starts_after_ns
        self.powered = on

    def _start_or_reset(self, value: int, now_ns: int) -> None:
        if value == STATUS_READY and self.in_monitor:
            self.in_monitor = False
            self.values = dict(self._stored)
            self.silent_until_ns = now_ns + WAKE_SILENCE_NS
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
