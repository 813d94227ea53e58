"""The operator of a simulated pendant at a keyboard, or a program: buttons on a descriptor, a word a line."""

from __future__ import annotations

import os
from collections.abc import Callable

from drivers.errors import InputError
from drivers.simulated.safety_puck import button_named

_LONGEST_LINE_BYTES = 1000


class PendantLines:
    """Reads words from `descriptor` (standard input); unknown ones are told through `say` and passed over.

    `other_lines` may take lines that are no buttons. The end of the input, or an input that cannot be read, ends
    nothing but the reading: `open` turns false.
    """

    def __init__(
        self, descriptor: int, say: Callable[[str], None], other_lines: Callable[[str], bool] = lambda _: False
    ) -> None:
        self._descriptor = descriptor
        self._say = say
        self._other_lines = other_lines
        self._rest = b""
        self.open = True
        try:
            os.fstat(descriptor)
        except OSError:
            self.open = False

    def fileno(self) -> int:
        """Descriptor to wait on while `open`."""
        return self._descriptor

    def read(self) -> list[str]:
        """The buttons pressed since the last call; call it when the descriptor is readable."""
        try:
            data = os.read(self._descriptor, 4096)
        except BlockingIOError:
            return []
        except OSError:  # a terminal that has gone, or belongs to another job now
            data = b""
        if not data:
            self.open = False
            data = b"\n"
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _LONGEST_LINE_BYTES:
            lines, self._rest = [*lines, self._rest], b""
        texts = [line.decode(errors="replace").strip() for line in lines]
        pressed = []
        for text in texts:
            if not text or self._other_lines(text):
                continue
            try:
                pressed.append(button_named(text.lower()))
            except InputError as error:
                self._say(error.message)
        return pressed
