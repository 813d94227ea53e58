"""Joint torques as the two packed frames that the pucks take. Pure.

Joint torques in N·m (DH), puck units on the wire. Each motor is limited by itself, behind the differentials, to the
smaller of the puck's MT and our own bound, then floored as the vendor does. A torque beyond the limit is clipped, not
scaled: the puck would clip it just so, and scaling both motors of a differential would take weight-bearing torque from
the joint that asked for nothing too much. Zeros are torques like others. Source: WAM reference 2.4, 5.1, 5.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.errors import InputError
from drivers.wam.frames import torque_data
from drivers.wam.parameters import JOINTS
from drivers.wam.transmission import joint_to_motor_torque


class TorquePacking:
    """Packs joint torques for one arm."""

    def __init__(self, units_per_Nm: ArrayLike, limit_units: ArrayLike, torque_id: int) -> None:
        """Puck units per N·m of motor torque (7), largest magnitude of each motor in puck units (7), number of T."""
        motor_per_joint = np.array([joint_to_motor_torque(row) for row in np.eye(JOINTS)]).T
        self._units_per_joint_Nm = np.asarray(units_per_Nm, dtype=np.float64)[:, None] * motor_per_joint
        self._limits: list[float] = np.asarray(limit_units, dtype=np.float64).tolist()
        self._torque_id = torque_id

    def frames(self, joint_torque_Nm: Sequence[float] | NDArray[np.float64]) -> tuple[bytes, bytes]:
        """Data of the frames to groups 1 and 2. InputError if the torques are not seven finite numbers."""
        torque_Nm = np.asarray(joint_torque_Nm, dtype=np.float64)
        if torque_Nm.shape != (JOINTS,) or not isfinite(torque_Nm.sum()):
            raise InputError(f"joint torques {torque_Nm.tolist()} are not acceptable; expected seven finite numbers.")
        units: list[float] = (self._units_per_joint_Nm @ torque_Nm).tolist()
        for motor, limit in enumerate(self._limits):
            if not -limit <= units[motor] <= limit:
                if units[motor] != units[motor]:  # enormous torques of both signs in one differential
                    raise InputError(f"joint torques {torque_Nm.tolist()} are not acceptable; expected real ones.")
                units[motor] = limit if units[motor] > 0.0 else -limit
        one, two, three, four, five, six, seven = units
        torque_id = self._torque_id
        return torque_data(one, two, three, four, torque_id), torque_data(five, six, seven, 0.0, torque_id)
