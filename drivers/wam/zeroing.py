"""Where the motors' counters are set when the arm stands in its home pose: plain, or corrected by absolute encoders.

Pure. Joint angles in rad (DH), motor angles in rad at the motor shaft, joint and motor arrays of seven. An absolute
encoder knows its motor's angle within one turn; calibrated, it tells how far the hand-placed arm really is from home,
as long as each motor is within half a turn of its place, some ±4° of joint 1. Source: WAM reference 4.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import InputError
from drivers.wam.properties import ABSOLUTE_ENCODER_FIRMWARE, ROLE_ABSOLUTE_ENCODER
from drivers.wam.transmission import joint_to_motor, motor_to_joint

NO_ZERO_ANGLE = -1.0
"""Stands for a motor without calibrated zero angle; anything outside [0, 2π] does."""
_TURN = 2.0 * np.pi
_COUNT_RANGE = 2**21
"""Positions travel as 22-bit numbers."""


@dataclass(frozen=True, eq=False)
class ZeroingPlan:
    """What zeroing will do; nothing is written yet."""

    motor_counts: tuple[int, ...]
    """P of motors 1 to 7."""
    joint_rad: NDArray[np.float64]
    """Where the arm is then taken to be (7)."""
    motor_error_rad: NDArray[np.float64]
    """How far each motor stands before its place in home, −π to π (7); 0 where nothing tells."""
    corrected: tuple[int, ...]
    """Motors, 1 to 7, that an absolute encoder corrects."""


def plan_zeroing(
    home_rad: NDArray[np.float64],
    counts_per_turn: Sequence[int],
    zero_angle_rad: NDArray[np.float64],
    mechanical_counts: Sequence[int | None],
) -> ZeroingPlan:
    """Counters for an arm that stands at, or near, `home_rad`.

    `mechanical_counts`: MECH of each motor, None where it does not count (see `has_absolute_encoder`); such a motor,
    and one whose `zero_angle_rad` is outside [0, 2π], is zeroed plainly: home is taken at its word. Home need not lie
    within the joint limits. InputError if a counter would not fit into 22 bits.
    """
    turns = np.array(counts_per_turn, dtype=np.float64)
    home_motor_rad = joint_to_motor(home_rad)
    counts = np.array([np.nan if count is None else count for count in mechanical_counts], dtype=np.float64)
    usable = np.isfinite(counts) & (zero_angle_rad >= 0.0) & (zero_angle_rad <= _TURN)
    error_rad = np.zeros_like(home_motor_rad)
    expected = home_motor_rad + zero_angle_rad
    error_rad[usable] = wrapped(expected[usable] - counts[usable] * _TURN / turns[usable])
    # An absolute encoder's place is a whole number of counts; rounding must not make it the one below.
    motor_counts = np.floor(turns / _TURN * (home_motor_rad - error_rad) + 1e-6)
    if np.any(np.abs(motor_counts) >= _COUNT_RANGE):
        raise InputError(
            f"home {home_rad.tolist()} rad needs motor counts {motor_counts.tolist()}; "
            f"expected less than {_COUNT_RANGE} in magnitude.",
            help="Correct home_rad of the arm.",
        )
    return ZeroingPlan(
        motor_counts=tuple(int(count) for count in motor_counts),
        joint_rad=home_rad - motor_to_joint(error_rad),
        motor_error_rad=error_rad,
        corrected=tuple(int(index) + 1 for index in np.flatnonzero(usable)),
    )


def zero_angles(
    joint_rad: NDArray[np.float64], counts_per_turn: Sequence[int], mechanical_counts: Sequence[float | None]
) -> NDArray[np.float64]:
    """Zero angles (7), rad in [0, 2π), of motors whose MECH was read while the joints were at `joint_rad` (7).

    The angle that each absolute encoder would show with all joints at zero; −1 for motors without (None).
    """
    turns = np.array(counts_per_turn, dtype=np.float64)
    counts = np.array([np.nan if count is None else count for count in mechanical_counts], dtype=np.float64)
    angles = np.mod(counts * _TURN / turns - joint_to_motor(joint_rad), _TURN)
    angles[angles >= _TURN] = 0.0  # np.mod of a tiny negative number rounds up to the whole turn
    return np.where(np.isfinite(angles), angles, NO_ZERO_ANGLE)


def has_absolute_encoder(firmware: int, role: int) -> bool:
    """Whether MECH of a motor puck knows the motor's angle after power-up, and may be used for zeroing."""
    return firmware >= ABSOLUTE_ENCODER_FIRMWARE and bool(role & ROLE_ABSOLUTE_ENCODER)


def wrapped(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles of any shape in [−π, π)."""
    return np.mod(angle_rad + np.pi, _TURN) - np.pi
