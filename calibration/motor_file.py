"""The tendon motors' own file: TOML with what `stillgrasp calibrate motors` measured; keys begin with the side.

It is laid over `[tendons]` of robot.toml, which names it as `own_file`: one place for what belongs to these two motors
on this hand. Units in the keys' names; ticks are the position register's counts.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from calibration.motor_setup import MotorSetup
from calibration.toml_files import FieldError, read_toml
from drivers.dynamixel.control_tables import MODELS
from drivers.wam.own_file import write_own_file

SIDES = ("right", "left")
_MOTOR_KEYS = ("id", "tightening_sign", "zero_ticks", "travel_m")
_MODEL_NAMES = tuple(model.name for model in MODELS.values())

_Id = Annotated[int, Meta(ge=0, le=253)]
_Sign = Literal[-1, 1]
_Ticks = Annotated[int, Meta(ge=-1048575, le=1048575)]
_Excursion = Annotated[float, Meta(ge=-0.1, le=0.5)]
_HEADER = (
    "# What was measured on these tendon motors, laid over [tendons] of robot.toml. Written by `stillgrasp calibrate\n"
    "# motors`, which keeps all keys but no comments; the file before is beside this one, ending in .bak.\n"
)


class MotorFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file's keys; what was not measured is left out."""

    model: str | None = None
    right_id: _Id | None = None
    right_tightening_sign: _Sign | None = None
    right_zero_ticks: _Ticks | None = None
    right_travel_m: tuple[_Excursion, _Excursion] | None = None
    left_id: _Id | None = None
    left_tightening_sign: _Sign | None = None
    left_zero_ticks: _Ticks | None = None
    left_travel_m: tuple[_Excursion, _Excursion] | None = None

    def __post_init__(self) -> None:
        if self.model is not None and self.model not in _MODEL_NAMES:
            raise FieldError("model", f"one of {', '.join(_MODEL_NAMES)}")
        if self.right_id is not None and self.right_id == self.left_id:
            raise FieldError("left_id", f"another id than right_id = {self.right_id}")
        for side in SIDES:
            travel_m = getattr(self, f"{side}_travel_m")
            if travel_m is not None and not travel_m[0] < travel_m[1]:
                raise FieldError(f"{side}_travel_m", "a lower and then an upper excursion")

    def laid_over_tendons(self) -> dict[str, Any]:
        """The keys as they are named in `[tendons]` of robot.toml, nested as there."""
        nested: dict[str, Any] = {} if self.model is None else {"model": self.model}
        for side in SIDES:
            values = {key: getattr(self, f"{side}_{key}") for key in _MOTOR_KEYS}
            nested[side] = {key: value for key, value in values.items() if value is not None}
        return nested


def read_motor_file(file: Path) -> MotorFile:
    """The file's content. Raises ConfigurationError."""
    return read_toml(file, MotorFile)


def write_motor_setup(file: Path, right: MotorSetup, left: MotorSetup, model: str) -> None:
    """Lay both motors over the file, which need not exist; all or nothing. Raises ConfigurationError, InputError."""
    if file.exists():
        read_motor_file(file)  # a damaged file is told before it is written over
    changes: dict[str, object] = {"model": model}
    for side, motor in zip(SIDES, (right, left), strict=True):
        changes |= {
            f"{side}_id": motor.motor_id,
            f"{side}_tightening_sign": motor.tightening_sign,
            f"{side}_zero_ticks": motor.zero_ticks,
            f"{side}_travel_m": [round(end_m, 5) for end_m in motor.travel_m],
        }
    write_own_file(file, changes, header=_HEADER)
