"""Where the arm is commanded to be: a planned wrist pose or joint path, with the hand's offset laid on top.

    holding    the planned wrist pose stands still
    wrist      it moves along a straight line with a turn about one axis, jerk-limited
    joints     the joints move together along a straight line in joint space; only while no object is compensated

The command never jumps: it starts at the measured pose on activation and every path begins and ends at rest. Stopping
is the path's own time coming to rest (`path_time.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio
import ruckig
from numpy.typing import NDArray

from controller.cycle.arm_model import ArmModel
from controller.cycle.compensation import STILL, PlanarMotion, WristOffset
from controller.cycle.inverse_kinematics import DifferentialInverseKinematics
from controller.cycle.path_planning import Trajectory, planned
from controller.cycle.path_time import ThrottledTime

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArmMotionLimits:
    """Limits of commanded paths at full speed (WAM reference 5.4: libbarrett's defaults are 0.5 rad/s and 0.1 m/s)."""

    joint_velocity_rad_s: tuple[float, ...] = (0.75, 0.75, 1.0, 1.0, 1.5, 1.5, 1.5)
    joint_acceleration_rad_s2: tuple[float, ...] = (1.5, 1.5, 2.0, 2.0, 3.0, 3.0, 3.0)
    joint_jerk_rad_s3: tuple[float, ...] = (15.0, 15.0, 20.0, 20.0, 30.0, 30.0, 30.0)
    wrist_velocity_m_s: float = 0.15
    wrist_acceleration_m_s2: float = 0.5
    wrist_jerk_m_s3: float = 5.0
    wrist_angular_velocity_rad_s: float = 0.8
    stop_time_s: float = 0.15


class ArmMotion:
    """Commanded joint angles, velocities and accelerations, period by period."""

    def __init__(
        self,
        model: ArmModel,
        kinematics: DifferentialInverseKinematics,
        offset: WristOffset,
        period_s: float,
        limits: ArmMotionLimits,
    ) -> None:
        self._model = model
        self._kinematics = kinematics
        self._offset = offset
        self._period_s = period_s
        self._limits = limits
        self._time = ThrottledTime(period_s, limits.stop_time_s)
        self._joint_path: Trajectory | None = None
        self._wrist_path: Trajectory | None = None
        self._path_start = np.eye(4)
        self._path_shift = np.zeros(3)
        self._path_turn = np.zeros(3)
        self.T_world_wrist_plan = np.eye(4)
        self.joint_rad = np.zeros(7)
        self.joint_velocity_rad_s = np.zeros(7)
        self.joint_acceleration_rad_s2 = np.zeros(7)
        self.scale = 1.0
        self.wrist_error_m = 0.0
        """Distance of the commanded wrist from where it is wanted."""
        self._target = np.eye(4)
        self._twist = np.zeros(6)

    def place(self, joint_rad: Array, offset: PlanarMotion = STILL) -> None:
        """Command standing at `joint_rad` (7, rad), as measured; forget any path. The measured pose holds the hand's
        present `offset` already: the plan is what lies beneath it."""
        self._joint_path = self._wrist_path = None
        self.joint_rad[:] = joint_rad
        self.joint_velocity_rad_s[:] = 0.0
        self.joint_acceleration_rad_s2[:] = 0.0
        T_world_wrist = self._model.wrist_pose(joint_rad)
        if offset is not STILL:
            T_world_wrist = T_world_wrist @ np.linalg.inv(self._offset.matrix(offset))
        self._set_plan(T_world_wrist)
        self._kinematics.set_posture(joint_rad)
        self.scale = 1.0

    def keep(self, offset: PlanarMotion) -> None:
        """The hand's offset ends here: the wrist stays where it is with it, and plans from there."""
        if not self.moving:
            self._set_plan(self.T_world_wrist_plan @ self._offset.matrix(offset))

    @property
    def wrist_target_xyz_m(self) -> Array:
        """Where the wrist is wanted, offset included, world axes (3)."""
        return self._target[:3, 3]

    @property
    def moving(self) -> bool:
        """Whether a path is under way."""
        return self._joint_path is not None or self._wrist_path is not None

    def move_joints(self, target_rad: Array, speed: float) -> None:
        """Begin a joint path to `target_rad` (7, rad) at the fraction `speed` (0, 1] of the limits."""
        limits = self._limits
        request = ruckig.InputParameter(7)
        request.current_position = self.joint_rad.tolist()
        request.target_position = [float(angle) for angle in target_rad]
        request.max_velocity = [speed * v for v in limits.joint_velocity_rad_s]
        request.max_acceleration = [speed * a for a in limits.joint_acceleration_rad_s2]
        request.max_jerk = [speed * j for j in limits.joint_jerk_rad_s3]
        request.synchronization = ruckig.Synchronization.Phase
        self._joint_path = planned(request, 7)
        self._time.start()

    def move_wrist(self, T_world_wrist: Array, speed: float) -> None:
        """Begin a straight path of the planned wrist to `T_world_wrist` (4×4) at the fraction `speed` of the limits."""
        limits = self._limits
        start = self.T_world_wrist_plan.copy()
        shift = T_world_wrist[:3, 3] - start[:3, 3]
        turn = pinocchio.log3(T_world_wrist[:3, :3] @ start[:3, :3].T)
        distance_m, angle_rad = float(math.hypot(*shift)), float(math.hypot(*turn))
        # The path is one number from 0 to 1; the slower of translation and rotation sets its pace.
        pace = max(distance_m / limits.wrist_velocity_m_s, angle_rad / limits.wrist_angular_velocity_rad_s, 1e-3)
        agility = limits.wrist_acceleration_m_s2 / limits.wrist_velocity_m_s
        snap = limits.wrist_jerk_m_s3 / limits.wrist_velocity_m_s
        request = ruckig.InputParameter(1)
        request.current_position = [0.0]
        request.target_position = [1.0]
        request.max_velocity = [speed / pace]
        request.max_acceleration = [speed * agility / pace]
        request.max_jerk = [speed * snap / pace]
        self._wrist_path = planned(request, 1)
        self._path_start, self._path_shift, self._path_turn = start, shift, turn
        self._time.start()

    def stop(self) -> bool:
        """End a path that the throttle has brought to rest; True if no path is under way any more."""
        if self.moving and self._time.standing:
            self._end_path()
        return not self.moving

    def step(self, offset: PlanarMotion, throttle: float) -> None:
        """One period: move along the path, lay the hand offset on top, solve for the joints."""
        if self._joint_path is not None:
            self._step_joints(self._joint_path, throttle)
            return
        linear, angular = self._step_plan(throttle)
        self._aim(offset, linear, angular)
        step = self._kinematics.step(self.joint_rad, self.joint_velocity_rad_s, self._target, self._twist)
        np.subtract(step.velocity, self.joint_velocity_rad_s, out=self.joint_acceleration_rad_s2)
        self.joint_acceleration_rad_s2 /= self._period_s
        self.joint_velocity_rad_s[:] = step.velocity
        self.joint_rad += self._period_s * self.joint_velocity_rad_s
        self.scale = step.scale
        self.wrist_error_m = step.position_error_m

    def _step_joints(self, path: Trajectory, throttle: float) -> None:
        time_s, speed, speed_rate = self._time.step(throttle)
        angle, velocity, acceleration = path.at_time(min(time_s, path.duration))
        self.joint_rad[:] = angle
        self.joint_velocity_rad_s[:] = velocity
        self.joint_acceleration_rad_s2[:] = acceleration
        self.joint_acceleration_rad_s2 *= speed * speed
        self.joint_acceleration_rad_s2 += speed_rate * self.joint_velocity_rad_s
        self.joint_velocity_rad_s *= speed
        self.scale = 1.0
        self.wrist_error_m = 0.0
        if time_s >= path.duration:
            self._end_path()

    def _step_plan(self, throttle: float) -> tuple[Array | None, Array | None]:
        """Move the planned wrist along its path; its velocity and angular velocity in world axes (None: it stands)."""
        path = self._wrist_path
        if path is None:
            return None, None
        time_s, speed, _ = self._time.step(throttle)
        position, velocity, _ = path.at_time(min(time_s, path.duration))
        fraction, rate = position[0], velocity[0] * speed
        plan = self.T_world_wrist_plan
        plan[:3, :3] = pinocchio.exp3(fraction * self._path_turn) @ self._path_start[:3, :3]
        plan[:3, 3] = self._path_start[:3, 3] + fraction * self._path_shift
        self._set_plan(plan)
        if time_s >= path.duration:
            self._end_path()
            return None, None
        return rate * self._path_shift, rate * self._path_turn

    def _aim(self, offset: PlanarMotion, linear: Array | None, angular: Array | None) -> None:
        """Wrist target and twist, world axes: T_plan · X."""
        if offset is STILL:
            self._target[:] = self.T_world_wrist_plan
            self._twist[:] = 0.0
            arm = None
        else:
            arm = self._offset.lay_on(offset, self._target, self._twist)
        if linear is not None and angular is not None:
            self._twist[:3] += linear
            self._twist[3:] += angular
            if arm is not None:
                self._twist[0] += angular[1] * arm[2] - angular[2] * arm[1]
                self._twist[1] += angular[2] * arm[0] - angular[0] * arm[2]
                self._twist[2] += angular[0] * arm[1] - angular[1] * arm[0]

    def _set_plan(self, T_world_wrist: Array) -> None:
        self.T_world_wrist_plan = T_world_wrist
        self._offset.plan(T_world_wrist)

    def _end_path(self) -> None:
        if self._joint_path is not None:
            self.joint_velocity_rad_s[:] = 0.0
            self.joint_acceleration_rad_s2[:] = 0.0
            self._set_plan(self._model.wrist_pose(self.joint_rad))
            # The free motion leans to where the joints are: drifting elsewhere would show friction at the wrist.
            self._kinematics.set_posture(self.joint_rad)
        self._joint_path = self._wrist_path = None
