"""The link between the front and each of its children, over which they begin, report and learn that the other has gone.

It lives exactly as long as both processes: the kernel shows the death of one as end-of-file to the other, and closing
it is how the front ends a child. What goes over it is rare and in words; nothing of the cycle does.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from controller.service.links import Link, LinkClosed, LinkFull, OrderedReader, OrderedSender
from drivers.clock import Clock

_LONGEST_TEXT_BYTES = 4000


class Word(IntEnum):
    """What can be said."""

    GO = 1  # to a child: the buses are there, begin
    PRESS = 2  # to the world: a button of the pendant
    READY = 3  # from a child: it runs
    SAID = 4  # from a child: a line for the operator
    FAILED = 5  # from a child: why it ends
    PROMPT = 6  # from the cycle: its code, and in the next line what the operator is asked for
    MOTORS = 7  # from the cycle: firmware of the arm's motor pucks
    FAULT = 8  # to the world: something that goes wrong with the arm, or after "motors" with these, as JSON
    WARNING = 9  # from a child: a code, and in the next line what the operator should know


class Saying(NamedTuple):
    """One thing said."""

    word: Word
    text: str


class Lifeline:
    """One end; both ends are alike."""

    def __init__(self, link: Link, clock: Clock) -> None:
        self._link = link
        self._clock = clock
        self._sender = OrderedSender(link)
        self._reader = OrderedReader(link)

    @property
    def closed(self) -> bool:
        """True as soon as the other process has gone or closed its end."""
        return self._link.closed

    def say(self, word: Word, text: str = "") -> bool:
        """Say something; False if the other end has gone or does not listen. Never raises for that."""
        payload = text.encode()[:_LONGEST_TEXT_BYTES]
        try:
            self._sender.send(payload, self._clock.now_ns(), word)
        except (LinkClosed, LinkFull):
            return False
        return True

    def hear(self) -> Saying | None:
        """The next thing said, None if nothing was; what was said before an end can still be heard after it."""
        message = self._reader.receive()
        return None if message is None else Saying(Word(message.kind), message.payload.decode(errors="replace"))

    def fileno(self) -> int:
        """Descriptor to wait on."""
        return self._link.fileno()

    def close(self) -> None:
        """Close this end."""
        self._link.close()
