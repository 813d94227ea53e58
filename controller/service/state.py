"""The robot's state as clients see it: nested names from one cycle record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio

from controller.cycle.grasp_state import ArmState, GraspPhase, HandStatus
from controller.messages import CompensationIndex, HandFault, Reason
from controller.reasons import EXPLANATIONS

Record = Mapping[str, float | list[float]]


def state_map(record: Record) -> dict[str, Any]:
    """The state of one cycle, with units in the names; what tactile pads add is in `tactile_state.py`."""
    fault = Reason(_integer(record, "reason"))
    return {
        "arm": {
            "state": ArmState(_integer(record, "arm_state")).name.lower(),
            "joint_rad": record["joint_rad"],
            "joint_command_rad": record["joint_command_rad"],
            "joint_torque_Nm": record["joint_torque_Nm"],
            "wrist_target_xyz_m": record["wrist_xyz_m"],
            "wrist_plan_xyz_m": record["wrist_plan_xyz_m"],
            "wrist_plan_quaternion_wxyz": _quaternion_wxyz(record["wrist_plan_rotation"]),
            "payload_fraction": record["payload_fraction"],
        },
        "hand": {
            "state": HandStatus(_integer(record, "hand_state")).name.lower(),
            "excursion_m": record["hand_excursion_m"],
            "tension_N": record["hand_tension_N"],
            "tension_uncertainty_N": record["hand_tension_uncertainty_N"],
            "age_us": record["hand_age_us"],
            "effort": record["hand_effort"],
            "temperature_C": record["hand_temperature_C"],
            "voltage_V": record["hand_voltage_V"],
            "derating": record["hand_derating"],
            "read_rate_hz": record["hand_read_rate_hz"],
            "faults": [str(fault.name).lower() for fault in HandFault if _integer(record, "hand_fault") & fault],
        },
        "grasp": {
            "phase": GraspPhase(_integer(record, "grasp_phase")).name.lower(),
            "fault": "" if fault is Reason.NONE else EXPLANATIONS[fault].code,
            "index_mean_m": record["index_mean_m"],
            "index_difference_m": record["index_difference_m"],
            "load_index_N": record["load_index_N"],
            "winding_m": record["winding_m"],
        },
        "compensation": {
            "enabled": bool(record["compensation_enabled"]),
            "index": CompensationIndex(_integer(record, "compensation_index")).name.lower(),
            "offset": record["offset"],
            "offset_target": record["offset_target"],
            "scale": record["inverse_kinematics_scale"],
            "governor": record["governor"],
        },
        "cycle": {
            "number": _integer(record, "cycle"),
            "missed_periods": _integer(record, "missed_periods"),
            "late_us": record["late_us"],
            "cpu_us": record["cpu_us"],
        },
    }


def _quaternion_wxyz(rotation: float | list[float]) -> list[float]:
    """Of a rotation matrix's nine entries, row by row."""
    turn = pinocchio.Quaternion(np.reshape(rotation, (3, 3)))
    return [float(turn.w), float(turn.x), float(turn.y), float(turn.z)]


def _integer(record: Record, name: str) -> int:
    value = record[name]
    assert isinstance(value, float)
    return int(value)
