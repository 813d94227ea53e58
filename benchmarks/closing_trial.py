"""One closing on an object that is not quite the motion table's, on virtual time: what was found, and what was so.

The whole daemon closes the hand of the simulated robot. The truth is the finger-side excursion at which the world's
first force appears at each fingertip, as that motor would tell it: with the error of its spool's zero. Order right,
left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from calibration.build import build_or_load
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import DIRECTORY as HANDS
from calibration.motion_table import MotionTable
from calibration.objects import load_object
from controller.config import RobotConfig, Tactile, load_config
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import OBJECT, approach_joints, demo_cases, preposition, table_name
from controller.simulation.truth import WorldObserver
from controller.simulation.virtual_robot import VirtualRobot
from controller.simulation.world import World
from drivers.dynamixel.control_tables import model_by_name
from drivers.errors import CommandError
from drivers.simulated.dynamixel import taut_ticks

WIDTH_M, MASS_KG = 0.040, 0.1
HEIGHT_M, FRICTION = 0.12, 0.3
SLENDER = 2.5
"""Height over width at most: higher, an object that one finger pushes at half its height tips over."""
APPROACH_M = 0.02
AWAY_M = 0.5
NODES = 11
NOISE_COUNTS = 2.0
_CELLS = tuple((row, column) for row, columns in ((0, 5), (1, 3)) for column in range(columns))
TACTILE = Tactile(
    interface="socket",
    channel="memory",
    right_cells=_CELLS,
    left_cells=tuple((row + 2, column) for row, column in _CELLS),
)


@dataclass(frozen=True)
class Trial:
    """What is so in the world, where it is not as the table has it.

    `wider_m`: the object's diameter; `aside_m`: it stands off along the hand's x axis; `zero_error_m`: of both spools'
    zeros. `split`: the grasp with a 10 % onset split. `tendon_stiffness_N_per_m`: of hand and table alike. `present`:
    whether there is an object. `pads`: on both fingertips.
    """

    model: str = "XM430-W350"
    closing_rate_m_s: float = 0.010
    wider_m: float = 0.0
    aside_m: float = 0.0
    zero_error_m: tuple[float, float] = (0.0, 0.0)
    mass_kg: float = MASS_KG
    split: bool = False
    tendon_stiffness_N_per_m: float | None = None
    present: bool = True
    pads: bool = False
    seed: int = 1


@dataclass(frozen=True)
class Closing:
    """How a closing ended: `outcome` is "contact" or the error's code. Excursions in m, (2,)."""

    outcome: str
    off_centre: bool
    object_offset_m: float
    found_m: NDArray[np.float64]
    expected_m: NDArray[np.float64]
    true_m: NDArray[np.float64]
    """NaN for a finger that touched nothing before the end."""
    pushed_m: float
    """How far the object was moved in the room, at most, until the hand had opened again or held."""

    @property
    def error_m(self) -> NDArray[np.float64]:
        """Found less true, (2,)."""
        return self.found_m - self.true_m


def run(trial: Trial, directory: Path) -> Closing:
    """Close once. `directory`: of the tables, objects and hands that are made on the way."""
    config = _config(trial, directory)
    case = demo_cases(0)[1 if trial.split else 0]
    path = Path(config.tables.directory) / f"{table_name(case)}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    table, _ = build_or_load(
        path,
        configured_hand(config),
        load_object(OBJECT),
        GraspSpec(onset_split=case.onset_split, compensated=True),
        nodes=NODES,
    )
    x_axis = np.array([np.cos(case.object_yaw_rad), np.sin(case.object_yaw_rad), 0.0])
    place = np.array(case.object_xyz_m) + (trial.aside_m + (0.0 if trial.present else AWAY_M)) * x_axis
    scene = replace(
        case.scene,
        object=_object(trial, directory),
        object_xyz_m=tuple(place.tolist()),
        joint_rad=tuple(approach_joints(config, table, case)),
        motor_noise_counts=NOISE_COUNTS,
        spool_zero_error_m=trial.zero_error_m,
        seed=trial.seed,
    )
    watch = _Watch()
    robot = VirtualRobot(config, scene, observe=watch.observe)
    watch.observer = WorldObserver(robot.world, configured_hand(config))
    robot.activate()
    with robot.client() as client:
        preposition(client, case)
        watch.begin()
        told: dict[str, Any] = {}
        outcome = "contact"
        try:
            told = client.grasp_close(rate_m_s=trial.closing_rate_m_s).wait()
        except CommandError as error:
            outcome = error.code
            robot.run_for(0.5)
        state = client.status()["state"]["grasp"]["phase"]
    assert state == ("contact" if outcome == "contact" else "prepositioned"), state
    return _closing(trial, table, config, watch, outcome, told)


