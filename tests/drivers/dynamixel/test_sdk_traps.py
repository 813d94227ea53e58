"""Traps of dynamixel-sdk 4.1.0 that no other test shows: each first as the SDK has it, then as it is here.

If a later SDK mends one, its test says so, and the way round it can go. The others stand where their subject is tested;
docs/motors.md lists all. Source: dynamixel reference 5.4, 5.5, 6.1, 7.
"""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Iterator
from typing import Any

import dynamixel_sdk
import pytest
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from drivers.clock import Readable, VirtualClock
from drivers.dynamixel.bus import Status, sync_write_parameters
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.control_tables import XM430_W350
from drivers.dynamixel.motor import TendonMotor
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.protocol2_bus import Protocol2Bus
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import DeviceError, NoReplyError, ProtocolError
from drivers.simulated.serial_lines import client_baud

ACCESS_ERRORS = bytes.fromhex("FF FF FD 00 01 04 00 55 07 B0 8C" + "FF FF FD 00 02 04 00 55 07 38 8C")


class SilentLine:
    """Takes everything, says nothing."""

    def write(self, data: bytes) -> None: ...
    def read(self, max_bytes: int) -> bytes:
        return b""

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return None

    def discard_input(self) -> None: ...
    def close(self) -> None: ...


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """A pty's slave descriptor and path; nobody answers."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield slave, os.ttyname(slave)
    os.close(slave)
    os.close(master)


def read_by_sdk(rig: Any, length: int = 2) -> Any:
    """The SDK's group read of two motors' current, over the same port."""
    group = GroupSyncRead(rig.port, PacketHandler(2.0), 126, length)
    for motor_id in (1, 2):
        group.addParam(motor_id)
    assert group.txRxPacket() == COMM_SUCCESS
    return group


def test_the_error_byte_of_a_group_read(rig_of: Any) -> None:
    """The SDK throws it away: nobody would hear that motor 2 is overloaded."""
    rig = rig_of((1, 1020, 2), (2, 1020, 2))
    rig.motors[1]["hardware"] = 0x20
    group = read_by_sdk(rig)
    assert [group.isAvailable(motor_id, 126, 2) for motor_id in (1, 2)] == [True, True]
    first, second = Protocol2Bus(rig.port).read_group(126, 2, (1, 2))
    assert (first, second) == (Status(1, False, b"\0\0"), Status(2, True, b"\0\0"))


def test_the_crc_of_an_error_is_not_data(rig_of: Any) -> None:
    """Both motors refuse; the SDK reports success and gives each status's CRC out as its current."""
    rig = rig_of((1, 1020, 2), (2, 1020, 2))
    refusals = [ACCESS_ERRORS[:11], ACCESS_ERRORS[11:]] * 2
    rig.line.spoil = lambda answer: refusals.pop(0)
    assert read_by_sdk(rig).getData(1, 126, 2) == 0x8CB0
    for failure in Protocol2Bus(rig.port).read_group(126, 2, (1, 2)):
        assert isinstance(failure, ProtocolError)
    rig.line.spoil = lambda answer: ACCESS_ERRORS[:11]
    assert PacketHandler(2.0).read2ByteTxRx(rig.port, 1, 126) == (0x8CB0, 0, 7)
    rig.port.distrust()
    with pytest.raises(ProtocolError, match="access error"):
        Protocol2Bus(rig.port).read(1, 126, 2)


def test_negative_values_are_negative(rig_of: Any) -> None:
    """The most frequent report of users: −37 counts read as 65 499."""
    rig = rig_of((1, 1020, 2))
    rig.motors[0]["effort"] = -37
    assert PacketHandler(2.0).read2ByteTxRx(rig.port, 1, 126)[0] == 65499
    motor = TendonMotor(Protocol2Bus(rig.port), MotorSettings(1, 1, 0), XM430_W350)
    assert motor.read("present_current") == -37


def test_a_silent_motor_is_waited_for_once() -> None:
    """The SDK asks the port again and again, for 34 ms at 90 % of a core; here the clock is asked to wait once."""

    class CountingClock(VirtualClock):
        waits = 0

        def wait_readable(self, source: Readable, deadline_ns: int) -> bool:
            self.waits += 1
            return super().wait_readable(source, deadline_ns)

    clock = CountingClock()
    with pytest.raises(NoReplyError):
        Protocol2Bus(WaitingPort(SilentLine(), clock)).read(1, 126, 2)
    assert clock.waits == 1
    assert clock.now_ns() < 5_000_000


