"""Brings a robot of each model through the phases of a grasp, and lets a copy of it live through each case."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from controller.config import RobotConfig, load_config
from controller.simulation.demo_cases import GraspCase
from tests.system.forked import in_a_fork
from tests.system.motor_fault_cases import CASES
from tests.system.motor_fault_judge import judge, suffer
from tests.system.motor_fault_matrix import WATCH_S, XM, Case
from tests.system.motor_fault_rig import PHASES, Robot, Seen, Watch

ZERO_TICKS = {"RX-28": 100, "MX-28": 600}
"""Where all of the travel lies within one turn; other models know their turns."""
RobotIn = Callable[[str, str], tuple[Robot, Watch | None]]
"""Model and phase: the robot, and what it goes through without a fault."""


def entries(models: Sequence[str], phases: Sequence[str]) -> list[Any]:
    """Parameters of a test, phase by phase, so that one robot goes through them in order."""
    return [
        pytest.param(case, phase, id=f"{case.model}-{phase}-{case.name}")
        for model in models
        for phase in phases
        for case in CASES
        if case.model == model and case.cell(phase)
    ]


class Robots:
    """One robot a model, made when it is first asked for, and anew for a phase that is over."""

    def __init__(self, directory: str, case: GraspCase) -> None:
        self._directory = directory
        self._case = case
        self._robots: dict[str, Robot] = {}
        self._usual: dict[tuple[str, str], Watch] = {}

    def __call__(self, model: str, phase: str) -> tuple[Robot, Watch | None]:
        robot = self._robots.get(model)
        if robot is None or PHASES.index(robot.phase) > PHASES.index(phase):
            robot = self._robots[model] = Robot(self._config(model), self._case)
        robot.advance(phase)
        if phase == "start-up":
            return robot, None
        if (model, phase) not in self._usual:
            self._usual[model, phase] = in_a_fork(lambda: robot.suffer((), WATCH_S)).watch
        return robot, self._usual[model, phase]

    def _config(self, model: str) -> RobotConfig:
        tendons: dict[str, Any] = {"model": model}
        if zero_ticks := ZERO_TICKS.get(model):
            tendons |= {side: {"zero_ticks": zero_ticks} for side in ("right", "left")}
        return load_config(overrides={"tables": {"directory": self._directory}, "tendons": tendons})


def case_named(name: str, model: str = XM) -> Case:
    """A row of the matrix."""
    return next(case for case in CASES if (case.name, case.model) == (name, model))


def live_through(case: Case, phase: str, robot_in: RobotIn, spoil: Callable[[Robot], None] | None = None) -> None:
    """A copy of the robot has the case's faults, and is judged; `spoil` takes away what should react."""
    robot, usual = robot_in(case.model, phase)

    def suffered() -> Seen:
        if spoil is not None:
            spoil(robot)
        return suffer(robot, case, phase)

    judge(case, phase, in_a_fork(suffered), usual)
