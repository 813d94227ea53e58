"""The weights on simulated tendon motors, changed by lines on standard input: whoever hangs them is at a keyboard too.

hang 2                  2 kg on both cords
hang right 0.5          0.5 kg on one; 0 takes it off
"""

from __future__ import annotations

import math
from collections.abc import Callable

from controller.typed_lines import TypedLines
from drivers.errors import InputError
from drivers.simulated.hanging_weights import HangingWeights

SIDES = ("right", "left")
WEIGHT_LINES_HELP = '"hang right 2" on standard input puts 2 kg on the right one, "hang 2" on both'


class WeightLines(TypedLines):
    """Reads `descriptor` and does what it says; lines that cannot be obeyed are told through `say`."""

    def __init__(self, descriptor: int, weights: HangingWeights, say: Callable[[str], None]) -> None:
        super().__init__(descriptor)
        self._weights = weights
        self._say = say

    def obey(self) -> None:
        """All lines that came since the last call."""
        for line in self.read():
            try:
                self._hang(line)
            except InputError as error:
                self._say(error.message)

    def _hang(self, line: str) -> None:
        words = line.lower().split()
        if not words:
            return
        side = words[1] if len(words) == 3 else None
        if words[0] != "hang" or len(words) not in (2, 3) or side not in (None, *SIDES):
            raise InputError(f"{line!r} is not understood; expected such as {WEIGHT_LINES_HELP}.")
        motors = range(len(SIDES)) if side is None else (SIDES.index(side),)
        mass_kg = _number(words[-1])
        for motor in motors:
            self._weights.hang(motor, mass_kg)
        self._say(f"{' and '.join(SIDES[motor] for motor in motors)}: {mass_kg:g} kg")


def _number(word: str) -> float:
    try:
        return float(word.removesuffix("kg"))
    except ValueError:
        return math.nan  # which no cord takes