def test_the_default_time_out_is_not_the_sdk_s(terminal: tuple[int, str]) -> None:
    """34 ms for a silent motor, of which 32 are the adapter's default latency, whatever it is set to."""
    port = PortHandler(terminal[1])
    port.openPort()
    port.setPacketTimeout(11)
    assert 34.0 < port.packet_timeout < 35.0
    port.closePort()
    clock = VirtualClock()
    ours = WaitingPort(SerialLine(terminal[1], 1_000_000), clock)
    ours.setPacketTimeout(11)
    clock.advance_to_ns(5_000_000)
    assert ours.isPacketTimeout()
    ours.close()


def test_a_rate_is_set_without_closing_the_line(terminal: tuple[int, str]) -> None:
    """The SDK opens at 1 Mbit/s, and closes and opens the port again to set a rate, of which it knows seventeen."""
    port = PortHandler(terminal[1])
    port.openPort()
    before = port.ser
    port.setBaudRate(57_600)
    assert port.ser is not before
    assert not port.setBaudRate(57_142)
    port.closePort()
    line = SerialLine(terminal[1], 57_142)
    assert client_baud(terminal[0]) == 57_142
    assert not hasattr(WaitingPort, "setBaudRate")
    line.close()


def test_the_port_is_locked(terminal: tuple[int, str]) -> None:
    """Two SDK clients open one port without a word; beside ours nobody who asks gets it."""
    first, second = PortHandler(terminal[1]), PortHandler(terminal[1])
    assert first.openPort()
    assert second.openPort()
    first.closePort()
    second.closePort()
    line = SerialLine(terminal[1], 1_000_000)
    with pytest.raises(DeviceError, match="another process holds it"):
        SerialLine(terminal[1], 1_000_000)
    line.close()


def test_unplugging_is_no_termios_error() -> None:
    """The SDK lets termios.error through and keeps the port busy for ever; here it is a BusError each time."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)
    port = PortHandler(path)
    port.openPort()
    os.close(slave)
    os.close(master)
    with pytest.raises(Exception, match="Input/output error") as caught:
        PacketHandler(2.0).ping(port, 1)
    assert not isinstance(caught.value, DeviceError)
    assert PacketHandler(2.0).ping(port, 1)[1] == dynamixel_sdk.COMM_PORT_BUSY
    master, slave = pty.openpty()
    tty.setraw(slave)
    ours = WaitingPort(SerialLine(os.ttyname(slave), 1_000_000), VirtualClock())
    os.close(slave)
    os.close(master)
    for _ in range(2):
        with pytest.raises(DeviceError, match="serial line"):
            Protocol2Bus(ours).ping(1)


def test_received_stuffing_is_taken_out() -> None:
    """After one stuffed group the SDK also eats an FD of plain FF FD FD; what it does on transmit is packet A18x."""
    sdk, ours = Protocol2PacketHandler(), Protocol2Bus(WaitingPort(SilentLine(), VirtualClock()))._handler
    stuffed = [0xFF, 0xFF, 0xFD, 0, 1, 14, 0, 0x55, 0, 0xFF, 0xFF, 0xFD, 0xFD, 0xFF, 0xFD, 0xFD, 7, 8, 9, 1, 2]
    assert sdk.removeStuffing(list(stuffed))[5] == 12
    assert ours.removeStuffing(list(stuffed))[5] == 13  # type: ignore[attr-defined]  # not of what buses use


def test_a_sync_write_of_unequal_lengths_is_not_sent() -> None:
    """The SDK takes data that are too short, and ends in an IndexError when it sends them."""
    group = GroupSyncWrite(WaitingPort(SilentLine(), VirtualClock()), PacketHandler(2.0), 116, 4)
    group.addParam(1, [1, 2])
    with pytest.raises(IndexError):
        group.txPacket()
    with pytest.raises(ValueError, match="the same length"):
        sync_write_parameters({1: b"\x01\x02\x03\x04", 2: b"\x01\x02"})


def test_a_failed_read_is_not_zero(rig_of: Any) -> None:
    """The SDK answers 0 and a result code that is easily passed over; a goal of 0 once drove a robot into itself."""
    rig = rig_of((1, 1020, 2))
    rig.motors[0].silent = True
    value, result, _ = PacketHandler(2.0).read4ByteTxRx(rig.port, 1, 132)
    assert value == 0
    assert result != COMM_SUCCESS
    rig.port.distrust()
    with pytest.raises(NoReplyError):
        TendonMotor(Protocol2Bus(rig.port), MotorSettings(1, 1, 0), XM430_W350).inspect()
    assert rig.motors[0].writes == []
