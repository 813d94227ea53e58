"""Port and checked transactions against the worked packets of the reference, and against what a bad line does."""

from typing import Any

import dynamixel_sdk
import pytest
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.dynamixel.bus import PingAnswer, Status
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.protocol2_bus import Protocol2Bus, StuffingPacketHandler
from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError

MILLISECOND = 1_000_000


class ScriptedLine:
    """A virtual line that keeps what is written and plays prepared bytes: (delay after the request in ns, bytes)."""

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.sent: list[bytes] = []
        self.script: list[list[tuple[int, bytes]]] = []
        self.arriving: list[tuple[int, bytes]] = []

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        for delay_ns, reply in self.script.pop(0) if self.script else []:
            self.arriving.append((self.clock.now_ns() + delay_ns, reply))

    def read(self, max_bytes: int) -> bytes:
        time_ns, data = self.arriving.pop(0)
        assert time_ns <= self.clock.now_ns(), "read ahead of time"
        if data[max_bytes:]:
            self.arriving.insert(0, (time_ns, data[max_bytes:]))
        return data[:max_bytes]

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self.arriving[0][0] if self.arriving else None

    def discard_input(self) -> None:
        self.arriving = [item for item in self.arriving if item[0] > self.clock.now_ns()]

    def close(self) -> None:
        self.arriving = []


def make_bus(*replies: str | bytes) -> tuple[Protocol2Bus, ScriptedLine, VirtualClock]:
    """A bus whose requests are answered, 0.3 ms later, by the given packets (hex or bytes) in order."""
    clock = VirtualClock()
    line = ScriptedLine(clock)
    for reply in replies:
        line.script.append([(300_000, bytes.fromhex(reply) if isinstance(reply, str) else reply)])
    return Protocol2Bus(WaitingPort(line, clock)), line, clock


A15 = "FF FF FD 00 FE 1D 00 55 00 01 D2 00 FD FF FF FF 00 08 00 00 2C 77 00 02 DB FF 00 00 00 00 D2 05 00 00 7C 71"
A12 = "FF FF FD 00 01 0E 00 55 00 D2 00 FD FF FF FF 00 08 00 00 B7 1C"
A13 = "FF FF FD 00 02 0E 00 55 80 00 00 00 00 00 00 D2 05 00 00 CA BB"


def test_crc_check_value() -> None:
    """The catalogue's check value of CRC-16/UMTS (reference 4.2)."""
    assert StuffingPacketHandler().updateCRC(0, b"123456789", 9) == 0xFEE8


@given(st.binary(max_size=60))
def test_crc_is_the_sdk_s(data: bytes) -> None:
    """The quicker CRC must be the vendor's for every packet."""
    assert StuffingPacketHandler().updateCRC(0, data, len(data)) == Protocol2PacketHandler().updateCRC(
        0, data, len(data)
    )


@given(st.lists(st.sampled_from([0xFF, 0xFD, 0x00]), max_size=40))
def test_stuffing_is_undone_and_hides_the_header(body: list[int]) -> None:
    """No body may look like a header on the wire, and every body comes back; the SDK's own pair breaks both."""
    length = len(body) + 3
    packet = [0xFF, 0xFF, 0xFD, 0, 1, length, 0, 0x55, *body, 1, 2]
    stuffed = StuffingPacketHandler().addStuffing(list(packet))
    assert b"\xff\xff\xfd\x00" not in bytes(stuffed[7:-2]) + b"\x01"
    assert len(stuffed) == 7 + stuffed[5] + 256 * stuffed[6]
    assert StuffingPacketHandler().removeStuffing(stuffed) == packet


def statuses(bus: Protocol2Bus) -> tuple[Status, ...]:
    """A group read of both motors that must succeed."""
    results = bus.read_group(126, 10, (1, 2))
    assert all(isinstance(result, Status) for result in results), results
    return results  # type: ignore[return-value]  # just asserted


def value_of(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)


def test_fast_sync_read_takes_the_worked_answer_apart() -> None:
    """A14 and A15: one packet for both motors, 210, −3, 2048 and −37, 0, 1490."""
    bus, line, _ = make_bus(A15)
    assert bus.try_fast_read(126, 10, (1, 2))
    assert line.sent == [bytes.fromhex("FF FF FD 00 FE 09 00 8A 7E 00 0A 00 01 02 BB 1A")]
    line.script.append([(300_000, bytes.fromhex(A15))])
    parts = [
        (value_of(s.parameters[:2]), value_of(s.parameters[2:6]), value_of(s.parameters[6:])) for s in statuses(bus)
    ]
    assert parts == [(210, -3, 2048), (-37, 0, 1490)]


