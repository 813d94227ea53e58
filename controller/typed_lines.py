"""Lines that somebody types, or a program writes, on a descriptor, for those who do something else meanwhile."""

from __future__ import annotations

import os
import select

_LONGEST_LINE_BYTES = 1000


class TypedLines:
    """Reads `descriptor` (standard input) only when there is something to read: a terminal and a pipe alike.

    The end of the input, or an input that cannot be read, ends nothing but the reading: `open` turns false.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.open = True
        try:
            os.fstat(descriptor)
        except OSError:
            self.open = False

    def fileno(self) -> int:
        """Descriptor to wait on while `open`."""
        return self._descriptor

    @property
    def is_terminal(self) -> bool:
        """Whether somebody sits there."""
        return os.isatty(self._descriptor)

    def read(self) -> list[str]:
        """All whole lines that came since the last call, without spaces at their ends; it does not wait."""
        lines: list[bytes] = []
        while self.open and select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                data = os.read(self._descriptor, 4096)
            except OSError:  # a terminal that has gone, or belongs to another job now
                data = b""
            if not data:
                self.open = False
                data = b"\n" if self._rest else b""
            *whole, self._rest = (self._rest + data).split(b"\n")
            lines += whole
            if len(self._rest) > _LONGEST_LINE_BYTES:
                lines.append(self._rest)
                self._rest = b""
        return [line.decode(errors="replace").strip() for line in lines]
