"""When the arm model carries the object: lifted, not merely gripped."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from controller.cycle.arm_model import ArmModel
from controller.cycle.grasp_state import GraspPhase
from controller.cycle.lifted_load import RAMP_S, LiftedLoad

PERIOD_S = 0.002
MASS_KG = 0.6
Q = np.array([0.0, 0.6, 0.0, 1.8, 0.0, -0.8, 0.0])


class Robot:
    """An arm model, and a grasp and a planned wrist that the tests move."""

    def __init__(self) -> None:
        self.model = ArmModel()
        self.empty_Nm = self.model.gravity(Q)
        self.motion = SimpleNamespace(T_world_wrist_plan=np.eye(4))
        table = SimpleNamespace(contact_pose=(0.0, 0.09, 0.0), object_mass_kg=MASS_KG)
        self.grasping = SimpleNamespace(phase=GraspPhase.NONE, gripping=False, table=table)
        self.load = LiftedLoad(self.model, cast(Any, self.motion), cast(Any, self.grasping), PERIOD_S)

    def run(self, phase: GraspPhase, raised_m: float, duration_s: float = 2 * RAMP_S) -> list[float]:
        """What the arm carries, period by period."""
        self.grasping.phase = phase
        self.motion.T_world_wrist_plan[2, 3] = raised_m
        fractions = []
        for _ in range(round(duration_s / PERIOD_S)):
            self.load.step()
            fractions.append(self.model.payload_fraction)
        return fractions


@pytest.fixture
def robot() -> Robot:
    return Robot()


def gripped(robot: Robot) -> None:
    for phase in (GraspPhase.CLOSING, GraspPhase.CONTACT, GraspPhase.SQUEEZING, GraspPhase.HOLDING):
        assert robot.run(phase, 0.0)[-1] == 0.0


def test_a_gripped_object_weighs_nothing_until_it_is_lifted(robot: Robot) -> None:
    """Protects the grip from an arm that pulls the object up by its weight while the support still carries it."""
    gripped(robot)
    assert robot.model.gravity(Q) == pytest.approx(robot.empty_Nm)
    assert robot.run(GraspPhase.CARRYING, 0.02)[-1] == 1.0
    jacobian = robot.model.jacobian(Q)
    lever = robot.model.wrist_pose(Q)[:3, :3] @ np.array([0.0, 0.09, 0.0])
    force = np.array([0.0, 0.0, 9.80665 * MASS_KG])
    by_virtual_work = jacobian.T @ np.concatenate((force, np.cross(lever, force)))
    assert robot.model.gravity(Q) - robot.empty_Nm == pytest.approx(by_virtual_work, abs=2e-3)


def test_its_weight_comes_and_goes_on_a_ramp(robot: Robot) -> None:
    """Protects the arm from torques that jump."""
    gripped(robot)
    up = robot.run(GraspPhase.CARRYING, 0.02)
    down = robot.run(GraspPhase.HOLDING, 0.0)
    for fractions in (up, down):
        assert max(abs(np.diff([1.0 - fractions[-1], *fractions]))) <= PERIOD_S / RAMP_S + 1e-12
    assert (up[-1], down[-1]) == (1.0, 0.0)


@pytest.mark.parametrize("phase", [GraspPhase.RELEASING, GraspPhase.NONE])
def test_an_object_that_was_let_go_weighs_nothing(robot: Robot, phase: GraspPhase) -> None:
    """Protects from an arm that rises when it has set the object down elsewhere."""
    gripped(robot)
    robot.run(GraspPhase.CARRYING, 0.1)
    assert robot.run(phase, 0.1)[-1] == 0.0


@pytest.mark.parametrize(("gripping", "carried"), [(True, 1.0), (False, 0.0)])
def test_in_a_fault_what_is_held_is_carried_on(robot: Robot, gripping: bool, carried: float) -> None:
    """A fault keeps the object, so it keeps its weight."""
    gripped(robot)
    robot.run(GraspPhase.CARRYING, 0.1)
    robot.grasping.gripping = gripping
    assert robot.run(GraspPhase.FAULT, 0.1)[-1] == carried


def test_the_next_object_begins_at_its_own_height_and_mass(robot: Robot) -> None:
    """A grasp on a higher shelf is not a lifted one, and the last object's mass is forgotten."""
    gripped(robot)
    robot.run(GraspPhase.CARRYING, 0.1)
    whole_Nm = robot.model.gravity(Q) - robot.empty_Nm
    robot.run(GraspPhase.NONE, 0.1)
    robot.grasping.table.object_mass_kg = MASS_KG / 6
    assert robot.run(GraspPhase.CLOSING, 0.4)[-1] == 0.0
    assert robot.run(GraspPhase.HOLDING, 0.4)[-1] == 0.0
    robot.run(GraspPhase.CARRYING, 0.5)
    assert robot.model.gravity(Q) - robot.empty_Nm == pytest.approx(whole_Nm / 6, abs=1e-9)
