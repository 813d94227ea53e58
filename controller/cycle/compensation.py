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

from controller.cycle.path_planning import NO_PLAN

Array = NDArray[np.float64]
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


def after(first: Vector3, then: PlanarMotion) -> PlanarMotion:
    """first · then: the offset `then`, begun where the hand is off by `first` already (x, y, θ; m, rad)."""
    x, y, angle = first
    cos, sin = math.cos(angle), math.sin(angle)
    (px, py, phi), (vx, vy, w), (ax, ay, alpha) = then
    return PlanarMotion(
        (x + cos * px - sin * py, y + sin * px + cos * py, angle + phi),
        (cos * vx - sin * vy, sin * vx + cos * vy, w),
        (cos * ax - sin * ay, sin * ax + cos * ay, alpha),
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
        self.failures = 0
        """Periods in which no plan was found."""

    def reset(self) -> None:
        """No offset, and none under way."""
        self.motion = STILL

    def step(self, target: PlanarMotion) -> PlanarMotion:
        """One period towards `target`, the offset wanted at the end of this period."""
        dt, request, limits = self._period_s, self._input, self._limits
        pose, rate, acceleration = self.motion
        request.current_position = [
            _clean(o - (p - v * dt + 0.5 * a * dt * dt))
            for o, p, v, a in zip(pose, target.pose, target.rate, target.acceleration, strict=True)
        ]
        request.current_velocity = [
            _clean(o - (v - a * dt)) for o, v, a in zip(rate, target.rate, target.acceleration, strict=True)
        ]
        request.current_acceleration = [_clean(o - a) for o, a in zip(acceleration, target.acceleration, strict=True)]
        request.max_velocity = [_left(m, v) for m, v in zip(limits.velocity, target.rate, strict=True)]
        request.max_acceleration = [_left(m, a) for m, a in zip(limits.acceleration, target.acceleration, strict=True)]
        if not self._planned():
            # Where two kinds of profile meet to the last bit Ruckig finds none; a nanometre aside it does.
            request.current_position = [position + 1e-9 for position in request.current_position]
            if not self._planned():
                self.failures += 1
                x, y, angle = (o + v * dt for o, v in zip(pose, rate, strict=True))
                self.motion = PlanarMotion((x, y, angle), rate, STILL.acceleration)  # coast, and plan anew from there
                return self.motion
        self.motion = PlanarMotion(
            _sum(target.pose, self._output.new_position),
            _sum(target.rate, self._output.new_velocity),
            _sum(target.acceleration, self._output.new_acceleration),
        )
        return self.motion

    def _planned(self) -> bool:
        try:
            self._generator.update(self._input, self._output)
        except NO_PLAN:
            return False
        return True


class WristOffset:
    """X and its twist from the planar hand offset, for one mount T_wrist_hand."""

    def __init__(self, T_wrist_hand: Array) -> None:
        self._T_wrist_hand = T_wrist_hand.copy()
        self._T_hand_wrist = np.linalg.inv(T_wrist_hand)
        self._hand_wrist_rows: list[list[float]] = self._T_hand_wrist[:3].tolist()
        self.plan(np.eye(4))

    def matrix(self, offset: PlanarMotion) -> Array:
        """X = T_WH · D · T_WH⁻¹, 4×4."""
        x, y, angle = offset.pose
        cos, sin = math.cos(angle), math.sin(angle)
        D = np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
        X: Array = self._T_wrist_hand @ D @ self._T_hand_wrist
        return X

    def plan(self, T_world_wrist: Array) -> None:
        """Take the planned wrist pose (4×4, world) that `lay_on` lays offsets on; whenever it has changed."""
        T_world_hand = T_world_wrist @ self._T_wrist_hand
        self._x_axis, self._y_axis, self._normal, self._hand_origin = T_world_hand[:3].T.tolist()
        self._wrist_origin: list[float] = T_world_wrist[:3, 3].tolist()

    def lay_on(self, offset: PlanarMotion, target: Array, twist: Array) -> Vector3:
        """Write T_world_wrist · X into `target` (4×4) and the offset's twist (6, world axes, linear first, at the
        target's origin) into `twist`; returns the shift (3, m) from planned to target origin.

        The same as `matrix`, in plain numbers: this runs in the cycle.
        """
        x, y, angle = offset.pose
        vx, vy, rate = offset.rate
        cos, sin = math.cos(angle), math.sin(angle)
        axes = list(zip(self._x_axis, self._y_axis, self._normal, strict=True))
        # World axes of the hand turned by the offset, then the wrist in them.
        turned = [(cos * a + sin * b, cos * b - sin * a, n) for a, b, n in axes]
        (r00, r01, r02, px), (r10, r11, r12, py), (r20, r21, r22, pz) = self._hand_wrist_rows
        rows = [
            (u * r00 + v * r10 + n * r20, u * r01 + v * r11 + n * r21, u * r02 + v * r12 + n * r22)
            for u, v, n in turned
        ]
        l0, l1, l2 = (u * px + v * py + n * pz for u, v, n in turned)
        hand = [o + x * a + y * b for o, (a, b, _) in zip(self._hand_origin, axes, strict=True)]
        origin = (hand[0] + l0, hand[1] + l1, hand[2] + l2)
        target[:3] = [(*row, place) for row, place in zip(rows, origin, strict=True)]
        n0, n1, n2 = self._normal
        (a0, b0, _), (a1, b1, _), (a2, b2, _) = axes
        twist[:] = (
            vx * a0 + vy * b0 + rate * (n1 * l2 - n2 * l1),
            vx * a1 + vy * b1 + rate * (n2 * l0 - n0 * l2),
            vx * a2 + vy * b2 + rate * (n0 * l1 - n1 * l0),
            rate * n0,
            rate * n1,
            rate * n2,
        )
        w0, w1, w2 = self._wrist_origin
        return (origin[0] - w0, origin[1] - w1, origin[2] - w2)


def _clean(value: float) -> float:
    """Round-off of a deviation that has ended would only send Ruckig looking for a plan."""
    return 0.0 if abs(value) < 1e-11 else value


def _left(limit: float, used: float) -> float:
    """What the target's motion leaves of a limit; never less than a fifth, so that a deviation always ends."""
    return max(limit - abs(used), 0.2 * limit)


def _sum(first: Vector3, second: list[float]) -> Vector3:
    return (first[0] + second[0], first[1] + second[1], first[2] + second[2])
