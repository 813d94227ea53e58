"""Every worked packet of dynamixel reference 4.3 in both directions: the driver sends it or understands it, and the
simulated motor understands it or produces it. The bytes are the reference's; nobody's packer is asked for them.

A16, B1 and B7 the driver never sends (bulk reads; a ping of protocol 1.0 looks like a status); there the vendor's SDK
is the other side.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from dynamixel_sdk import GroupBulkRead, PacketHandler

from drivers.clock import VirtualClock
from drivers.dynamixel.bus import MotorBus, PingAnswer, Status
from drivers.dynamixel.control_tables import MX_28, XM430_W350
from drivers.dynamixel.discovery import motor_bus
from drivers.dynamixel.port import WaitingPort
from drivers.errors import ProtocolError
from tests.drivers.simulated.motor_bench import Bench

PACKETS = {
    "A1": "FF FF FD 00 02 03 00 01 19 72",
    "A2": "FF FF FD 00 02 07 00 55 00 FC 03 2D 1D 73",
    "A3": "FF FF FD 00 01 07 00 02 7E 00 02 00 35 49",
    "A4": "FF FF FD 00 01 06 00 55 00 DB FF CB 83",
    "A5": "FF FF FD 00 01 06 00 03 40 00 01 DB 66",
    "A6": "FF FF FD 00 01 04 00 55 00 A1 0C",
    "A7": "FF FF FD 00 02 07 00 03 66 00 6A FF 45 EB",
    "A8": "FF FF FD 00 01 06 00 03 09 00 00 69 63",
    "A9": "FF FF FD 00 01 06 00 03 62 00 05 68 E4",
    "A10": "FF FF FD 00 FE 0D 00 83 66 00 02 00 01 78 00 02 78 00 4F 84",
    "A11": "FF FF FD 00 FE 09 00 82 7E 00 0A 00 01 02 38 92",
    "A12": "FF FF FD 00 01 0E 00 55 00 D2 00 FD FF FF FF 00 08 00 00 B7 1C",
    "A13": "FF FF FD 00 02 0E 00 55 80 00 00 00 00 00 00 D2 05 00 00 CA BB",
    "A14": "FF FF FD 00 FE 09 00 8A 7E 00 0A 00 01 02 BB 1A",
    "A15": "FF FF FD 00 FE 1D 00 55 00 01 D2 00 FD FF FF FF 00 08 00 00 2C 77"
    " 00 02 DB FF 00 00 00 00 D2 05 00 00 7C 71",
    "A16": "FF FF FD 00 FE 0D 00 92 01 46 00 01 00 02 90 00 03 00 66 F9",
    "A17": "FF FF FD 00 01 05 00 55 80 20 99 21",
    "A18": "FF FF FD 00 01 0A 00 03 74 00 FF FF FD FD 00 21 E7",
    "A18x": "FF FF FD 00 01 09 00 03 74 00 FF FF FD 00 C9 07",
    "A19": "FF FF FD 00 01 03 00 08 2F 4E",
    "A20": "FF FF FD 00 02 04 00 55 04 32 8C",
    "A21": "FF FF FD 00 01 04 00 55 07 B0 8C",
    "B1": "FF FF 01 02 01 FB",
    "B2": "FF FF 01 02 00 FC",
    "B3": "FF FF 01 04 02 24 08 CC",
    "B4": "FF FF 01 0A 00 FF 07 00 00 C8 04 78 29 81",
    "B5": "FF FF 02 05 03 22 99 01 39",
    "B6": "FF FF FE 0A 83 1E 02 01 00 02 02 58 02 F5",
    "B7": "FF FF FE 09 92 00 08 01 24 08 02 24 0B",
    "B8": "FF FF 01 02 20 DC",
    "B9": "FF FF 01 04 03 18 00 DF",
}
OK_OF_2 = "FF FF FD 00 02 04 00 55 00 29 0C"
P1_OK_OF_2 = "FF FF 02 02 00 FB"


def packet(name: str) -> bytes:
    return bytes.fromhex(PACKETS.get(name, name))


class PreparedLine:
    """Keeps what is sent; each request is answered by the next prepared bytes."""

    def __init__(self, *answers: bytes) -> None:
        self.sent: list[bytes] = []
        self._answers = list(answers)
        self._arrived = b""

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self._arrived = self._answers.pop(0) if self._answers else b""

    def read(self, max_bytes: int) -> bytes:
        data, self._arrived = self._arrived[:max_bytes], self._arrived[max_bytes:]
        return data

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return 0 if self._arrived else None

    def discard_input(self) -> None:
        self._arrived = b""

    def close(self) -> None:
        self._arrived = b""


def driver(protocol: int, *answers: str) -> tuple[MotorBus, PreparedLine]:
    line = PreparedLine(*(b"".join(packet(name) for name in answer.split("+")) for answer in answers))
    return motor_bus(protocol, WaitingPort(line, VirtualClock())), line


@pytest.mark.parametrize(
    ("sent", "protocol", "act", "answered"),
    [
        ("A1", 2, lambda bus: bus.ping(2), "A2"),
        ("A3", 2, lambda bus: bus.read(1, 126, 2), "A4"),
        ("A5", 2, lambda bus: bus.write(1, 64, b"\x01"), "A6"),
        ("A7", 2, lambda bus: bus.write(2, 102, (-150).to_bytes(2, "little", signed=True)), OK_OF_2),
        ("A8", 2, lambda bus: bus.write(1, 9, b"\x00"), "A6"),
        ("A9", 2, lambda bus: bus.write(1, 98, b"\x05"), "A6"),
        ("A10", 2, lambda bus: bus.sync_write(102, {1: b"\x78\x00", 2: b"\x78\x00"}), ""),
        ("A11", 2, lambda bus: bus.read_group(126, 10, (1, 2)), "A12+A13"),
        ("A14", 2, lambda bus: bus.try_fast_read(126, 10, (1, 2)), "A15"),
        ("A18", 2, lambda bus: bus.write(1, 116, b"\xff\xff\xfd\x00"), "A6"),
        ("A19", 2, lambda bus: bus.reboot(1), "A6"),
        ("B3", 1, lambda bus: bus.read(1, 36, 8), "B4"),
        ("B5", 1, lambda bus: bus.write(2, 34, (409).to_bytes(2, "little")), P1_OK_OF_2),
        ("B6", 1, lambda bus: bus.sync_write(30, {1: b"\x00\x02", 2: b"\x58\x02"}), ""),
        ("B9", 1, lambda bus: bus.write(1, 24, b"\x00"), "B2"),
    ],
)
def test_the_driver_sends_it(sent: str, protocol: int, act: Callable[[MotorBus], object], answered: str) -> None:
    """What leaves for the motors is what the reference worked out, and its worked answer is no error."""
    bus, line = driver(protocol, answered)
    act(bus)
    assert line.sent == [packet(sent)]


def number(data: bytes, start: int, stop: int) -> int:
    return int.from_bytes(data[start:stop], "little", signed=True)


@pytest.mark.parametrize(
    ("answer", "protocol", "act", "meaning"),
    [
        ("A2", 2, lambda bus: bus.ping(2), PingAnswer(1020, 45, False)),
        ("A4", 2, lambda bus: number(bus.read(1, 126, 2).parameters, 0, 2), -37),
        ("A6", 2, lambda bus: bus.write(1, 64, b"\x01"), Status(1, False, b"")),
        ("A17", 2, lambda bus: bus.read(1, 70, 1), Status(1, True, b"\x20")),
        ("B2", 1, lambda bus: bus.write(1, 24, b"\x00"), Status(1, False, b"")),
        ("B4", 1, lambda bus: bus.read(1, 36, 8), Status(1, False, bytes.fromhex("FF 07 00 00 C8 04 78 29"))),
        ("B8", 1, lambda bus: bus.write(1, 24, b"\x00"), Status(1, True, b"", alarms=0x20)),
    ],
)
def test_the_driver_understands_it(
    answer: str, protocol: int, act: Callable[[MotorBus], object], meaning: object
) -> None:
    """Values, alert and alarms as the reference explains them."""
    assert act(driver(protocol, answer)[0]) == meaning


@pytest.mark.parametrize(
    ("answers", "fast", "meaning"),
    [
        ("A12+A13", False, [(False, 210, -3, 2048), (True, 0, 0, 1490)]),
        ("A15", True, [(False, 210, -3, 2048), (False, -37, 0, 1490)]),
    ],
)
def test_the_driver_understands_both_motors(
    answers: str, fast: bool, meaning: list[tuple[bool, int, int, int]]
) -> None:
    """A12, A13, A15: each motor's current, velocity, position and alert."""
    bus, _ = driver(2, *([answers] * (1 + fast)))
    assert bus.try_fast_read(126, 10, (1, 2)) if fast else True
    seen = []
    for status in bus.read_group(126, 10, (1, 2)):
        assert isinstance(status, Status)
        data = status.parameters
        seen.append((status.alert, number(data, 0, 2), number(data, 2, 6), number(data, 6, 10)))
    assert seen == meaning


