"""Motors at the baud rate that they leave the factory with, on virtual time: their samples are 20 to 35 ms old."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from calibration.motion_table import MotionTable
from controller.config import RobotConfig, load_config
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.virtual_robot import VirtualRobot

pytestmark = pytest.mark.slow
FACTORY_BAUD = 57_600


def test_motors_at_their_factory_baud_rate_grip(config: RobotConfig, symmetric_case: GraspCase) -> None:
    """Protects who has not set the rate yet: contact is found where it is, and the squeeze ends where it was to end."""
    directory = config.tables.directory
    slow = load_config(overrides={"tables": {"directory": directory}, "tendons": {"baud": FACTORY_BAUD}})
    table = MotionTable.load(Path(directory) / f"{table_name(symmetric_case)}.npz")
    joints = tuple(approach_joints(slow, table, symmetric_case))
    robot = VirtualRobot(slow, replace(symmetric_case.scene, joint_rad=joints))
    robot.activate()
    with robot.client() as client:
        preposition(client, symmetric_case, approach_m=0.02)
        closed = client.grasp_close().wait()
        assert closed["contact_excursion_m"] == pytest.approx(closed["expected_excursion_m"], abs=1e-4)
        squeezed = client.grasp_squeeze(load_N=40.0, duration_s=0.6).wait()
    assert squeezed.get("reason") is None
    reached, wanted = (squeezed[what]["mean_excursion_m"] for what in ("applied", "desired"))
    assert reached == pytest.approx(wanted, abs=1e-4)
