"""The real serial line, on pseudo terminals."""

import errno
import fcntl
import os
import pty
import re
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from drivers.clock import MonotonicClock
from drivers.dynamixel import byte_line
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
    with pytest.raises(BusError, match=f"another process holds it.*fuser {path}"):
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
    with pytest.raises(BusError, match=r"/dev/no-such-adapter: .*there is no such device.*robot.toml"):
        SerialLine("/dev/no-such-adapter", 1_000_000)
    with pytest.raises(BusError, match="/dev/null: is not a serial line"):
        SerialLine("/dev/null", 1_000_000)
    with pytest.raises(InputError, match="baud = 0"):
        SerialLine("/dev/null", 0)


def test_a_user_without_permission_hears_of_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests may run as root, whom nothing is forbidden: the system's refusal is played."""

    def refuse(*arguments: object, **settings: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(BusError, match=r"this user may not.*ls -l /dev/ttyUSB0.*dialout"):
        SerialLine("/dev/ttyUSB0", 1_000_000)


def test_a_serial_device_is_exclusive_while_it_is_open(
    terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """flock keeps out only who asks for it; a pty stands for the adapter here, and gets its mark off again."""
    monkeypatch.setattr(byte_line, "_is_pty", lambda descriptor: False)
    _, path = terminal

    def exclusive(descriptor: int) -> bool:
        return fcntl.ioctl(descriptor, getattr(termios, "TIOCGEXCL", 0x80045440), b"\0\0\0\0")[0] == 1

    observer = os.open(path, os.O_RDWR | os.O_NOCTTY)
    line = SerialLine(path, 1_000_000)
    assert exclusive(observer)
    line.close()
    assert not exclusive(observer)
    os.close(observer)


@pytest.mark.parametrize(
    ("timer", "advice"), [("16\n", "for 16 ms .*at no more than 62 Hz.*echo 1 > .*udev"), ("1\n", "$")]
)
def test_the_adapter_s_latency_timer_is_read_and_told(
    terminal: tuple[int, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, timer: str, advice: str
) -> None:
    """16 ms, the default, makes 60 reads a second of whatever baud rate (reference 5.2)."""
    _, path = terminal
    monkeypatch.setattr(byte_line, "USB_SERIAL_DEVICES", tmp_path)
    line = SerialLine(path, 1_000_000)
    assert (line.latency_timer_ms, line.advice) == (None, "")
    line.latency_timer_file.parent.mkdir()
    line.latency_timer_file.write_text(timer)
    assert line.latency_timer_ms == int(timer)
    assert re.search(advice, line.advice)
    assert bool(line.advice) is (timer != "1\n")
    line.close()
