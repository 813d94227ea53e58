"""Gravity calibrated on the whole daemon in front of a world whose masses, friction and encoders are not the model's.

Virtual time, with a faster arm and shorter sampling than a real calibration's: what is protected is that the torque
model gets better in poses that were not measured, and by how much.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

from calibration.gravity_plan import GravityPlan, plan_gravity
from controller.client import Client
from controller.config import RobotConfig, load_config
from controller.gravity_command import identified
from controller.service.assembly import arm_model, arm_parameters, configured_hand, joint_limits
from controller.service.calibrate import CalibrationRun
from controller.service.state import state_map
from controller.service.state_stream import StateSeen, as_seen
from controller.simulation.scene import Scene
from controller.simulation.virtual_robot import VirtualRobot
from drivers.errors import CommandError
from drivers.wam.own_file import write_own_file

pytestmark = pytest.mark.slow
Array = npt.NDArray[np.float64]

FAST_ARM = {
    "limits": {
        "velocity_rad_s": [2.0, 2.0, 4.0, 4.0, 5.0, 5.0, 5.0],
        "acceleration_rad_s2": [8.0, 8.0, 20.0, 20.0, 40.0, 40.0, 40.0],
    }
}


class VirtualStates:
    """The state stream of a virtual robot, 100 Hz; while it is waited for, virtual time runs."""

    def __init__(self) -> None:
        self.client: Client | None = None
        self._newest: dict[str, Any] = {}

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        self._newest = record

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        pass

    def next(self, timeout_s: float) -> StateSeen | None:
        assert self.client is not None
        if timeout_s == 0.0:
            return None
        before = self._newest
        self.client.receive_until(self.client.clock.now_ns() + 10_000_000)  # its time and the robot's are one
        return None if self._newest is before else as_seen(state_map(self._newest))

    def close(self) -> None:
        pass


def configured(directory: Path) -> RobotConfig:
    """The default installation with a fast arm and an own file in `directory`."""
    own = directory / "arm.toml"
    write_own_file(own, {"safety_velocity_m_s": 6.5})
    return load_config(overrides={"arm": {**FAST_ARM, "own_file": str(own)}})


def begun(config: RobotConfig) -> tuple[VirtualRobot, CalibrationRun]:
    states = VirtualStates()
    robot = VirtualRobot(config, Scene(), recorder=states)
    robot.run_for(1.0)
    robot.press("activate")
    robot.run_for(0.1)
    limits = joint_limits(config, arm_parameters(config))
    slowest = float(limits.velocity_rad_s.min())
    states.client = robot.client()
    return robot, CalibrationRun(states.client, states, config.cycle.period_s, slowest, travel_speed=1.0)


def short_plan(config: RobotConfig) -> GravityPlan:
    """Five of the nine poses, which tell all joints apart as well as the nine, and less time at each."""
    limits = joint_limits(config, arm_parameters(config))
    plan = plan_gravity(limits.lower_rad, limits.upper_rad, settling_s=0.1, sampling_s=0.22)
    poses = tuple(plan.poses_rad[pose] for pose in (0, 4, 6, 7, 8))
    return replace(plan, poses_rad=poses, speed_rad_s=0.3)


def true_gravity(robot: VirtualRobot, q: Array) -> Array:
    """What holds the world's arm, with its hand, at poses (n, 7)."""
    parts = robot.world.parts
    data = mujoco.MjData(parts.model)
    robot.world.copy_state_to(data)
    data.qvel[:] = 0.0
    torques = []
    for angles in q:
        data.qpos[parts.arm] = angles
        mujoco.mj_forward(parts.model, data)
        torques.append(np.array(data.qfrc_bias[parts.arm]))
    return np.array(torques)


def rms_error(config: RobotConfig, robot: VirtualRobot, q: Array) -> Array:
    """Root mean square (7, N·m) of the installation's torque model against the world."""
    model = arm_model(config, configured_hand(config))
    error = np.array([model.gravity(angles) for angles in q]) - true_gravity(robot, q)
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)), np.float64)


def test_calibration_makes_the_torque_model_better_where_it_was_not_measured(tmp_path: Path) -> None:
    """Protects the purpose: in front of 3 % of mass error and 1.5 N·m of friction, gravity in poses never visited is
    met several times better than by the masses, through the arm's own file, as the daemon would read it."""
    config = configured(tmp_path)
    robot, run = begun(config)
    plan = short_plan(config)
    fit = identified(config, plan, run.measure_gravity(plan))
    assert fit.refused_joints() == ()

    limits = joint_limits(config, arm_parameters(config))
    q = np.random.default_rng(7).uniform(limits.lower_rad, limits.upper_rad, (300, 7))
    before = rms_error(config, robot, q)
    assert config.arm.own_file is not None
    write_own_file(Path(config.arm.own_file), {"gravity_mu_kg_m": fit.mu_kg_m.tolist()})
    after = rms_error(config, robot, q)
    print(f"gravity error over 300 poses, N·m rms: masses {before.round(4)}, calibrated {after.round(4)}")
    assert (after[2:6] < 0.5 * before[2:6]).all()
    assert after[1] < before[1]
    assert (after < [1e-6, 0.15, 0.06, 0.06, 0.02, 0.02, 0.005]).all()
    # The simulated friction (1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05) from half the difference of both approaches.
    np.testing.assert_allclose(fit.friction_Nm, [1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05], rtol=0.25)


def test_an_arm_that_goes_idle_in_the_middle_ends_the_calibration(tmp_path: Path) -> None:
    """Protects the operator's pendant: it ends the run with a clear error, and what was measured is given up."""
    config = configured(tmp_path)
    robot, run = begun(config)
    run.say = lambda text: robot.press("idle") if text == "pose 1 of 5, from below" else None
    with pytest.raises(CommandError, match="not active"):
        run.measure_gravity(short_plan(config))
    robot.run_for(0.1)
    with pytest.raises(CommandError, match="idle, not active"):
        run.measure_gravity(short_plan(config))
