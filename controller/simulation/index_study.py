"""Which index leaves the object stillest: each motor type, each condition, one grasp on virtual time.

What is so differs from what the configuration believes as a `Condition` says. How three indices come of one run, and
what is measured: `index_shadows.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from calibration.build import build_or_load
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import DIRECTORY, load_hand
from calibration.motion_table import MotionTable
from calibration.objects import load_object
from controller.config import RobotConfig, load_config
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import (
    OBJECT,
    GraspCase,
    approach_joints,
    command_grasp,
    demo_cases,
    table_name,
)
from controller.simulation.index_shadows import Cell, ShadowedIndex, StudyWatch, cells
from controller.simulation.scene import Scene
from controller.simulation.virtual_robot import VirtualRobot
from drivers.dynamixel.control_tables import MODELS, RX_28, model_by_name
from drivers.dynamixel.load_law import LAW_VOLTAGE_V, NOMINAL_FRICTION_PART, current_law

MODEL_NAMES = tuple(model.name for model in MODELS.values())
GRASPS = ("symmetric", "split 10 %")
HAND = "t42pp"
STIFFNESS_N_PER_M = 4.5e4
HOLD_S, LONG_HOLD_S = 1.0, 60.0
LONG_MODEL = "XM430-W350"
"""Whose grasp off the centre is held for a minute in every condition: to hold any of them costs as long again."""
NOISE_COUNTS = 2.0
"""Standard deviation of the motors' current or load."""
_ZERO_TICKS = {RX_28.name: 100}
_OTHER_ZERO_TICKS = 600
"""Where the spools are mounted: so that their travel lies in one turn."""


@dataclass(frozen=True)
class Condition:
    """What is so, beside what the configuration believes; both with gear friction and noise."""

    name: str
    words: str
    believed_N_per_m: float = STIFFNESS_N_PER_M
    """Tendon stiffness in the hand file, from which the table is built."""
    true_N_per_m: float = STIFFNESS_N_PER_M
    torque: float = 1.0
    """Torque constant believed, as a part of the true one."""
    friction: float = 1.0
    """The same of the gear friction."""
    offset: float = 0.0
    """What the motors tell too much, as a part of full effort."""
    drift_per_s: float = 0.0
    long_hold: bool = False
    """Held for `LONG_HOLD_S` by every model in the grasp that is off the centre, where more can drift."""

    def hold_s(self, model_name: str, grasp: str) -> float:
        """How long the object is held."""
        return LONG_HOLD_S if (self.long_hold or model_name == LONG_MODEL) and grasp == GRASPS[1] else HOLD_S


CONDITIONS = (
    Condition("rigid", "tendons that do not stretch, known", math.inf, math.inf),
    Condition("nominal", "all as believed: tendons 4.5e4 N/m"),
    Condition("3e4", "tendons 3e4 N/m, known", 3e4, 3e4),
    Condition("6e4", "tendons 6e4 N/m, known", 6e4, 6e4),
    Condition("softer", "tendons 30 % softer than the hand file says", true_N_per_m=0.7 * STIFFNESS_N_PER_M),
    Condition("stiffer", "tendons 30 % stiffer than the hand file says", true_N_per_m=1.3 * STIFFNESS_N_PER_M),
    Condition("friction", "gear friction 30 % above what the load law believes", friction=1.0 / 1.3),
    Condition("torque", "motors 20 % weaker than the load law believes", torque=1.25),
    Condition(
        "drift",
        "effort told 2 % of its full value too high, and 0.2 % more every second",
        offset=0.02,
        drift_per_s=0.002,
        long_hold=True,
    ),
)


def hand_file(stiffness_N_per_m: float, directory: Path) -> Path:
    """The packaged hand with tendons of this stiffness, as a file."""
    text = (DIRECTORY / f"{HAND}.toml").read_text(encoding="utf-8")
    text = text.replace("tendon_stiffness_N_per_m = inf", f"tendon_stiffness_N_per_m = {stiffness_N_per_m!r}")
    file = directory / f"{HAND}-{stiffness_N_per_m:.0f}.toml"
    if not file.exists() or file.read_text(encoding="utf-8") != text:
        directory.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return file


