"""How a child waits for its beginning: GO from the front, or the end of either."""

from __future__ import annotations

import select

from controller.service.lifeline import Lifeline, Word
from controller.service.stop_requests import StopRequests


def wait_for_go(lifeline: Lifeline, stop: StopRequests) -> bool:
    """Wait until the front says GO; False if it has gone, or a signal has come, first."""
    while stop.received is None:
        saying = lifeline.hear()
        if saying is not None:
            if saying.word is Word.GO:
                return True
        elif lifeline.closed:
            return False
        else:
            select.select([lifeline.fileno(), stop.fileno()], [], [])
            stop.drain()
    return False
