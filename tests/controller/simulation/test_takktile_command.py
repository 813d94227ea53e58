"""`stillgrasp simulate takktile` as a process of its own, with a driver in front of it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from controller.simulation.takktile_command import ForceLines
from drivers.clock import MonotonicClock, nanoseconds
from drivers.errors import InputError
from drivers.simulated.takktile import SimulatedTakktile
from drivers.simulated.takktile_lines import SocketTransport, TakktileServer
from drivers.takktile.bridge import Bridge
from drivers.takktile.frames import Cell, Firmware

COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()", "simulate", "takktile"]


@pytest.mark.slow  # a process that loads its libraries
def test_forces_from_standard_input_reach_the_driver() -> None:
    """The socket that --json names answers as a TakkFast bridge; a weight on one cell presses that cell alone."""
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:
        process = subprocess.Popen(
            [*COMMAND, "--json", "--channel", f"{directory}/pads", "--firmware", "TakkFast"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            told = json.loads(process.stdout.readline())
            assert told == {"interface": "socket", "channel": f"{directory}/pads"}
            clock = MonotonicClock()
            bridge = Bridge(SocketTransport(told["channel"], clock), clock)
            assert bridge.firmware is Firmware.TAKK_FAST
            bridge.start(0.005)
            before = pressures(bridge, clock)
            process.stdin.write("0:2 5\n")
            process.stdin.flush()
            after = pressures(bridge, clock)
            while before[2] - after[2] < 100.0:  # the line is on its way
                after = pressures(bridge, clock)
            moved = before - after
            assert np.flatnonzero(moved > 20.0).tolist() == [bridge.cells.index(Cell(0, 2))]
            bridge.close()
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        assert not Path(directory, "pads").exists()


def pressures(bridge: Bridge, clock: MonotonicClock) -> np.ndarray:
    frame = bridge.read(clock.now_ns() + nanoseconds(5.0))
    assert frame is not None
    return np.array([cell.pressure for cell in frame.cells], dtype=np.float64)


@pytest.mark.parametrize("line", ["right", "right x", "up 1", "9:9 1", "0:0:0 1", "right nan", "left -1", "right 1e9"])
def test_what_is_no_force_changes_nothing(line: str) -> None:
    """It is told, with what is expected."""
    said: list[str] = []
    lines = ForceLines(0, said.append)
    device = SimulatedTakktile(lambda: lines.force_N)
    lines.take(line, device)
    assert "expected right, left or ROW:COLUMN" in said[0]
    assert lines.force_N == [0.0, 0.0]
    assert device.pressed_N == {}


def test_forces_are_set() -> None:
    """By finger and by cell, each replacing the one before."""
    lines = ForceLines(0, lambda _: None)
    device = SimulatedTakktile(lambda: lines.force_N)
    for line in ("right 1.5", "left 2", "left 0.5", "0:2 3", ""):
        lines.take(line, device)
    assert lines.force_N == [1.5, 0.5]
    assert device.pressed_N == {Cell(0, 2): 3.0}


def test_a_taken_socket_is_told() -> None:
    """A second server at one path."""
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:
        device = SimulatedTakktile(lambda: (0.0, 0.0))
        first = TakktileServer(Path(directory, "pads"), device, MonotonicClock())
        with pytest.raises(InputError, match="does not exist yet"):
            TakktileServer(Path(directory, "pads"), device, MonotonicClock())
        first.close()
