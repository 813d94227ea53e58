"""Free closing: where one finger stands while its tendon pulls and nothing is touched.

Every joint balances its own tension, k q = T ∇l(q). With tendons at a constant offset that is explicit; past a straight
run it is found by Newton's method.
Source: hand-mechanics reference 4.
"""

from __future__ import annotations

import numpy as np

from calibration.hand.bundle import Reals
from calibration.hand.joints import JointModel
from calibration.hand.tendon import ConstantOffset, TendonLaw
from drivers.errors import MechanicsError

STEP_LIMIT = 0.2
ITERATIONS = 60
TOLERANCE = 1e-13
"""Largest unbalanced moment, per stiffness of the joint's angle (rad)."""


def settled(joint: JointModel, law: TendonLaw, tension_N: float) -> Reals:
    """Coordinates (n,) of one joint under a tendon tension ≥ 0, clipped at its stops. Errors: MechanicsError.

    A flexure keeps the shape with which it meets its stop: more tension would press its faces, not bend it.
    """
    if isinstance(law, ConstantOffset):
        return np.clip(tension_N * law.row / joint.stiffness_Nm_per_rad, joint.lower_rad, joint.upper_rad)
    stop, stop_N = _at_upper_stop(joint, law)
    if tension_N >= stop_N:
        return stop
    q, stiffness = np.zeros(joint.size), joint.stiffness_Nm_per_rad
    for _ in range(ITERATIONS):
        jet = law.at(q[None, :])
        moment = stiffness * q - tension_N * jet.gradient[0]
        if np.abs(moment).max() < TOLERANCE * stiffness[0]:
            return q
        step = np.linalg.solve(np.diag(stiffness) - tension_N * jet.hessian[0], moment)
        q = q - step * min(1.0, STEP_LIMIT / float(np.abs(step).max()))
        q[0] = min(q[0], joint.upper_rad[0])
    raise MechanicsError("tendon_load_N", f"free closing at {tension_N:g} N was not found.", help="Load it less.")


def _at_upper_stop(joint: JointModel, law: TendonLaw) -> tuple[Reals, float]:
    """Coordinates with which the joint meets its upper stop, and the tension that brings it there."""
    q, stiffness = joint.upper_rad[0] * joint.angle_row, joint.stiffness_Nm_per_rad
    tension_N = float(stiffness[0] * q[0] / law.at(q[None, :]).gradient[0, 0])
    for _ in range(ITERATIONS):
        jet = law.at(q[None, :])
        moment = stiffness * q - tension_N * jet.gradient[0]
        if np.abs(moment).max() < TOLERANCE * stiffness[0]:
            return q, tension_N
        K = np.diag(stiffness) - tension_N * jet.hessian[0]
        K[:, 0] = -jet.gradient[0]  # the tension is free instead of the angle, which is held
        step = np.linalg.solve(K, moment)
        tension_N -= float(step[0])
        q[1:] -= step[1:]
    raise MechanicsError("flexion_limit_deg", "the joint does not reach its upper stop by closing freely.")
