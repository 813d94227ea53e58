"""The demo's grasps, and one run of one grasp on virtual time, commanded by a client as a task planner would."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, cast

import numpy as np
import pinocchio
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.build import build_or_load
from calibration.grasp.specification import GraspSpec
from calibration.motion_table import MotionTable
from calibration.objects import load_object
from controller.client import Client
from controller.config import RobotConfig
from controller.cycle.arm_model import ArmModel
from controller.service.assembly import arm_model, configured_hand
from controller.service.requests import grasp_wrist_pose
from controller.simulation.scene import READY_RAD, Scene
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

IndexName = Literal["load", "excursion", "fused"]

OBJECT = "cylinder40"
LOAD_N = 66.0
SQUEEZE_S = 1.2
AFTER_SQUEEZE_S = 0.5
APPROACH_M = 0.08
_LIMIT_MARGIN_RAD = 0.1
_LEAST_MANIPULABILITY_M = 0.1


@dataclass(frozen=True)
class GraspCase:
    """One grasp of the demo: onset split and where the object stands (its section's centre, world) and is turned."""

    name: str
    onset_split: float
    object_xyz_m: tuple[float, float, float]
    object_yaw_rad: float

    @property
    def scene(self) -> Scene:
        """The scene of this grasp."""
        return Scene(OBJECT, self.object_xyz_m, self.object_yaw_rad)


def demo_cases(seed: int, attempt: int = 0) -> list[GraspCase]:
    """A symmetric grasp, one with a 10 % onset split, and one drawn from `seed`; each `attempt` draws another place."""
    place = Scene()
    yaw_rad = -0.5 * math.pi  # the hand comes in along the world's x
    draw = np.random.default_rng((seed, attempt))
    split = float(draw.uniform(0.05, 0.15) * draw.choice((-1.0, 1.0)))
    x, y, z = draw.uniform((0.74, -0.12, 0.50), (0.84, 0.12, 0.62)).tolist()
    turned_rad = yaw_rad + float(draw.uniform(-0.35, 0.35))
    return [
        GraspCase("symmetric", 0.0, place.object_xyz_m, yaw_rad),
        GraspCase("split 10 %", 0.1, place.object_xyz_m, yaw_rad),
        GraspCase(
            f"random, seed {seed}", round(split, 4), (round(x, 4), round(y, 4), round(z, 4)), round(turned_rad, 4)
        ),
    ]


def table_name(case: GraspCase) -> str:
    """Name of the case's motion table on the shelf."""
    return f"t42pp-fitted-{OBJECT}-split{case.onset_split:+.4f}"


def case_table(config: RobotConfig, case: GraspCase, directory: Path) -> tuple[MotionTable, bool]:
    """The case's motion table, built or, if its inputs are unchanged, reused (True)."""
    hand = configured_hand(config)
    directory.mkdir(parents=True, exist_ok=True)
    grasp = GraspSpec(onset_split=case.onset_split, compensated=True)
    return build_or_load(directory / f"{table_name(case)}.npz", hand, load_object(OBJECT), grasp)


def approach_joints(config: RobotConfig, table: MotionTable, case: GraspCase) -> list[float]:
    """Joint angles (7, rad) at which the hand stands `APPROACH_M` before the grasp, well inside the arm's limits.

    Raises InputError if there are none.
    """
    model = arm_model(config, configured_hand(config))
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = pinocchio.exp3(np.array([0.0, 0.0, case.object_yaw_rad]))
    T_world_object[:3, 3] = case.object_xyz_m
    T_world_wrist = grasp_wrist_pose(table, T_world_object, config.T_wrist_hand)
    T_world_wrist[:3, 3] -= APPROACH_M * (T_world_wrist @ config.T_wrist_hand)[:3, 1]
    return reach(model, T_world_wrist, READY_RAD)


def reach(model: ArmModel, T_world_wrist: NDArray[np.float64], near_rad: tuple[float, ...]) -> list[float]:
    """Joint angles (7, rad) that bring the wrist to a pose (4×4, world), near others. InputError if there are none."""
    parameters = load_wam_parameters()
    lower, upper = parameters.joint_lower_rad + _LIMIT_MARGIN_RAD, parameters.joint_upper_rad - _LIMIT_MARGIN_RAD
    near = np.array(near_rad)

    def distance(q: NDArray[np.float64]) -> NDArray[np.float64]:
        pose = model.wrist_pose(q)
        turn = pinocchio.log3(pose[:3, :3] @ T_world_wrist[:3, :3].T)
        return np.concatenate((5.0 * (pose[:3, 3] - T_world_wrist[:3, 3]), turn, 1e-3 * (q - near)))

    q = least_squares(distance, near, bounds=(lower, upper), xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    for _ in range(10):  # the leaning towards `near` leaves a trace, which Newton steps take away
        pose = model.wrist_pose(q)
        turn = pinocchio.log3(T_world_wrist[:3, :3] @ pose[:3, :3].T)
        q = q + np.linalg.pinv(model.jacobian(q)) @ np.concatenate((T_world_wrist[:3, 3] - pose[:3, 3], turn))
    error_m = float(np.linalg.norm(model.wrist_pose(q)[:3, 3] - T_world_wrist[:3, 3]))
    least = float(np.linalg.svd(model.jacobian(q), compute_uv=False)[-1])
    if error_m > 1e-6 or least < _LEAST_MANIPULABILITY_M or not ((lower <= q) & (q <= upper)).all():
        raise InputError(
            f"the wrist cannot well reach {T_world_wrist[:3, 3].round(3).tolist()} m; choose a nearer place."
        )
    return [float(angle) for angle in q]


class Watch(Protocol):
    """What looks on while a grasp runs; `watching` is set from the beginning of closing to the end of the hold."""

    watching: bool

    def observe(self, world: World) -> None: ...

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None: ...

    def event(self, event: dict[str, Any], time_ns: int) -> None: ...


def run_case(config: RobotConfig, case: GraspCase, watch: Watch, *, index: str, compensated: bool) -> dict[str, Any]:
    """One grasp on virtual time, from `hello` to `grasp.release`; returns what the daemon says of the squeeze.

    Raises CommandError if the daemon refuses or fails.
    """
    table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
    joints = approach_joints(config, table, case)
    robot = VirtualRobot(config, case.scene, recorder=watch, observe=watch.observe)
    robot.activate()
    with robot.client() as client:
        return command_grasp(
            client,
            case,
            joints,
            index=index,
            compensated=compensated,
            before_close=lambda: setattr(watch, "watching", True),
            after_squeeze=lambda: robot.run_for(AFTER_SQUEEZE_S),
            after_hold=lambda: setattr(watch, "watching", False),
        )


def preposition(client: Client, case: GraspCase, *, table: str | None = None, approach_m: float = APPROACH_M) -> None:
    """Bring the hand before the case's object, open; `table`: another one's name. CommandError."""
    client.grasp_preposition(
        table or table_name(case),
        object_xyz_m=case.object_xyz_m,
        object_yaw_rad=case.object_yaw_rad,
        approach_m=approach_m,
        speed=1.0,
    ).wait()


def command_grasp(
    client: Client,
    case: GraspCase,
    joints_rad: list[float],
    *,
    index: str,
    compensated: bool,
    before_close: Callable[[], None] = lambda: None,
    after_squeeze: Callable[[], None] = lambda: None,
    after_hold: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """What a task planner says for one grasp, whatever carries it; returns what the daemon says of the squeeze."""
    client.hello("demo")
    client.compensation_set(compensated, index=cast(IndexName, index))
    client.arm_move_joints(joints_rad, speed=1.0).wait()
    preposition(client, case)
    before_close()
    client.grasp_close().wait()
    squeezed = client.grasp_squeeze(load_N=LOAD_N, duration_s=SQUEEZE_S).wait()
    after_squeeze()
    client.grasp_hold()
    after_hold()
    client.grasp_release().wait()
    return squeezed
