"""A heavy object is gripped, lifted and carried on virtual time: the arm model carries it, and it does not slip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.objects import load_object
from controller.config import load_config
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition
from controller.simulation.demo_report import Track
from controller.simulation.virtual_robot import VirtualRobot

pytestmark = pytest.mark.slow

HEAVY = """
name = "full glass"
mass_kg = 0.6
height_m = 0.12
shape = { kind = "disc", diameter_m = 0.040 }
[support]
friction = 0.3
"""
LIFT_M = 0.05


def test_a_heavy_object_is_lifted_without_a_sag(tmp_path: Path, symmetric_case: GraspCase) -> None:
    """600 g weigh on the wrist from the moment they are lifted; without them in the model it sags and they slip."""
    config = load_config(overrides={"tables": {"directory": str(tmp_path)}})
    object_file = tmp_path / "glass.toml"
    object_file.write_text(HEAVY)
    hand = configured_hand(config)
    table = build_table(hand, load_object(str(object_file)), GraspSpec(), nodes=9)
    table.save(tmp_path / "glass.npz")
    track = Track(hand)
    scene = replace(symmetric_case.scene, object=str(object_file))
    robot = VirtualRobot(config, scene, recorder=track, observe=track.observe)
    robot.activate()
    with robot.client() as client:
        client.hello("test")
        client.arm_move_joints(approach_joints(config, table, symmetric_case), speed=1.0).wait()
        preposition(client, symmetric_case, table="glass")
        client.grasp_close().wait()
        client.grasp_squeeze(load_N=80.0, duration_s=1.0).wait()
        track.watching = True
        robot.run_for(0.01)
        arm = client.status()["state"]["arm"]
        x, y, z = arm["wrist_plan_xyz_m"]
        client.arm_move_wrist([x, y, z + LIFT_M], arm["wrist_plan_quaternion_wxyz"], speed=0.5).wait()
        robot.run_for(0.3)
        assert client.status()["state"]["arm"]["payload_fraction"] == 1.0
    wrist_m = np.array([truth.T_world_wrist[2, 3] for truth in track.truths])
    glass_m = np.array([truth.T_world_object[2, 3] for truth in track.truths])
    wanted_m = np.array([record["wrist_xyz_m"][2] for record in track.records])
    at = np.searchsorted(track.record_times_ns, [truth.time_ns for truth in track.truths])
    error_m = wrist_m - wanted_m[np.clip(at, 0, len(wanted_m) - 1)]
    assert glass_m[-1] - glass_m[0] == pytest.approx(LIFT_M, abs=3e-4)
    assert abs(error_m).max() < 0.4e-3
    assert abs(error_m[-1]) < 0.05e-3
