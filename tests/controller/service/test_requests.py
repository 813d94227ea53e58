"""From requests to cycle commands: poses by matrices, loads by the table, and what is refused here already."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import DIRECTORY as HANDS
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from controller.config import RobotConfig, load_config
from controller.messages import CommandKind, CompensationIndex
from controller.pose import Pose
from controller.service.assembly import index_name
from controller.service.commands import COMMANDS, make_command
from controller.service.requests import Plan, Planner, Step, grasp_wrist_pose
from controller.service.table_shelf import TableShelf
from drivers.dynamixel.control_tables import MODELS, RX_28
from drivers.errors import CommandError
from drivers.wam.parameters import load_wam_parameters

HAND = load_hand("t42pp", preset="fitted")
TABLE = build_table(HAND, load_object("cylinder40"), GraspSpec(onset_split=0.1), nodes=9)
NARROW = {"lower_rad": [-1.0] * 7, "upper_rad": [1.0] * 7}


def planner_for(directory: Path, **arm_limits: Any) -> Planner:
    config = load_config(overrides={"arm": {"limits": arm_limits}} if arm_limits else None)
    return Planner(config, TableShelf(directory, HAND))


@pytest.fixture(scope="module")
def shelf_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("shelf")
    for name in ("mug", "jug"):
        TABLE.save(directory / f"{name}.npz")
    return directory


@pytest.fixture
def planner(shelf_directory: Path) -> Planner:
    return planner_for(shelf_directory)


def plan(planner: Planner, command: str, **args: Any) -> Plan:
    return planner.plan(make_command(command, args))


def matrix(step: Step) -> NDArray[np.float64]:
    x, y, z, qw, qx, qy, qz = step.values[:7]
    return Pose((x, y, z), (qw, qx, qy, qz)).matrix()


def test_every_command_of_the_cycle_has_a_plan(planner: Planner) -> None:
    """No command of the language falls through between front and cycle."""
    fast = {
        "stop": CommandKind.STOP,
        "fault.clear": CommandKind.FAULT_CLEAR,
        "shutdown": CommandKind.SHUTDOWN,
        "arm.hold": CommandKind.ARM_HOLD,
        "hand.open": CommandKind.OPEN,
        "grasp.hold": CommandKind.HOLD,
        "grasp.release": CommandKind.RELEASE,
        "grasp.close": CommandKind.CLOSE,
    }
    for name, kind in fast.items():
        assert list(plan(planner, name).steps) == [Step(kind)]
    answered_by_front = {"hello", "status", "table.list"}
    with_arguments = {"arm.move_joints", "arm.move_wrist", "grasp.preposition", "grasp.squeeze", "table.load"}
    assert set(COMMANDS) == {*fast, *answered_by_front, *with_arguments, "compensation.set"}


def test_a_closing_rate_is_passed_on(planner: Planner) -> None:
    """And only if it was given: the cycle has its own."""
    assert plan(planner, "grasp.close", rate_m_s=0.004).steps[0].values == (0.004,)


places = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 1.5))
turns = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))


@given(places, turns)
def test_at_the_wrist_pose_the_fingers_meet_the_object(place: tuple[float, ...], turn: tuple[float, ...]) -> None:
    """T_world_wrist·T_WH·T_HO(0) is where the object stands (paper II-A)."""
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = pinocchio.exp3(np.array(turn))
    T_world_object[:3, 3] = place
    T_wrist_hand = load_config().T_wrist_hand
    T_hand_object = np.eye(4)
    T_hand_object[:3, :3] = pinocchio.exp3(TABLE.contact_pose[3:])
    T_hand_object[:3, 3] = TABLE.contact_pose[:3]
    T_world_wrist = grasp_wrist_pose(TABLE, T_world_object, T_wrist_hand)
    np.testing.assert_allclose(T_world_wrist @ T_wrist_hand @ T_hand_object, T_world_object, atol=1e-12)


def test_a_preposition_comes_in_along_the_palm(planner: Planner, shelf_directory: Path) -> None:
    """Table first, then before the object, then straight in along the palm's normal, at the speed asked for."""
    steps = list(
        plan(
            planner,
            "grasp.preposition",
            table="mug",
            object_xyz_m=(0.7, 0.1, 0.5),
            object_yaw_rad=-1.2,
            approach_m=0.06,
            speed=0.3,
        ).steps
    )
    assert steps[0].kind is CommandKind.LOAD_TABLE
    assert steps[0].table is not None
    before, there = (matrix(step) for step in steps[1:])
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = pinocchio.exp3(np.array([0.0, 0.0, -1.2]))
    T_world_object[:3, 3] = 0.7, 0.1, 0.5
    T_wrist_hand = load_config().T_wrist_hand
    np.testing.assert_allclose(there, grasp_wrist_pose(TABLE, T_world_object, T_wrist_hand), atol=1e-9)
    np.testing.assert_allclose(before[:3, :3], there[:3, :3], atol=1e-12)
    palm_normal = (there @ T_wrist_hand)[:3, 1]
    np.testing.assert_allclose(there[:3, 3] - before[:3, 3], 0.06 * palm_normal, atol=1e-12)
    assert [step.values[7] for step in steps[1:]] == [0.3, 0.3]
    assert steps[-1].kind is CommandKind.PREPOSITION


