"""The simulated world: arm, hand, object and support as physics on an integer-nanosecond time base.

Simulated devices reach it through two faces: the arm's joints (torque in, angle out) and the tendon motors' shafts
(torque in, angle and speed out; positive = tendon pulled in; motor 0 right, 1 left). Sensors are perfect here; devices
quantise. `truth` is for reporters and tests alone, and looking at it changes nothing. The world knows the parameters
of arm, hand and object but none of the product's mechanics, tables or control, so that agreement between the two means
something.

Frames: world z up; model and its frames in `world_model.py`. Same calls, same bits.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.hand.parameters import Hand
from calibration.objects.parameters import GraspObject
from controller.simulation.fingertip_force import fingertip_forces_N
from controller.simulation.world_model import Imperfections, Placement, WorldModel, build_world_model
from controller.simulation.world_object import TIP_FRICTION, ObjectSetting
from drivers.clock import nanoseconds
from drivers.errors import InputError, MechanicsError
from drivers.wam.parameters import JOINTS, WamParameters

BRAKING_NMS_PER_RAD = (150.0, 150.0, 50.0, 30.0, 2.5, 2.5, 0.25)
"""Shorted motors at the joints [assumed]: squared torque constant and ratio (WAM reference 5.3) over 1.5 to 3 Ω."""
FAR_BELOW_M = 10.0
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class World:
    """One arm with its hand, an object, and what it stands on.

    `T_world_object` is the pose of the object's frame: origin at its reference point, half its height above the foot,
    z along its axis; its outline is turned in this frame by `outline_angle_rad`. A `weightless` object floats where
    it is put. `tip_friction`: coefficient at the right and left fingertip. The arm starts at `joint_rad`, at rest,
    braking; the fingers start open. `hand_only` welds the arm and leaves the spools to `wind_spools`. Errors:
    InputError for poses and values that cannot be, MechanicsError for hands and objects that cannot be simulated.
    """

    def __init__(
        self,
        hand: Hand,
        grasp_object: GraspObject,
        arm_parameters: WamParameters,
        *,
        T_world_base: NDArray[np.float64],
        T_wrist_hand: NDArray[np.float64],
        T_world_object: NDArray[np.float64],
        joint_rad: ArrayLike,
        seed: int = 0,
        physics_period_s: float = 0.0005,
        imperfections: Imperfections | None = None,
        spool_radius_m: float = 0.0105,
        hand_only: bool = False,
        outline_angle_rad: float = 0.0,
        weightless: bool = False,
        tip_friction: tuple[float, float] = (TIP_FRICTION, TIP_FRICTION),
        start_ns: int = 0,
    ) -> None:
        if not 1e-5 <= physics_period_s <= 2e-3:
            raise InputError(f"physics_period_s = {physics_period_s} is not accepted; expected 0.00001 to 0.002.")
        if not 1e-3 <= spool_radius_m <= 0.1:
            raise InputError(f"spool_radius_m = {spool_radius_m} is not accepted; expected 0.001 to 0.1.")
        self._start_rad = _vector("joint_rad", joint_rad, JOINTS)
        padded = any(finger.tip.pad_length_m > 0.0 for finger in hand.fingers)
        self._parts: WorldModel = build_world_model(
            hand,
            ObjectSetting(grasp_object, outline_angle_rad, weightless, tip_friction, padded),
            arm_parameters,
            Placement(T_world_base, T_wrist_hand, T_world_object, self._start_rad),
            seed=seed,
            physics_period_s=physics_period_s,
            imperfections=imperfections or Imperfections(),
            spool_radius_m=spool_radius_m,
            hand_only=hand_only,
        )
        model = self._parts.model
        self._model = model
        self._data = mujoco.MjData(model)
        self._state = np.empty(mujoco.mj_stateSize(model, _STATE))
        self._hand_only = hand_only
        self._period_ns = nanoseconds(physics_period_s)
        self._time_ns = start_ns
        self._before_step: list[Callable[[int], None]] = []
        self._arm_commands: list[tuple[int, int, tuple[float, ...], bool]] = []
        self._arm_command_count = 0
        self._arm_damping = model.dof_damping[self._parts.arm].copy()
        self._arm_damping_braking = self._arm_damping + np.array(BRAKING_NMS_PER_RAD)[self._parts.arm]
        model.dof_damping[self._parts.arm] = self._arm_damping_braking
        self._data.qpos[self._parts.arm] = self._start_rad[self._parts.arm]

    # Time

    @property
    def time_ns(self) -> int:
        """How far the physics has come, ns; at most one physics period behind the last `advance_to`."""
        return self._time_ns

    @property
    def physics_period_ns(self) -> int:
        """Duration of one physics step, ns."""
        return self._period_ns

    def call_before_each_step(self, callback: Callable[[int], None]) -> None:
        """Have `callback(now_ns)` called at the beginning of every physics step: the simulated motors' inner loop."""
        self._before_step.append(callback)

    def advance_to(self, now_ns: int) -> None:
        """Do all physics steps that end by `now_ns`; a time that is past does nothing.

        Raises MechanicsError when the physics diverges.
        """
        model, data, period_ns = self._model, self._data, self._period_ns
        while self._time_ns + period_ns <= now_ns:
            for callback in self._before_step:
                callback(self._time_ns)
            while self._arm_commands and self._arm_commands[0][0] <= self._time_ns:
                self._apply(*self._arm_commands.pop(0)[2:])
            mujoco.mj_step(model, data)
            self._time_ns += period_ns
        for warning in (
            mujoco.mjtWarning.mjWARN_BADQPOS,
            mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC,
        ):
            if data.warning[warning].number:
                raise MechanicsError(
                    "world", f"the physics diverged before {self._time_ns} ns.", help="Check the torques."
                )

    def pass_over(self, duration_ns: int) -> None:
        """Let time pass in which nothing happens. InputError if it is negative."""
        if duration_ns < 0:
            raise InputError(f"duration_ns = {duration_ns} is not accepted; expected at least 0.")
        self._time_ns += duration_ns

    # Arm

    def joint_position_rad(self) -> NDArray[np.float64]:
        """Joint angles, shape (7,)."""
        return self._start_rad.copy() if self._hand_only else self._data.qpos[self._parts.arm].copy()

    def joint_velocity_rad_s(self) -> NDArray[np.float64]:
        """Joint speeds, shape (7,)."""
        return np.zeros(JOINTS) if self._hand_only else self._data.qvel[self._parts.arm].copy()

    def set_joint_torque_Nm(self, torque: ArrayLike, braking: bool, at_ns: int) -> None:
        """Motor torque at the joints, shape (7,), from `at_ns` until the next; `braking` shorts the motors."""
        if self._hand_only:
            raise InputError("the arm is welded; expected hand_only = False.")
        values = _vector("torque", torque, JOINTS)
        self._arm_command_count += 1
        insort(self._arm_commands, (at_ns, self._arm_command_count, tuple(values.tolist()), braking))

    def _apply(self, torque_Nm: tuple[float, ...], braking: bool) -> None:
        self._data.qfrc_applied[self._parts.arm] = torque_Nm
        self._model.dof_damping[self._parts.arm] = self._arm_damping_braking if braking else self._arm_damping

    # Tendon motors

    def shaft_angle_rad(self, motor: int) -> float:
        """Output shaft angle since the fingers were open."""
        return float(self._data.qpos[self._parts.spool[motor]])

    def shaft_velocity_rad_s(self, motor: int) -> float:
        """Output shaft speed."""
        return float(self._data.qvel[self._parts.spool[motor]])

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        """Torque on the output shaft before gear friction, held until the next."""
        if self._hand_only or not np.isfinite(torque):
            raise InputError(f"shaft torque {torque} is not accepted; expected a finite one, and hand_only = False.")
        self._data.qfrc_applied[self._parts.spool[motor]] = torque

    def wind_spools(self, rate_rad_s: Sequence[float]) -> None:
        """Only with `hand_only`: turn both spools at these rates (right, left), whatever the tendons pull."""
        if not self._hand_only:
            raise InputError("the spools belong to the motors; expected hand_only = True.")
        self._data.qvel[self._parts.spool] = _vector("rate_rad_s", rate_rad_s, 2)

    # Fingertips

    def fingertip_force_N(self) -> tuple[float, float]:
        """Normal force at the right and left fingertip in the last physics step: what tactile pads on them feel."""
        right, left = fingertip_forces_N(self._model, self._data, self._parts.tip_geom.tolist()).tolist()
        return right, left

    # Object

    def push_object(self, force_N: Sequence[float], torque_Nm: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Disturb the object with force and torque in world axes at its centre of mass, (3,) each, until the next."""
        wrench = np.concatenate([_vector("force_N", force_N, 3), _vector("torque_Nm", torque_Nm, 3)])
        self._data.xfrc_applied[self._parts.object_body] = wrench

    def take_support_away(self) -> None:
        """From now on nothing carries the object but the hand; without a support this does nothing."""
        if self._parts.support_geom is not None:
            self._model.geom_pos[self._parts.support_geom, 2] -= FAR_BELOW_M

    # What really is

    @property
    def parts(self) -> WorldModel:
        """The compiled model and where its parts are."""
        return self._parts

    def copy_state_to(self, data: mujoco.MjData) -> None:
        """Copy the physics' state into other data of the same model; the physics is left as it is."""
        mujoco.mj_getState(self._model, self._data, self._state, _STATE)
        mujoco.mj_setState(self._model, data, self._state, _STATE)


def _vector(name: str, values: ArrayLike, size: int) -> NDArray[np.float64]:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (size,) or not np.all(np.isfinite(array)):
        raise InputError(f"{name} = {values!r} is not accepted; expected {size} finite numbers.")
    return array