def test_errors_inside_a_fast_answer_are_each_motor_s_own() -> None:
    """The SDK throws them away: here motor 1 is in alert and gives its value, motor 2 refuses and gives none."""
    packet = b"\xff\xff\xfd\x00\xfe" + (1 + 2 * 6).to_bytes(2, "little") + b"\x55"
    for error, motor_id in ((0x80, 1), (0x07, 2)):
        packet += bytes((error, motor_id, 0x34, 0x12))
        packet += StuffingPacketHandler().updateCRC(0, packet, len(packet)).to_bytes(2, "little")
    bus, _, _ = make_bus(packet)
    bus.fast = True
    first, second = bus.read_group(126, 2, (1, 2))
    assert first == Status(1, True, b"\x34\x12")
    assert isinstance(second, ProtocolError)
    assert "access error" in second.message


def test_firmware_without_fast_reads_is_read_the_slow_way(rig_of: Any) -> None:
    """Silence on the first try, and never tried again."""
    rig = rig_of((1, 1020, 2), (2, 1020, 2))
    rig.motors[1].fast = False
    bus = Protocol2Bus(rig.port)
    assert not bus.try_fast_read(126, 10, (1, 2))
    assert [s.motor_id for s in statuses(bus)] == [1, 2]


def test_echo_is_passed_over(rig_of: Any) -> None:
    """An adapter that gives the host its own bytes back changes nothing but the time."""
    rig = rig_of((1, 1020, 2), (2, 1020, 2), echo=True)
    bus = Protocol2Bus(rig.port)
    bus.sync_write(102, {1: b"\x78\x00", 2: b"\x78\x00"})
    assert bus.ping(2) == PingAnswer(1020, 45, False)
    assert [s.motor_id for s in statuses(bus)] == [1, 2]


def test_sync_read_keeps_values_and_alert_apart() -> None:
    """A11 to A13: the SDK's group read throws the alert bit of motor 2 away."""
    bus, line, _ = make_bus(bytes.fromhex(A12 + A13))
    first, second = statuses(bus)
    assert line.sent == [bytes.fromhex("FF FF FD 00 FE 09 00 82 7E 00 0A 00 01 02 38 92")]
    parts = [
        (value_of(s.parameters[:2]), value_of(s.parameters[2:6]), value_of(s.parameters[6:])) for s in (first, second)
    ]
    assert parts == [(210, -3, 2048), (0, 0, 1490)]
    assert (first.alert, second.alert) == (False, True)


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        ("FF FF FD 00 01 04 00 55 07 B0 8C", r"refused: access error \(7\)"),  # A21: the SDK yields the CRC as value
        ("FF FF FD 00 01 05 00 55 80 20 99 21", "expected motor 1 and 13 bytes"),  # A17: length of another read
        ("FF FF FD 00 02 04 00 55 04 32 8C", "was ff ff fd 00 02 .* expected motor 1"),  # A20
        ("FF FF FD 00 01 06 00 55 00 DB FF CB 84", "damaged reply"),
        ("FF FF FD 00 01 06 00 55", "damaged reply"),
    ],
)
def test_wrong_answer_never_yields_a_value(reply: str, reason: str) -> None:
    """Refusal, foreign length, foreign id, wrong CRC, half a packet: the traps of reference 6.1."""
    bus, _, _ = make_bus(reply)
    with pytest.raises(ProtocolError, match=reason):
        bus.read(1, 126, 2)


def test_silence_costs_the_margin_and_no_more() -> None:
    """A silent motor may hold the bus for wire time and margin (4.3 ms), not for the SDK's 34 ms."""
    bus, _, clock = make_bus()
    with pytest.raises(NoReplyError, match="tendon motor 1: no reply"):
        bus.read(1, 126, 2)
    assert 4 * MILLISECOND < clock.now_ns() < 4.5 * MILLISECOND


def test_late_reply_is_not_taken_for_the_next() -> None:
    """A reply that comes after its time-out fits the next read of the same length exactly; it must be thrown away."""
    bus, line, clock = make_bus()
    late, fresh = "FF FF FD 00 01 06 00 55 00 DB FF CB 83", bytes.fromhex("FF FF FD 00 01 06 00 55 00 78 00 34 81")
    fresh = bytes(fresh[:-2]) + StuffingPacketHandler().updateCRC(0, fresh, len(fresh) - 2).to_bytes(2, "little")
    line.script = [[(6 * MILLISECOND, bytes.fromhex(late))], [(MILLISECOND, fresh)]]
    with pytest.raises(NoReplyError):
        bus.read(1, 126, 2)
    assert value_of(bus.read(1, 126, 2).parameters) == 120
    assert clock.now_ns() > 8 * MILLISECOND


