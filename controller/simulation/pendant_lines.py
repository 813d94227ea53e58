"""The operator of a simulated pendant at a keyboard, or a program: buttons on a descriptor, a word a line.

A line that begins with a brace is no button but a fault of the arm, a JSON object as `fault_file.py` takes it; one that
begins with "motors" and a brace, a fault of the tendon motors; with "pads", one of the tactile pads.
"""

from __future__ import annotations

from collections.abc import Callable

from controller.typed_lines import TypedLines
from drivers.errors import InputError
from drivers.simulated.safety_puck import button_named

MOTORS, PADS = "motors", "pads"


class PendantLines(TypedLines):
    """Reads words from `descriptor` (standard input); unknown ones are told through `say` and passed over."""

    def __init__(self, descriptor: int, say: Callable[[str], None]) -> None:
        super().__init__(descriptor)
        self._say = say

    def read(self) -> list[str]:
        """Buttons pressed and faults typed since the last call; it does not wait."""
        pressed = []
        for text in filter(None, super().read()):
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
