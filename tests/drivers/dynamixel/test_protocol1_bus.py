"""Protocol 1.0 transactions against the worked packets of the reference, literal motors, and the unmodified SDK."""

from __future__ import annotations

from typing import Any

import dynamixel_sdk
import pytest
from dynamixel_sdk.protocol1_packet_handler import Protocol1PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.dynamixel.bus import PingAnswer, Status
from drivers.dynamixel.control_tables import MX_28
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.protocol1_bus import Protocol1Bus
from drivers.dynamixel.reading import direct_plan
from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError

B4 = "FF FF 01 0A 00 FF 07 00 00 C8 04 78 29 81"


class AnsweringLine:
    """A line that keeps what is written and plays prepared bytes 0.3 ms after each request."""

    def __init__(self, clock: VirtualClock, *replies: bytes) -> None:
        self.clock = clock
        self.sent: list[bytes] = []
        self.replies = list(replies)
        self.arriving: list[tuple[int, bytes]] = []

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        if self.replies:
            self.arriving.append((self.clock.now_ns() + 300_000, self.replies.pop(0)))

    def read(self, max_bytes: int) -> bytes:
        _, data = self.arriving.pop(0)
        if data[max_bytes:]:
            self.arriving.insert(0, (0, data[max_bytes:]))
        return data[:max_bytes]

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self.arriving[0][0] if self.arriving else None

    def discard_input(self) -> None:
        self.arriving = []

    def close(self) -> None:
        self.arriving = []


def make_bus(*replies: str | bytes) -> tuple[Protocol1Bus, AnsweringLine]:
    """A bus whose requests are answered with these packets, hex or bytes, in order."""
    clock = VirtualClock()
    line = AnsweringLine(clock, *(bytes.fromhex(r) if isinstance(r, str) else r for r in replies))
    return Protocol1Bus(WaitingPort(line, clock)), line


def test_block_read_is_the_worked_packet_and_gives_its_values() -> None:
    """B3 and B4: position 2047, standing, 19.6 % of load clockwise, 12 V, 41 °C."""
    bus, line = make_bus(B4)
    status = bus.read(1, 36, 8)
    assert line.sent == [bytes.fromhex("FF FF 01 04 02 24 08 CC")]
    values = direct_plan(MX_28).fast.decode(status.parameters)
    assert values == {
        "present_position": 2047,
        "present_velocity": 0,
        "present_load": -200,
        "present_input_voltage": 120,
        "present_temperature": 41,
    }


def test_alarm_comes_with_the_value_and_refusal_without() -> None:
    """B8: overload tells of the motor, and the answer is good; a range error tells that the request was not done."""
    bus, _ = make_bus("FF FF 01 02 20 DC", "FF FF 01 02 08 F4")
    assert bus.write(1, 24, b"\0") == Status(1, True, b"", alarms=0x20)
    with pytest.raises(ProtocolError, match="refused: range"):
        bus.write(1, 30, b"\xff\x7f")


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        ("FF FF 01 02 00 FC", "expected motor 1 and 14 bytes"),  # no data
        ("FF FF 02 0A 00 FF 07 00 00 C8 04 78 29 80", "expected motor 1"),  # another's
        ("FF FF 01 0A 00 FF 07 00 00 C8 04 78 29 82", "damaged reply"),  # checksum
        ("FF FF 01 0A 00 FF 07", "damaged reply"),  # half of it
    ],
)
def test_wrong_answer_never_yields_a_value(reply: str, reason: str) -> None:
    """Foreign length, foreign id, wrong checksum, half a packet."""
    bus, _ = make_bus(reply)
    with pytest.raises(ProtocolError, match=reason):
        bus.read(1, 36, 8)


@pytest.mark.parametrize("place", [(0, 3), (36, 2), (42, 1), (36, 8)])
def test_echo_is_not_taken_for_an_answer(rig_of: Any, place: tuple[int, int]) -> None:
    """The trap of reference 6.1: behind an echoing adapter the SDK reads the request as the value."""
    rig = rig_of((1, 29, 1), echo=True)
    rig.motors[0]["position"], rig.motors[0]["voltage"] = 1490, 118
    bus = Protocol1Bus(rig.port)
    bus.sync_write(24, {1: b"\1"})  # its echo, too, stands before the answer
    assert bus.read(1, *place).parameters == rig.motors[0].read(*place)
    assert bus.ping(1) == PingAnswer(29, 40, False)


