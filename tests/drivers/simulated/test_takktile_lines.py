"""The simulated bridge behind its socket: another process' driver sees what one in memory sees."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.clock import MonotonicClock, nanoseconds
from drivers.errors import BusError, InputError, ProtocolError
from drivers.simulated.takktile import SimulatedTakktile
from drivers.simulated.takktile_lines import SocketTransport, TakktileServer
from drivers.takktile.bridge import Bridge
from drivers.takktile.frames import Request


class ServedClock(MonotonicClock):
    """Lets the server run whenever its client waits: both ends in one thread."""

    server: TakktileServer | None = None

    def wait_readable(self, source: object, deadline_ns: int) -> bool:
        while True:
            if self.server is not None:
                self.server.step()
            if super().wait_readable(source, min(deadline_ns, self.now_ns() + 200_000)):  # type: ignore[arg-type] # a SocketTransport
                return True
            if self.now_ns() >= deadline_ns:
                return False


@pytest.fixture
def clock() -> ServedClock:
    return ServedClock()


@pytest.fixture
def device() -> SimulatedTakktile:
    return SimulatedTakktile(lambda: (1.0, 2.0))


@pytest.fixture
def server(tmp_path: Path, device: SimulatedTakktile, clock: ServedClock) -> Iterator[TakktileServer]:
    clock.server = TakktileServer(tmp_path / "pads", device, clock)
    yield clock.server
    clock.server.close()


def test_a_driver_over_the_socket_samples(
    server: TakktileServer, device: SimulatedTakktile, clock: ServedClock
) -> None:
    """Scan, coefficients, start and frames travel as in memory."""
    bridge = Bridge(SocketTransport(str(server.path), clock), clock)
    assert bridge.cells == tuple(cell.cell for cell in device.cells)
    bridge.start(0.005)
    frames = [bridge.read(clock.now_ns() + nanoseconds(2.0)) for _ in range(5)]
    assert all(frame is not None and len(frame.cells) == 16 for frame in frames)
    bridge.close()
    assert device.requests[-1] == (Request.SAMPLING, 0, 0)


def test_a_stall_is_a_refusal(server: TakktileServer, clock: ServedClock) -> None:
    """A request that the firmware does not know."""
    transport = SocketTransport(str(server.path), clock)
    with pytest.raises(ProtocolError, match="0x77"):
        transport.request(0x77, 0, 0, 8)


def test_rubbish_is_passed_over(server: TakktileServer, clock: ServedClock) -> None:
    """A client that does not speak the protocol stalls nothing, and the next client is served."""
    rubbish = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    rubbish.connect(str(server.path))
    for packet in (b"", b"C", b"C" + bytes(7), b"zzz", b"C\x40" + bytes(7)):
        if packet:
            rubbish.send(packet)
    server.step()
    rubbish.close()
    server.step()
    assert Bridge(SocketTransport(str(server.path), clock), clock).cells


def test_unplugging_is_seen(server: TakktileServer, device: SimulatedTakktile, clock: ServedClock) -> None:
    """As a USB device that is pulled out: the next read says so."""
    bridge = Bridge(SocketTransport(str(server.path), clock), clock)
    bridge.start(0.005)
    device.unplugged = True
    with pytest.raises(BusError, match="has gone"):
        bridge.read(clock.now_ns() + nanoseconds(2.0))


def test_no_bridge_and_no_place_are_told(tmp_path: Path, clock: ServedClock) -> None:
    """Nobody at the path, or a path that cannot be had."""
    with pytest.raises(BusError, match="simulate takktile"):
        SocketTransport(str(tmp_path / "nobody"), clock)
    with pytest.raises(InputError, match="no socket can be made"):
        TakktileServer(tmp_path / "no" / "directory", SimulatedTakktile(lambda: (0.0, 0.0)), clock)
