"""A line of bytes: what the motor port writes to and reads from, and the real serial one.

`SerialLine` opens a serial device or a pty's slave side through pyserial, 8N1, raw, non-blocking and locked (flock)
against a second process: two processes on one port corrupt each other silently (dynamixel reference 5.5). Any baud rate
is accepted, 57 142 too. Every way in which an unplugged adapter shows itself becomes a BusError.
"""

from __future__ import annotations

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
            self._serial.reset_input_buffer()
        except _LINE_ERRORS as error:
            raise BusError(
                path,
                f"serial line cannot be opened: {error}.",
                help="Is the adapter plugged in, is the path right, may this user open it, is it free?",
            ) from error

    @property
    def latency_timer_ms(self) -> int | None:
        """The USB adapter's latency timer, ms: 1 is wanted (dynamixel reference 5.2). None if it has none."""
        setting = Path("/sys/bus/usb-serial/devices") / Path(self.path).resolve().name / "latency_timer"
        try:
            return int(setting.read_text())
        except (OSError, ValueError):
            return None

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
            self._serial.reset_input_buffer()
        except _LINE_ERRORS as error:
            raise self._error("cannot be flushed", error) from error

    def close(self) -> None:
        self._descriptor = -1
        try:
            self._serial.close()
        except _LINE_ERRORS as error:
            raise self._error("cannot be closed", error) from error

    def _error(self, what: str, cause: object) -> BusError:
        return BusError(
            self.path, f"serial line {what}: {cause}.", help="Check the adapter's plug and power, then start again."
        )