@pytest.mark.parametrize(("answer", "motor_id", "reason"), [("A20", 2, "data range error"), ("A21", 1, "access error")])
def test_the_driver_takes_it_for_a_refusal(answer: str, motor_id: int, reason: str) -> None:
    """No value comes of a status that refuses."""
    with pytest.raises(ProtocolError, match=reason):
        driver(2, answer)[0].read(motor_id, 126, 2)


def test_the_driver_never_sends_a18x() -> None:
    """Unstuffed, as the bare SDK has it: the motor would not accept it."""
    bus, line = driver(2, "A6")
    bus.write(1, 116, b"\xff\xff\xfd\x00")
    assert line.sent != [packet("A18x")]
    bare = PreparedLine()
    PacketHandler(2.0).writeTxOnly(WaitingPort(bare, VirtualClock()), 1, 116, 4, [0xFF, 0xFF, 0xFD, 0x00])
    assert bare.sent == [packet("A18x")]


# the simulated motor's side


def _of_a11(bench: Bench) -> None:
    first, second = (motor.value for motor in bench.sim.motors)
    assert first("present_current") == second("present_current") == 0
    for name, value in {"present_current": 210, "present_velocity": -3, "present_position": 2048}.items():
        bench.sim.motors[0].put(name, value)
    for name, value in {"present_position": 1490, "hardware_error_status": 0x20}.items():
        bench.sim.motors[1].put(name, value)


