"""The pty in front of a simulated device: baud rates as a client sets them, unplugging, and a link that follows."""

import os
import select
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import serial

from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.faults import FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.serial_lines import MemoryLine, PtyServer
from tests.drivers.simulated.motor_bench import MILLISECOND, Bench

PING_1 = bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E")


class Line:
    """A server on virtual time, stepped by hand, and what a client gets from it."""

    def __init__(self, bench: Bench, **options: Any) -> None:
        self.bench = bench
        self.clock = VirtualClock()
        self.server = PtyServer(bench.sim, self.clock, **options)

    def exchange(self, client: serial.Serial, data: bytes) -> bytes:
        """Write, let 20 ms pass, read."""
        client.write(data)
        select.select([self.server.fileno()], [], [], 1.0)
        self.server.step()
        self.clock.advance_to_ns(self.clock.now_ns() + 20 * MILLISECOND)
        self.server.step()
        return bytes(client.read(100))


@pytest.fixture
def lines() -> Iterator[Any]:
    made: list[Line] = []

    def make(bench: Bench, **options: Any) -> Line:
        made.append(Line(bench, **options))
        return made[-1]

    yield make
    for line in made:
        line.server.close()


@pytest.mark.parametrize(
    ("own", "asked", "answered"), [(57_600, 57_142, 1), (57_600, 1_000_000, 0), (4_500_000,) * 2 + (1,)]
)
def test_the_client_s_rate_counts(lines: Any, own: int, asked: int, answered: int) -> None:
    """Any rate that pyserial can set, those too that termios has no name for."""
    line = lines(Bench(baud=own), baud=own)
    with serial.Serial(line.server.port, asked, timeout=0) as client:
        assert bool(line.exchange(client, PING_1)) == bool(answered)


def test_a_client_that_sets_no_rate_is_understood(lines: Any) -> None:
    """Whoever opens the terminal as a plain file finds it set as the motors are."""
    line = lines(Bench(baud=57_600), baud=57_600)
    client = os.open(line.server.port, os.O_RDWR | os.O_NOCTTY)
    try:
        os.write(client, PING_1)
        line.server.step()
        line.clock.advance_to_ns(20 * MILLISECOND)
        line.server.step()
        assert os.read(client, 100)[4] == 1
    finally:
        os.close(client)


def test_wire_time_is_the_client_s(lines: Any) -> None:
    """10 bytes at 57 600 bit/s take 1.74 ms to the motor; the answer comes 0.55 ms later and takes 2.43 ms."""
    line = lines(Bench(baud=57_600), baud=57_600)
    with serial.Serial(line.server.port, 57_600, timeout=0) as client:
        client.write(PING_1)
        select.select([line.server.fileno()], [], [], 1.0)
        line.server.step()
        assert line.server.next_due_ns() == pytest.approx(24 * 10 / 57_600 * 1e9 + 550_000, abs=2)


def test_unplugging_ends_the_terminal_and_a_link_leads_to_the_next(lines: Any, tmp_path: Path) -> None:
    """The client sees an error, as on a real adapter; nothing is waited for meanwhile; then the link works again."""
    faults = {"fault": [{"action": {"kind": "unplug"}, "at_s": 0.01, "for_s": 0.1}]}
    bench = Bench(faults=msgspec.convert(faults, FaultScript[SerialAction]))
    link = tmp_path / "tendons"
    line = lines(bench, link=link)
    with serial.Serial(str(link), 1_000_000, timeout=0) as client:
        assert line.exchange(client, PING_1)
        bench.control(20 * MILLISECOND)
        line.server.step()
        assert line.server.filenos() == []
        with pytest.raises(OSError, match="Input/output error"):
            client.write(b"x")
    assert not link.is_symlink()  # its terminal may become somebody else's
    bench.control(200 * MILLISECOND)
    line.server.step()
    assert os.readlink(link) == line.server.port
    with serial.Serial(str(link), 1_000_000, timeout=0) as client:
        assert line.exchange(client, PING_1)


def test_a_closed_memory_line_says_so() -> None:
    """Use after close is a BusError, not silence."""
    line = MemoryLine(Bench().sim, VirtualClock())
    line.close()
    line.close()
    with pytest.raises(BusError, match="was closed"):
        line.write(PING_1)