def _closing(
    trial: Trial, table: MotionTable, config: RobotConfig, watch: _Watch, outcome: str, told: dict[str, Any]
) -> Closing:
    tick_m = model_by_name(trial.model).tick_rad * config.tendons.right.spool_radius_m
    zero_m = tick_m * np.round(np.array(trial.zero_error_m) / tick_m)
    return Closing(
        outcome,
        told.get("reason", {}).get("code") == "off_centre",
        told.get("object_offset_m", 0.0),
        np.array(told.get("contact_excursion_m", (np.nan, np.nan))),
        table.contact_excursion_m,
        np.array([watch.touched_m.get(finger, np.nan) for finger in (0, 1)]) + zero_m,
        watch.pushed_m,
    )


class _Watch:
    """Notes the truth: excursions of first touch, and how far the object was pushed."""

    def __init__(self) -> None:
        self.observer: WorldObserver | None = None
        self.touched_m: dict[int, float] = {}
        self.pushed_m = 0.0
        self._start_m: NDArray[np.float64] | None = None

    def begin(self) -> None:
        assert self.observer is not None
        self._start_m = self.observer.truth().T_world_object[:2, 3].copy()

    def observe(self, world: World) -> None:
        if self._start_m is None or self.observer is None:
            return
        forces_N = world.fingertip_force_N()
        if max(forces_N) == 0.0:
            return
        truth = self.observer.truth()
        for finger, force_N in enumerate(forces_N):
            if force_N > 0.0:
                self.touched_m.setdefault(finger, float(truth.tendon_excursion_m[finger]))
        moved_m = float(np.linalg.norm(truth.T_world_object[:2, 3] - self._start_m))
        self.pushed_m = max(self.pushed_m, moved_m)


def _config(trial: Trial, directory: Path) -> RobotConfig:
    zero = {"zero_ticks": taut_ticks(model_by_name(trial.model))}
    overrides: dict[str, Any] = {
        "tables": {"directory": str(directory / f"tables-{trial.tendon_stiffness_N_per_m}")},  # of one hand
        "tendons": {"model": trial.model, "right": zero, "left": zero},
    }
    config = load_config(overrides=overrides)
    if trial.tendon_stiffness_N_per_m is not None:
        file = _hand(trial.tendon_stiffness_N_per_m, directory)
        config = msgspec.structs.replace(config, hand=msgspec.structs.replace(config.hand, file=str(file)))
    return msgspec.structs.replace(config, tactile=TACTILE) if trial.pads else config


def _hand(stiffness_N_per_m: float, directory: Path) -> Path:
    """The packaged hand with tendons that stretch."""
    text = (HANDS / "t42pp.toml").read_text(encoding="utf-8")
    path = directory / f"t42pp-{stiffness_N_per_m:g}.toml"
    path.write_text(
        text.replace("tendon_stiffness_N_per_m = inf", f"tendon_stiffness_N_per_m = {stiffness_N_per_m}"),
        encoding="utf-8",
    )
    return path


def _object(trial: Trial, directory: Path) -> str:
    """The table's object, or a file of one that differs in width or mass."""
    if trial.wider_m == 0.0 and trial.mass_kg == MASS_KG:
        return OBJECT
    width_m = WIDTH_M + trial.wider_m
    height_m = min(HEIGHT_M, SLENDER * width_m)
    path = directory / f"cylinder{1e3 * width_m:g}-{trial.mass_kg:g}.toml"
    path.write_text(
        f'name = "cylinder"\nmass_kg = {trial.mass_kg}\nheight_m = {height_m}\n'
        f'shape = {{ kind = "disc", diameter_m = {width_m} }}\n[support]\nfriction = {FRICTION}\n',
        encoding="utf-8",
    )
    return str(path)
