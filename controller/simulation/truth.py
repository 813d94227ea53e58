"""What is really so in the simulated world; for the demo's report and for tests alone (an import contract holds it).

Computed beside the physics on data of its own, so that looking changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from calibration.hand.parameters import Hand
from controller.simulation.fingertip_force import fingertip_forces_N
from controller.simulation.world import World


@dataclass(frozen=True, eq=False)
class WorldTruth:
    """What is really so. Poses 4×4; fingers in the order right, left."""

    time_ns: int
    T_world_object: NDArray[np.float64]
    T_world_wrist: NDArray[np.float64]
    T_hand_object: NDArray[np.float64]
    finger_joint_rad: NDArray[np.float64]
    """Flexion from rest, (2, 2): finger, proximal and distal; of a flexure its end angle."""
    tip_m: NDArray[np.float64]
    """Centres of the fingertip arcs in the hand frame, (2, 2): finger, x and y."""
    tendon_excursion_m: NDArray[np.float64]
    """Finger-side: what the joints took up, (2,)."""
    tendon_tension_N: NDArray[np.float64]
    contact_force_N: NDArray[np.float64]
    """Normal force between each fingertip and the object, (2,)."""


class WorldObserver:
    """Looks at one world; `hand` gives the tendons' stiffness."""

    def __init__(self, world: World, hand: Hand) -> None:
        self._world = world
        self._parts = world.parts
        self._model = self._parts.model
        self._data = mujoco.MjData(self._model)
        self._tendon_stiffness_N_per_m = np.array([finger.tendon_stiffness_N_per_m for finger in hand.fingers])

    def truth(self) -> WorldTruth:
        """The true state now."""
        parts, data = self._parts, self._data
        self._world.copy_state_to(data)
        mujoco.mj_forward(self._model, data)
        T_world_hand = _pose(data, parts.hand_body)
        T_world_object = _pose(data, parts.object_body)
        T_hand_world = np.linalg.inv(T_world_hand)
        joints = np.array([[data.qpos[hinges].sum() for hinges in finger] for finger in parts.finger])
        tips_m = data.site_xpos[parts.tip_site] @ T_hand_world[:3, :3].T + T_hand_world[:3, 3]
        return WorldTruth(
            time_ns=self._world.time_ns,
            T_world_object=T_world_object,
            T_world_wrist=_pose(data, parts.wrist_body),
            T_hand_object=T_hand_world @ T_world_object,
            finger_joint_rad=joints,
            tip_m=tips_m[:, :2],
            tendon_excursion_m=parts.spool_radius_m * data.qpos[parts.spool] - self._stretch_m(),
            tendon_tension_N=self._tension_N(),
            contact_force_N=fingertip_forces_N(self._model, data, parts.tip_geom.tolist()),
        )

    def _tension_N(self) -> NDArray[np.float64]:
        data, tendons = self._data, self._parts.tendon
        tension_N = np.zeros(2)
        stretch_m = np.maximum(data.ten_length[tendons] - self._parts.tendon_rest_m, 0.0)
        elastic = np.isfinite(self._tendon_stiffness_N_per_m)
        tension_N[elastic] = self._tendon_stiffness_N_per_m[elastic] * stretch_m[elastic]
        limits = data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON
        for finger in np.flatnonzero(~elastic):
            tension_N[finger] = data.efc_force[limits & (data.efc_id == tendons[finger])].sum()
        return tension_N

    def _stretch_m(self) -> NDArray[np.float64]:
        """What the spools have wound up less what the joints have taken up, (2,); negative while a tendon is slack."""
        parts, length_m = self._parts, self._data.ten_length
        lag_m = np.array([0.0 if feed is None else length_m[feed] for feed in parts.tendon_feed])
        stretch_m: NDArray[np.float64] = length_m[parts.tendon] - parts.tendon_rest_m + lag_m
        return stretch_m


def _pose(data: mujoco.MjData, body: int) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[body].reshape(3, 3)
    pose[:3, 3] = data.xpos[body]
    return pose
