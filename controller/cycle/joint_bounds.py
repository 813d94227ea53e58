"""How fast each joint may go in the coming period: speed, acceleration and stopping distance (viability).

Time runs in periods of length h; a joint moves by v·h in each, and v may change by a·h from one to the next. From
velocity v = n·a·h + r (0 ≤ r < a·h), this period and the braking after it together cover

    T(v) = h · ((n + 1) v − a h n (n + 1) / 2)

A velocity is allowed towards a limit at distance d when T(v) ≤ d. Then v − a·h is allowed in the next period, since
T(v − a h) = T(v) − v h: whoever obeys can always obey again, and stops before the limit without ever exceeding the
acceleration. Inverting T: with n from the whole steps, v = d / ((n + 1) h) + a h n / 2.

Outside a position limit (home may lie there) the joint may rest or move inwards. When bounds disagree, because the arm
starts outside them or they were lowered, acceleration wins, and the others are approached as fast as it allows.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from controller.cycle.arm_model import JOINTS, FloatArray
from drivers.errors import InputError
from drivers.wam.parameters import WamParameters

DEFAULT_ACCELERATION_RAD_S2 = (4.0, 4.0, 6.0, 6.0, 10.0, 10.0, 10.0)


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Position (rad), velocity (rad/s) and acceleration (rad/s²) limits of the commanded motion, (7) each."""

    lower_rad: FloatArray
    upper_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray

    def __post_init__(self) -> None:
        for name in ("lower_rad", "upper_rad", "velocity_rad_s", "acceleration_rad_s2"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (JOINTS,) or not np.isfinite(values).all():
                raise InputError(f"joint limit {name} is {values.tolist()}; expected {JOINTS} finite values.")
            if name.startswith(("velocity", "acceleration")) and values.min() <= 0.0:
                raise InputError(f"joint limit {name} is {values.tolist()}; expected positive values.")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if (self.lower_rad >= self.upper_rad).any():
            raise InputError(
                f"joint limits run from {self.lower_rad.tolist()} to {self.upper_rad.tolist()} rad; "
                "expected each lower one below its upper one."
            )

    @classmethod
    def from_parameters(cls, parameters: WamParameters) -> JointLimits:
        """The arm's own limits, with a calm acceleration (nothing published names one)."""
        return cls(
            parameters.joint_lower_rad,
            parameters.joint_upper_rad,
            parameters.joint_velocity_limit_rad_s,
            np.array(DEFAULT_ACCELERATION_RAD_S2),
        )


class JointBounds:
    """Velocity bounds for the coming period. Keeps its own arrays: what `at` returns is valid until the next call."""

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        if not (isfinite(period_s) and period_s > 0.0):
            raise InputError(f"period_s is {period_s}; expected a positive time in seconds.")
        self.limits = limits
        self._step = limits.acceleration_rad_s2 * period_s  # speed change in one period
        self._half_step = 0.5 * self._step
        self._period_s = period_s
        self._inverse_knot = 8.0 / (self._step * period_s)
        # Row 0 towards the lower limits, row 1 towards the upper ones.
        self._room = np.zeros((2, JOINTS))
        self._whole = np.zeros((2, JOINTS))
        self._speed = np.zeros((2, JOINTS))
        self._lower = np.zeros(JOINTS)
        self._upper = np.zeros(JOINTS)
        self._slowest = np.zeros(JOINTS)
        self._fastest = np.zeros(JOINTS)

    def at(self, q: FloatArray, v_previous: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest velocity (7, rad/s) for the coming period; the box is never empty.

        q           (7) position now, rad
        v_previous  (7) velocity of the period that ends now, rad/s
        """
        limits, room, whole, speed = self.limits, self._room, self._whole, self._speed
        np.subtract(q, limits.lower_rad, out=room[0])
        np.subtract(limits.upper_rad, q, out=room[1])
        np.maximum(room, 0.0, out=room)

        # n = floor((−1 + √(1 + 8 d / (a h²))) / 2)
        np.multiply(room, self._inverse_knot, out=whole)
        whole += 1.0
        np.sqrt(whole, out=whole)
        whole -= 1.0
        whole *= 0.5
        np.floor(whole, out=whole)
        np.multiply(whole, self._half_step, out=speed)
        whole += 1.0
        whole *= self._period_s
        room /= whole
        speed += room
        np.minimum(speed, limits.velocity_rad_s, out=speed)

        np.subtract(v_previous, self._step, out=self._slowest)
        np.add(v_previous, self._step, out=self._fastest)
        lower, upper = self._lower, self._upper
        np.negative(speed[0], out=lower)
        np.minimum(np.maximum(lower, self._slowest, out=lower), self._fastest, out=lower)
        np.minimum(np.maximum(speed[1], self._slowest, out=upper), self._fastest, out=upper)
        return lower, upper
