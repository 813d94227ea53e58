"""A whole grasp on virtual time in which one pad alone touches: the pads deliver it, and the cycle lets go."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from calibration.motion_table import MotionTable
from controller.config import RobotConfig, Tactile
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.truth import WorldObserver
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World
from drivers.errors import CommandError
from drivers.simulated.faults import Fault
from drivers.simulated.takktile_fault_actions import Press

RIGHT = tuple((row, column) for row, columns in ((0, 5), (1, 3)) for column in range(columns))
TACTILE = Tactile(
    interface="socket", channel="memory", right_cells=RIGHT, left_cells=tuple((row + 2, c) for row, c in RIGHT)
)


@pytest.mark.slow
def test_one_pad_alone_is_one_sided_contact(config: RobotConfig, symmetric_case: GraspCase) -> None:
    """The object is gone; something light meets the right fingertip where the object should be: too light for the
    motors, enough for the pad. The grasp ends for that reason."""
    table = MotionTable.load(Path(config.tables.directory) / f"{table_name(symmetric_case)}.npz")
    joints = tuple(approach_joints(config, table, symmetric_case))
    x, y, z = symmetric_case.object_xyz_m
    scene = replace(symmetric_case.scene, joint_rad=joints, object_xyz_m=(x, y + 0.5, z))
    pressed = False

    def press_when_there(world: World) -> None:
        nonlocal pressed
        if not pressed and observer.truth().tendon_excursion_m[0] > table.contact_excursion_m[0] - 1e-4:
            pressed = True
            assert virtual.devices.pads is not None
            virtual.devices.pads.add_fault(Fault(action=Press(cells=RIGHT, newtons=0.08)), virtual.time.now_ns)

    with_pads = msgspec.structs.replace(config, tactile=TACTILE)
    virtual = VirtualRobot(with_pads, scene, observe=press_when_there, observe_period_s=0.01)
    observer = WorldObserver(virtual.world, configured_hand(config))
    virtual.activate()
    client = virtual.client()
    preposition(client, symmetric_case, approach_m=0.02)
    with pytest.raises(CommandError) as refused:
        client.grasp_close(rate_m_s=0.02).wait()
    assert refused.value.code == "one_sided_contact"
    assert pressed
    assert client.status()["state"]["grasp"]["phase"] == "prepositioned"
