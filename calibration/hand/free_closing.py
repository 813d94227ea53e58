"""Free closing: where one finger stands while its tendon pulls and nothing is touched.

Every joint balances its own tension, k q = T ∇l(q). With tendons at a constant offset that is explicit; past a straight
run it is the minimum of V − T l, found by Newton's method with the joint's angle held between its stops.
Source: hand-mechanics reference 4.
"""

from __future__ import annotations

import numpy as np

from calibration.hand.bundle import Reals
from calibration.hand.joints import JointModel
from calibration.hand.tendon import ConstantOffset, TendonLaw
from drivers.errors import MechanicsError

STEP_LIMIT = 0.2
ITERATIONS = 100
TOLERANCE = 1e-13
"""Largest unbalanced moment, per stiffness of the joint's angle (rad)."""


def settled(joint: JointModel, law: TendonLaw, tension_N: float) -> Reals:
    """Coordinates (n,) of one joint under a tendon tension, clipped at its stops. Errors: MechanicsError."""
    if isinstance(law, ConstantOffset):
        return np.clip(tension_N * law.row / joint.stiffness_Nm_per_rad, joint.lower_rad, joint.upper_rad)
    stiffness, first = joint.stiffness_Nm_per_rad, float(joint.stiffness_Nm_per_rad[0])
    lower, upper = joint.lower_rad[0], joint.upper_rad[0]
    q = np.zeros(joint.size)
    for _ in range(ITERATIONS):
        jet = law.at(q[None, :])
        moment = stiffness * q - tension_N * jet.gradient[0]
        held = (q[0] >= upper and moment[0] < 0) or (q[0] <= lower and moment[0] > 0)
        free = slice(1 if held else 0, None)
        if np.abs(moment[free]).max(initial=0.0) < TOLERANCE * first:
            return q
        K = (np.diag(stiffness) - tension_N * jet.hessian[0])[free, free]
        step = -np.linalg.solve(K, moment[free])
        if float(step @ moment[free]) > 0:  # uphill: the energy is not convex here
            step = -moment[free] / stiffness[free]
        q[free] += step * min(1.0, STEP_LIMIT / float(np.abs(step).max()))
        q[0] = min(max(q[0], lower), upper)
    raise MechanicsError("tendon_load_N", f"free closing at {tension_N:g} N was not found.", help="Load it less.")
