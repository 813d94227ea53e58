"""One simulated CAN bus: its wire, its devices, and what a fault script does between them and the hosts.

A `CanSegment` carries frames in the order of arbitration and lets devices answer; the hubs around it hold the clients
(hosts) and hand over what it delivers. Times in ns. Source: WAM reference 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from heapq import heappop, heappush
from typing import Protocol

from drivers.simulated.can_faults import CanFaults, FloodSource
from drivers.simulated.can_wire import CanWire, Frame, TimedFrame, WireFrame

Deliver = Callable[[int, Frame, object], None]
"""Hand a frame that arrives at a time to all clients but its sender."""


class CanDevice(Protocol):
    """A device on the simulated wire: one or several nodes in one."""

    def receive(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        """Hear a frame that ended on the wire at `now_ns`, its own among them; the frames that answer it."""
        ...

    def tick(self, now_ns: int) -> list[TimedFrame]:
        """Do what is due by `now_ns` without being asked; the frames that follow from it."""
        ...


class CanSegment:
    """The bus between the clients of a hub and the devices."""

    def __init__(self, devices: Sequence[CanDevice], deliver: Deliver, faults: CanFaults | None = None) -> None:
        self._devices = tuple(devices)
        self._deliver = deliver
        self.faults = faults
        self._wire = CanWire()
        self._late: list[tuple[int, int, Frame, object]] = []
        self._late_count = 0

    def waiting(self, client: object = None) -> int:
        """Number of frames that wait for the wire, of one client or of all."""
        return self._wire.waiting() if client is None else self._wire.waiting_from(client)

    def next_ns(self) -> int | None:
        """When something happens next, as things stand: a frame ends, a delayed one arrives, a fault begins or ends."""
        frame = self._wire.next()
        if self.faults is None:
            return None if frame is None else frame.end_ns
        times = [] if frame is None else [frame.end_ns]
        if self._late:
            times.append(self._late[0][0])
        if (due_ns := self.faults.next_ns()) is not None:
            times.append(due_ns)
        return min(times, default=None)

    def send(self, frame: Frame, client: object, now_ns: int) -> list[Frame]:
        """Put a client's frame on the wire; what of it waits there now. SendRefusedError if its adapter refuses."""
        if self.faults is None:
            self._wire.offer(now_ns, frame, client)
            return [frame]
        frames = self.faults.from_host(frame, now_ns)
        self._fetch()
        for ready_ns, reaching in frames:
            self._wire.offer(ready_ns, reaching, client)
        return [reaching for ready_ns, reaching in frames if ready_ns <= now_ns]

    def transmit(self, frames: Sequence[TimedFrame], device: object) -> None:
        """Put a device's frames on the wire."""
        if self.faults is not None and frames:
            frames = self.faults.to_the_wire(list(frames))
        for ready_ns, frame in frames:
            self._wire.offer(ready_ns, frame, device)

    def next_start_ns(self) -> int | None:
        """When the frame that goes next starts, as things stand."""
        frame = self._wire.next()
        return None if frame is None else frame.start_ns

    def carry(self) -> Frame:
        """Carry the frame that goes next: clients get it, devices hear it and offer their answers."""
        carried = self._wire.take()
        self._hand_over(carried)
        _, end_ns, frame, sender = carried
        if isinstance(sender, FloodSource) and (following := sender.following(end_ns)) is not None:
            self._wire.offer(*following, sender)
        for device in self._devices:
            if answers := device.receive(frame, end_ns):
                self.transmit(answers, device)
        if self.faults is not None:
            self.faults.advance(end_ns)
            self._fetch()
        return frame

    def carry_until(self, now_ns: int) -> None:
        """Carry and deliver all that ends by `now_ns`."""
        while True:
            if self.faults is not None:
                self._advance(now_ns)
            frame = self._wire.next()
            if frame is None or frame.end_ns > now_ns:
                break
            self.carry()
        self._deliver_late(now_ns)

    def step(self, now_ns: int) -> None:
        """Carry what has ended by `now_ns` and let devices do what is due."""
        self.carry_until(now_ns)
        for device in self._devices:
            self.transmit(device.tick(now_ns), device)

    def _advance(self, now_ns: int) -> None:
        """Faults up to the end of the next frame, or up to now if none ends before."""
        assert self.faults is not None
        frame = self._wire.next()
        self.faults.advance(now_ns if frame is None else min(frame.end_ns, now_ns))
        self._fetch()

    def _fetch(self) -> None:
        faults = self.faults
        assert faults is not None
        if faults.lost_queue:
            faults.lost_queue = False
            self._wire.withdraw(lambda sender: sender not in self._devices and not isinstance(sender, FloodSource))
        for ready_ns, frame, sender in faults.to_wire:
            self._wire.offer(ready_ns, frame, sender)
        faults.to_wire.clear()
        for arrival_ns, frame in faults.to_hosts:
            self._put_late(arrival_ns, frame, None)
        faults.to_hosts.clear()

    def _hand_over(self, carried: WireFrame) -> None:
        _, end_ns, frame, sender = carried
        if self.faults is None:
            self._deliver(end_ns, frame, sender)
            return
        self.faults.advance(end_ns)
        self._fetch()
        if self.faults.deaf:
            return
        for arrival_ns, heard in self.faults.to_the_hosts(frame, end_ns):
            self._put_late(arrival_ns, heard, sender)
        self._deliver_late(end_ns)

    def _put_late(self, arrival_ns: int, frame: Frame, sender: object) -> None:
        self._late_count += 1
        heappush(self._late, (arrival_ns, self._late_count, frame, sender))

    def _deliver_late(self, now_ns: int) -> None:
        while self._late and self._late[0][0] <= now_ns:
            arrival_ns, _, frame, sender = heappop(self._late)
            self._deliver(arrival_ns, frame, sender)