def test_second_status_of_a_failed_sync_read_is_not_taken_for_the_next() -> None:
    """When motor 1 refuses, motor 2's answer is still under way."""
    bus, line, _ = make_bus()
    refusal = bytes.fromhex("FF FF FD 00 01 04 00 55 07 B0 8C")
    line.script = [[(300_000, refusal), (600_000, bytes.fromhex(A13))], [(300_000, bytes.fromhex(A12 + A13))]]
    for failure in bus.read_group(126, 10, (1, 2)):
        assert isinstance(failure, ProtocolError)
        assert "access error" in failure.message
    assert [s.motor_id for s in statuses(bus)] == [1, 2]


def test_bytes_that_never_stop_do_not_keep_the_bus() -> None:
    """An adapter that babbles must not hang the hand process in the SDK's receive loop."""
    bus, line, clock = make_bus()
    line.script = [[(10_000 * i, b"\xff") for i in range(1, 5000)]]
    with pytest.raises(ProtocolError):
        bus.read(1, 126, 2)
    assert clock.now_ns() < 5 * MILLISECOND


@given(st.lists(st.binary(min_size=1, max_size=30), max_size=8))
def test_noise_never_crashes_hangs_or_yields_a_value(chunks: list[bytes]) -> None:
    """Whatever comes in instead of an answer is an error of the tree, within the time-out."""
    bus, line, clock = make_bus()
    line.script = [[(20_000 * (i + 1), chunk) for i, chunk in enumerate(chunks)]]
    assert all(isinstance(result, DeviceError) for result in bus.read_group(126, 10, (1, 2)))
    assert clock.now_ns() < 6 * MILLISECOND


@given(st.lists(st.binary(min_size=1, max_size=30), max_size=8))
def test_noise_instead_of_a_fast_answer_is_an_error_too(chunks: list[bytes]) -> None:
    """The same for the one answer that the SDK does not unstuff."""
    bus, line, clock = make_bus()
    bus.fast = True
    line.script = [[(20_000 * (i + 1), chunk) for i, chunk in enumerate(chunks)]]
    assert all(isinstance(result, DeviceError) for result in bus.read_group(126, 10, (1, 2)))
    assert clock.now_ns() < 6 * MILLISECOND


@given(st.integers(0, 35), st.integers(1, 255))
def test_damaged_fast_answer_never_yields_a_value(position: int, flip: int) -> None:
    """Only the last CRC covers the whole, and it is the one that is checked."""
    damaged = bytearray.fromhex(A15)
    damaged[position] ^= flip
    bus, _, _ = make_bus(bytes(damaged))
    bus.fast = True
    assert all(isinstance(result, DeviceError) for result in bus.read_group(126, 10, (1, 2)))


@given(
    st.integers(0, 252),
    st.integers(0, 600),
    st.binary(min_size=1, max_size=20).filter(lambda data: b"\xff\xff\xfd" not in data),
)
def test_every_request_without_stuffing_is_the_sdk_s(motor_id: int, address: int, data: bytes) -> None:
    """For every id, address and content the bytes on the wire are those of the unmodified SDK."""
    bus, line, _ = make_bus()
    clock = VirtualClock()
    theirs = ScriptedLine(clock)
    port = WaitingPort(theirs, clock)
    handler = dynamixel_sdk.PacketHandler(2.0)
    handler.writeTxOnly(port, motor_id, address, len(data), list(data))
    port.is_using = False
    handler.readTx(port, motor_id, address, len(data))
    with pytest.raises(NoReplyError):
        bus.write(motor_id, address, data)
    with pytest.raises(NoReplyError):
        bus.read(motor_id, address, len(data))
    assert line.sent == theirs.sent


@given(st.integers(0, 20), st.integers(1, 255))
def test_damaged_answer_never_yields_a_value(position: int, flip: int) -> None:
    """Any single damaged byte of a good answer is noticed."""
    damaged = bytearray.fromhex(A12)
    damaged[position] ^= flip
    bus, _, _ = make_bus(bytes(damaged))
    with pytest.raises(DeviceError):
        bus.read(1, 126, 10)


def test_line_that_ended_is_a_bus_error_and_the_bus_recovers() -> None:
    """End of file is not a time-out; and the SDK's busy flag must not stay set after it."""

    class EndedLine(ScriptedLine):
        def read(self, max_bytes: int) -> bytes:
            return b""

    clock = VirtualClock()
    line = EndedLine(clock)
    line.script = [[(100_000, b"\0")], [(100_000, b"\0")]]
    bus = Protocol2Bus(WaitingPort(line, clock))
    for _ in range(2):
        with pytest.raises(BusError, match="has ended"):
            bus.read(1, 126, 2)
