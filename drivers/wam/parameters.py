"""The arm's numbers: home, limits, motor constants and friction, read from `wam7.toml`.

All arrays have seven elements in joint order (base to tool), or motor order where the name says motor, and are
read-only. SI units, joint angles in the DH convention of the WAM reference 6.1; sources beside the values in the file.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigurationError

JOINTS = 7
_BUILT_IN = Path(__file__).with_name("wam7.toml")


@dataclass(frozen=True, eq=False)
class WamParameters:
    """Constants of one arm; each array has shape (7,), float64."""

    name: str
    home_rad: NDArray[np.float64]
    """Pose in which the arm is zeroed."""
    joint_lower_rad: NDArray[np.float64]
    joint_upper_rad: NDArray[np.float64]
    joint_velocity_limit_rad_s: NDArray[np.float64]
    joint_effort_limit_Nm: NDArray[np.float64]
    counts_per_turn: NDArray[np.float64]
    """Encoder counts a motor turn (CTS), motors 1 to 7."""
    units_per_Nm: NDArray[np.float64]
    """Puck units per N·m of motor torque (IPNM), motors 1 to 7."""
    motor_torque_limit_units: NDArray[np.float64]
    """Largest magnitude that a puck applies (MT), puck units, motors 1 to 7."""
    rotor_inertia_kgm2: NDArray[np.float64]
    """Rotor inertia seen from the joint, to be added about the joint axis."""
    viscous_friction_Nms_per_rad: NDArray[np.float64]


_ANY_SIGN = frozenset({"home_rad", "joint_lower_rad", "joint_upper_rad"})


def load_wam_parameters(path: Path | None = None) -> WamParameters:
    """Read a parameter file; without `path` the packaged `wam7.toml`.

    Raises ConfigurationError, naming file, key, value and what is accepted.
    """
    file = _BUILT_IN if path is None else path
    try:
        with file.open("rb") as stream:
            content = tomllib.load(stream)
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(file, "file", str(error), "a readable TOML file") from error
    known = {field.name for field in fields(WamParameters)}
    for key in content.keys() - known:
        raise ConfigurationError(file, key, content[key], f"only the keys {', '.join(sorted(known))}")
    for key in known - content.keys():
        raise ConfigurationError(file, key, None, "a value: the key is missing")
    name = content.pop("name")
    if not isinstance(name, str):
        raise ConfigurationError(file, "name", name, "a string")
    parameters = WamParameters(name=name, **{key: _seven(file, key, content[key]) for key in content})
    if np.any(parameters.joint_lower_rad >= parameters.joint_upper_rad):
        accepted = "each lower limit below its upper limit"
        raise ConfigurationError(file, "joint_lower_rad", content["joint_lower_rad"], accepted)
    return parameters


def _seven(file: Path, key: str, value: object) -> NDArray[np.float64]:
    """Check one array: seven finite numbers, positive unless the key is an angle."""
    accepted = "seven finite numbers" if key in _ANY_SIGN else "seven finite positive numbers"
    if not isinstance(value, list) or len(value) != JOINTS:
        raise ConfigurationError(file, key, value, accepted)
    if any(isinstance(item, bool) or not isinstance(item, int | float) for item in value):
        raise ConfigurationError(file, key, value, accepted)
    array = np.array(value, dtype=np.float64)
    if not np.all(np.isfinite(array)) or (key not in _ANY_SIGN and np.any(array <= 0.0)):
        raise ConfigurationError(file, key, value, accepted)
    array.flags.writeable = False
    return array
