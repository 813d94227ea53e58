"""Gravity of the arm from seven identified vectors mu instead of from masses (WAM reference 6.6).

With t_j = g_j × mu_j + R(j+1 to j) t_{j+1} in the DH frame of link j, from 7 to 1, the torque that holds joint j is the
z component of t_j in frame j − 1. Equivalent: τ_j = z_{j−1} · Σ_{k≥j} g × (R_k mu_k). This is the gravity of an arm
all of whose joints meet in one point, with 1 kg at mu_k on link k; so Pinocchio works it out, too. mu in kg·m.

mu replaces the arm's own gravity only. What it is to be replaced by and what the masses say differ by a torque of the
same form, which is added to the dynamics of the masses: inertia, hand and object stay as they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio

from drivers.errors import InputError

FloatArray = npt.NDArray[np.float64]


def mu_of_masses(model: Any, T_last_tool: Any) -> FloatArray:
    """The gravity vectors (7, 3), in DH frames, that give the same gravity as the masses of a Pinocchio model.

    `T_last_tool`: the tool plate in the frame of the last joint (pinocchio.SE3), where DH frame 7 is.
    """
    outboard_kg = 0.0
    vectors = []
    for joint in range(model.njoints - 1, 0, -1):
        inertia = model.inertias[joint]
        following = _following(model, joint, T_last_tool)
        in_joint_frame = inertia.mass * inertia.lever + outboard_kg * following.translation
        vectors.append(following.rotation.T @ in_joint_frame)
        outboard_kg += inertia.mass
    return np.array(vectors[::-1])


def checked_mu(mu_kg_m: npt.ArrayLike, joints: int) -> FloatArray:
    """`mu_kg_m` as an array (joints, 3); InputError if it is not one, or not finite."""
    mu = np.asarray(mu_kg_m, dtype=np.float64)
    if mu.shape != (joints, 3) or not np.isfinite(mu).all():
        raise InputError(f"gravity vectors are {mu.tolist()}; expected {joints} rows of three finite numbers, kg·m.")
    return mu


class GravityDifference:
    """Torques (N·m) of gravity vectors `difference_kg_m` (7, 3) on the joints of a Pinocchio model as mounted."""

    def __init__(self, model: Any, T_last_tool: Any, difference_kg_m: FloatArray) -> None:
        self._model = model.copy()
        for joint, vector in enumerate(difference_kg_m, start=1):
            rotation = _following(model, joint, T_last_tool).rotation
            # Inertia is not asked for, but must not be zero.
            self._model.inertias[joint] = pinocchio.Inertia(1.0, rotation @ vector, np.eye(3))
            self._model.jointPlacements[joint] = pinocchio.SE3(model.jointPlacements[joint].rotation, np.zeros(3))
        self._data = self._model.createData()

    def torque(self, q: FloatArray) -> FloatArray:
        """(7, N·m) at the joint angles `q` (7, rad), checked by the caller; valid until the next call."""
        torque: FloatArray = pinocchio.computeGeneralizedGravity(self._model, self._data, q)
        return torque


def _following(model: Any, joint: int, T_last_tool: Any) -> Any:
    """Where DH frame `joint` is in the frame of that joint: the next joint's place, or the tool's."""
    return model.jointPlacements[joint + 1] if joint + 1 < model.njoints else T_last_tool
