"""How a child begins: it waits for GO from the front, or the end of either, and then finds its devices."""

from __future__ import annotations

import select
from collections.abc import Callable
from typing import TypeVar

from controller.service.lifeline import Lifeline, Word
from controller.service.stop_requests import StopRequests
from drivers.errors import NoReplyError

T = TypeVar("T")
SIMULATED_ATTEMPTS = 5


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


def find(device: Callable[[], T], simulated: bool) -> T:
    """Call `device`, which starts or asks a device; a simulated one that keeps silent is asked again, because its whole
    process may have been waiting for a processor. Raises DeviceError."""
    for _ in range(SIMULATED_ATTEMPTS - 1 if simulated else 0):
        try:
            return device()
        except NoReplyError:
            continue
    return device()
