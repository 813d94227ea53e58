"""The arm's numbers: home, limits, motor constants and friction, read from `wam7.toml` and the arm's own file.

The own file holds what was measured on one arm, any of the same keys; it is laid over the packaged file.

Arrays have seven elements in joint order (base to tool), or motor order where the name says motor, and are read-only.
SI units, joint angles in the DH convention of the WAM reference 6.1; sources beside the values in the file.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigurationError
from drivers.wam.own_file import read_flat_toml

JOINTS = 7
_BUILT_IN = Path(__file__).with_name("wam7.toml")


@dataclass(frozen=True, eq=False)
class WamParameters:
    """Constants of one arm; each array has shape (7,), float64."""

    name: str
    home_rad: NDArray[np.float64]
    """Pose in which the arm is zeroed; it may lie outside the joint limits."""
    zero_angle_rad: NDArray[np.float64]
    """Motor angles that the absolute encoders of motors 1 to 7 show with all joints at 0; outside [0, 2π]: unused."""
    safety_velocity_m_s: float
    """Fault limit of the elbow's speed that the safety puck watches."""
    safety_motor_torque_Nm: float
    """Fault limit of the commanded torque of motors 1 to 4 that the safety puck watches."""
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
    joint_encoder_counts: NDArray[np.float64]
    """Counts a joint turn of the joint encoders; 0 where there cannot be one."""
    use_joint_encoders: bool
    """Whether joint encoders, where fitted and indexed, tell the angles of their joints."""
    rotor_inertia_kgm2: NDArray[np.float64]
    """Rotor inertia seen from the joint, to be added about the joint axis."""
    viscous_friction_Nms_per_rad: NDArray[np.float64]
    gravity_mu_kg_m: NDArray[np.float64] | None = None
    """Identified gravity vectors of the bare arm, (7, 3), each in its link's DH frame (6.6); None: masses are used."""


_OPTIONAL = frozenset({"gravity_mu_kg_m"})
_LARGEST_MU_KG_M = 20.0
"""Ten times what the whole arm weighs at the elbow."""
_ANY_SIGN = frozenset({"home_rad", "zero_angle_rad", "joint_lower_rad", "joint_upper_rad"})
_OR_ZERO = frozenset({"joint_encoder_counts"})
_HIGHEST = {"safety_velocity_m_s": 7.0, "safety_motor_torque_Nm": 3.0}
"""Single numbers: above these the safety puck would never fault (WAM reference 3.2)."""


def load_wam_parameters(path: Path | None = None, *, own: Path | None = None) -> WamParameters:
    """Read a parameter file; without `path` the packaged `wam7.toml`. Keys of the arm's `own` file are laid over it.

    Raises ConfigurationError, naming file, key, value and what is accepted.
    """
    base = _BUILT_IN if path is None else path
    known = {field.name for field in fields(WamParameters)}
    origin: dict[str, Path] = {}
    content: dict[str, object] = {}
    for file in (base, own):
        if file is not None:
            document = read_flat_toml(file)
            for key in document.keys() - known:
                raise ConfigurationError(file, key, document[key], f"only the keys {', '.join(sorted(known))}")
            content |= document
            origin |= dict.fromkeys(document, file)
    for key in known - _OPTIONAL - content.keys():
        raise ConfigurationError(base, key, None, "a value: the key is missing")
    values: dict[str, Any] = {}
    for key, value in content.items():
        if key == "name":
            if not isinstance(value, str):
                raise ConfigurationError(origin[key], key, value, "a string")
            values[key] = value
        elif key == "use_joint_encoders":
            if not isinstance(value, bool):
                raise ConfigurationError(origin[key], key, value, "true or false")
            values[key] = value
        elif key in _HIGHEST:
            values[key] = _number(origin[key], key, value)
        elif key in _OPTIONAL:
            values[key] = _gravity_vectors(origin[key], key, value)
        else:
            values[key] = _seven(origin[key], key, value)
    parameters = WamParameters(**values)
    if np.any(parameters.joint_lower_rad >= parameters.joint_upper_rad):
        accepted = "each lower limit below its upper limit"
        raise ConfigurationError(origin["joint_lower_rad"], "joint_lower_rad", content["joint_lower_rad"], accepted)
    return parameters


def _number(file: Path, key: str, value: object) -> float:
    """Check a single number."""
    highest = _HIGHEST[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= highest:
        raise ConfigurationError(file, key, value, f"a number above 0 and at most {highest:g}")
    return float(value)


def _seven(file: Path, key: str, value: object) -> NDArray[np.float64]:
    """Check one array: seven finite numbers, positive unless the key is an angle."""
    lowest = -np.inf if key in _ANY_SIGN else 0.0 if key in _OR_ZERO else np.finfo(np.float64).tiny
    accepted = "seven finite numbers"
    if key not in _ANY_SIGN:
        accepted += ", none negative" if key in _OR_ZERO else ", all positive"
    if not isinstance(value, list) or len(value) != JOINTS:
        raise ConfigurationError(file, key, value, accepted)
    if any(isinstance(item, bool) or not isinstance(item, int | float) for item in value):
        raise ConfigurationError(file, key, value, accepted)
    array = np.array(value, dtype=np.float64)
    if not np.all(np.isfinite(array)) or np.any(array < lowest):
        raise ConfigurationError(file, key, value, accepted)
    array.flags.writeable = False
    return array


def _gravity_vectors(file: Path, key: str, value: object) -> NDArray[np.float64]:
    """Check seven rows of three numbers."""
    rows = value if isinstance(value, list) else []
    numbers = [item for row in rows if isinstance(row, list) and len(row) == 3 for item in row]
    real = all(isinstance(item, int | float) and not isinstance(item, bool) for item in numbers)
    if len(rows) != JOINTS or len(numbers) != 3 * JOINTS or not real:
        raise ConfigurationError(file, key, value, "seven rows of three numbers, kg·m")
    array = np.array(rows, dtype=np.float64)
    if not np.all(np.abs(array) <= _LARGEST_MU_KG_M):
        raise ConfigurationError(file, key, value, f"seven rows of three numbers within ±{_LARGEST_MU_KG_M:g} kg·m")
    array.flags.writeable = False
    return array