def test_every_motion_of_a_preposition_is_one_to_the_cycle(planner: Planner) -> None:
    """With an object in the hand the cycle must refuse a preposition before anything moves: it must know it as one."""
    steps = plan(planner, "grasp.preposition", table="mug", object_xyz_m=(0.7, 0.1, 0.5)).steps
    assert {step.kind for step in steps} == {CommandKind.LOAD_TABLE, CommandKind.PREPOSITION}


@pytest.mark.parametrize(("name", "kinds"), [("mug", 2), ("jug", 3)])
def test_a_table_is_handed_over_once(planner: Planner, name: str, kinds: int) -> None:
    """A table that the cycle has is not sent again; another one is."""
    planner.table, planner.table_name = TABLE, "mug"
    steps = plan(planner, "grasp.preposition", table=name, object_xyz_m=(0.7, 0.1, 0.5)).steps
    assert len(steps) == kinds


def test_a_squeeze_is_an_excursion_of_the_table(planner: Planner) -> None:
    """Load to excursion by the table; without a duration the configured rate sets it; both are told as desired."""
    planner.table = TABLE
    made = plan(planner, "grasp.squeeze", load_N=45.0)
    excursion_m, load_N, duration_s = made.steps[0].values
    assert float(TABLE.at_excursion(excursion_m, 0.0).tension.mean()) == pytest.approx(45.0, abs=1e-6)
    assert duration_s == pytest.approx(excursion_m / load_config().squeeze.squeeze_rate_m_s)
    assert made.desired == {"load_N": load_N, "mean_excursion_m": excursion_m, "duration_s": duration_s}
    assert plan(planner, "grasp.squeeze", load_N=45.0, duration_s=0.7).steps[0].values[2] == 0.7


@pytest.mark.parametrize(
    ("load_N", "table", "code"),
    [(45.0, False, "no_table"), (121.0, True, "load_above_cap"), (5.0, True, "outside_table")],
)
def test_an_impossible_squeeze_is_refused_with_the_range(
    planner: Planner, load_N: float, table: bool, code: str
) -> None:
    """Above the cap, outside the table, or without one: the answer says what is accepted."""
    planner.table = TABLE if table else None
    with pytest.raises(CommandError) as caught:
        plan(planner, "grasp.squeeze", load_N=load_N)
    assert caught.value.code == code
    assert caught.value.accepted or caught.value.help


