"""Identifies one arm's gravity: the vectors mu of WAM reference 6.6, fitted to the torques that held it.

The law: t_j = g × R_j mu_j + t_{j+1} in base axes, from joint 7 to 1, and the torque that holds joint j is the
component of t_j along its axis z_{j−1}. Of each t_j only that component is measured; the other two are unknowns of the
fit, two a pose, beside the three of mu_j. A ridge holds what the data do not tell: a part of mu_j along its joint's
axis, which cannot be told from the neighbour's, and all of mu_1 on a level base. What is fitted is the difference from
a known arm (mu from its masses), so that what is not told stays as it was.

mu in kg·m, each in its link's DH frame; gravity in m/s², in DH frame 0; joint angles in rad, torques in N·m. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calibration.gravity_plan import JOINTS, Balanced
from drivers.errors import InputError

Array = npt.NDArray[np.float64]

RIDGE = 1e-6
ACCEPTED_RMS_NM = (1.0, 1.0, 0.6, 0.6, 0.2, 0.2, 0.1)
"""[A] largest root mean square of what is left, joint by joint: about what friction of the approaches leaves."""
_LEAST_EXCITATION = 0.3
"""Second singular value of a joint's directions of gravity over all poses, in g; the vendor's have 1.0 or more."""
# WAM reference 6.1: the turn of each DH frame about its x axis.
_ALPHA_SIGN = (-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class GravityFit:
    """What was found. Residuals are measured less modelled torques, (n, 7), N·m."""

    mu_kg_m: Array
    """(7, 3)"""
    residual_Nm: Array
    residual_before_Nm: Array
    """What the known arm left."""
    friction_Nm: Array
    """Coulomb friction (7), estimated from half the difference of both approaches."""

    @property
    def rms_Nm(self) -> Array:
        """Root mean square of the residuals (7)."""
        return _rms(self.residual_Nm)

    @property
    def rms_before_Nm(self) -> Array:
        """Root mean square of what the known arm left (7)."""
        return _rms(self.residual_before_Nm)

    @property
    def worst_pose(self) -> tuple[int, ...]:
        """The pose, from 0, with the largest residual of each joint."""
        return tuple(int(pose) for pose in np.abs(self.residual_Nm).argmax(axis=0))

    def refused_joints(self, accepted_rms_Nm: tuple[float, ...] = ACCEPTED_RMS_NM) -> tuple[int, ...]:
        """Joints, from 0, that leave more than is accepted; none: the fit is good."""
        return tuple(int(joint) for joint in np.flatnonzero(~(self.rms_Nm <= np.array(accepted_rms_Nm))))


def gravity_torque(mu_kg_m: Array, joint_rad: Array, gravity_m_s2: Array) -> Array:
    """Torques (n, 7) that hold an arm of gravity vectors `mu_kg_m` (7, 3) at each of the poses `joint_rad` (n, 7)."""
    links = _link_rotations(joint_rad)
    torque = np.zeros((len(joint_rad), JOINTS))
    outboard = np.zeros((len(joint_rad), 3))
    for joint in range(JOINTS - 1, -1, -1):
        outboard = outboard + np.cross(gravity_m_s2, links[joint + 1] @ mu_kg_m[joint])
        torque[:, joint] = np.einsum("ni,ni->n", links[joint][:, :, 2], outboard)
    return torque


def fit_gravity(
    measured: Balanced, gravity_m_s2: Array, known_mu_kg_m: Array, carried_Nm: Array | None = None
) -> GravityFit:
    """Gravity vectors of the bare arm from balanced measurements of it.

    gravity_m_s2   (3) in DH frame 0: not along its z where the base is not level
    known_mu_kg_m  (7, 3) of the arm as it is supposed to be, which the ridge leans to
    carried_Nm     (n, 7) torques that what hangs on the flange took of the measured ones; None: nothing hung there

    Raises InputError on arrays that do not belong together or are not finite, and where the poses are too much alike.
    """
    q, torque = measured.joint_rad, measured.torque_Nm
    carried = np.zeros_like(torque) if carried_Nm is None else np.asarray(carried_Nm, dtype=np.float64)
    shapes = (q.shape == torque.shape == carried.shape == (len(q), JOINTS), known_mu_kg_m.shape == (JOINTS, 3))
    if not all(shapes) or gravity_m_s2.shape != (3,):
        raise InputError(
            "gravity fit: expected poses and torques of seven joints each, seven mu and one gravity vector."
        )
    if not all(np.isfinite(values).all() for values in (q, torque, carried, known_mu_kg_m, gravity_m_s2)):
        raise InputError("gravity fit: the measurements hold values that are not finite; expected numbers only.")
    before = torque - carried - gravity_torque(known_mu_kg_m, q, gravity_m_s2)
    change = _fit_difference(_link_rotations(q), before, gravity_m_s2)
    return GravityFit(
        mu_kg_m=known_mu_kg_m + change,
        residual_Nm=before - gravity_torque(change, q, gravity_m_s2),
        residual_before_Nm=before,
        friction_Nm=measured.friction_Nm.mean(axis=0),
    )


def _fit_difference(links: Array, torque: Array, gravity_m_s2: Array) -> Array:
    """Gravity vectors (7, 3) that explain `torque` (n, 7) best, joint by joint from the last to the first."""
    poses = len(torque)
    cross_g = np.cross(gravity_m_s2, np.eye(3)).T  # g × x = cross_g @ x
    mu = np.zeros((JOINTS, 3))
    outboard = np.zeros((poses, 3))
    for joint in range(JOINTS - 1, -1, -1):
        base, link = links[joint], links[joint + 1]
        to_base = np.swapaxes(base, 1, 2)
        directions = to_base @ cross_g @ link
        if joint > 0 and not _excitation(directions[:, 2], gravity_m_s2) >= _LEAST_EXCITATION:
            raise InputError(
                f"gravity fit: the poses hardly turn joint {joint + 1} and what it carries against gravity; expected "
                "poses as different as the vendor's nine."
            )
        # Unknowns: mu_j, then x and y of t_j of each pose, in the axes of frame j − 1.
        left = np.zeros((poses, 3, 3 + 2 * poses))
        left[:, :, :3] = directions
        for pose in range(poses):
            left[pose, 0, 3 + 2 * pose] = left[pose, 1, 4 + 2 * pose] = -1.0
        right = -np.einsum("nij,nj->ni", to_base, outboard)
        right[:, 2] += torque[:, joint]
        A, b = left.reshape(3 * poses, -1), right.reshape(-1)
        mu[joint] = np.linalg.solve(A.T @ A + RIDGE * np.eye(A.shape[1]), A.T @ b)[:3]
        outboard = outboard + np.cross(gravity_m_s2, link @ mu[joint])
    return mu


def _excitation(rows: Array, gravity_m_s2: Array) -> float:
    """How well two components of mu can be told: second singular value of `rows` (n, 3), over g."""
    singular = np.linalg.svd(rows, compute_uv=False)
    return float(singular[1] / np.linalg.norm(gravity_m_s2)) if len(singular) > 1 else 0.0


def _link_rotations(joint_rad: Array) -> Array:
    """Rotations of DH frames 0 to 7 in frame 0, (8, n, 3, 3), for poses (n, 7)."""
    c, s = np.cos(joint_rad), np.sin(joint_rad)
    zero = np.zeros(len(joint_rad))
    frames = [np.broadcast_to(np.eye(3), (len(joint_rad), 3, 3))]
    for joint, sign in enumerate(_ALPHA_SIGN):
        cosine = 0.0 if sign else 1.0
        rows = (
            (c[:, joint], -s[:, joint] * cosine, s[:, joint] * sign),
            (s[:, joint], c[:, joint] * cosine, -c[:, joint] * sign),
            (zero, zero + sign, zero + cosine),
        )
        frames.append(frames[-1] @ np.moveaxis(np.array(rows), 2, 0))
    return np.array(frames)


def _rms(values: Array) -> Array:
    rms: Array = np.sqrt(np.mean(np.square(values), axis=0))
    return rms
