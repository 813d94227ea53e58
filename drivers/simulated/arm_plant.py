"""What stands behind the pucks of a simulated arm: its mechanics, from outside."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class ArmPlant(Protocol):
    """The mechanics behind the pucks."""

    def joint_position_rad(self) -> NDArray[np.float64]:
        """Joint angles (7) now, rad."""
        ...

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        """Apply motor torques, as joint torques (7) in N·m, from `at_ns` until the next call. `braking`: the motors are
        idle or without power and brake resistively; the torque is then zero."""
        ...
