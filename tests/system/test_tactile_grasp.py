"""Whole grasps on virtual time with pads on the fingertips: contact is found by them, against the world's own truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.motion_table import MotionTable
from controller.config import RobotConfig, Tactile
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import GraspCase, approach_joints, table_name
from controller.simulation.truth import WorldObserver
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World

pytestmark = pytest.mark.slow
CELLS = tuple((row, column) for row, columns in ((0, 5), (1, 3)) for column in range(columns))
TACTILE = Tactile(
    interface="socket",
    channel="memory",
    right_cells=CELLS,
    left_cells=tuple((row + 2, column) for row, column in CELLS),
)


class Robot:
    """A robot with pads, near the object; it notes the true excursions at which each fingertip first touches."""

    def __init__(self, config: RobotConfig, case: GraspCase) -> None:
        table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
        joints = tuple(approach_joints(config, table, case))
        config = msgspec.structs.replace(config, tactile=TACTILE)
        self.case = case
        self.touched: dict[int, float] = {}
        self.virtual = VirtualRobot(config, replace(case.scene, joint_rad=joints), observe=self._note)
        self.observer = WorldObserver(self.virtual.world, configured_hand(config))
        self.virtual.activate()
        self.client = self.virtual.client()

    def close(self, rate_m_s: float) -> NDArray[np.float64]:
        """Preposition and close; the excursions that were found, (2,)."""
        self.client.grasp_preposition(
            table_name(self.case),
            object_xyz_m=self.case.object_xyz_m,
            object_yaw_rad=self.case.object_yaw_rad,
            approach_m=0.02,
            speed=1.0,
        ).wait()
        self.touched.clear()
        return np.array(self.client.grasp_close(rate_m_s=rate_m_s).wait()["contact_excursion_m"])

    def release(self) -> None:
        self.client.grasp_release().wait()

    def _note(self, world: World) -> None:
        for finger, force_N in enumerate(world.fingertip_force_N()):
            if force_N > 0.0 and finger not in self.touched:
                self.touched[finger] = float(self.observer.truth().tendon_excursion_m[finger])


@pytest.fixture(scope="module")
def robot(config: RobotConfig, symmetric_case: GraspCase) -> Robot:
    return Robot(config, symmetric_case)


@pytest.mark.parametrize("rate_m_s", [0.010, 0.020])
def test_contact_is_where_the_fingertips_touched(robot: Robot, rate_m_s: float) -> None:
    """At two closing speeds: within 0.1 mm of excursion of the world's first contact of each finger, and the state
    tells both forces as the world has them."""
    found_m = robot.close(rate_m_s)
    true_m = np.array([robot.touched[0], robot.touched[1]])
    assert found_m == pytest.approx(true_m, abs=1e-4)
    robot.virtual.run_for(0.2)
    state = robot.client.status()["state"]["tactile"]
    assert state["touching"] == [1.0, 1.0]
    assert state["force_N"] == pytest.approx(robot.observer.truth().contact_force_N, abs=0.15)
    robot.release()


def test_pads_that_are_lost_leave_contact_to_the_motors(robot: Robot) -> None:
    """Unplugged before the grasp: it closes all the same, and finds contact by load."""
    assert robot.virtual.devices.pads is not None
    robot.virtual.devices.pads.unplugged = True
    found_m = robot.close(0.020)
    true_m = np.array([robot.touched[0], robot.touched[1]])
    assert found_m == pytest.approx(true_m, abs=1e-4)
    assert robot.client.status()["state"]["grasp"]["phase"] == "contact"
