"""Answers of an operator, a line each, while something else goes on: a motor that holds a weight must be kept talking.

Reads a descriptor (standard input) only when there is something to read, so that it serves a terminal and a pipe alike.
"""

from __future__ import annotations

import os
import select
from collections.abc import Callable

from drivers.errors import InputError

_LONGEST_LINE_BYTES = 1000


class Answers:
    """Lines from `descriptor`; prompts go out through `say`."""

    def __init__(self, descriptor: int, say: Callable[[str], None]) -> None:
        self._descriptor = descriptor
        self._say = say
        self._pending = b""
        self._ended = False

    def ask(self, prompt: str, meanwhile: Callable[[], object]) -> str:
        """The next line, without spaces at its ends; `meanwhile` is called until it is there. InputError if none can
        come any more."""
        self._say(prompt)
        while True:
            line, found, rest = self._pending.partition(b"\n")
            if found:
                self._pending = rest
                return line.decode(errors="replace").strip()
            if self._ended:
                raise InputError("nobody answered; nothing was written.", help="Run it at a terminal.")
            self._read()
            meanwhile()

    def _read(self) -> None:
        if not select.select([self._descriptor], [], [], 0.0)[0]:
            return
        data = os.read(self._descriptor, 4096)
        self._pending += data
        if not data or len(self._pending) > _LONGEST_LINE_BYTES * 4:
            self._ended = True