def _of_a14(bench: Bench) -> None:
    _of_a11(bench)
    for name, value in {"present_current": -37, "hardware_error_status": 0}.items():
        bench.sim.motors[1].put(name, value)


def _of_b3(bench: Bench) -> None:
    for name, value in {"present_position": 2047, "present_load": -200, "present_temperature": 41}.items():
        bench.sim.motors[0].put(name, value)


@pytest.mark.parametrize(
    ("request_name", "prepare", "answers"),
    [
        ("A1", lambda bench: None, "A2"),
        ("A3", lambda bench: bench.sim.motors[0].put("present_current", -37), "A4"),
        ("A5", lambda bench: None, "A6"),
        ("A7", lambda bench: None, OK_OF_2),
        ("A8", lambda bench: None, "A6"),
        ("A9", lambda bench: None, "A6"),
        ("A10", lambda bench: None, ""),
        ("A11", _of_a11, "A12+A13"),
        ("A14", _of_a14, "A15"),
        ("A19", lambda bench: None, "A6"),
        ("B1", lambda bench: None, "B2"),
        ("B1", lambda bench: bench.sim.trip(0, 0x20), "B8"),
        ("B3", _of_b3, "B4"),
        ("B5", lambda bench: None, P1_OK_OF_2),
        ("B6", lambda bench: None, ""),
        ("B9", lambda bench: None, "B2"),
    ],
)
def test_the_simulated_motor_answers_it(request_name: str, prepare: Callable[[Bench], None], answers: str) -> None:
    """Byte for byte, from the state that the reference's answer tells of."""
    bench = Bench(XM430_W350 if request_name.startswith("A") else MX_28)
    prepare(bench)
    expected = b"".join(packet(name) for name in answers.split("+"))
    assert bench.sim.receive(packet(request_name), 0) == expected


