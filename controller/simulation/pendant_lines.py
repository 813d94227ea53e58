"""The operator of a simulated pendant at a keyboard, or a program: buttons on a descriptor, a word a line.

A line that begins with a brace is no button but a fault of the arm, a JSON object as `fault_file.py` takes it; one that
begins with "motors" and a brace, a fault of the tendon motors; with "pads", one of the tactile pads.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from drivers.errors import InputError
from drivers.simulated.safety_puck import button_named

MOTORS, PADS = "motors", "pads"
_LONGEST_LINE_BYTES = 1000


class PendantLines:
    """Reads words from `descriptor` (standard input); unknown ones are told through `say` and passed over.

    The end of the input, or an input that cannot be read, ends nothing but the reading: `open` turns false.
    """

    def __init__(self, descriptor: int, say: Callable[[str], None]) -> None:
        self._descriptor = descriptor
        self._say = say
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
        """Buttons pressed and faults typed since the last call; call it when the descriptor is readable."""
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
            if not text:
                continue
            if is_fault(text):
                pressed.append(text)
                continue
            try:
                pressed.append(button_named(text.lower()))
            except InputError as error:
                self._say(error.message)
        return pressed


def is_fault(line: str) -> bool:
    """Whether a line is a fault rather than a button."""
    return line.removeprefix(MOTORS).removeprefix(PADS).lstrip().startswith("{")
