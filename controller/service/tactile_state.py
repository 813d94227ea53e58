"""The tactile pads as clients and recordings see them: from the tactile process' reports, pure.

Order right, left; cells in the order of the map under [tactile]; N, raw counts, Pcomp counts (TakkTile reference 4, 6).
"""

from __future__ import annotations

from typing import Any

from calibration.tactile_file import SIDES
from controller.pad_messages import CellState, PadReport
from drivers.takktile.quality import CellQuality


def pad_record(report: PadReport) -> dict[str, float | list[float]]:
    """What the pads add to a cycle's record; only where there are pads."""
    state = report.state
    return {
        "tactile_force_N": list(state.force_N),
        "tactile_deviation_N": list(state.deviation_N),
        "tactile_total_N": sum(state.force_N),
        "tactile_touching": [float(touching) for touching in state.touching],
        "tactile_valid_cells": [float(count) for count in state.valid_cells],
    }


def pad_state(report: PadReport, age_s: float) -> dict[str, Any]:
    """`tactile` of the state: both fingers, and the map of each with its cells' forces and raw words."""
    state = report.state
    return {
        "present": report.present,
        "age_s": age_s,
        "force_N": list(state.force_N),
        "deviation_N": list(state.deviation_N),
        "total_N": sum(state.force_N),
        "touching": list(state.touching),
        "valid_cells": list(state.valid_cells),
        "cells": {side: _map_of([c for c in report.cells if c.finger == i]) for i, side in enumerate(SIDES)},
    }


def pad_recording(report: PadReport) -> dict[str, Any]:
    """One frame for the recording: all that the forces were made of, so that a grasp can be evaluated again with
    another calibration: force = Σ gain · (counts above zero − thermal · change of the smooth temperature count), where
    `counts` is that difference with the calibration of the day."""
    cells = report.cells
    return {
        "finger": [cell.finger for cell in cells],
        "place": [[cell.row, cell.column] for cell in cells],
        "pressure": [cell.pressure for cell in cells],
        "temperature": [cell.temperature for cell in cells],
        "quality": [cell.quality for cell in cells],
        "counts": [cell.counts for cell in cells],
        "zero_counts": [cell.zero_counts for cell in cells],
        "zero_temperature": [cell.zero_temperature for cell in cells],
        "smooth_temperature": [cell.smooth_temperature for cell in cells],
        "cell_force_N": [cell.force_N for cell in cells],
        "coefficients": [cell.coefficients.hex() for cell in cells],
        "force_N": list(report.state.force_N),
        "deviation_N": list(report.state.deviation_N),
        "touching": list(report.state.touching),
    }


def quality_words(quality: int) -> str:
    """What is wrong with a cell, in words; empty: nothing."""
    return " ".join(str(flag.name).lower() for flag in CellQuality(quality))


def _map_of(cells: list[CellState]) -> dict[str, Any]:
    return {
        "place": [[cell.row, cell.column] for cell in cells],
        "force_N": [cell.force_N for cell in cells],
        "pressure": [cell.pressure for cell in cells],
        "temperature": [cell.temperature for cell in cells],
        "zero_counts": [cell.zero_counts for cell in cells],
        "quality": [quality_words(cell.quality) for cell in cells],
    }
