"""Two ways to the same wire: `struct can_frame` on python-can's socket, and python-can's own message objects."""

from __future__ import annotations

import random
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.seqpacket_can import SeqpacketBus
from drivers.wam.bus import ARM_FILTERS, PythonCanBus, SocketCanBus, bus_errno, frames_of, raw_frame
from drivers.wam.frames import RawFrame

FILTERS: can.typechecking.CanFilters = [
    {"can_id": number, "can_mask": mask, "extended": False} for number, mask in ARM_FILTERS
]


class Pair:
    """One bus and the other end of its socket."""

    def __init__(self, path: Path, kind: type[PythonCanBus]) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(str(path))
            listener.listen(1)
            opened = SeqpacketBus(str(path), can_filters=FILTERS)
            self.wire, _ = listener.accept()
        path.unlink()
        self.wire.setblocking(False)
        self.bus = kind(opened, VirtualClock())

    def put(self, identifier: int, data: bytes) -> None:
        """A `struct can_frame`, written out."""
        self.wire.send(struct.pack("=IBBBB", identifier, len(data), 0, 0, 0) + data.ljust(8, b"\0"))

    def heard(self) -> list[RawFrame]:
        frames: list[RawFrame] = []
        while (frame := self.bus.receive_frame(0)) is not None:
            frames.append((frame[0], bytes(frame[1])))
        return frames

    def close(self) -> None:
        self.wire.close()
        self.bus.close()


@pytest.fixture
def pairs(tmp_path: Path) -> Iterator[tuple[Pair, Pair]]:
    both = Pair(tmp_path / "lean", SocketCanBus), Pair(tmp_path / "python-can", PythonCanBus)
    yield both
    for pair in both:
        pair.close()


def test_both_hear_the_same(pairs: tuple[Pair, Pair]) -> None:
    """Protects the choice between them: any identifier and data, error frames too, filtered alike, byte by byte."""
    chance = random.Random(5)
    sent = [(chance.randrange(0x800), chance.randbytes(chance.randrange(9))) for _ in range(3000)]
    sent += [(0x20000040, bytes(8)), (0x20000100, bytes(8)), (0x423, b"\1\2\3")]
    heard: list[list[RawFrame]] = [[], []]
    for identifier, data in sent:
        for pair, frames in zip(pairs, heard, strict=True):
            pair.put(identifier, data)
            frames += pair.heard()
    assert heard[0] == heard[1]
    wanted = [frame for frame in sent if any(not (frame[0] ^ number) & mask & 0x7FF for number, mask in ARM_FILTERS)]
    assert [frame for frame in heard[0] if frame[0] < 0x800] == [frame for frame in wanted if frame[0] < 0x800]
    assert [frame[0] for frame in heard[0] if frame[0] > 0x800] == [0x20000040, 0x20000100]


def test_both_send_the_same(pairs: tuple[Pair, Pair]) -> None:
    """Protects the wire: the same sixteen bytes, whichever way a frame takes."""
    chance = random.Random(6)
    for _ in range(300):
        identifier, data = chance.randrange(0x800), chance.randbytes(chance.randrange(9))
        packets = []
        for pair in pairs:
            pair.bus.send_frame(identifier, data)
            pair.bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data))
            packets += [pair.wire.recv(32), pair.wire.recv(32)]
        assert packets == [struct.pack("=IBBBB", identifier, len(data), 0, 0, 0) + data.ljust(8, b"\0")] * 4


def test_extended_remote_and_odd_packets_pass_neither(pairs: tuple[Pair, Pair]) -> None:
    """Protects the parser: what is no standard data frame is dropped, and what follows is heard."""
    for pair in pairs:
        pair.put(0x80000423, b"abc")
        pair.put(0x40000423, b"")
        pair.wire.send(b"12345")
        pair.wire.send(bytes(20))
        pair.put(0x443, b"xyz")
        assert pair.heard() == [(0x443, b"xyz")]


def test_a_refusing_adapter_is_named_and_comes_back(pairs: tuple[Pair, Pair]) -> None:
    """Protects torques: ENOBUFS is an error of the call that sent, with its number, and nothing is kept for later."""
    for pair in pairs:
        pair.wire.send(struct.pack("=H", 105))
        assert pair.heard() == []
        with pytest.raises(BusError) as caught:
            pair.bus.send_frame(0x401, bytes(8))
        assert bus_errno(caught.value) == 105
        pair.wire.send(struct.pack("=H", 0))
        pair.heard()
        pair.bus.send_frame(0x402, b"new")
        assert pair.wire.recv(32)[:4] == struct.pack("=I", 0x402)
        with pytest.raises(BlockingIOError):
            pair.wire.recv(32)


def send_without_end(bus: PythonCanBus) -> None:
    for _ in range(100_000):
        bus.send_frame(0x401, bytes(8))


def test_a_full_socket_never_blocks(pairs: tuple[Pair, Pair]) -> None:
    """Protects the cycle: a bus that nobody reads is an error at once, in a blocking socket too."""
    for pair in pairs:
        if isinstance(pair.bus, SocketCanBus):
            pair.bus._bus.frame_socket.setblocking(True)  # type: ignore[attr-defined]  # SeqpacketBus
        with pytest.raises(BusError) as caught:
            send_without_end(pair.bus)
        assert bus_errno(caught.value) == 11


def test_a_closed_bus_is_gone_for_both(pairs: tuple[Pair, Pair]) -> None:
    """Protects the caller: a hub that has gone is a BusError, when receiving and when sending."""
    for pair in pairs:
        pair.wire.close()
        with pytest.raises(BusError, match="received"):
            pair.bus.receive_frame(0)
        with pytest.raises(BusError, match="sent"):
            pair.bus.send_frame(0x404, b"0")


def test_a_bus_of_messages_alone_carries_frames() -> None:
    """Protects other buses: what only knows messages can stand in, error frames included."""

    class Messages:
        def __init__(self) -> None:
            self.sent: list[can.Message] = []

        def send(self, message: can.Message) -> None:
            self.sent.append(message)

        def receive(self, deadline_ns: int) -> can.Message | None:
            return can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8))

        def close(self) -> None: ...

    bus = Messages()
    frames = frames_of(bus)
    frames.send_frame(0x401, b"\xaa")
    assert raw_frame(bus.sent[0]) == (0x401, b"\xaa")
    assert frames.receive_frame(0) == (0x20000040, bytes(8))
