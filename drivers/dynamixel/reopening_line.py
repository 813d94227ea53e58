"""A serial line that comes back by itself when its adapter is plugged in again.

Every operation on a line that is gone is a BusError, as it is without this; but from time to time one of them tries to
open the line anew, with its exclusive lock. The motors meanwhile hold (with their watchdogs tripped, where they have
one), so that whoever drives them goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from drivers.clock import Clock, nanoseconds
from drivers.dynamixel.byte_line import ByteLine
from drivers.errors import BusError

RETRY_S = 0.5
_Result = TypeVar("_Result")


class ReopeningLine:
    """`line`, and after a failure whatever `open_line` gives; tried every `RETRY_S`."""

    def __init__(self, line: ByteLine, open_line: Callable[[], ByteLine], clock: Clock) -> None:
        self._line: ByteLine | None = line
        self._open_line = open_line
        self._clock = clock
        self._retry_ns = 0

    def write(self, data: bytes) -> None:
        self._try(lambda line: line.write(data))

    def read(self, max_bytes: int) -> bytes:
        return self._try(lambda line: line.read(max_bytes))

    def discard_input(self) -> None:
        self._try(lambda line: line.discard_input())

    def fileno(self) -> int:
        return -1 if self._line is None else self._line.fileno()

    def next_arrival_ns(self) -> int | None:
        return None if self._line is None else self._line.next_arrival_ns()

    def close(self) -> None:
        """Give the line back. It is opened again only if it is used again: so says a reader that met its end."""
        line, self._line = self._line, None
        self._retry_ns = self._clock.now_ns() + nanoseconds(RETRY_S)
        if line is not None:
            line.close()

    def _try(self, act: Callable[[ByteLine], _Result]) -> _Result:
        try:
            return act(self._present())
        except BusError:
            if self._line is not None:
                self.close()
            raise

    def _present(self) -> ByteLine:
        if self._line is None:
            if self._clock.now_ns() < self._retry_ns:
                raise BusError("serial line", "is gone.", help="It is opened again when the adapter is plugged in.")
            self._retry_ns = self._clock.now_ns() + nanoseconds(RETRY_S)
            self._line = self._open_line()
        return self._line
