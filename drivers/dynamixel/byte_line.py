"""A line of bytes: what the motor port writes to and reads from, and the real serial one.

`SerialLine` opens a serial device or a pty's slave side through pyserial, 8N1, raw, non-blocking and locked against a
second process: two processes on one port corrupt each other silently (dynamixel reference 5.5). flock keeps out those
who ask, TIOCEXCL those who do not. Any baud rate is accepted, 57 142 too. Every way in which an unplugged adapter shows
itself becomes a BusError.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import termios
from pathlib import Path
from typing import Protocol

import serial

from drivers.errors import BusError, InputError


class ByteLine(Protocol):
    """A two-way line of bytes; also what a `Clock` can wait for (`drivers.clock.Readable`)."""

    def write(self, data: bytes) -> None:
        """Hand over all of `data`; BusError if that is not possible."""
        ...

    def read(self, max_bytes: int) -> bytes:
        """What has arrived, at most `max_bytes`; empty if nothing; never waits. BusError if the line is gone.

        A line that has come to its end may instead be readable (to `select`) and yet empty.
        """
        ...

    def fileno(self) -> int:
        """File descriptor to select on; −1 for a virtual line."""
        ...

    def next_arrival_ns(self) -> int | None:
        """Virtual time at which the next bytes arrive (may be past); None on a real line."""
        ...

    def discard_input(self) -> None:
        """Throw away what has arrived."""
        ...

    def close(self) -> None:
        """Give the line back; may be called twice."""
        ...


USB_SERIAL_DEVICES = Path("/sys/bus/usb-serial/devices")
_PTY_MAJORS = range(136, 144)  # Linux' numbers of /dev/pts

# pyserial lets termios.error and bare OSError through beside its own exception, and TypeError once it is closed
_LINE_ERRORS = (serial.SerialException, termios.error, OSError, TypeError, ValueError)


class SerialLine:
    """A serial device (`/dev/ttyUSB0`) or pty at `baud` bit/s."""

    def __init__(self, path: str, baud: int) -> None:
        if baud <= 0:
            raise InputError(f"baud = {baud} is not a baud rate; expected a positive number of bits per second.")
        self.path = path
        try:
            self._serial = serial.Serial(port=path, baudrate=baud, timeout=0, exclusive=True)
            self._descriptor: int = self._serial.fileno()
            if not _is_pty(self._descriptor):
                fcntl.ioctl(self._descriptor, termios.TIOCEXCL)
            self._serial.reset_input_buffer()
        except _LINE_ERRORS as error:
            raise _not_opened(path, error) from error

    @property
    def latency_timer_file(self) -> Path:
        """Where the kernel keeps the USB adapter's latency timer; other devices have no such file."""
        return USB_SERIAL_DEVICES / Path(self.path).resolve().name / "latency_timer"

    @property
    def latency_timer_ms(self) -> int | None:
        """The USB adapter's latency timer, ms: 1 is wanted (dynamixel reference 5.2). None if it has none."""
        try:
            return int(self.latency_timer_file.read_text())
        except (OSError, ValueError):
            return None

    @property
    def advice(self) -> str:
        """What to do about a latency timer that is too long; empty if it is right or if there is none."""
        latency_ms = self.latency_timer_ms
        if latency_ms is None or latency_ms <= 1:
            return ""
        return (
            f"{self.path}: the USB adapter keeps answers back for {latency_ms} ms (latency timer), expected 1: motor "
            f"data come at no more than {1000 // latency_ms} Hz. As root: echo 1 > {self.latency_timer_file}; "
            'for good, a udev rule (docs/motors.md): ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", '
            'ATTR{latency_timer}="1".'
        )

    def write(self, data: bytes) -> None:
        # not pyserial's write, which waits by itself: packets are far smaller than the kernel's buffer
        try:
            written = os.write(self._descriptor, data)
        except _LINE_ERRORS as error:
            raise self._error("does not take bytes", error) from error
        if written != len(data):
            raise self._error("does not take bytes", f"{written} of {len(data)} written")

    def read(self, max_bytes: int) -> bytes:
        try:
            return os.read(self._descriptor, max_bytes)
        except BlockingIOError:
            return b""
        except _LINE_ERRORS as error:
            raise self._error("cannot be read", error) from error

    def fileno(self) -> int:
        return self._descriptor

    def next_arrival_ns(self) -> int | None:
        return None

    def discard_input(self) -> None:
        try:
            termios.tcflush(self._descriptor, termios.TCIFLUSH)
        except _LINE_ERRORS as error:
            raise self._error("cannot be flushed", error) from error

    def close(self) -> None:
        if self._descriptor >= 0:
            with contextlib.suppress(*_LINE_ERRORS):  # an unplugged one has nothing to give back
                fcntl.ioctl(self._descriptor, termios.TIOCNXCL)
        self._descriptor = -1
        try:
            self._serial.close()
        except _LINE_ERRORS as error:
            raise self._error("cannot be closed", error) from error

    def _error(self, what: str, cause: object) -> BusError:
        return BusError(
            self.path, f"serial line {what}: {cause}.", help="Check the adapter's plug and power, then start again."
        )


def _is_pty(descriptor: int) -> bool:
    """A pty's other side keeps it open, so that an exclusive mark would outlive a client that crashed."""
    return os.major(os.fstat(descriptor).st_rdev) in _PTY_MAJORS


def _not_opened(path: str, error: Exception) -> BusError:
    number = getattr(error, "errno", None)
    cause = error.__context__
    if number is None and isinstance(cause, OSError | termios.error) and cause.args:
        number = cause.args[0]  # pyserial words it anew
    unknown = (f"serial line cannot be opened: {error}.", "Is the adapter plugged in, and is the path right?")
    reason, help = _REASONS.get(number or 0, unknown)
    return BusError(path, reason, help=help.format(path=path))


_BUSY = (
    "serial line cannot be opened: another process holds it.",
    "Stop it: `fuser {path}` names it. Two programs on one bus corrupt each other's packets.",
)
_REASONS: dict[int, tuple[str, str]] = {
    errno.ENOENT: (
        "serial line cannot be opened: there is no such device.",
        "Plug the adapter in and see /dev/serial/by-id; the path is tendons.port in robot.toml.",
    ),
    errno.EACCES: (
        "serial line cannot be opened: this user may not.",
        "Add the user to the group of the device (`ls -l {path}`; dialout on Debian and Ubuntu) and log in again.",
    ),
    errno.EBUSY: _BUSY,
    errno.EAGAIN: _BUSY,
    errno.ENOTTY: ("is not a serial line.", "Give the path of the USB adapter, such as /dev/ttyUSB0."),
}
