"""The tendon motors' own file: TOML with what `stillgrasp calibrate motors` and `motor-load` measured.

It is laid over `[tendons]` of robot.toml, which names it as `own_file`: one place for what belongs to these two motors
on this hand. Keys begin with the side, and have units in their names; ticks are the position register's counts. A load
law belongs to a motor: where another one is mounted on its side, or of another model, it is taken out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from calibration.load_calibration import LoadCalibration, check_model_name
from calibration.motor_setup import MotorSetup
from calibration.toml_files import FieldError, from_document, load_document, read_toml
from drivers.dynamixel.control_tables import model_by_name
from drivers.dynamixel.load_law import LoadLaw
from drivers.wam.own_file import write_own_file

SIDES = ("right", "left")
_MOUNTING_KEYS = ("id", "tightening_sign", "zero_ticks", "travel_m")
_CURRENT_LAW_KEYS = ("torque_constant_Nm_per_A", "friction_current_A")
_LOAD_LAW_KEYS = ("stall_torque_12V_Nm", "friction_load", "back_emf_load_s_per_m")
_LAW_KEYS = (*_CURRENT_LAW_KEYS, *_LOAD_LAW_KEYS)
_CALIBRATED = "calibrated"

_Id = Annotated[int, Meta(ge=0, le=253)]
_Sign = Literal[-1, 1]
_Ticks = Annotated[int, Meta(ge=-1048575, le=1048575)]
_Excursion = Annotated[float, Meta(ge=-0.1, le=0.5)]
_Torque = Annotated[float, Meta(gt=0, le=20)]
_Current = Annotated[float, Meta(ge=0, le=2)]
_Part = Annotated[float, Meta(ge=0, le=0.5)]
_PerSpeed = Annotated[float, Meta(ge=0, le=100)]
_HEADER = (
    "# What was measured on these tendon motors, laid over [tendons] of robot.toml. Written by `stillgrasp calibrate\n"
    "# motors` and `motor-load`, which keep no comments; the file before is beside this one, ending in .bak.\n"
)


class MotorFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file's keys; what was not measured is left out."""

    model: str | None = None
    right_id: _Id | None = None
    right_tightening_sign: _Sign | None = None
    right_zero_ticks: _Ticks | None = None
    right_travel_m: tuple[_Excursion, _Excursion] | None = None
    right_torque_constant_Nm_per_A: _Torque | None = None
    right_friction_current_A: _Current | None = None
    right_stall_torque_12V_Nm: _Torque | None = None
    right_friction_load: _Part | None = None
    right_back_emf_load_s_per_m: _PerSpeed | None = None
    right_calibrated: LoadCalibration | None = None
    left_id: _Id | None = None
    left_tightening_sign: _Sign | None = None
    left_zero_ticks: _Ticks | None = None
    left_travel_m: tuple[_Excursion, _Excursion] | None = None
    left_torque_constant_Nm_per_A: _Torque | None = None
    left_friction_current_A: _Current | None = None
    left_stall_torque_12V_Nm: _Torque | None = None
    left_friction_load: _Part | None = None
    left_back_emf_load_s_per_m: _PerSpeed | None = None
    left_calibrated: LoadCalibration | None = None

    def __post_init__(self) -> None:
        if self.model is not None:
            check_model_name("model", self.model)
        if self.right_id is not None and self.right_id == self.left_id:
            raise FieldError("left_id", f"another id than right_id = {self.right_id}")
        for side in SIDES:
            travel_m = getattr(self, f"{side}_travel_m")
            if travel_m is not None and not travel_m[0] < travel_m[1]:
                raise FieldError(f"{side}_travel_m", "a lower and then an upper excursion")
            calibrated = getattr(self, f"{side}_calibrated")
            if calibrated is not None and calibrated.model != self.model:
                raise FieldError(f"{side}_calibrated.model", f"{self.model}, as model says")

    def laid_over_tendons(self) -> dict[str, Any]:
        """The keys as they are named in `[tendons]` of robot.toml, nested as there."""
        nested: dict[str, Any] = {} if self.model is None else {"model": self.model}
        for side in SIDES:
            values = {key: getattr(self, f"{side}_{key}") for key in (*_MOUNTING_KEYS, *_LAW_KEYS)}
            calibrated: LoadCalibration | None = getattr(self, f"{side}_{_CALIBRATED}")
            if calibrated is not None:
                values[_CALIBRATED] = _present(calibrated)
            nested[side] = {key: value for key, value in values.items() if value is not None}
        return nested


