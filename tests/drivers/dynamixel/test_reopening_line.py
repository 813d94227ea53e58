"""An adapter that is pulled out and plugged in again, on pseudo terminals and with simulated motors."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.byte_line import ByteLine, SerialLine
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.protocol2_bus import Protocol2Bus
from drivers.dynamixel.reopening_line import RETRY_S, ReopeningLine
from drivers.errors import BusError

RETRY_NS = round(RETRY_S * 1e9)


def test_it_is_opened_again_now_and_then_and_not_all_the_time() -> None:
    """A bus error for every use while it is gone; one attempt a retry time; then it works as before."""
    clock, there, attempts = VirtualClock(), [True], []

    class Line:
        def write(self, data: bytes) -> None:
            if not there:
                raise BusError("adapter", "is gone.")

        def fileno(self) -> int:
            return -1

        def close(self) -> None:
            pass

    def open_line() -> Any:
        attempts.append(clock.now_ns())
        if not there:
            raise BusError("adapter", "is not there.")
        return Line()

    line = ReopeningLine(open_line(), open_line, clock)
    line.write(b"a")
    there.clear()
    for _ in range(100):
        with pytest.raises(BusError):
            line.write(b"a")
        clock.advance_to_ns(clock.now_ns() + RETRY_NS // 20)
    assert 4 <= len(attempts) - 1 <= 5
    there.append(True)
    clock.advance_to_ns(clock.now_ns() + RETRY_NS)
    line.write(b"a")


def test_a_port_that_met_the_end_is_opened_again(rig_of: Callable[..., Any]) -> None:
    """The end of file shows only to the port: it gives the line back, and the next request after a while opens it."""
    rig = rig_of((1, 1020, 2))

    class Ended:
        def __init__(self, line: ByteLine) -> None:
            self.line = line

        def read(self, max_bytes: int) -> bytes:
            return b""

        def __getattr__(self, name: str) -> Any:
            return getattr(self.line, name)

    bus = Protocol2Bus(WaitingPort(ReopeningLine(Ended(rig.line), lambda: rig.line, rig.clock), rig.clock))
    for reason in ("has ended", "is gone"):
        with pytest.raises(BusError, match=reason):
            bus.ping(1)
    rig.clock.advance_to_ns(rig.clock.now_ns() + RETRY_NS)
    assert bus.ping(1).model_number == 1020


def test_a_real_line_comes_back_under_its_path(tmp_path: Path) -> None:
    """Unplugged and plugged in again: the same path leads to another device, and the lock is taken anew."""
    path, clock = tmp_path / "adapter", VirtualClock()
    master, slave = pty.openpty()
    tty.setraw(slave)
    path.symlink_to(os.ttyname(slave))
    line = ReopeningLine(SerialLine(str(path), 1_000_000), lambda: SerialLine(str(path), 1_000_000), clock)
    line.write(b"one")
    os.close(master)
    with pytest.raises(BusError):
        line.write(b"lost")
    os.close(slave)
    path.unlink()
    clock.advance_to_ns(RETRY_NS)
    with pytest.raises(BusError, match="no such device"):
        line.write(b"lost")
    master, slave = pty.openpty()
    tty.setraw(slave)
    path.symlink_to(os.ttyname(slave))
    clock.advance_to_ns(2 * RETRY_NS)
    line.write(b"two")
    assert os.read(master, 10) == b"two"
    with pytest.raises(BusError, match="another process holds it"):
        SerialLine(str(path), 1_000_000)
    line.close()
    os.close(master)
    os.close(slave)
