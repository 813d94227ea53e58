"""Signals as requests, sent to this very process."""

from __future__ import annotations

import os
import select
import signal

import pytest

from controller.service.stop_requests import StopRequests


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_wakes_and_is_remembered_once(number: signal.Signals) -> None:
    """The loop wakes for a signal, the first one counts, and afterwards all is as before."""
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with StopRequests() as stop:
        assert stop.received is None
        os.kill(os.getpid(), number)
        assert select.select([stop], [], [], 10.0)[0]
        stop.drain()
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.received is number
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


def test_what_a_shell_ignored_for_us_is_heard_all_the_same() -> None:
    """`stillgrasp run &` in a script starts with SIGINT ignored; `kill -INT` must still stop the arm."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with StopRequests(keyboard=False) as stop:
            os.kill(os.getpid(), signal.SIGINT)
            assert stop.received is None
        with StopRequests() as stop:
            os.kill(os.getpid(), signal.SIGINT)
            assert stop.received is signal.SIGINT
    finally:
        signal.signal(signal.SIGINT, before)
