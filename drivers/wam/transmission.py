"""Motor ↔ joint transmission of the seven-joint WAM: angles and torques, pure.

Motor angle in rad at the motor shaft, joint angle in rad in the DH convention; torques in N·m. Cables couple joints 2
and 3 (motors 2, 3) and joints 5 and 6 (motors 5, 6); elsewhere each joint has its own motor. With motor = C · joint,
power balance gives joint torque = Cᵀ · motor torque. Source: WAM reference 5.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_JOINT_TO_MOTOR = np.array(
    [
        [-42.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 28.25, -16.8155, 0.0, 0.0, 0.0, 0.0],
        [0.0, -28.25, -16.8155, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, -18.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 9.7, -9.7, 0.0],
        [0.0, 0.0, 0.0, 0.0, 9.7, 9.7, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -14.93],
    ]
)
_MOTOR_TO_JOINT = np.linalg.inv(_JOINT_TO_MOTOR)
_JOINT_TO_MOTOR_TORQUE = np.ascontiguousarray(_MOTOR_TO_JOINT.T)
_MOTOR_TO_JOINT_TORQUE = np.ascontiguousarray(_JOINT_TO_MOTOR.T)


def joint_to_motor(joint_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motor angles (7), rad, of joint angles (7), rad."""
    return _JOINT_TO_MOTOR @ joint_rad


def motor_to_joint(motor_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Joint angles (7), rad, of motor angles (7), rad."""
    return _MOTOR_TO_JOINT @ motor_rad


def joint_to_motor_torque(joint_torque_Nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motor torques (7), N·m, that give the joint torques (7), N·m."""
    return _JOINT_TO_MOTOR_TORQUE @ joint_torque_Nm


def motor_to_joint_torque(motor_torque_Nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Joint torques (7), N·m, that the motor torques (7), N·m, give."""
    return _MOTOR_TO_JOINT_TORQUE @ motor_torque_Nm
