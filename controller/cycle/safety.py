"""Limits and plausibility: what ends a motion, as pure checks over numbers the cycle has anyway.

Each check answers `Reason.NONE` or the reason to stop; what is done about it is the cycle's business: the hand
freezes both excursions, the arm stops along its path and holds, or goes idle if it cannot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.cycle.compensation import PlanarMotion
from controller.messages import HandFault, Reason

Array = NDArray[np.float64]


_HAND_FAULTS = (
    (HandFault.TORQUE_LOST | HandFault.OVERHEATED, Reason.HAND_OVERHEATED),
    (HandFault.TORQUE_LOST | HandFault.OVERLOADED, Reason.HAND_OVERLOADED),
    (HandFault.RESTARTED, Reason.HAND_RESTARTED),
    (HandFault.TORQUE_LOST, Reason.HAND_TORQUE_LOST),
    (HandFault.POSITION_JUMP, Reason.HAND_POSITION_JUMP),
    (HandFault.ONE_SILENT, Reason.HAND_MOTOR_SILENT),
    (HandFault.ASTRAY, Reason.HAND_NOT_FOLLOWING),
    (HandFault.BUS_LOST, Reason.HAND_BUS_LOST),
    (HandFault.OTHER_MODE, Reason.HAND_OTHER_MODE),
    (HandFault.OUTSIDE_TURN, Reason.HAND_OUTSIDE_TURN),
    (HandFault.REFUSED, Reason.HAND_REFUSED),
    (HandFault.NO_REPLY, Reason.HAND_SILENT),
    (HandFault.VOLTAGE, Reason.HAND_VOLTAGE),
    (HandFault.HARDWARE, Reason.HAND_HARDWARE),
    (HandFault.HOT, Reason.HAND_HOT),
)
"""What the hand process says is wrong, the worst first."""
HAND_REASONS = (Reason.NONE, *(reason for _, reason in reversed(_HAND_FAULTS)))
"""What can be wrong with the hand, from nothing to the worst; one of them only the cycle can see."""
HAND_RANKS = {reason: rank for rank, reason in enumerate(HAND_REASONS)}


@dataclass(frozen=True)
class SafetyLimits:
    """Bands beyond which the cycle stops."""

    tracking_error_rad: tuple[float, ...] = (0.08, 0.08, 0.1, 0.1, 0.2, 0.2, 0.25)
    torque_residual_Nm: tuple[float, ...] = (25.0, 25.0, 15.0, 15.0, 4.0, 4.0, 1.2)
    residual_time_s: float = 0.02
    silent_cycles: int = 5  # of incomplete position replies in a row (WAM reference 4.6)
    hand_age_s: float = 0.085  # told within 100 ms; dynamixel reference 5.4: dead above that
    offset_m: float = 0.06
    offset_rad: float = 0.6
    offset_lag_m: float = 0.003


class SafetyMonitor:
    """Keeps the few counters that the checks need."""

    def __init__(self, limits: SafetyLimits, period_s: float) -> None:
        self._limits = limits
        self._residual_cycles = max(1, round(limits.residual_time_s / period_s))
        self._over_band = [0] * 7
        self._silent = self._escaped = 0

    @property
    def silent_cycles(self) -> int:
        """Incomplete position replies in a row that are a fault."""
        return self._limits.silent_cycles

    def reset(self) -> None:
        """Forget what was counted, at activation."""
        self._over_band = [0] * 7
        self._silent = self._escaped = 0

    def replies(self, complete: bool) -> Reason:
        """Position replies of this cycle."""
        self._silent = 0 if complete else self._silent + 1
        return Reason.ARM_SILENT if self._silent >= self._limits.silent_cycles else Reason.NONE

    def tracking(self, joint_rad: Array, command_rad: Array) -> Reason:
        """Measured against commanded joint angles (7, rad)."""
        for measured, wanted, band in zip(
            joint_rad.tolist(), command_rad.tolist(), self._limits.tracking_error_rad, strict=True
        ):
            if not abs(measured - wanted) <= band:
                return Reason.TRACKING_ERROR
        return Reason.NONE

    def escapes(self, joint_rad: Array, command_rad: Array) -> bool:
        """Whether an arm that shall hold is not being held: for some time a joint was twice its band away."""
        far = np.abs(joint_rad - command_rad) > 2.0 * np.array(self._limits.tracking_error_rad)
        self._escaped = self._escaped + 1 if far.any() else 0
        return self._escaped >= self._residual_cycles

    def residual(self, torque_residual_Nm: Array) -> Reason:
        """Feedback part of the joint torque (7, N·m): what the model cannot explain."""
        self._over_band = [
            count + 1 if abs(residual) > band else 0
            for count, residual, band in zip(
                self._over_band, torque_residual_Nm.tolist(), self._limits.torque_residual_Nm, strict=True
            )
        ]
        return Reason.COLLISION if max(self._over_band) >= self._residual_cycles else Reason.NONE

    def hand(self, age_s: float | None, fault: HandFault) -> Reason:
        """Age of the newest hand sample and what the hand process says is wrong."""
        if age_s is None or age_s > self._limits.hand_age_s:
            fault |= HandFault.NO_REPLY
        if not fault:  # as ever: flags are slow to compare
            return Reason.NONE
        named = (reason for bits, reason in _HAND_FAULTS if fault & bits == bits)
        return next(named, Reason.NONE)

    def offset(self, target: PlanarMotion, offset: PlanarMotion) -> Reason:
        """Size of the hand offset and how far it lags behind its target."""
        limits = self._limits
        x, y, angle = target.pose
        if x * x + y * y > limits.offset_m**2 or abs(angle) > limits.offset_rad:
            return Reason.OFFSET_LIMIT
        dx, dy = x - offset.pose[0], y - offset.pose[1]
        return Reason.OFFSET_LAG if dx * dx + dy * dy > limits.offset_lag_m**2 else Reason.NONE


def attention(age_s: float, *, sure_s: float = 0.025, lost_s: float = 0.05) -> float:
    """Fraction of its pace at which a motion may go on whose newest sample is so old, 0 to 1.

    What is not seen is not moved on. A sound bus never gets there: positions of the arm come every cycle, samples of
    the motors are 3 to 6 ms old at 1 Mbit/s. At 57 600 bit/s they are 20 to 35: slowed down a little.
    """
    return min(max((lost_s - age_s) / (lost_s - sure_s), 0.0), 1.0)


def governor(
    lag_m: float,
    scale: float,
    object_speed_m_s: float,
    speed_limit_m_s: float,
    *,
    free_m: float = 3e-4,
    stop_m: float = 1e-3,
) -> float:
    """Fraction of the winding rate that the arm can bear, 0 to 1.

    `lag_m` is how far the arm's offset is behind, `scale` the inverse kinematics' own s, `object_speed_m_s` the speed
    at which full-rate winding would move the object in the hand.
    """
    by_lag = min(max((stop_m - lag_m) / (stop_m - free_m), 0.0), 1.0)
    by_speed = 1.0 if object_speed_m_s <= speed_limit_m_s else speed_limit_m_s / object_speed_m_s
    return min(by_lag, by_speed, scale)
