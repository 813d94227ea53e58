"""Readings of tendon motors under known loads as a file: CSV or TOML, one reading a row.

    side        right, left
    model       such as XM430-W350       firmware   the motor's, a number
    motion      winding, unwinding
    mass_kg, or tension_N
    speed_mm_s  of the tendon
    effort      A, or load as a part of full output at that supply; positive = tightening
    voltage_V, temperature_C             the motor's own

CSV has these names in its first line; lines that begin with # are passed over. TOML has a `[[reading]]` for each.
`stillgrasp calibrate motor-load` writes such a CSV and reads both.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2
from calibration.load_calibration import check_model_name
from calibration.motor_load import Reading
from calibration.toml_files import FieldError, from_document, load_document
from drivers.dynamixel.load_law import SpoolMotion
from drivers.errors import ConfigurationError, InputError

Side = Literal["right", "left"]
_MOTIONS = {"winding": SpoolMotion.WINDING, "unwinding": SpoolMotion.UNWINDING}
_NUMBERS = ("mass_kg", "tension_N", "speed_mm_s", "effort", "voltage_V", "temperature_C")


@dataclass(frozen=True, slots=True)
class MotorReadings:
    """All readings of one motor."""

    side: Side
    model: str
    firmware: int
    readings: tuple[Reading, ...]


class _Row(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    side: Side
    model: str
    firmware: Annotated[int, Meta(ge=0, le=255)]
    motion: Literal["winding", "unwinding"]
    mass_kg: Annotated[float, Meta(ge=0, le=50)] | None = None
    tension_N: Annotated[float, Meta(ge=0, le=500)] | None = None
    speed_mm_s: Annotated[float, Meta(gt=0, le=200)]
    effort: Annotated[float, Meta(ge=-10, le=10)]
    voltage_V: Annotated[float, Meta(ge=5, le=30)]
    temperature_C: Annotated[float, Meta(ge=-20, le=120)]

    def __post_init__(self) -> None:
        check_model_name("model", self.model)
        if (self.mass_kg is None) == (self.tension_N is None):
            raise FieldError("tension_N" if self.mass_kg is not None else "mass_kg", "either mass_kg or tension_N")


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    reading: list[_Row]


def read_readings(file: Path) -> list[MotorReadings]:
    """The motors of a readings file, right first. ConfigurationError that names file, line, value and what is accepted;
    InputError for a side with several models or firmwares."""
    if file.suffix.lower() == ".csv":
        rows, places = _csv_rows(file)
    else:
        rows = load_document(file)
        entries = rows.get("reading", ())
        places = [f"reading {number}" for number in range(1, len(entries) + 1)] if isinstance(entries, list) else []
    document = from_document(rows, _File, file, written_as=lambda key: _as_written(key, places))
    motors = []
    for side in ("right", "left"):
        own = [(row, place) for row, place in zip(document.reading, places, strict=True) if row.side == side]
        if not own:
            continue
        first = own[0][0]
        for row, place in own:
            if (row.model, row.firmware) != (first.model, first.firmware):
                raise InputError(
                    f"{file}: {place} is of a {row.model}, firmware {row.firmware}; the {side} motor's first of a "
                    f"{first.model}, firmware {first.firmware}.",
                    help="Give the readings of one motor a side.",
                )
        motors.append(MotorReadings(first.side, first.model, first.firmware, tuple(_reading(*one) for one in own)))
    if not motors:
        raise InputError(f"{file}: no readings.", help="Write a line for each stroke that was measured.")
    return motors


def write_readings(file: Path, motors: Sequence[MotorReadings]) -> None:
    """Write them as CSV, a file that is there already being replaced. InputError if it cannot be written."""
    text = io.StringIO()
    names = [name for name in _Row.__struct_fields__ if name != "mass_kg"]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for motor in motors:
        for reading in motor.readings:
            writer.writerow(
                {
                    "side": motor.side,
                    "model": motor.model,
                    "firmware": motor.firmware,
                    "motion": reading.motion.name.lower(),
                    "tension_N": f"{reading.tension_N:.4f}",
                    "speed_mm_s": f"{1e3 * abs(reading.rate_m_s):.4f}",
                    "effort": f"{reading.effort:.6f}",
                    "voltage_V": f"{reading.voltage_V:.2f}",
                    "temperature_C": f"{reading.temperature_C:.1f}",
                }
            )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text.getvalue())
    except OSError as error:
        raise InputError(f"{file}: the readings cannot be written there ({error.strerror}).") from error


def _reading(row: _Row, place: str) -> Reading:
    motion = _MOTIONS[row.motion]
    tension_N = row.tension_N
    if tension_N is None:
        tension_N = STANDARD_GRAVITY_M_PER_S2 * (row.mass_kg or 0.0)
    rate_m_s = motion.value * row.speed_mm_s * 1e-3
    return Reading(motion, tension_N, row.effort, rate_m_s, row.voltage_V, row.temperature_C, place)


def _csv_rows(file: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(file, "(file)", str(error), "a readable CSV file") from error
    kept = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not kept:
        return {"reading": []}, []
    names = [name.strip() for name in next(csv.reader([kept[0][1]]))]
    rows, places = [], []
    for number, line in kept[1:]:
        values = [value.strip() for value in next(csv.reader([line]))]
        if len(values) != len(names):
            raise ConfigurationError(file, f"line {number}", line, f"{len(names)} values: {', '.join(names)}")
        rows.append({name: _value(name, value) for name, value in zip(names, values, strict=True) if value})
        places.append(f"line {number}")
    return {"reading": rows}, places


def _value(name: str, text: str) -> float | int | str:
    try:
        if name == "firmware":
            return int(text)
        return float(text) if name in _NUMBERS else text
    except ValueError:
        return text  # the decoder says what was expected of it


def _as_written(key: str, places: Sequence[str]) -> str:
    """'reading[3].effort' as 'line 5, effort'."""
    head, _, name = key.partition("].")
    number = head.removeprefix("reading[").rstrip("]")
    if not number.isdigit() or int(number) >= len(places):
        return key
    return f"{places[int(number)]}, {name}" if name else places[int(number)]
