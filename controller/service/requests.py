"""From a validated request to what the cycle shall do: one plan a request, of one or more cycle commands.

Everything that takes longer than a cycle may wait is worked out here, in the front: poses, tables, loads to excursions.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import pinocchio
from numpy.typing import NDArray

from calibration.motion_table import MotionTable
from controller.config import RobotConfig
from controller.messages import CommandKind
from controller.service import commands as asked
from controller.service.assembly import INDEX_NAMES, arm_parameters, index_name
from controller.service.table_shelf import TableShelf, excursion_at_load
from drivers.errors import CommandError

C = TypeVar("C", bound=asked.Command)


@dataclass(frozen=True)
class Step:
    """One cycle command of a plan; a table travels beside it as a memfd."""

    kind: CommandKind
    values: tuple[float, ...] = ()
    table: MotionTable | None = None


@dataclass
class Plan:
    """What one request wants: steps one after the other, and what the answer tells besides."""

    steps: deque[Step]
    desired: dict[str, Any] = field(default_factory=dict)


class Planner:
    """Makes plans; knows the tables and which of them the cycle has."""

    def __init__(self, config: RobotConfig, shelf: TableShelf) -> None:
        self._config = config
        self._arm = arm_parameters(config)
        self._shelf = shelf
        self.table: MotionTable | None = None
        self.table_name = ""
        self.compensation_index = index_name(config)
        self._makers: Mapping[type[asked.Command], Callable[[Any], Plan]] = {
            asked.Stop: lambda _: _one(CommandKind.STOP),
            asked.FaultClear: lambda _: _one(CommandKind.FAULT_CLEAR),
            asked.Shutdown: lambda _: _one(CommandKind.SHUTDOWN),
            asked.ArmHold: lambda _: _one(CommandKind.ARM_HOLD),
            asked.ArmMoveJoints: self._move_joints,
            asked.ArmMoveWrist: lambda c: _one(CommandKind.MOVE_WRIST, (*_flat(c.T_world_wrist.matrix()), c.speed)),
            asked.HandOpen: lambda _: _one(CommandKind.OPEN),
            asked.GraspPreposition: self._preposition,
            asked.GraspClose: lambda c: _one(CommandKind.CLOSE, () if c.rate_m_s is None else (c.rate_m_s,)),
            asked.GraspSqueeze: self._squeeze,
            asked.GraspHold: lambda _: _one(CommandKind.HOLD),
            asked.GraspRelease: lambda _: _one(CommandKind.RELEASE),
            asked.TableLoad: lambda c: Plan(deque([self._load(c.table)])),
            asked.CompensationSet: self._set_compensation,
        }

    def plan(self, command: asked.Command) -> Plan:
        """The plan for a command that concerns the cycle. Raises CommandError."""
        return self._makers[type(command)](command)

    def _move_joints(self, command: asked.ArmMoveJoints) -> Plan:
        limits = self._config.arm.limits
        own = self._arm
        lower, upper = limits.lower_rad or own.joint_lower_rad, limits.upper_rad or own.joint_upper_rad
        for joint, (low, angle, high) in enumerate(zip(lower, command.joint_rad, upper, strict=True), start=1):
            if not low <= angle <= high:
                raise CommandError(
                    "joint_limit",
                    f"joint_rad[{joint - 1}] = {angle:g} is outside the range of joint {joint}.",
                    key=f"joint_rad[{joint - 1}]",
                    accepted=f"{low:g} to {high:g} rad",
                    help=f"Accepted: {low:g} to {high:g} rad.",
                )
        return _one(CommandKind.MOVE_JOINTS, (*command.joint_rad, command.speed))

    def _preposition(self, command: asked.GraspPreposition) -> Plan:
        steps: deque[Step] = deque()
        if self.table is None or command.table != self.table_name:
            steps.append(self._load(command.table))
        table = steps[0].table if steps else self.table
        assert table is not None
        T_world_wrist = grasp_wrist_pose(table, command.T_world_object(), self._config.T_wrist_hand)
        T_world_hand = T_world_wrist @ self._config.T_wrist_hand
        before = T_world_wrist.copy()
        before[:3, 3] -= command.approach_m * T_world_hand[:3, 1]
        steps.append(Step(CommandKind.PREPOSITION, (*_flat(before), command.speed, 0.0)))
        steps.append(Step(CommandKind.PREPOSITION, (*_flat(T_world_wrist), command.speed, 1.0)))
        return Plan(steps, {"wrist_xyz_m": T_world_wrist[:3, 3].tolist()})

    def _squeeze(self, command: asked.GraspSqueeze) -> Plan:
        if self.table is None:
            raise CommandError("no_table", "No motion table is loaded.", help="Send `grasp.preposition` first.")
        cap_N = self._config.squeeze.load_cap_N
        if command.load_N > cap_N:
            raise CommandError(
                "load_above_cap",
                f"load_N = {command.load_N:g} is above the load cap.",
                key="load_N",
                accepted=f"at most {cap_N:g} N",
            )
        excursion_m = excursion_at_load(self.table, command.load_N)
        duration_s = command.duration_s
        if duration_s is None:
            duration_s = excursion_m / self._config.squeeze.squeeze_rate_m_s
        desired = {"load_N": command.load_N, "mean_excursion_m": excursion_m, "duration_s": duration_s}
        return Plan(deque([Step(CommandKind.SQUEEZE, (excursion_m, command.load_N, duration_s))]), desired)

    def _set_compensation(self, command: asked.CompensationSet) -> Plan:
        index = command.index or self.compensation_index
        return _one(CommandKind.SET_COMPENSATION, (float(command.enabled), float(INDEX_NAMES[index])))

    def _load(self, name: str) -> Step:
        return Step(CommandKind.LOAD_TABLE, table=self._shelf.open(name))


def grasp_wrist_pose(
    table: MotionTable, T_world_object: NDArray[np.float64], T_wrist_hand: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Wrist pose (4×4, world) at which the object, standing at `T_world_object`, is where the fingers first touch it.

    T_world_wrist = T_world_object · T_hand_object(0)⁻¹ · T_wrist_hand⁻¹ (paper II-A).
    """
    x, y, z, *rotation_vector = table.contact_pose
    T_hand_object = np.eye(4)
    T_hand_object[:3, :3] = pinocchio.exp3(np.array(rotation_vector))
    T_hand_object[:3, 3] = (x, y, z)
    pose: NDArray[np.float64] = T_world_object @ np.linalg.inv(T_hand_object) @ np.linalg.inv(T_wrist_hand)
    return pose


def _one(kind: CommandKind, values: tuple[float, ...] = ()) -> Plan:
    return Plan(deque([Step(kind, values)]))


def _flat(T: NDArray[np.float64]) -> tuple[float, ...]:
    """Position and quaternion w, x, y, z of a pose."""
    quaternion = pinocchio.Quaternion(T[:3, :3])
    return (*T[:3, 3].tolist(), float(quaternion.w), float(quaternion.x), float(quaternion.y), float(quaternion.z))
