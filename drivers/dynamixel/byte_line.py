"""A line of bytes: what the motor port writes to and reads from, and the real serial one.

`SerialLine` opens a serial device or a pty's slave side through pyserial, 8N1, raw, non-blocking and locked (flock)
against a second process: two processes on one port corrupt each other silently (dynamixel reference 5.5). Any baud rate
is accepted, 57 142 too. Every way in which an unplugged adapter shows itself becomes a BusError.
"""

from __future__ import annotations

import os
import termios
from collections.abc import Iterator
from contextlib import contextmanager
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


class SerialLine:
    """A serial device (`/dev/ttyUSB0`) or pty at `baud` bit/s."""

    WRITE_TIMEOUT_S = 0.05

    def __init__(self, path: str, baud: int) -> None:
        if baud <= 0:
            raise InputError(f"baud = {baud} is not a baud rate; expected a positive number of bits per second.")
        self.path = path
        with self._bus_errors(
            "cannot be opened", "Is the adapter plugged in, is the path right, may this user open it, is it free?"
        ):
            self._serial = serial.Serial(
                port=path, baudrate=baud, timeout=0, write_timeout=self.WRITE_TIMEOUT_S, exclusive=True
            )
            self._descriptor: int = self._serial.fileno()
            self._serial.reset_input_buffer()

    @property
    def latency_timer_ms(self) -> int | None:
        """The USB adapter's latency timer, ms: 1 is wanted (dynamixel reference 5.2). None if it has none."""
        setting = Path("/sys/bus/usb-serial/devices") / Path(self.path).resolve().name / "latency_timer"
        try:
            return int(setting.read_text())
        except (OSError, ValueError):
            return None

    def write(self, data: bytes) -> None:
        with self._bus_errors("does not take bytes"):
            self._serial.write(data)

    def read(self, max_bytes: int) -> bytes:
        with self._bus_errors("cannot be read"):
            try:
                return os.read(self._descriptor, max_bytes)
            except BlockingIOError:
                return b""

    def fileno(self) -> int:
        return self._descriptor

    def next_arrival_ns(self) -> int | None:
        return None

    def discard_input(self) -> None:
        with self._bus_errors("cannot be flushed"):
            self._serial.reset_input_buffer()

    def close(self) -> None:
        with self._bus_errors("cannot be closed"):
            self._serial.close()

    @contextmanager
    def _bus_errors(
        self, what: str, help: str = "Check the adapter's plug and power, then start again."
    ) -> Iterator[None]:
        # pyserial lets termios.error and bare OSError through beside its own exception, and TypeError once it is closed
        try:
            yield
        except (serial.SerialException, termios.error, OSError, TypeError, ValueError) as error:
            raise BusError(self.path, f"serial line {what}: {error}.", help=help) from error
