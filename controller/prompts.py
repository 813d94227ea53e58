"""Questions to an operator, answered by a line each, while something else goes on: a motor with a weight is watched."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from controller.typed_lines import TypedLines
from drivers.errors import InputError


class Prompts:
    """Lines from `descriptor`; prompts go out through `say`.

    At a terminal, what was typed before a question is no answer to it: a second Enter must not start a motor. In a pipe
    all answers may lie ready.
    """

    def __init__(self, descriptor: int, say: Callable[[str], None]) -> None:
        self._lines = TypedLines(descriptor)
        self._say = say
        self._waiting: deque[str] = deque()

    def ask(self, prompt: str, meanwhile: Callable[[], object]) -> str:
        """The next line; `meanwhile` is called until it is there. InputError if none can come any more."""
        if self._lines.is_terminal:
            self._lines.read()
            self._waiting.clear()
        self._say(prompt)
        while not self._waiting:
            if not self._lines.open:
                raise InputError("nobody answered; nothing was written.", help="Run it at a terminal.")
            self._waiting.extend(self._lines.read())
            meanwhile()
        return self._waiting.popleft()
