"""A fault script at work on a simulated CAN bus: between the host's adapter and the wire, and on the device.

The hub asks `CanFaults` what becomes of each frame and tells it how time passes; actions are in `can_fault_actions.py`
and in the device's own union. Times in ns. Source: WAM reference 7; linux/can/error.h.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from typing import Any, Protocol

from drivers.clock import nanoseconds
from drivers.simulated.can_fault_actions import (
    BusOff,
    Corrupt,
    Delay,
    Drop,
    Duplicate,
    ErrorFrame,
    Flood,
    FrameAction,
    QueueFull,
    Reorder,
    Truncate,
    Unplug,
)
from drivers.simulated.can_wire import BIT_NS, ERROR_FLAG, Frame, TimedFrame, frame_bits
from drivers.simulated.faults import START, Fault, FaultScript, Running, Schedule

ERROR_BUS_OFF = 0x40
ERROR_RESTARTED = 0x100


class FaultyDevice(Protocol):
    """A device that can have faults of its own, and tells what happens to it."""

    fault_instants: tuple[type, ...]
    """Its actions that have no duration."""
    fault_events: tuple[str, ...]
    """Events that it tells of."""

    def check_fault(self, action: object) -> None:
        """InputError if this device cannot have such a fault."""
        ...

    def begin_fault(self, action: object, now_ns: int) -> list[TimedFrame]:
        """Have a fault; the frames that follow from it."""
        ...

    def end_fault(self, action: object, now_ns: int) -> list[TimedFrame]:
        """Be sound again; the frames that follow from it."""
        ...

    def take_events(self) -> list[tuple[int, str]]:
        """What has happened since the last call: time and event."""
        ...


class SendRefusedError(Exception):
    """The adapter does not take a frame, for the reason `errno`; the bus's own classes make it their error."""

    def __init__(self, number: int) -> None:
        super().__init__(os.strerror(number))
        self.errno = number


class FloodSource:
    """One flood while it lasts; offers its next frame when the last is through."""

    def __init__(self, action: Flood, begin_ns: int, end_ns: int | None) -> None:
        self.frame = Frame(action.id, bytes.fromhex(action.data))
        self._period_ns = max(nanoseconds(action.period_s), frame_bits(*self.frame) * BIT_NS)
        self._end_ns = end_ns
        self._ready_ns = begin_ns

    def following(self, sent_ns: int) -> TimedFrame | None:
        """The frame after one that ended at `sent_ns`; None at the end."""
        self._ready_ns = max(self._ready_ns + self._period_ns, sent_ns)
        return None if self._end_ns is not None and self._ready_ns >= self._end_ns else (self._ready_ns, self.frame)


