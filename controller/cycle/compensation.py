"""From where the object is going to where the wrist must go.

    T_BW(t) = T_BW,plan(t) · X(t),      X = T_WH · D(t) · T_WH⁻¹,      D = T_HO(0) · T_HO(t)⁻¹

exactly, in hand axes, from the table alone. D is planar for a planar hand: three numbers (x, y, θ) with exact rates,
smoothed by Ruckig and fed with velocity and acceleration: Ruckig fed with coarse positions chatters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import ruckig
from numpy.typing import NDArray

Vector3 = tuple[float, float, float]


class PlanarMotion(NamedTuple):
    """A planar pose (x m, y m, θ rad) in hand axes with its first and second derivative in time."""

    pose: Vector3
    rate: Vector3
    acceleration: Vector3


STILL = PlanarMotion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def hand_offset(contact_pose: Vector3, pose: Vector3, rate: Vector3, acceleration: Vector3) -> PlanarMotion:
    """D = T_HO(0) · T_HO(t)⁻¹ with derivatives, from the object's planar pose in the hand (x, y, θ; m, rad).

    With φ = θ₀ − θ: D = (p₀ − R(φ) p, φ), so it is zero at contact.
    """
    x, y, angle = pose
    vx, vy, w = rate
    ax, ay, alpha = acceleration
    phi = contact_pose[2] - angle
    cos, sin = math.cos(phi), math.sin(phi)
    # u = d/dt in axes that turn with R(φ): ṗ + φ̇ k×p, and its derivative, φ̇ = −ω
    ux, uy = vx + w * y, vy - w * x
    dux = ax + alpha * y + w * vy + w * uy
    duy = ay - alpha * x - w * vx - w * ux
    return PlanarMotion(
        (contact_pose[0] - (cos * x - sin * y), contact_pose[1] - (sin * x + cos * y), phi),
        (-(cos * ux - sin * uy), -(sin * ux + cos * uy), -w),
        (-(cos * dux - sin * duy), -(sin * dux + cos * duy), -alpha),
    )


@dataclass(frozen=True)
class OffsetLimits:
    """Limits of the hand offset: translation m, rotation rad, and their rates."""

    velocity: Vector3 = (0.25, 0.25, 1.5)
    acceleration: Vector3 = (2.0, 2.0, 12.0)
    jerk: Vector3 = (60.0, 60.0, 400.0)


class OffsetSmoother:
    """Follows the wanted hand offset within velocity, acceleration and jerk limits (Ruckig, three numbers).

    Ruckig plans to *reach* a state; a target that moves on would make it slow down first, to pass through the state
    just behind it, and fall back by tenths of a millimetre. So it plans the *deviation* from the target to rest at
    zero, in axes that move with the target, with what the target's own motion leaves of the limits.
    """

    def __init__(self, period_s: float, limits: OffsetLimits) -> None:
        self._period_s = period_s
        self._limits = limits
        self._generator = ruckig.Ruckig(3, period_s)
        self._input = ruckig.InputParameter(3)
        self._output = ruckig.OutputParameter(3)
        self._input.max_jerk = list(limits.jerk)
        self._input.target_position = [0.0, 0.0, 0.0]
        self._input.target_velocity = [0.0, 0.0, 0.0]
        self._input.target_acceleration = [0.0, 0.0, 0.0]
        self._input.synchronization = ruckig.Synchronization.No
        self.motion = STILL

    def reset(self) -> None:
        """No offset, and none under way."""
        self.motion = STILL

    def step(self, target: PlanarMotion) -> PlanarMotion:
        """One period towards `target`, the offset wanted at the end of this period."""
        dt, request, limits = self._period_s, self._input, self._limits
        pose, rate, acceleration = self.motion
        request.current_position = [
            o - (p - v * dt + 0.5 * a * dt * dt)
            for o, p, v, a in zip(pose, target.pose, target.rate, target.acceleration, strict=True)
        ]
        request.current_velocity = [
            o - (v - a * dt) for o, v, a in zip(rate, target.rate, target.acceleration, strict=True)
        ]
        request.current_acceleration = [o - a for o, a in zip(acceleration, target.acceleration, strict=True)]
        request.max_velocity = [_left(m, v) for m, v in zip(limits.velocity, target.rate, strict=True)]
        request.max_acceleration = [_left(m, a) for m, a in zip(limits.acceleration, target.acceleration, strict=True)]
        self._generator.update(request, self._output)
        self.motion = PlanarMotion(
            _sum(target.pose, self._output.new_position),
            _sum(target.rate, self._output.new_velocity),
            _sum(target.acceleration, self._output.new_acceleration),
        )
        return self.motion


class WristOffset:
    """X and its twist from the planar hand offset, for one mount T_wrist_hand."""

    def __init__(self, T_wrist_hand: NDArray[np.float64]) -> None:
        self._R = T_wrist_hand[:3, :3].copy()
        self._origin = T_wrist_hand[:3, 3].copy()
        self._normal = self._R[:, 2].copy()
        self._normal_cross = np.array(
            [
                [0.0, -self._normal[2], self._normal[1]],
                [self._normal[2], 0.0, -self._normal[0]],
                [-self._normal[1], self._normal[0], 0.0],
            ]
        )
        self._normal_cross2 = self._normal_cross @ self._normal_cross
        self._x_axis = self._R[:, 0].copy()
        self._y_axis = self._R[:, 1].copy()
        self._identity = np.eye(3)

    def pose(self, motion: PlanarMotion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """X as (rotation 3×3, translation m), in wrist axes."""
        x, y, angle = motion.pose
        rotation = self._identity + math.sin(angle) * self._normal_cross + (1.0 - math.cos(angle)) * self._normal_cross2
        translation = self._x_axis * x + self._y_axis * y + self._origin - rotation @ self._origin
        return rotation, translation

    def twist(
        self, motion: PlanarMotion, rotation: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Velocity of the wrist origin and angular velocity, both in the axes of the planned wrist."""
        vx, vy, w = motion.rate
        angular = self._normal * w
        linear = self._x_axis * vx + self._y_axis * vy - w * (self._normal_cross @ (rotation @ self._origin))
        return linear, angular


def _left(limit: float, used: float) -> float:
    """What the target's motion leaves of a limit; never less than a fifth, so that a deviation always ends."""
    return max(limit - abs(used), 0.2 * limit)


def _sum(first: Vector3, second: list[float]) -> Vector3:
    return (first[0] + second[0], first[1] + second[1], first[2] + second[2])
