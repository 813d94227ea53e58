"""`stillgrasp calibrate tactile`: known weights on one finger's pad, and what its cells are worth in newtons.

The plan, the fit and its acceptance are `calibration/tactile.py`'s; here the operator is led through it and the bridge
is read. Stop the daemon first: a bridge has one client.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from calibration.tactile import (
    ACCEPTED_RESIDUAL,
    STANDARD_GRAVITY_M_S2,
    Press,
    TactileFit,
    fit,
    fit_thermal,
    plan,
)
from calibration.tactile_file import SIDES, check_tactile_file, write_pad
from controller.calibration_options import AsJson, Config, await_enter, say
from controller.config import Tactile, load_config
from controller.service.tactile_assembly import configured_cells, open_bridge
from controller.service.tactile_state import quality_words
from drivers.clock import Clock, MonotonicClock, nanoseconds
from drivers.errors import InputError, NoReplyError
from drivers.takktile.bridge import Bridge, BridgeFrame
from drivers.takktile.calibration import PadCalibration, check_cells, nominal
from drivers.takktile.frames import DEVICE, Cell
from drivers.takktile.pads import Pads
from drivers.takktile.quality import BROKEN, CellQuality, Flags

TACTILE_EXAMPLE = "Example: stillgrasp calibrate tactile right --config robot.toml --mass 0.05 --mass 0.1 --mass 0.2"
LONGEST_FRAME_S = 0.5
DEFAULT_MASSES_KG = [0.05, 0.1, 0.2]


class PadMeter:
    """Reads one side's cells above their zero. Raises DeviceError and InputError."""

    def __init__(self, bridge: Bridge, clock: Clock, tactile: Tactile, side: str) -> None:
        self._bridge, self._clock = bridge, clock
        both = [nominal(configured_cells(tactile, name)) for name in SIDES]
        dead = check_cells((both[0], both[1]), bridge.cells, bridge.coefficient_bytes)
        self.cells = tuple(cell for cell in configured_cells(tactile, side) if cell not in dead)
        """The side's cells that are alive."""
        self._columns = [bridge.cells.index(cell) for cell in self.cells]
        # The other side's cells are somebody else's: they may be anything while this side's zero is taken.
        pad = nominal(self.cells)
        self._pads = Pads((pad, pad), bridge.cells, bridge.coefficients)
        bridge.start(tactile.period_s)

    def zero(self) -> None:
        """Take the zero; the pad must be free, and its cells sound."""
        self._drain()
        self._pads.tare()
        while self._pads.taring:
            self._take()
        self._refuse(self._pads.readings().quality, BROKEN | CellQuality.NO_ZERO)

    def mean_counts(self, duration_s: float) -> tuple[float, ...]:
        """Mean signal of each cell, Pcomp counts above zero."""
        self._drain()
        end_ns = self._clock.now_ns() + nanoseconds(duration_s)
        rows = []
        while self._clock.now_ns() < end_ns:
            self._take()
            rows.append(self._pads.counts[self._columns])
            self._refuse(self._pads.readings().quality, BROKEN | CellQuality.SATURATED)
        return tuple(np.mean(rows, axis=0).tolist())

    def warm_up(self, duration_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signals and temperature counts of the free pad, (m, n) each, a row a second."""
        end_ns = self._clock.now_ns() + nanoseconds(duration_s)
        counts, temperatures = [], []
        while self._clock.now_ns() < end_ns:
            row_end_ns = min(self._clock.now_ns() + nanoseconds(1.0), end_ns)
            seen, warmth = [], []
            while self._clock.now_ns() < row_end_ns:
                warmth.append(self._take()[self._columns])
                seen.append(self._pads.counts[self._columns])
            if seen:
                counts.append(np.mean(seen, axis=0))
                temperatures.append(np.mean(warmth, axis=0))
        return np.array(counts), np.array(temperatures)

    def _refuse(self, quality: Flags, kinds: CellQuality) -> None:
        """Nothing is calibrated with a cell that cannot be believed."""
        for cell, column in zip(self.cells, self._columns, strict=True):
            flaw = CellQuality(int(quality[column])) & kinds
            if flaw & CellQuality.SATURATED:
                raise InputError(f"cell {_name(cell)} is pressed beyond its range.", help="Use lighter masses.")
            if flaw:
                raise InputError(
                    f"cell {_name(cell)} is {quality_words(flaw)}; expected a sound one.",
                    help="Leave it out of the map under [tactile], or mend it.",
                )

    def _drain(self) -> None:
        """What waited while the operator did is of long ago."""
        for _ in range(3):
            self._read()

    def _take(self) -> NDArray[np.float64]:
        """One frame into the pads; the temperature counts of all cells."""
        frame = self._read()
        self._pads.take(frame, free=False)
        return np.array([cell.temperature for cell in frame.cells], dtype=np.float64)

    def _read(self) -> BridgeFrame:
        frame = self._bridge.read(self._clock.now_ns() + nanoseconds(LONGEST_FRAME_S))
        if frame is None:
            raise NoReplyError(DEVICE, f"gave no frame within {LONGEST_FRAME_S:g} s.", help="Check its plug.")
        return frame


def tactile(
    side: Annotated[str, typer.Argument(help="Which finger: right or left.")],
    config: Config = None,
    mass: Annotated[
        list[float] | None, typer.Option(help="A mass that you have, kg; repeat it for each. Else 0.05, 0.1 and 0.2.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The pads' own file; else tactile.own_file of robot.toml.")
    ] = None,
    seconds_a_press: Annotated[
        float, typer.Option("--seconds", min=0.1, max=60, help="Averaged for each press.")
    ] = 1.0,
    warm_up: Annotated[
        float, typer.Option(min=0, max=7200, help="Seconds to watch the free pad warm up first, for thermal drift.")
    ] = 0.0,
    accept: Annotated[
        float, typer.Option(min=0.001, max=1, help="Held-out residual to accept, as a part of the largest load.")
    ] = ACCEPTED_RESIDUAL,
    as_json: AsJson = False,
) -> None:
    """Calibrate one finger's tactile pad: put known masses on it, and find what its cells are worth in newtons.

    Stop the daemon, lay the finger down with its pad upwards, and follow the prompts: each mass at each cell and midway
    between neighbours, at least 40 presses. The result is judged at places that were left out of the fit, and written
    if it is accepted; the file before is kept as .bak. Name the file in robot.toml as tactile.own_file.
    """
    robot = load_config(config)
    if side not in SIDES:
        raise InputError(f"{side!r} is no side; expected right or left.")
    if robot.tactile is None:
        raise InputError("no tactile pads are configured.", help="Fill in [tactile] of robot.toml.")
    file = output or (Path(robot.tactile.own_file) if robot.tactile.own_file else None)
    if file is None:
        raise InputError(
            "it is not said where the calibration shall be written.",
            help='Give --output FILE, or write own_file = "FILE" under [tactile] of robot.toml.',
        )
    masses_kg = mass or DEFAULT_MASSES_KG
    plan(configured_cells(robot.tactile, side), masses_kg)  # told before anything is opened
    check_tactile_file(file)
    clock = MonotonicClock()
    with contextlib.closing(Bridge(open_bridge(robot.tactile, clock), clock)) as bridge:
        meter = PadMeter(bridge, clock, robot.tactile, side)
        thermal = _thermal(meter, side, warm_up)
        presses = _measure(meter, side, masses_kg, seconds_a_press)
        found = fit(presses)
        chips = tuple(bridge.coefficient_bytes[cell].hex() for cell in meter.cells)
    pad = PadCalibration(meter.cells, found.gain_N_per_count, thermal, chips)
    accepted = found.accepted(accept)
    if accepted:
        write_pad(file, side, pad, found.residual_N)
    _tell(found, pad, presses, file if accepted else None, accept, as_json)
    if not accepted:
        raise typer.Exit(1)


def _thermal(meter: PadMeter, side: str, duration_s: float) -> tuple[float, ...]:
    if not duration_s:
        return (0.0,) * len(meter.cells)
    await_enter(f"take everything off the {side} pad, which then warms up for {duration_s:g} s,")
    meter.zero()
    return fit_thermal(*meter.warm_up(duration_s))


def _measure(meter: PadMeter, side: str, masses_kg: list[float], duration_s: float) -> list[Press]:
    """All presses of the plan, with a new zero at every place."""
    steps = plan(meter.cells, masses_kg)
    presses: list[Press] = []
    before = None
    for number, (place, mass_kg) in enumerate(steps, start=1):
        if place != before:
            await_enter(f"take everything off the {side} pad")
            meter.zero()
            before = place
        where = f"at cell {place}" if len(place.cells) == 1 else f"midway between cells {place}"
        await_enter(f"{number} of {len(steps)}: put {mass_kg * 1e3:g} g on the {side} pad {where}")
        presses.append(Press(place, mass_kg * STANDARD_GRAVITY_M_S2, meter.mean_counts(duration_s)))
    return presses


def _tell(
    found: TactileFit, pad: PadCalibration, presses: list[Press], file: Path | None, limit: float, as_json: bool
) -> None:
    silent = [_name(pad.cells[index]) for index in found.silent_cells]
    if as_json:
        told = {
            "accepted": file is not None,
            "file": None if file is None else str(file.absolute()),
            "cells": [list(cell) for cell in pad.cells],
            "gain_N_per_count": list(pad.gain_N_per_count),
            "thermal_counts": list(pad.thermal_counts),
            "residual_N": found.residual_N,
            "relative_residual": found.relative_residual,
            "worst_place": str(found.worst_place),
            "worst_error": found.worst_error,
            "silent_cells": silent,
            "presses": len(presses),
        }
        typer.echo(json.dumps(told))
    else:
        typer.echo("cell   " + " ".join(f"{_name(cell):>8}" for cell in pad.cells))
        typer.echo("N/count" + " ".join(f"{gain:8.5f}" for gain in pad.gain_N_per_count))
        typer.echo(
            f"held-out residual {found.residual_N:.3f} N, {found.relative_residual:.1%} of the largest load; "
            f"worst place {found.worst_place}: {found.worst_error:+.1%}"
        )
        typer.echo(f"{file}: written" if file else f"not accepted: more than {limit:.1%}; nothing was written")
    if silent:
        say(f"no weight moved the cells {', '.join(silent)}: leave them out of the map, or press there")


def _name(cell: Cell) -> str:
    return f"{cell.row}:{cell.column}"
