"""The simulated robot with other tendon motors: the configured model winds the world's fingers; faults reach it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from controller.config import RobotConfig, load_config
from controller.service.assembly import configured_hand
from controller.service.assignment import SceneChoice
from controller.simulation.scene import Scene, build_devices
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world_process import simulated_devices
from drivers.clock import nanoseconds
from drivers.dynamixel.control_tables import MODELS, model_by_name
from drivers.errors import InputError
from drivers.simulated.faults import Fault
from drivers.simulated.serial_fault_actions import SerialAction


def _config(model: str, zero_ticks: int) -> RobotConfig:
    side = {"zero_ticks": zero_ticks}
    return load_config(None, {"tendons": {"model": model, "right": side, "left": side}})


@pytest.mark.parametrize("name", [model.name for model in MODELS.values()])
def test_every_model_winds_the_world_s_tendons(name: str) -> None:
    """15 mm of goal close both fingers by about as much in half a second, in the model's own ticks."""
    model = model_by_name(name)
    config = _config(name, 300)
    devices = build_devices(config, configured_hand(config), Scene())
    goal_ticks = 300 + round(0.015 / 0.0105 / model.tick_rad)
    for motor in devices.motors.motors:
        writes = {"goal_position": goal_ticks}
        if model.protocol == 2:
            writes = {"operating_mode": 4, "torque_enable": 1, **writes}
        for register_name, value in writes.items():
            register = model.registers[register_name]
            assert motor.write(register.address, register.encode(value)) == 0
    devices.world.advance_to(nanoseconds(0.8))
    wound_m = [0.0105 * devices.world.shaft_angle_rad(motor) for motor in (0, 1)]
    assert wound_m == pytest.approx([0.015, 0.015], abs=0.003)
    read_m = [0.0105 * (motor.value("present_position") - 300) * model.tick_rad for motor in devices.motors.motors]
    assert read_m == pytest.approx(wound_m, abs=0.0105 * model.tick_rad)


def test_a_motor_fault_reaches_the_whole_robot() -> None:
    """An MX-28 hand starts up under the daemon's own parts; a motor that is cut off later is told to the client."""
    robot = VirtualRobot(_config("MX-28", 600), Scene())
    robot.activate()
    assert [motor.value("torque_enable") for motor in robot.devices.motors.motors] == [1, 1]
    fault = {"action": {"kind": "cut_off", "motors": [2]}, "at_s": 0.05}
    robot.add_motor_fault(msgspec.convert(fault, Fault[SerialAction]))
    robot.run_for(0.5)
    assert not robot.devices.motors.motors[1].powered
    hand = robot.client().status()["state"]["hand"]
    assert hand["faults"] == ["no_reply", "one_silent"]
    with pytest.raises(InputError, match="motor 9 is not on the bus"):
        robot.add_motor_fault(msgspec.convert({"action": {"kind": "silence", "motors": [9]}}, Fault[SerialAction]))


def test_the_command_line_s_outline_reaches_the_world() -> None:
    """A flat-sided object of a split grasp stands in `run --simulate` as its table has it, not square to the hand."""
    config = load_config()

    def geometry(choice: SceneChoice) -> NDArray[np.float64]:
        model = simulated_devices(config, choice, 0).world.parts.model
        return np.concatenate([model.geom_pos.ravel(), model.geom_quat.ravel(), model.mesh_vert.ravel()])

    square = geometry(SceneChoice(object="rectangle40"))
    turned = geometry(SceneChoice(object="rectangle40", outline_angle_rad=-0.0453))
    scene = Scene(object="rectangle40", outline_angle_rad=-0.0453)
    model = build_devices(config, configured_hand(config), scene).world.parts.model
    asked = np.concatenate([model.geom_pos.ravel(), model.geom_quat.ravel(), model.mesh_vert.ravel()])
    assert np.array_equal(turned, asked)
    assert not np.array_equal(turned, square)
