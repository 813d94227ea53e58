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
from math import isfinite, sqrt

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
    """Velocity bounds for the coming period. Plain floats: arrays of seven cost more than they save here."""

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        if not (isfinite(period_s) and period_s > 0.0):
            raise InputError(f"period_s is {period_s}; expected a positive time in seconds.")
        self.limits = limits
        self._period_s = period_s
        speed_change = limits.acceleration_rad_s2 * period_s
        # From this far away a joint at full speed can still stop: T(v) ≤ v² / (2 a) + v h.
        far = limits.velocity_rad_s * (limits.velocity_rad_s / (2.0 * limits.acceleration_rad_s2) + period_s)
        self._joints = list(
            zip(
                limits.lower_rad.tolist(),
                limits.upper_rad.tolist(),
                limits.velocity_rad_s.tolist(),
                speed_change.tolist(),
                far.tolist(),
                strict=True,
            )
        )

    def at(self, q: list[float], v_previous: list[float]) -> tuple[list[float], list[float]]:
        """Least and greatest velocity (7, rad/s) of each joint for the coming period; the box is never empty.

        q           (7) position now, rad
        v_previous  (7) velocity of the period that ends now, rad/s
        """
        lower = []
        upper = []
        for position, speed, (low, high, most, change, far) in zip(q, v_previous, self._joints, strict=True):
            slowest = speed - change
            fastest = speed + change
            room = position - low
            bound = -most if room >= far else -min(most, stoppable_speed(room, change, self._period_s))
            lower.append(slowest if bound < slowest else fastest if bound > fastest else bound)
            room = high - position
            bound = most if room >= far else min(most, stoppable_speed(room, change, self._period_s))
            upper.append(slowest if bound < slowest else fastest if bound > fastest else bound)
        return lower, upper


def stoppable_speed(room: float, change: float, period_s: float) -> float:
    """Greatest v with T(v) ≤ `room` (rad), zero outside the limit; `change` is a h, the speed's step in rad/s. Pure."""
    if room <= 0.0:
        return 0.0
    whole = int((sqrt(1.0 + 8.0 * room / (change * period_s)) - 1.0) / 2.0)
    return room / ((whole + 1) * period_s) + 0.5 * change * whole