class CanFaults:
    """One run of a script on one bus with its device. InputError for a script that does not fit them.

    `to_wire` and `to_hosts` collect what follows from faults as time passes, for the hub to take.
    """

    def __init__(self, script: FaultScript[Any], device: FaultyDevice, start_ns: int = 0) -> None:
        instants = (ErrorFrame, *device.fault_instants)
        self._schedule: Schedule[Any] = Schedule(script, (FrameAction,), instants, device.fault_events, start_ns)
        self._device = device
        self._schedule.check_actions(self._check)
        self._bus_off: list[BusOff] = []
        self._full = self._unplugged = 0
        self.to_wire: list[tuple[int, Frame, object]] = []
        """Time, frame and sender: the device, or a `FloodSource`."""
        self.to_hosts: list[TimedFrame] = []
        """Error frames, for all hosts."""
        self.times_unplugged = 0
        """An adapter that was unplugged is another when it is back: buses that were open stay dead."""
        self.lost_queue = False
        """The adapter has left the bus: frames of hosts that wait in its queue are to be forgotten."""
        self.struck = 0
        """Frames that frame actions have changed so far."""

    def add(self, fault: Fault[Any], now_ns: int) -> None:
        """Have one more fault, timed from now. InputError if it does not fit."""
        self._check(fault.action)
        self._schedule.add(fault)
        self._schedule.notice(START, now_ns)

    # --- time

    def next_ns(self) -> int | None:
        """When something begins or ends next, as far as that is known."""
        return self._schedule.next_ns()

    def advance(self, now_ns: int) -> None:
        """Begin and end what is due by `now_ns`."""
        self._hear_events()
        for time_ns, edge, running in self._schedule.due(now_ns):
            (self._begin if edge == "begin" else self._end)(running, time_ns)
            self._hear_events()

    def _hear_events(self) -> None:
        for time_ns, event in self._device.take_events():
            self._schedule.notice(event, time_ns)

    # --- the adapter

    @property
    def unplugged(self) -> bool:
        """Whether the hosts' adapter is gone."""
        return self._unplugged > 0

    @property
    def deaf(self) -> bool:
        """Whether hosts hear nothing."""
        return bool(self._unplugged or self._bus_off)

    @property
    def refusal(self) -> int:
        """Why the adapter takes no frames, as errno; 0 if it does."""
        if self._unplugged:
            return errno.ENODEV
        return errno.ENOBUFS if self._full or any(action.refuse for action in self._bus_off) else 0

    def from_host(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        """What reaches the wire of a frame that a host sends. SendRefusedError if the adapter does not take it."""
        self.advance(now_ns)
        if self.refusal:
            raise SendRefusedError(self.refusal)
        if self._bus_off:
            return []
        self._schedule.count_frame(now_ns)
        return self._altered([(now_ns, frame)], lambda action: action.concerns(frame, True), now_ns)

    # --- devices' frames

    def to_the_wire(self, frames: list[TimedFrame]) -> list[TimedFrame]:
        """What reaches the wire of frames that the device sends."""
        reaching: list[TimedFrame] = []
        for ready_ns, frame in frames:
            reaching += self._altered([(ready_ns, frame)], _selection(frame, on_wire=True), ready_ns)
        return reaching

    def to_the_hosts(self, frame: Frame, end_ns: int) -> list[TimedFrame]:
        """What hosts hear, and when, of a device's frame that ended on the wire at `end_ns`."""
        self._schedule.count_frame(end_ns)
        return self._altered([(end_ns, frame)], _selection(frame, on_wire=False), end_ns)

    # --- at work

    def _altered(
        self, frames: list[TimedFrame], concerns: Callable[[FrameAction], bool], now_ns: int
    ) -> list[TimedFrame]:
        for running in self._schedule.frame_faults:
            if concerns(running.action) and running.strikes(now_ns):
                self.struck += 1
                frames = [outcome for timed in frames for outcome in _struck(running, *timed)]
        return frames

    def _begin(self, running: Running[Any], now_ns: int) -> None:
        action = running.action
        match action:
            case Flood():
                flood = FloodSource(action, now_ns, running.end_ns)
                self.to_wire.append((now_ns, flood.frame, flood))
            case ErrorFrame():
                self._tell_hosts(action.error, bytes.fromhex(action.data), now_ns)
            case BusOff():
                self._tell_hosts(ERROR_BUS_OFF, bytes(8), now_ns)
                self._bus_off.append(action)
                self.lost_queue = True
            case QueueFull():
                self._full += 1
            case Unplug():
                self._unplugged += 1
                self.times_unplugged += 1
                self.lost_queue = True
            case _:
                self._device_sends(self._device.begin_fault(action, now_ns))

    def _end(self, running: Running[Any], now_ns: int) -> None:
        action = running.action
        match action:
            case Flood():
                pass  # its source knows its end
            case BusOff():
                self._bus_off.remove(action)
                self._tell_hosts(ERROR_RESTARTED, bytes(8), now_ns)
            case QueueFull():
                self._full -= 1
            case Unplug():
                self._unplugged -= 1
            case _:
                self._device_sends(self._device.end_fault(action, now_ns))

    def _tell_hosts(self, error: int, data: bytes, now_ns: int) -> None:
        if not self.deaf:
            self.to_hosts.append((now_ns, Frame(ERROR_FLAG | error, data)))

    def _device_sends(self, frames: list[TimedFrame]) -> None:
        self.to_wire += [(ready_ns, frame, self._device) for ready_ns, frame in self.to_the_wire(frames)]

    def _check(self, action: object) -> None:
        if not isinstance(action, FrameAction | Flood | ErrorFrame | BusOff | QueueFull | Unplug):
            self._device.check_fault(action)


def _selection(frame: Frame, *, on_wire: bool) -> Callable[[FrameAction], bool]:
    return lambda action: action.on_wire == on_wire and action.concerns(frame, False)


def _struck(running: Running[Any], time_ns: int, frame: Frame) -> list[TimedFrame]:
    """What a frame action makes of one frame."""
    action = running.action
    match action:
        case Drop():
            return []
        case Delay():
            return [(time_ns + nanoseconds(action.by_s), frame)]
        case Duplicate():
            copies = [(time_ns + nanoseconds(action.after_s) * copy, frame) for copy in range(1, action.times + 1)]
            return [(time_ns, frame), *copies]
        case Reorder():
            return [(time_ns + round(running.random.random() * nanoseconds(action.within_s)), frame)]
        case Truncate():
            return [(time_ns, Frame(frame.identifier, frame.data[: action.length]))]
        case Corrupt() if action.data is not None:
            return [(time_ns, Frame(frame.identifier, bytes.fromhex(action.data)))]
        case Corrupt() if frame.data:
            content = bytearray(frame.data)
            for place in running.random.sample(range(8 * len(content)), min(action.bits, 8 * len(content))):
                content[place // 8] ^= 1 << place % 8
            return [(time_ns, Frame(frame.identifier, bytes(content)))]
    return [(time_ns, frame)]