@pytest.mark.parametrize(
    ("request_name", "register", "values"),
    [
        ("A5", "torque_enable", (1, 0)),
        ("A7", "goal_current", (1193, -150)),
        ("A8", "return_delay_time", (0, 250)),
        ("A10", "goal_current", (120, 120)),
        ("B5", "torque_limit", (1023, 409)),
        ("B6", "goal_position", (512, 600)),
        ("B9", "torque_enable", (0, 0)),
    ],
)
def test_the_simulated_motor_does_it(request_name: str, register: str, values: tuple[int, int]) -> None:
    """The registers hold what the reference says was written; torque was on before B9."""
    bench = Bench(XM430_W350 if request_name.startswith("A") else MX_28)
    if request_name == "B9":
        bench.sim.motors[0].put("torque_enable", 1)
    bench.sim.receive(packet(request_name), 0)
    assert tuple(motor.value(register) for motor in bench.sim.motors) == values


def test_the_simulated_motor_answers_bulk_reads() -> None:
    """A16 with A17 in its answer, and B7 with B4, though the driver asks neither."""
    bench = Bench(XM430_W350)
    bench.sim.motors[0].put("hardware_error_status", 0x20)
    assert bench.sim.receive(packet("A16"), 0).startswith(packet("A17"))
    bench = Bench(MX_28)
    _of_b3(bench)
    answer = bench.sim.receive(packet("B7"), 0)
    assert answer[:14] == packet("B4")
    assert answer[14:-1] == bytes.fromhex("FF FF 02 0A 00 00 00 00 00 00 00 78 1E")


def test_the_simulated_motor_refuses_as_worked_out() -> None:
    """A18 means 16 646 143 ticks, beyond its range: A20's refusal of motor 1; A20 itself of motor 2; A21 of a read."""
    bench = Bench(XM430_W350)
    assert bench.sim.receive(packet("A18"), 0)[8] == 0x04
    assert bench.write(2, "operating_mode", 99) == 0x04
    out_of_range = bytes.fromhex("FF FF FD 00 02 06 00 03 0B 00 63") + b"\0\0"
    crc = PacketHandler(2.0).updateCRC(0, list(out_of_range), len(out_of_range) - 2)
    assert bench.sim.receive(out_of_range[:-2] + crc.to_bytes(2, "little"), 0) == packet("A20")
    beyond = bytes.fromhex("FF FF FD 00 01 07 00 02 00 10 02 00") + b"\0\0"
    crc = PacketHandler(2.0).updateCRC(0, list(beyond), len(beyond) - 2)
    assert bench.sim.receive(beyond[:-2] + crc.to_bytes(2, "little"), 0) == packet("A21")


def test_the_simulated_motor_does_not_accept_a18x() -> None:
    """Its body looks like a header: it is answered, if at all, by an error, and no goal is taken."""
    bench = Bench(XM430_W350)
    bench.sim.receive(packet("A18x"), 0)
    assert bench.read(1, "goal_position") == 0


def test_the_sdk_sends_what_the_driver_does_not() -> None:
    """A16, B1 and B7 as the unmodified SDK packs them: the simulated motors are right with other clients too."""
    line = PreparedLine()
    port: Any = WaitingPort(line, VirtualClock())
    bulk = GroupBulkRead(port, PacketHandler(2.0))
    bulk.addParam(1, 70, 1)
    bulk.addParam(2, 144, 3)
    bulk.txPacket()
    port.is_using = False
    PacketHandler(1.0).bulkReadTx(port, [8, 1, 36, 8, 2, 36], 6)
    port.is_using = False
    PacketHandler(1.0).ping(port, 1)
    assert line.sent[:3] == [packet("A16"), packet("B7"), packet("B1")]


def test_no_packet_is_forgotten() -> None:
    """Each of the reference's rows is named in this file beside its bytes."""
    text = Path(__file__).read_text(encoding="utf-8")
    for name in PACKETS:
        assert text.count(f'"{name}"') + text.count(f"+{name}") + text.count(f"{name}+") >= 2, name
