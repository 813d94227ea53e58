"""SIGINT, SIGTERM and SIGHUP as a request to stop: a flag, and a descriptor that wakes a loop.

A second signal changes nothing.
"""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequests:
    """While entered, signals only set `received`; afterwards they do what they did before. Main thread only.

    SIGINT is taken even where it was ignored before, as a shell does to its background jobs: somebody sent it. With
    `keyboard` false it is ignored: a child's Ctrl-C is the front's to hear. SIGHUP stays ignored under nohup.
    """

    def __init__(self, *, keyboard: bool = True) -> None:
        self._keyboard = keyboard
        self.received: signal.Signals | None = None
        self._before: dict[signal.Signals, Any] = {}
        self._wakeup_before = -1
        self._waking, self._woken = socket.socketpair()
        self._waking.setblocking(False)
        self._woken.setblocking(False)

    def __enter__(self) -> Self:
        self._wakeup_before = signal.set_wakeup_fd(self._waking.fileno(), warn_on_full_buffer=False)
        handler: Callable[[int, FrameType | None], None] = self._receive
        for number in _SIGNALS:
            if number is signal.SIGINT and not self._keyboard:
                self._before[number] = signal.signal(number, signal.SIG_IGN)
            elif number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                self._before[number] = signal.signal(number, handler)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup_before)
        self._waking.close()
        self._woken.close()

    def fileno(self) -> int:
        """Becomes readable when a signal has come; `drain` makes it quiet again."""
        return self._woken.fileno()

    def drain(self) -> None:
        """Forget that the descriptor was readable; `received` stays."""
        try:
            while self._woken.recv(64):
                pass
        except BlockingIOError:
            pass

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = self.received or signal.Signals(number)
