"""Processor time of the tactile process: frames of a simulated bridge in, forces and contact out, every cell told.

    python -m benchmarks.bench_tactile [--json] [--seconds N] [--firmware TakktileUSB …]

`stillgrasp simulate takktile` runs in a process of its own behind its socket; this process runs the daemon's tactile
part on it at the configured period (default 8 ms), with 16 cells. The share is processor time of this process by wall
time; on a real bridge libusb's waiting comes in the place of the socket's. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.simulated_device import simulated_device
from controller.pad_messages import PadOrder, PadState
from controller.service.links import LatestReader, LatestSender, socket_links
from controller.service.tactile import TactilePart
from drivers.clock import MonotonicClock
from drivers.simulated.takktile import two_fingers
from drivers.simulated.takktile_lines import SocketTransport
from drivers.takktile.calibration import nominal
from drivers.takktile.frames import Firmware
from drivers.takktile.touch import TouchSettings


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench_tactile", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object a line instead of a table")
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement (default 3)")
    parser.add_argument("--period", type=float, default=0.008, help="of frames, s (default 0.008)")
    parser.add_argument("--firmware", nargs="+", default=[one.value for one in Firmware], help="bridges to measure")
    chosen = parser.parse_args(arguments)
    results = [measure(firmware, chosen.period, chosen.seconds) for firmware in chosen.firmware]
    if chosen.json:
        for result in results:
            print(json.dumps(result))
    else:
        show(results, Console())


def measure(firmware: str, period_s: float, duration_s: float) -> dict[str, Any]:
    """All figures of one bridge."""
    clock = MonotonicClock()
    with (
        tempfile.TemporaryDirectory(prefix="sg-") as directory,
        simulated_device("takktile", "--firmware", firmware, "--channel", f"{directory}/pads") as told,
    ):
        path = told["channel"]
        cycle, cycle_end = socket_links()
        front, front_end = socket_links()
        right, left = (nominal([cell.cell for cell in two_fingers() if cell.finger == i]) for i in (0, 1))
        part = TactilePart(
            clock,
            lambda: SocketTransport(path, clock),
            (right, left),
            LatestReader(cycle),
            LatestSender(cycle),
            LatestSender(front),
            period_s=period_s,
            touch=TouchSettings(),
        )
        part.start()
        try:
            LatestSender(cycle_end).send(PadOrder(True, 1).pack(), clock.now_ns())
            states, reports = LatestReader(cycle_end), LatestReader(front_end)
            while not tared(states):
                part.step()
                reports.new_values()
            frames, begin_s, begin_cpu_s = 0, time.monotonic(), time.process_time()
            while time.monotonic() - begin_s < duration_s:
                part.step()
                frames += 1
                states.new_values()
                reports.new_values()
            wall_s, cpu_s = time.monotonic() - begin_s, time.process_time() - begin_cpu_s
        finally:
            part.stop()
    return {
        "firmware": firmware,
        "cells": 16,
        "frames_per_s": frames / wall_s,
        "cpu_us_per_frame": cpu_s / frames * 1e6,
        "processor_percent": cpu_s / wall_s * 100.0,
    }


def tared(states: LatestReader) -> bool:
    """Whether the pads have their zero."""
    newest = states.newest()
    return newest is not None and min(PadState.unpack(newest[0]).valid_cells) > 0


def show(results: list[dict[str, Any]], console: Console) -> None:
    """As a table."""
    table = Table(title="the tactile process: processor time of a frame, and share of a core")
    for name in ("bridge", "cells", "frames/s", "µs a frame", "% of a core"):
        table.add_column(name, justify="left" if name == "bridge" else "right")
    for result in results:
        table.add_row(
            result["firmware"],
            str(result["cells"]),
            f"{result['frames_per_s']:.0f}",
            f"{result['cpu_us_per_frame']:.0f}",
            f"{result['processor_percent']:.1f}",
        )
    console.print(table)


if __name__ == "__main__":
    main()
