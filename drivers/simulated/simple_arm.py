"""A simple arm behind the simulated pucks: seven joints that turn independently, for tests that need no world.

Each joint is an inertia with viscous friction; idle motors brake. With `gravity_Nm` it also has weight, from whatever
model the caller gives. Between changes of torque the motion is the exact solution. Joint angles in rad, torques in N·m,
times in ns. Source: WAM reference 6.5 (rotor inertia, friction).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.clock import nanoseconds, seconds
from drivers.errors import InputError
from drivers.wam.parameters import JOINTS, WamParameters

LINK_INERTIA_KGM2 = (0.8, 0.8, 0.15, 0.15, 0.004, 0.004, 0.0003)
"""Of the links that hang on each joint, half stretched [assumed]; added to the rotors'."""
BRAKING_NMS_PER_RAD = (150.0, 150.0, 50.0, 30.0, 2.5, 2.5, 0.25)
"""Shorted motors at the joints [assumed], as the simulated world has them."""
_LONGEST_STEP_NS = nanoseconds(0.002)


class SimpleArm:
    """An `ArmPlant`. Torque changes may lie ahead of its time; they take effect when it gets there."""

    def __init__(
        self,
        parameters: WamParameters,
        joint_rad: ArrayLike,
        *,
        gravity_Nm: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
        start_ns: int = 0,
    ) -> None:
        """At rest at `joint_rad`, shape (7,). `gravity_Nm`: the torque (7) that holds the arm at joint angles (7).

        InputError for anything but seven finite angles.
        """
        self._joint_rad = np.array(joint_rad, dtype=np.float64)
        if self._joint_rad.shape != (JOINTS,) or not np.all(np.isfinite(self._joint_rad)):
            raise InputError(f"joint_rad = {joint_rad!r} is not accepted; expected seven finite numbers.")
        self.joint_rad_s: NDArray[np.float64] = np.zeros(JOINTS)
        """Joint speeds (7)."""
        self._inertia = np.array(LINK_INERTIA_KGM2) + parameters.rotor_inertia_kgm2
        self._friction = parameters.viscous_friction_Nms_per_rad
        self._braking = self._friction + np.array(BRAKING_NMS_PER_RAD)
        self._gravity_Nm = gravity_Nm
        self._torque_Nm: NDArray[np.float64] = np.zeros(JOINTS)
        self._brakes = True
        self._decays: dict[tuple[int, bool], tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        self._changes: deque[tuple[int, NDArray[np.float64], bool]] = deque()
        self._time_ns = start_ns

    def joint_position_rad(self) -> NDArray[np.float64]:
        """Joint angles (7) at the time to which it was last advanced."""
        return self._joint_rad.copy()

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        """Motor torques at the joints (7) from `at_ns` on; changes come in order of time."""
        self._changes.append((at_ns, torque_Nm, braking))

    def advance_to(self, now_ns: int) -> None:
        """Move on to `now_ns`; a time that is past does nothing."""
        while self._time_ns < now_ns:
            while self._changes and self._changes[0][0] <= self._time_ns:
                _, self._torque_Nm, self._brakes = self._changes.popleft()
            until_ns = min(now_ns, self._changes[0][0]) if self._changes else now_ns
            if self._gravity_Nm is not None:
                until_ns = min(until_ns, self._time_ns + _LONGEST_STEP_NS)
            self._turn(until_ns - self._time_ns)
            self._time_ns = until_ns

    def _turn(self, duration_ns: int) -> None:
        """Constant torque and linear friction: speeds approach their final values exponentially."""
        torque_Nm = self._torque_Nm
        if self._gravity_Nm is not None:
            torque_Nm = torque_Nm - self._gravity_Nm(self._joint_rad)
        damping = self._braking if self._brakes else self._friction
        final_rad_s = torque_Nm / damping
        excess_rad_s = self.joint_rad_s - final_rad_s
        decay, coasting_s = self._decay(duration_ns, self._brakes)
        self._joint_rad = self._joint_rad + final_rad_s * seconds(duration_ns) + excess_rad_s * coasting_s
        self.joint_rad_s = final_rad_s + excess_rad_s * decay

    def _decay(self, duration_ns: int, brakes: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Share of the excess speed that is left after a time, and the way it made, per rad/s. Times recur: kept."""
        kept = self._decays.get((duration_ns, brakes))
        if kept is None:
            damping = self._braking if brakes else self._friction
            decay = np.exp(-seconds(duration_ns) * damping / self._inertia)
            kept = self._decays[duration_ns, brakes] = decay, (1.0 - decay) * self._inertia / damping
        return kept