@pytest.mark.parametrize(("joint", "angle"), [(0, 1.01), (6, -1.01), (3, 1.5)])
def test_a_joint_outside_the_configured_range_is_refused(shelf_directory: Path, joint: int, angle: float) -> None:
    """The answer names the joint and its range."""
    planner = planner_for(shelf_directory, **NARROW)
    joints = [0.0] * 7
    assert plan(planner, "arm.move_joints", joint_rad=joints, speed=0.2).steps[0].values == (*joints, 0.2)
    joints[joint] = angle
    with pytest.raises(CommandError, match=f"joint {joint + 1}") as caught:
        plan(planner, "arm.move_joints", joint_rad=joints)
    assert (caught.value.code, caught.value.key) == ("joint_limit", f"joint_rad[{joint}]")


def test_a_joint_outside_the_arms_own_range_is_refused(planner: Planner) -> None:
    """An installation that configures no range has the arm's: a path into a stop is refused."""
    upper_rad = load_wam_parameters().joint_upper_rad
    with pytest.raises(CommandError, match="joint 4"):
        plan(planner, "arm.move_joints", joint_rad=[0.0, 0.0, 0.0, float(upper_rad[3]) + 0.05, 0.0, 0.0, 0.0])


def test_a_wrist_pose_is_passed_on_normalised(planner: Planner) -> None:
    """The cycle gets a unit quaternion whatever rounding the client did."""
    rounded = (0.7071, 0.0, 0.7071, 0.0)
    pose = {"xyz_m": (0.5, 0.1, 0.6), "quaternion_wxyz": rounded}
    (step,) = plan(planner, "arm.move_wrist", T_world_wrist=pose, speed=0.4).steps
    assert step.kind is CommandKind.MOVE_WRIST
    assert step.values[:3] == (0.5, 0.1, 0.6)
    assert math.hypot(*step.values[3:7]) == pytest.approx(1.0, abs=1e-12)
    assert step.values[3:7] == pytest.approx(rounded, abs=1e-4)
    assert step.values[7] == 0.4


def test_compensation_names_become_numbers(planner: Planner) -> None:
    """Each index by its name; without a name the configured one."""
    configured = CompensationIndex[index_name(load_config()).upper()]
    assert plan(planner, "compensation.set", enabled=True).steps[0].values == (1.0, float(configured))
    for index in CompensationIndex:
        made = plan(planner, "compensation.set", enabled=False, index=index.name.lower())
        assert list(made.steps) == [Step(CommandKind.SET_COMPENSATION, (0.0, float(index)))]


def test_the_index_follows_the_tendons(tmp_path: Path) -> None:
    """Tendons that stretch are known badly, so the load has a say; of stiff ones it knows nothing better."""
    text = (HANDS / "t42pp.toml").read_text(encoding="utf-8")
    elastic = tmp_path / "t42pp.toml"
    elastic.write_text(text.replace("tendon_stiffness_N_per_m = inf", "tendon_stiffness_N_per_m = 4.5e4"), "utf-8")
    assert index_name(load_config()) == "excursion"
    hand = {"file": str(elastic)}
    assert index_name(load_config(overrides={"hand": hand})) == "fused"
    for model in MODELS.values():
        wanted = "excursion" if model is RX_28 else "fused"  # its ticks beat against the samples: docs/index.md
        assert index_name(load_config(overrides={"hand": hand, "tendons": {"model": model.name}})) == wanted
    assert index_name(load_config(overrides={"compensation": {"index": "load"}})) == "load"


def test_a_load_table_plan_carries_the_table(planner: Planner) -> None:
    """And one that does not exist makes no plan at all."""
    (step,) = plan(planner, "table.load", table="jug").steps
    assert step.kind is CommandKind.LOAD_TABLE
    assert step.table is not None
    with pytest.raises(CommandError, match="no motion table"):
        plan(planner, "table.load", table="bowl")


def test_the_default_installation_is_the_one_tested() -> None:
    """The hand of the tables here is the one that the default configuration names."""
    config: RobotConfig = load_config()
    assert (config.hand.name, config.hand.preset) == ("t42pp", "fitted")
