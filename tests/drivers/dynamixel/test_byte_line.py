"""The real serial line, on pseudo terminals."""

import os
import pty
import tty
from collections.abc import Iterator

import pytest

from drivers.clock import MonotonicClock
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.port import WaitingPort
from drivers.errors import BusError, InputError


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """Master descriptor and slave path of a raw pty, as a simulator would keep it."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:
            continue  # the test has unplugged it


def test_bytes_pass_unchanged_at_an_odd_baud_rate(terminal: tuple[int, str]) -> None:
    """57 142 baud is what RX and MX hands run at, and no byte may be taken for a control character."""
    master, path = terminal
    line = SerialLine(path, 57142)
    line.write(bytes(range(256)))
    assert os.read(master, 1000) == bytes(range(256))
    os.write(master, b"\x00\x03\x11\x13\xff\r\n")
    assert line.read(100) == b"\x00\x03\x11\x13\xff\r\n"
    assert line.read(100) == b""
    line.close()
    line.close()


def test_second_opener_is_refused(terminal: tuple[int, str]) -> None:
    """Two processes on one port corrupt each other silently (reference 5.5)."""
    _, path = terminal
    line = SerialLine(path, 1_000_000)
    with pytest.raises(BusError, match="cannot be opened"):
        SerialLine(path, 1_000_000)
    line.close()
    SerialLine(path, 1_000_000).close()


def test_unplugging_is_a_bus_error(terminal: tuple[int, str]) -> None:
    """An unplugged adapter shows itself as termios.error, OSError or SerialException; all must become one error."""
    master, path = terminal
    line = SerialLine(path, 1_000_000)
    os.close(master)
    port = WaitingPort(line, MonotonicClock())
    port.setPacketTimeout(11)
    with pytest.raises(BusError):
        port.readPort(11)
    with pytest.raises(BusError):
        port.writePort([1])
    line.close()
    with pytest.raises(BusError):
        line.discard_input()


def test_missing_device_and_bad_baud_are_named() -> None:
    """A wrong path or rate is the first thing a user gets wrong."""
    with pytest.raises(BusError, match="/dev/no-such-adapter"):
        SerialLine("/dev/no-such-adapter", 1_000_000)
    with pytest.raises(InputError, match="baud = 0"):
        SerialLine("/dev/null", 0)
