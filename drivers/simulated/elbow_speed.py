"""Speeds that the safety puck watches: the elbow's, and a point's 350 mm beyond it on the forearm. Pure.

DH angles and speeds of joints 1 to 4 in rad and rad/s; the upper arm's axis and the forearm's meet in the elbow, 550 mm
from the shoulder: the 45 mm offsets between them are left out [assumed]. Source: WAM reference 4.3, 6.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, sin, sqrt

UPPER_ARM_M = 0.55
BEYOND_ELBOW_M = 0.35


def elbow_speeds_m_s(joint_rad: Sequence[float], joint_rad_s: Sequence[float]) -> tuple[float, float]:
    """Speed of the elbow and of the point beyond it, m/s."""
    _, q2, q3, q4 = joint_rad
    v1, v2, v3, v4 = joint_rad_s
    # Angular velocity of the upper arm, and of the forearm, in axes of the upper arm before its twist (z along it).
    wx, wy, wz = -sin(q2) * v1, v2, cos(q2) * v1
    elbow_x, elbow_y = UPPER_ARM_M * wy, -UPPER_ARM_M * wx
    fx, fy, fz = wx - sin(q3) * v4, wy + cos(q3) * v4, wz + v3
    dx, dy, dz = cos(q3) * sin(q4), sin(q3) * sin(q4), cos(q4)
    x = elbow_x + BEYOND_ELBOW_M * (fy * dz - fz * dy)
    y = elbow_y + BEYOND_ELBOW_M * (fz * dx - fx * dz)
    z = BEYOND_ELBOW_M * (fx * dy - fy * dx)
    return hypot(elbow_x, elbow_y), sqrt(x * x + y * y + z * z)
