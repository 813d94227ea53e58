"""The pads' own file: TOML with what `stillgrasp calibrate tactile` measured; keys begin with the finger's side.

Units: N a count, counts of compensated pressure a temperature count (TakkTile reference 6).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from calibration.toml_files import FieldError, read_toml
from drivers.errors import InputError
from drivers.takktile.calibration import PadCalibration
from drivers.takktile.frames import Cell
from drivers.wam.own_file import write_own_file

SIDES = ("right", "left")
Row = Annotated[int, Meta(ge=0, le=7)]
Column = Annotated[int, Meta(ge=0, le=5)]
Cells = Annotated[tuple[tuple[Row, Column], ...], Meta(min_length=1, max_length=48)]
_Gain = Annotated[float, Meta(ge=0, le=10)]
_Thermal = Annotated[float, Meta(ge=-100, le=100)]
_Chip = Annotated[str, Meta(pattern="^[0-9a-fA-F]{16}$")]
_HEADER = (
    "# What was measured on these tactile pads. Written by `stillgrasp calibrate tactile`, which keeps all keys but\n"
    "# no comments; the file before the last calibration is beside this one, ending in .bak.\n"
)


class TactileFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file's keys; a side that was not calibrated is left out."""

    right_cells: Cells | None = None
    right_gain_N_per_count: tuple[_Gain, ...] = ()
    right_thermal_counts: tuple[_Thermal, ...] = ()
    right_coefficients: tuple[_Chip, ...] = ()
    right_residual_N: Annotated[float, Meta(ge=0)] = 0.0
    left_cells: Cells | None = None
    left_gain_N_per_count: tuple[_Gain, ...] = ()
    left_thermal_counts: tuple[_Thermal, ...] = ()
    left_coefficients: tuple[_Chip, ...] = ()
    left_residual_N: Annotated[float, Meta(ge=0)] = 0.0

    def __post_init__(self) -> None:
        for side in SIDES:
            cells = getattr(self, f"{side}_cells") or ()
            for key in ("gain_N_per_count", "thermal_counts", "coefficients"):
                if len(getattr(self, f"{side}_{key}")) != len(cells):
                    raise FieldError(f"{side}_{key}", f"as many values as {side}_cells, {len(cells)}")
            if cells and max(getattr(self, f"{side}_gain_N_per_count")) <= 0.0:
                raise FieldError(f"{side}_gain_N_per_count", "at least one gain above 0")

    def pad(self, side: str) -> PadCalibration | None:
        """One side's calibration; None if it was not calibrated."""
        cells = getattr(self, f"{side}_cells")
        if cells is None:
            return None
        return PadCalibration(
            tuple(Cell(*cell) for cell in cells),
            getattr(self, f"{side}_gain_N_per_count"),
            getattr(self, f"{side}_thermal_counts"),
            getattr(self, f"{side}_coefficients"),
        )


def read_tactile_file(file: Path) -> TactileFile:
    """The file's content. Raises ConfigurationError."""
    return read_toml(file, TactileFile)


def check_tactile_file(file: Path) -> None:
    """Whether a calibration can be written there, before somebody lays out weights for half an hour.

    Raises ConfigurationError for a damaged file, and InputError for a place that cannot be written.
    """
    if file.exists():
        read_tactile_file(file)
    directory = next(parent for parent in file.absolute().parents if parent.exists())
    if not directory.is_dir() or not os.access(directory, os.W_OK):
        raise InputError(f"{file} cannot be written.", help="Name a file in a directory of yours.")


def write_pad(file: Path, side: str, pad: PadCalibration, residual_N: float) -> None:
    """Lay one side's calibration over the file, which need not exist. Raises ConfigurationError and InputError."""
    changes: dict[str, object] = {
        f"{side}_cells": [list(cell) for cell in pad.cells],
        f"{side}_gain_N_per_count": _rounded(pad.gain_N_per_count),
        f"{side}_thermal_counts": _rounded(pad.thermal_counts),
        f"{side}_coefficients": list(pad.coefficients),
        f"{side}_residual_N": round(residual_N, 4),
    }
    check_tactile_file(file)
    write_own_file(file, changes, header=_HEADER)


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(float(value), 8) for value in values]
