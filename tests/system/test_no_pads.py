"""Absent pads cost nothing: no part, no link, no line of a record."""

from __future__ import annotations

from controller.config import RobotConfig
from controller.simulation.demo_cases import GraspCase
from controller.simulation.virtual_robot import VirtualRobot


def test_without_the_table_nothing_of_the_pads_runs(config: RobotConfig, symmetric_case: GraspCase) -> None:
    """The default installation has no [tactile]: nobody steps for them, no record has a line of them, and
    no client sees them. (That the daemon has no such process is in `test_daemon.py`.)"""
    assert config.tactile is None
    robot = VirtualRobot(config, symmetric_case.scene)
    assert robot.devices.pads is None
    assert robot.time.part_names == ["world", "hub", "cycle", "hand", "front"]
    robot.activate()
    status = robot.client().status()
    assert status["state"]
    assert "tactile" not in status["state"]
    assert status["tactile_lost"] == ""
    assert not [name for name in robot.front.record or {} if "tactile" in name]
