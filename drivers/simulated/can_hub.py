"""The hub that joins clients and devices to one simulated CAN wire on virtual time.

`MemoryCanHub` lets devices answer a frame as soon as it is sent, from the state their world has now; what they answer
becomes visible when the wire would have delivered it. Times in ns. Source: WAM reference 1, 7.
"""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Sequence

import can

from drivers.clock import Clock, nanoseconds
from drivers.errors import BusError
from drivers.simulated.can_faults import CanFaults, SendRefusedError
from drivers.simulated.can_segment import CanDevice, CanSegment
from drivers.simulated.can_wire import Frame, TimedFrame, is_classic_frame

TRANSMIT_QUEUE = 10
"""Frames of a client that may wait for the wire: SocketCAN's usual queue. One more is refused with ENOBUFS."""
_LONGEST_AHEAD_NS = nanoseconds(0.002)
"""How far ahead a frame that is sent is carried at once; on a wire busy for longer it waits its turn."""


class MemoryCanHub:
    """Any number of `MemoryCanBus` clients and devices on one wire, on virtual time.

    A frame that a client sends is carried and answered within the call, so that devices answer from the state that
    their world has at the start of the transaction. The answers wait for the wire and can still be overtaken by a later
    frame of higher priority. Everybody hears every frame; clients not their own.
    """

    def __init__(self, devices: Sequence[CanDevice], faults: CanFaults | None = None) -> None:
        self._clients: list[MemoryCanBus] = []
        self._segment = CanSegment(devices, self._deliver, faults)

    def step(self, now_ns: int) -> None:
        """Carry what has ended on the wire by `now_ns` and let devices do what is due."""
        self._segment.step(now_ns)

    def next_due_ns(self) -> int | None:
        """When something happens next on this bus, as things stand."""
        return self._segment.next_ns()

    def transmit(self, frames: Sequence[TimedFrame], device: CanDevice) -> None:
        """Put frames of a device on the wire that nobody asked for, such as the pendant's."""
        self._segment.transmit(frames, device)

    def _join(self, client: MemoryCanBus) -> None:
        if self._segment.faults is not None and self._segment.faults.unplugged:
            raise BusError("simulated CAN", "there is no adapter.", help="Plug it in.")
        self._clients.append(client)

    def _leave(self, client: MemoryCanBus) -> None:
        if client in self._clients:
            self._clients.remove(client)

    def _times_unplugged(self) -> int:
        faults = self._segment.faults
        return 0 if faults is None else faults.times_unplugged

    def _send(self, frame: Frame, client: MemoryCanBus, now_ns: int) -> None:
        segment = self._segment
        while (start_ns := segment.next_start_ns()) is not None and start_ns < now_ns:
            segment.carry()
        if segment.waiting(client) >= TRANSMIT_QUEUE:
            raise SendRefusedError(errno.ENOBUFS)
        awaited = segment.send(frame, client, now_ns)
        while awaited:
            start_ns = segment.next_start_ns()
            if start_ns is None or start_ns > now_ns + _LONGEST_AHEAD_NS:
                break
            carried = segment.carry()
            awaited = [frame for frame in awaited if frame is not carried]

    def _carry_until(self, now_ns: int) -> None:
        self._segment.carry_until(now_ns)

    def _deliver(self, arrival_ns: int, frame: Frame, sender: object) -> None:
        for client in self._clients:
            if client is not sender:
                client.inbox.append((arrival_ns, frame))


class MemoryCanBus:
    """A client of a `MemoryCanHub`, for a part with its own virtual clock; implements drivers.wam.bus.CanBus and
    FrameBus.

    BusError from opening, sending and receiving if a fault script has unplugged the adapter; when it is back, the bus
    has to be opened again.
    """

    def __init__(self, hub: MemoryCanHub, clock: Clock) -> None:
        self._hub = hub
        self._clock = clock
        self._closed = False
        self.inbox: deque[tuple[int, Frame]] = deque()
        """Arrival time and frame, filled by the hub."""
        hub._join(self)
        self._adapter = hub._times_unplugged()

    def send(self, message: can.Message) -> None:
        """Put a standard data frame on the wire now. BusError if it is no such frame, or is not taken."""
        self._check()
        if not is_classic_frame(message):
            raise BusError(
                "simulated CAN", f"frame {message} is no standard data frame; expected an 11-bit identifier."
            )
        self._put(Frame.of(message))

    def receive(self, deadline_ns: int) -> can.Message | None:
        """Next frame that arrives by `deadline_ns`; the clock moves to its arrival, or else to the deadline."""
        frame = self.receive_frame(deadline_ns)
        return None if frame is None else frame.message()

    def send_frame(self, identifier: int, data: bytes) -> None:
        """Put a standard data frame on the wire now. BusError if it is not taken."""
        self._check()
        self._put(Frame(identifier, data))

    def receive_frame(self, deadline_ns: int) -> Frame | None:
        """As `receive`, without a message object."""
        self._check()
        deadline_ns = max(deadline_ns, self._clock.now_ns())
        while not self.inbox or self.inbox[0][0] > self._clock.now_ns():
            if not self._clock.wait_readable(self, deadline_ns):
                return None
            # What was waited for may still be on the wire, and another may have come first.
            self._hub._carry_until(self._clock.now_ns())
            self._check()
        return self.inbox.popleft()[1]

    def fileno(self) -> int:
        """There is nothing to select on: −1."""
        return -1

    def next_arrival_ns(self) -> int | None:
        """When something happens next for this client, as things stand: a frame comes, or the bus has to be looked at;
        None if nothing is under way."""
        event_ns = self._hub.next_due_ns()
        if not self.inbox:
            return event_ns
        return self.inbox[0][0] if event_ns is None else min(self.inbox[0][0], event_ns)

    def close(self) -> None:
        self._closed = True
        self._hub._leave(self)

    def reopen(self) -> None:
        """Be another client of the hub, with nothing heard yet. BusError if there is no adapter."""
        self.close()
        self.inbox.clear()
        self._hub._join(self)
        self._adapter, self._closed = self._hub._times_unplugged(), False

    def _put(self, frame: Frame) -> None:
        try:
            self._hub._send(frame, self, self._clock.now_ns())
        except SendRefusedError as refusal:
            cause = can.CanOperationError(str(refusal), refusal.errno)
            raise BusError(
                "simulated CAN",
                f"frame {frame.identifier:#05x} could not be sent ({refusal}).",
                help="End the fault that refuses it; then start again.",
            ) from cause

    def _check(self) -> None:
        if self._closed:
            raise BusError("simulated CAN", "the bus is closed.", help="Open it again.")
        if self._hub._times_unplugged() != self._adapter:
            gone = OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            raise BusError("simulated CAN", "the adapter is gone.", help="Plug it in and open the bus again.") from gone