@dataclass(frozen=True, slots=True)
class MeasuredLaw:
    """One motor's load law as it goes into the file."""

    motor_id: int
    law: LoadLaw
    calibrated: LoadCalibration

    def law_keys(self) -> dict[str, float]:
        """The keys of the law's own numbers."""
        law = self.law
        if model_by_name(self.calibrated.model).effort == "current":
            values = (law.torque_per_effort_Nm, law.friction_effort)
            return {key: round(value, 5) for key, value in zip(_CURRENT_LAW_KEYS, values, strict=True)}
        load_values = (law.torque_per_effort_Nm, law.friction_effort, law.back_emf_effort_s_per_m)
        return {key: round(value, 5) for key, value in zip(_LOAD_LAW_KEYS, load_values, strict=True)}


def read_motor_file(file: Path) -> MotorFile:
    """The file's content. Raises ConfigurationError."""
    return read_toml(file, MotorFile)


def write_motor_setup(file: Path, right: MotorSetup, left: MotorSetup, model: str) -> tuple[str, ...]:
    """Lay both motors over the file, which need not exist; all or nothing. A load law stays with its motor, whatever
    side it is on now; the sides whose law was taken out. Raises ConfigurationError, InputError."""
    before = read_motor_file(file) if file.exists() else MotorFile()  # a damaged file is told before it is written over
    laws = _laws_by_id(before) if before.model in (None, model) else {}
    changes: dict[str, object] = {"model": model}
    lost = []
    for side, motor in zip(SIDES, (right, left), strict=True):
        changes |= {
            f"{side}_id": motor.motor_id,
            f"{side}_tightening_sign": motor.tightening_sign,
            f"{side}_zero_ticks": motor.zero_ticks,
            f"{side}_travel_m": [round(end_m, 5) for end_m in motor.travel_m],
        }
        law = laws.get(motor.motor_id, {})
        if not law and any(getattr(before, f"{side}_{key}") is not None for key in (*_LAW_KEYS, _CALIBRATED)):
            lost.append(side)
        changes |= {f"{side}_{key}": value for key, value in law.items()}
    write_own_file(file, changes, without=_all_law_keys(SIDES), header=_HEADER)
    return tuple(lost)


def write_load_laws(file: Path, measured: Mapping[str, MeasuredLaw]) -> None:
    """Lay the load laws of these sides over the file, which need not exist; all or nothing. Raises ConfigurationError,
    InputError."""
    before = read_motor_file(file) if file.exists() else MotorFile()
    models = {one.calibrated.model for one in measured.values()}
    others: list[str] = []
    for side in SIDES:
        calibrated: LoadCalibration | None = getattr(before, f"{side}_{_CALIBRATED}")
        if side not in measured and calibrated is not None and calibrated.model not in models:
            others.append(side)  # both motors are of one model: that law is of one that is no longer there
    changes: dict[str, object] = {}
    for side, one in measured.items():
        changes |= {"model": one.calibrated.model, f"{side}_id": one.motor_id}
        changes |= {f"{side}_{key}": value for key, value in one.law_keys().items()}
        changes[f"{side}_{_CALIBRATED}"] = _present(one.calibrated)
    without = _all_law_keys((*measured, *others))
    kept = {key: value for key, value in (load_document(file) if file.exists() else {}).items() if key not in without}
    from_document({**kept, **changes}, MotorFile, file)  # a law that no start would take is not written
    write_own_file(file, changes, without=without, header=_HEADER)


def _laws_by_id(file: MotorFile) -> dict[int, dict[str, object]]:
    """The keys of each motor's load law, those that are there."""
    laws: dict[int, dict[str, object]] = {}
    for side in SIDES:
        motor_id: int | None = getattr(file, f"{side}_id")
        keys = {key: getattr(file, f"{side}_{key}") for key in _LAW_KEYS}
        law: dict[str, object] = {key: value for key, value in keys.items() if value is not None}
        calibrated: LoadCalibration | None = getattr(file, f"{side}_{_CALIBRATED}")
        if calibrated is not None:
            law[_CALIBRATED] = _present(calibrated)
        if motor_id is not None and law:
            laws[motor_id] = law
    return laws


def _all_law_keys(sides: Iterable[str]) -> list[str]:
    return [f"{side}_{key}" for side in sides for key in (*_LAW_KEYS, _CALIBRATED)]


def _present(calibrated: LoadCalibration) -> dict[str, object]:
    return {key: value for key, value in msgspec.structs.asdict(calibrated).items() if value is not None}
