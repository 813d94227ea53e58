"""How far a slow command is, ten times a second, worked out by the front from the cycle's records.

    arm.move_joints     joint_rad as commanded now            done: of the largest joint's way
    arm.move_wrist      wrist_xyz_m as planned now            done: of the straight way
    grasp.preposition   the same
    grasp.close         excursion_m, tension_N                right, left
    grasp.squeeze       mean_excursion_m, measured_load_N     done: of the excursion
    grasp.release, hand.open   excursion_m, tension_N         right, left

All with `command`, `elapsed_s` and the grasp's `phase`; `done` is 0 to 1, and left out where the way is not known. Pure
but for what it has seen before. Source: design 6.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from controller.cycle.grasp_state import GraspPhase
from controller.service import commands as asked
from drivers.clock import nanoseconds, seconds

PERIOD_S = 0.1
_SHORTEST_WAY = 1e-6
"""Of a way in m or rad; of less no part is told."""


class Progress:
    """One command that was accepted at `now_ns`; `desired` is what its acceptance told."""

    def __init__(self, command: asked.Command, desired: Mapping[str, Any], now_ns: int) -> None:
        self._command = command
        self._desired = desired
        self._begin_ns = now_ns
        self._next_ns = now_ns + nanoseconds(PERIOD_S)
        self._way: float | None = None

    def take(self, record: Mapping[str, Any], now_ns: int) -> dict[str, Any] | None:
        """What is to be told now of the newest record; None between two of them."""
        to_go = self._to_go(record)
        if self._way is None and to_go is not None:
            self._way = to_go
        if now_ns < self._next_ns:
            return None
        self._next_ns = now_ns + nanoseconds(PERIOD_S)
        told: dict[str, Any] = {
            "command": self._command.name,
            "elapsed_s": seconds(now_ns - self._begin_ns),
            "phase": GraspPhase(int(record["grasp_phase"])).name.lower(),
        }
        if to_go is not None and self._way is not None and self._way > _SHORTEST_WAY:
            told["done"] = min(max(1.0 - to_go / self._way, 0.0), 1.0)
        return told | self._values(record)

    def _to_go(self, record: Mapping[str, Any]) -> float | None:
        """What is left of the way, m or rad."""
        command = self._command
        if isinstance(command, asked.ArmMoveJoints):
            return float(max(abs(a - b) for a, b in zip(command.joint_rad, record["joint_command_rad"], strict=True)))
        if isinstance(command, asked.ArmMoveWrist):
            return math.dist(command.T_world_wrist.xyz_m, record["wrist_plan_xyz_m"])
        if isinstance(command, asked.GraspPreposition):
            return float(math.dist(self._desired["wrist_xyz_m"], record["wrist_plan_xyz_m"]))
        if isinstance(command, asked.GraspSqueeze):
            return max(float(self._desired["mean_excursion_m"]) - float(record["index_mean_m"]), 0.0)
        return None

    def _values(self, record: Mapping[str, Any]) -> dict[str, Any]:
        command = self._command
        if isinstance(command, asked.ArmMoveJoints):
            return {"joint_rad": record["joint_command_rad"]}
        if isinstance(command, asked.ArmMoveWrist | asked.GraspPreposition):
            return {"wrist_xyz_m": record["wrist_plan_xyz_m"]}
        tension_N = record["hand_tension_N"]
        if isinstance(command, asked.GraspSqueeze):
            return {"mean_excursion_m": record["index_mean_m"], "measured_load_N": sum(tension_N) / len(tension_N)}
        return {"excursion_m": record["hand_excursion_m"], "tension_N": tension_N}
