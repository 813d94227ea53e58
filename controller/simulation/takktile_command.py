"""`stillgrasp simulate takktile`: a simulated TakkTile bridge alone, with weights that are put on its pads by hand."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from controller.config import runtime_directory
from controller.service.run_directory import RunDirectory
from controller.service.stop_requests import StopRequests
from controller.simulation.device_loop import DeviceLoop
from controller.simulation.stepped_clock import SteppedClock
from controller.typed_lines import TypedLines
from drivers.simulated.faults import FaultScript
from drivers.simulated.takktile import SimulatedTakktile, two_fingers, uneven
from drivers.simulated.takktile_fault_actions import TakktileAction
from drivers.simulated.takktile_lines import TakktileServer
from drivers.takktile.frames import Cell, Firmware

TAKKTILE_EXAMPLE = (
    "Example: stillgrasp simulate takktile --channel pads.sock --json; in robot.toml, in the table tactile: "
    'interface = "socket", channel = "pads.sock". Forces, on standard input: right 1.5; or on one cell: 0:2 1.5. '
    'A fault, in faults.toml: \\[\\[fault]] on = "sampling", at_s = 5, for_s = 2, action = { kind = "unplug" }, '
    "each on a line of its own."
)


class FirmwareName(StrEnum):
    """Which bridge."""

    usb = Firmware.TAKKTILE_USB.value
    fast = Firmware.TAKK_FAST.value


class ForceLines:
    """Forces from lines such as `right 1.5`, `left 0` or `0:2 1.5` (row, column, N); the newest counts."""

    def __init__(self, descriptor: int, say: Callable[[str], None]) -> None:
        self.force_N = [0.0, 0.0]
        self._lines = TypedLines(descriptor)
        self._say = say

    @property
    def open(self) -> bool:
        """False from the end of the input on."""
        return self._lines.open

    def fileno(self) -> int:
        """Readable when a line, or the end, has come."""
        return self._lines.fileno()

    def read(self, device: SimulatedTakktile) -> None:
        """Take what was written."""
        for line in self._lines.read():
            self.take(line, device)

    def take(self, line: str, device: SimulatedTakktile) -> None:
        """One line; what is none is told and changes nothing."""
        place, _, text = line.strip().partition(" ")
        if not place:
            return
        try:
            force_N = float(text)
            if not 0.0 <= force_N <= 200.0:
                raise ValueError
            if place in ("right", "left"):
                self.force_N[("right", "left").index(place)] = force_N
                return
            row, column = (int(number) for number in place.split(":"))
            if Cell(row, column) not in {cell.cell for cell in device.cells}:
                raise ValueError
        except ValueError:
            self._say(f"{line.strip()!r} is no force; expected right, left or ROW:COLUMN, and 0 to 200 N")
            return
        device.pressed_N[Cell(row, column)] = force_N


def serve_takktile(
    channel: Path | None,
    firmware: FirmwareName,
    seed: int,
    faults: FaultScript[TakktileAction],
    ready: Callable[[str], None],
    say: Callable[[str], None],
) -> None:
    """Serve until a signal comes; `ready` gets the socket's path."""
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(StopRequests())
        if channel is None:
            directory = RunDirectory(runtime_directory())
            stack.callback(directory.remove)
            channel = directory.path / "pads"
        clock = SteppedClock()
        forces = ForceLines(0, say)
        device = SimulatedTakktile(
            lambda: forces.force_N,
            uneven(two_fingers(), seed),
            firmware=Firmware(firmware.value),
            seed=seed,
            faults=faults,
            start_ns=clock.now_ns(),
        )
        server = TakktileServer(channel.absolute(), device, clock)
        stack.callback(server.close)
        loop = DeviceLoop(clock, lambda now_ns: None, [server], server.filenos, say)
        clock.resume()
        ready(str(server.path))
        while stop.received is None:
            if forces in loop.turn([stop, forces] if forces.open else [stop]):
                forces.read(device)


def tell(path: str, as_json: bool, say: Callable[[str], None]) -> None:
    """Say that it runs."""
    if as_json:
        print(json.dumps({"interface": "socket", "channel": path}), flush=True)
    else:
        say(f"interface socket, channel {path}; stop with Ctrl-C")


def takktile(
    channel: Annotated[Path | None, typer.Option(help="Socket to serve; else one in a new private directory.")] = None,
    firmware: Annotated[FirmwareName, typer.Option(help="Which bridge it is.")] = FirmwareName.usb,
    faults: Annotated[
        Path | None, typer.Option(help="Fault script: TOML, or JSON lines (.jsonl).", show_default=False)
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the cells' sensitivities and noise.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the socket as one line of JSON when ready.")] = False,
) -> None:
    """A TakkTile bridge with two pads of eight cells, rows 0 and 1 right, 2 and 3 left.

    Forces come from standard input, a line each: `right 1.5`, `left 0`, or `0:2 1.5` for a weight on one cell, in N.
    No two cells are alike. Ctrl-C ends it.
    """
    from controller.calibration_options import say
    from controller.simulation.fault_file import read_takktile_faults

    script: FaultScript[TakktileAction] = FaultScript() if faults is None else read_takktile_faults(faults)
    serve_takktile(channel, firmware, seed, script, partial(tell, as_json=as_json, say=say), say)