def test_a_silent_echoing_bus_is_silence(rig_of: Any) -> None:
    """With the motor off, the echo alone must not become a motor."""
    rig = rig_of((1, 29, 1), echo=True)
    rig.motors[0].silent = True
    with pytest.raises(NoReplyError):
        Protocol1Bus(rig.port).ping(1)


def test_the_sdk_s_own_traps_are_there_and_not_used(rig_of: Any) -> None:
    """If a later SDK mends its bulk read or its echo, this test says so: then the ways round them can go."""
    rig = rig_of((1, 29, 1), echo=True)
    rig.motors[0]["position"] = 1490
    value, result, error = Protocol1PacketHandler().read2ByteTxRx(rig.port, 1, 36)
    assert (value, result, error) == (36 + 256 * 2, 0, 2)  # the address and length that were asked for
    group = dynamixel_sdk.GroupBulkRead(rig.port, Protocol1PacketHandler())
    group.addParam(1, 36, 8)
    with pytest.raises(TypeError):
        group.txPacket()


def test_one_silent_motor_does_not_silence_the_other(rig_of: Any) -> None:
    """Protocol 1.0 has no group read: each is asked alone, each fails alone."""
    rig = rig_of((1, 28, 1), (2, 28, 1))
    rig.motors[0].silent = True
    dead, living = Protocol1Bus(rig.port).read_group(36, 8, (1, 2))
    assert isinstance(dead, NoReplyError)
    assert isinstance(living, Status)


def test_there_is_no_reboot(rig_of: Any) -> None:
    """The SDK answers −9000; a user needs to hear what to do instead."""
    with pytest.raises(DeviceError, match="no such instruction"):
        Protocol1Bus(rig_of((1, 28, 1)).port).reboot(1)


@given(st.integers(0, 253), st.integers(0, 100), st.binary(min_size=1, max_size=20))
def test_every_request_is_the_sdk_s(motor_id: int, address: int, data: bytes) -> None:
    """For every id, address and content the bytes on the wire are those of the unmodified SDK."""
    bus, line = make_bus()
    clock = VirtualClock()
    theirs = AnsweringLine(clock)
    port = WaitingPort(theirs, clock)
    handler = dynamixel_sdk.PacketHandler(1.0)
    handler.writeTxOnly(port, motor_id, address, len(data), list(data))
    port.is_using = False
    handler.readTx(port, motor_id, address, len(data))
    with pytest.raises(NoReplyError):
        bus.write(motor_id, address, data)
    with pytest.raises(NoReplyError):
        bus.read(motor_id, address, len(data))
    assert line.sent == theirs.sent


@given(st.lists(st.binary(min_size=1, max_size=20), max_size=6))
def test_noise_never_crashes_hangs_or_yields_a_value(chunks: list[bytes]) -> None:
    """Whatever comes in instead of an answer is an error of the tree, within the time-out."""
    clock = VirtualClock()
    line = AnsweringLine(clock, b"".join(chunks))
    with pytest.raises(DeviceError):
        Protocol1Bus(WaitingPort(line, clock)).read(1, 36, 8)
    assert clock.now_ns() < 6_000_000


@given(st.integers(0, 13), st.integers(1, 255))
def test_damaged_answer_never_yields_a_value(position: int, flip: int) -> None:
    """Any single damaged byte of a good answer is noticed, or it is the error byte with the same alarms unseen."""
    damaged = bytearray.fromhex(B4)
    damaged[position] ^= flip
    bus, _ = make_bus(bytes(damaged))
    with pytest.raises(DeviceError):
        bus.read(1, 36, 8)


def test_line_that_ended_is_a_bus_error() -> None:
    """An unplugged adapter is not a silent motor; and the SDK's busy flag must not stay set after it."""

    class EndedLine(AnsweringLine):
        def read(self, max_bytes: int) -> bytes:
            return b""

    clock = VirtualClock()
    bus = Protocol1Bus(WaitingPort(EndedLine(clock, b"\0", b"\0"), clock))
    for _ in range(2):
        with pytest.raises(BusError, match="has ended"):
            bus.read(1, 36, 8)