def study_config(model_name: str, condition: Condition, directory: Path) -> RobotConfig:
    """The default installation with this motor and what it believes; tables and hands under `directory`."""
    model = model_by_name(model_name)
    zero_ticks = _ZERO_TICKS.get(model_name, _OTHER_ZERO_TICKS)
    motor: dict[str, float] = {"zero_ticks": zero_ticks}
    if model.effort == "current":
        law = current_law(model, 0.0105)
        motor["torque_constant_Nm_per_A"] = condition.torque * law.torque_per_effort_Nm
        motor["friction_current_A"] = condition.friction * law.friction_effort
    else:
        motor["stall_torque_12V_Nm"] = condition.torque * model.stall_torque_Nm(LAW_VOLTAGE_V)
        motor["friction_load"] = condition.friction * NOMINAL_FRICTION_PART
    believed = condition.believed_N_per_m
    return load_config(
        overrides={
            "hand": {"file": str(hand_file(believed, directory))},
            "tables": {"directory": str(directory / f"tables-{believed:.0f}")},
            "tendons": {"model": model_name, "right": motor, "left": motor},
        }
    )


def study_scene(
    case: GraspCase, joint_rad: list[float], model_name: str, condition: Condition, directory: Path
) -> Scene:
    """The case's scene with what is truly so; the arm stands before the object already."""
    model = model_by_name(model_name)
    full = model.stall_current_A if model.effort == "current" else 1.0
    offset, drift = condition.offset * full, condition.drift_per_s * full
    return replace(
        case.scene,
        joint_rad=tuple(joint_rad),
        motor_noise_counts=NOISE_COUNTS,
        motor_effort_offset=(offset, offset),
        motor_effort_drift_per_s=(drift, drift),
        hand=load_hand(hand_file(condition.true_N_per_m, directory)),
    )


def study_table(config: RobotConfig, case: GraspCase) -> MotionTable:
    """The case's motion table."""
    file = Path(config.tables.directory) / f"{table_name(case)}.npz"
    file.parent.mkdir(parents=True, exist_ok=True)
    grasp = GraspSpec(onset_split=case.onset_split, compensated=True)
    return build_or_load(file, configured_hand(config), load_object(OBJECT), grasp)[0]


def prepare(model_name: str, condition: Condition, directory: Path) -> None:
    """Hands and tables of all grasps, so that several processes find them there."""
    hand_file(condition.true_N_per_m, directory)
    config = study_config(model_name, condition, directory)
    for case in demo_cases(1):
        if case.name in GRASPS:
            study_table(config, case)


def run_cells(
    model_name: str,
    condition: Condition,
    grasp: str,
    directory: Path,
    *,
    carrier: str = "excursion",
) -> list[Cell]:
    """One run: a cell for each index, and one for no compensation. CommandError if the daemon refuses or fails."""
    config = study_config(model_name, condition, directory)
    case = next(case for case in demo_cases(1) if case.name == grasp)
    table = study_table(config, case)
    joints = approach_joints(config, table, case)
    scene = study_scene(case, joints, model_name, condition, directory)
    assert scene.hand is not None
    watch = StudyWatch(scene.hand, config.T_wrist_hand)
    robot = VirtualRobot(config, scene, recorder=watch, observe=watch.observe)
    robot.grasping.make_index = ShadowedIndex
    watch.grasping = robot.grasping
    robot.activate()
    ends_ns: list[int] = []
    held_s = condition.hold_s(model_name, grasp)

    def hold() -> None:
        ends_ns.append(robot.time.now_ns)
        watch.holding = True
        robot.run_for(held_s)

    def release() -> None:
        watch.holding = False
        ends_ns.append(robot.time.now_ns)

    with robot.client() as client:
        command_grasp(
            client,
            case,
            joints,
            index=carrier,
            compensated=True,
            before_close=lambda: setattr(watch, "watching", True),
            after_squeeze=hold,
            after_hold=release,
        )
    what = (model_name, condition.name, grasp, carrier, held_s)
    return cells(watch.moments, (ends_ns[0], ends_ns[1]), what)
