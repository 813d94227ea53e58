"""The last guard of the position limits: whatever is commanded, the joint control sees it brake before a limit.

The commanded motion keeps the limits by itself (`joint_bounds.py`); this is for a command gone wrong. Near a limit a
joint's command may move outwards no faster than it can still stop, at `GUARD_ACCELERATION` times the acceleration
limit, by the same stopping distance. So the joint control is asked to rest at the limit, and draws a joint that is
beyond it inwards, with its own gains, which are stable. A command that keeps the limits is passed on untouched.

A joint that begins outside, as joint 4 does at home (WAM reference 0, 8), may rest there or move inwards: it is not
kicked. Once a command is let in again, the guarded one catches up with the same acceleration. Angles in rad, (7).
"""

from __future__ import annotations

from math import isfinite

from controller.cycle.arm_model import FloatArray
from controller.cycle.joint_bounds import JointLimits, stoppable_speed
from drivers.errors import InputError

GUARD_ACCELERATION = 3.0
_CAUGHT_UP_RAD = 1e-6


class SoftLimits:
    """Keeps each joint's command inside its limits. Call `reset` on activation, then `held` once a period.

    Plain floats: arrays of seven cost more than they save here.
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        if not (isfinite(period_s) and period_s > 0.0):
            raise InputError(f"period_s is {period_s}; expected a positive time in seconds.")
        self._period_s = period_s
        braking = GUARD_ACCELERATION * limits.acceleration_rad_s2
        near = limits.velocity_rad_s * (limits.velocity_rad_s / (2.0 * braking) + period_s)
        self._free = list(zip((limits.lower_rad + near).tolist(), (limits.upper_rad - near).tolist(), strict=True))
        self._joints = list(
            zip(limits.lower_rad.tolist(), limits.upper_rad.tolist(), (braking * period_s).tolist(), strict=True)
        )
        self._angles = [0.0] * len(self._joints)
        self.speeds = [0.0] * len(self._joints)
        """Of the command last passed on (7, rad/s)."""
        self._apart: list[int] = []
        """Joints whose guarded command is not where it is wanted."""

    def reset(self, q: list[float]) -> None:
        """Begin at rest at the joint angles `q` (7), inside or outside."""
        self._angles, self.speeds, self._apart = q, [0.0] * len(q), []

    def held(self, q: FloatArray, v: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The command's position, velocity and acceleration (7) of this period, braked where it runs into a limit.

        Where nothing is in the way, the arrays themselves. NaN is passed on.
        """
        angles, speeds = q.tolist(), v.tolist()
        free = not self._apart
        for angle, (lower, upper) in zip(angles, self._free, strict=True):
            if not lower < angle < upper:
                free = False
        if not free:
            q, v, a = q.copy(), v.copy(), a.copy()
            apart = []
            for joint, angle in enumerate(angles):
                guarded, speed = self._guarded(joint, angle)
                if guarded != angle:
                    apart.append(joint)
                    a[joint] = (speed - self.speeds[joint]) / self._period_s
                    q[joint] = angles[joint] = guarded
                    v[joint] = speeds[joint] = speed
            self._apart = apart
        self._angles, self.speeds = angles, speeds
        return q, v, a

    def _guarded(self, joint: int, angle: float) -> tuple[float, float]:
        """Where this joint's command may be now, and its speed; `angle` itself where that is allowed."""
        lower, upper, change = self._joints[joint]
        before, speed_before = self._angles[joint], self.speeds[joint]
        period_s = self._period_s
        wanted = (angle - before) / period_s
        if joint in self._apart and abs(angle - before) > _CAUGHT_UP_RAD:
            # The command is elsewhere, because it was beyond a limit. Follow, able to stop where it is met.
            reach = stoppable_speed(abs(angle - before), change, period_s)
            wanted = min(max(reach if wanted > 0.0 else -reach, speed_before - change), speed_before + change)
        outwards = max(stoppable_speed(upper - before, change, period_s), speed_before - change)
        inwards = min(-stoppable_speed(before - lower, change, period_s), speed_before + change)
        speed = min(max(wanted, inwards), outwards)
        if speed == (angle - before) / period_s:
            return angle, speed
        return before + period_s * speed, speed
