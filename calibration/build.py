"""Hand × object × grasp → motion table.

Solves the grasp's equilibria on mean and difference of the tendon excursions, and again on mean load and difference;
takes all slopes from the equations themselves (implicit functions, no finite differences); and records what the table
was made of. Source: design 4, hand-mechanics reference 6 and 11.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import TOLERANCE, Drive, Flags, GraspSystem, grasp_system
from calibration.grasp.path_grid import PathGrid, events, excursion_drive, known, load_drive, solve_path_grid
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import Hand
from calibration.motion_table import FORMAT_VERSION, GRIDS, POSE, ContactData, MotionTable, TableHeader, described
from calibration.objects import GraspObject
from calibration.table_file import Arrays
from drivers.errors import MechanicsError, TableError

MODEL_VERSION = 2
"""Raise it when the equations change, so that stored tables are built again."""
NODES = 41
DIFFERENCE_RANGE_M = 2e-3
"""The table covers differences of ± this; two fingers wound at equal rate stay well inside."""
LEAST_LOAD_SLOPE = 0.2
"""The load tells the pose only while it rises by at least this share of its initial rise per metre of winding."""
FROZEN_TRAVEL_M = 2e-5
"""Stops that are met within this much winding of one another are met together (about 0.1 mm of object motion)."""

Progress = Callable[[float], None]


def build_table(
    hand: Hand,
    object: GraspObject,
    grasp: GraspSpec | None = None,
    *,
    nodes: int = NODES,
    progress: Progress | None = None,
) -> MotionTable:
    """Build a table of about `nodes` × `nodes`; `progress` hears the share done. Errors: MechanicsError."""
    grasp = grasp or GraspSpec()
    if not 9 <= nodes <= 401:
        raise MechanicsError("nodes", f"{nodes} nodes per axis are not between 9 and 401.")
    if grasp.supported and object.support is None:
        raise MechanicsError(
            "grasp.supported",
            f"{object.name} has no [support], but the grasp says it stands on one.",
            help="Change either.",
        )
    report = progress or (lambda _: None)
    system = grasp_system(hand, object, grasp)
    columns = nodes + 1 - nodes % 2  # the equal difference is a column of its own
    path = solve_path_grid(
        system,
        nodes=nodes,
        columns=columns,
        difference_range_m=DIFFERENCE_RANGE_M,
        progress=lambda done: report(0.6 * done),
    )
    channels = _channel_rows(system)
    arrays, residual = _excursion_arrays(system, path, channels)
    report(0.8)
    load, load_residual = _load_arrays(system, path, channels, nodes)
    arrays |= load | _frozen_arrays(system, path, channels)
    report(1.0)
    start = system.start
    header = TableHeader(
        format_version=FORMAT_VERSION,
        package_version=importlib.metadata.version("stillgrasp"),
        inputs_sha256=inputs_sha256(hand, object, grasp, nodes=nodes),
        hand=described(hand),
        object=described(object),
        grasp=described(grasp),
        settings={**_settings(nodes), "load_cap_N": system.load_cap_N, "frozen_travel_m": FROZEN_TRAVEL_M},
        solver={
            "tolerance": TOLERANCE,
            "largest_residual": max(residual, load_residual),
            "solved_share": float(path.solved.mean()),
            "largest_required_friction": float(np.nanmax(arrays["excursion.required_friction"])),
        },
        axes={name: list(axes) for name, axes in GRIDS.items()},
        tendons=["right", "left"],
        channels=[
            *POSE,
            *(f"{side}_{what}_N" for what in ("tension", "normal", "tangential") for side in ("right", "left")),
        ],
        contact=ContactData(
            excursion_m=start.tendon_excursion_m.tolist(),
            tension_N=start.tendon_load_N.tolist(),
            pose=[*start.object_pose[:2].tolist(), 0.0, 0.0, 0.0, float(start.object_pose[2])],
            free_closing_stiffness_N_per_m=start.free_closing_stiffness_N_per_m.tolist(),
        ),
        column_end=list(path.end_event),
    )
    return MotionTable(header, arrays)


def build_or_load(
    path: str | Path,
    hand: Hand,
    object: GraspObject,
    grasp: GraspSpec | None = None,
    *,
    nodes: int = NODES,
    progress: Progress | None = None,
) -> tuple[MotionTable, bool]:
    """The table at `path` if its inputs are these (True), else a new one, written there (False)."""
    wanted = inputs_sha256(hand, object, grasp or GraspSpec(), nodes=nodes)
    if Path(path).exists():
        try:
            table = MotionTable.load(path)
        except TableError:
            pass  # damaged or of an older format: replaced below
        else:
            if table.inputs_sha256 == wanted:
                return table, True
    table = build_table(hand, object, grasp, nodes=nodes, progress=progress)
    table.save(path)
    return table, False


def inputs_sha256(hand: Hand, object: GraspObject, grasp: GraspSpec, *, nodes: int = NODES) -> str:
    """SHA-256 over all that a table depends on."""
    return _digest(described(hand), described(object), described(grasp), nodes)


def is_current(table: MotionTable) -> bool:
    """Whether this version, with the parameters in the table's header, would build the same table."""
    header = table.header
    return header.inputs_sha256 == _digest(header.hand, header.object, header.grasp, int(header.settings["nodes"]))


def _digest(hand: Mapping[str, Any], object: Mapping[str, Any], grasp: Mapping[str, Any], nodes: int) -> str:
    inputs: Mapping[str, Any] = {
        "format": FORMAT_VERSION,
        "model": MODEL_VERSION,
        "package": importlib.metadata.version("stillgrasp"),
        "hand": hand,
        "object": object,
        "grasp": grasp,
        "settings": _settings(nodes),
    }
    return hashlib.sha256(json.dumps(inputs, sort_keys=True, allow_nan=False).encode()).hexdigest()


def _settings(nodes: int) -> dict[str, float]:
    return {"nodes": nodes, "difference_range_m": DIFFERENCE_RANGE_M, "least_load_slope": LEAST_LOAD_SLOPE}


def _channel_rows(system: GraspSystem) -> Reals:
    """(channels, size): rows that make the table's channels of a state (before the contact pose is taken off)."""
    n = system.unknowns
    pose = np.zeros((6, system.size))
    for channel, unknown in ((0, n - 3), (1, n - 2), (5, n - 1)):
        pose[channel, unknown] = 1.0
    contacts = system.contact_rows()
    return np.concatenate([pose, system.load_rows(), contacts[[0, 2]], contacts[[1, 3]]])


def _node_arrays(name: str, system: GraspSystem, drive: Drive, w: Reals, channels: Reals) -> Arrays:
    """Values and slopes at the nodes of `w` (n0, n1, size)."""
    solved = known(w)
    first = system.first_state()
    contact = channels @ first
    contact[6:] = 0.0  # loads and forces are stored as they are, only the pose is relative
    tangent = system.tangent(w[solved], drive)
    fields = {
        "value": w[solved] @ channels.T - contact,
        "along_0": tangent[:, :, 0] @ channels.T,
        "along_1": tangent[:, :, 1] @ channels.T,
        "mixed": system.mixed_derivative(w[solved], drive, tangent) @ channels.T,
    }
    arrays: Arrays = {}
    for key, values in fields.items():
        full = np.full((*solved.shape, channels.shape[0]), np.nan)
        full[solved] = values
        arrays[f"{name}.{key}"] = full
    return arrays


def _residual(system: GraspSystem, drive: Drive, w: Reals) -> float:
    return float(system.residual(w[known(w)], drive).max())


def _excursion_arrays(system: GraspSystem, path: PathGrid, channels: Reals) -> tuple[Arrays, float]:
    drive = excursion_drive(system)
    arrays = _node_arrays("excursion", system, drive, path.w, channels)
    value = arrays["excursion.value"]
    with np.errstate(invalid="ignore", divide="ignore"):
        friction = np.abs(value[:, :, 10:12] / value[:, :, 8:10]).max(2)
    pressed = (value[:, :, 8:10] > 1e-9).all(2)
    inside = path.solved & (path.mean_m[:, None] >= path.start_m) & (path.mean_m[:, None] <= path.end_m)
    stability = np.full(path.solved.shape, np.nan)
    stability[path.solved] = system.stability(path.w[path.solved])
    stop = np.full(path.solved.shape, -1, np.int8)
    for index, event in enumerate(event for event in events(system) if event.stop):
        stop[event.inside(np.nan_to_num(path.w, nan=0.5 * (event.limit + 0))) < 0] = index // 2
    stop[~path.solved] = -1
    arrays |= {
        "excursion.axis_0": path.mean_m,
        "excursion.axis_1": path.difference_m,
        "excursion.start": path.start_m,
        "excursion.end": _readable_end(path.solved, path.mean_m, path.start_m, path.end_m),
        "excursion.validity": (path.solved.astype(np.int8) + inside.astype(np.int8)),
        "excursion.joint_rad": path.w[:, :, : system.joints],
        "excursion.required_friction": np.where(inside, np.where(pressed, friction, 0.0), np.nan),
        "excursion.stability": stability,
        "excursion.active_stop": stop,
    }
    return arrays, _residual(system, drive, path.w)


def _load_arrays(system: GraspSystem, path: PathGrid, channels: Reals, nodes: int) -> tuple[Arrays, float]:
    """The same equilibria with the mean load prescribed instead of the mean excursion."""
    by_excursion, by_load = excursion_drive(system), load_drive(system)
    load_row = by_load.rows[0]
    slope = np.full(path.solved.shape, np.nan)
    slope[path.solved] = system.tangent(path.w[path.solved], by_excursion)[:, :, 0] @ load_row
    load = path.w @ load_row
    columns = path.difference_m.size
    least = LEAST_LOAD_SLOPE * slope[0, columns // 2]
    start, end = np.zeros(columns), np.zeros(columns)
    rising: list[Reals] = []
    for column in range(columns):
        flat = np.flatnonzero(~(slope[:, column] > least))
        last = int(flat[0]) if flat.size else path.mean_m.size  # nodes before `last` rise steeply enough
        means, loads = path.mean_m[: last + 1], load[: last + 1, column]
        if last == 0 or not np.isfinite(loads).all():
            means, loads = means[:last], loads[:last]
        if means.size:
            steep = means[-1]
            if means.size > last:
                steep = np.interp(-least, -slope[last - 1 : last + 1, column], means[-2:])
            start[column] = np.interp(path.start_m[column], means, loads)
            end[column] = np.interp(min(path.end_m[column], steep), means, loads)
        rising.append(path.w[:last, column])
    filled = np.array([states.shape[0] > 1 for states in rising])
    start[~filled] = end[~filled] = start[filled].min()  # columns without a path have an empty domain
    axis = np.linspace(float(start.min()), float(end.max()), nodes)
    axis = np.append(axis, axis[-1] + axis[1] - axis[0])
    guess = np.full((axis.size, columns, system.size), np.nan)
    for column, states in enumerate(rising):
        if not filled[column]:
            continue
        loads = states @ load_row
        near = (axis > loads[0] - 2 * (axis[1] - axis[0])) & (axis < end[column] + 2 * (axis[1] - axis[0]))
        for unknown in range(system.size):
            guess[near, column, unknown] = np.interp(axis[near], loads, states[:, unknown])
    w = _solved_by_load(system, path, by_load, axis, guess)
    solved = known(w)
    end = _readable_end(solved, axis, start, end)
    arrays = _node_arrays("load", system, by_load, w, channels)
    arrays |= {"load.axis_0": axis, "load.axis_1": path.difference_m, "load.start": start, "load.end": end}
    return arrays, _residual(system, by_load, w)


def _solved_by_load(system: GraspSystem, path: PathGrid, drive: Drive, axis: Reals, guess: Reals) -> Reals:
    """Newton from the guesses; solutions beyond the top of the load curve are dropped."""
    w = np.full_like(guess, np.nan)
    guessed = known(guess)
    wanted = np.stack(np.meshgrid(axis, path.difference_m, indexing="ij"), axis=-1)[guessed]
    wanted[:, 1] += drive.rows[1] @ system.first_state()
    before = drive.rows @ guess[guessed].T
    found = advance(system, guess[guessed], drive, before.T, wanted)
    good = known(found)
    rise = np.full(found.shape[0], np.nan)
    rise[good] = system.tangent(found[good], drive)[:, :, 0] @ excursion_drive(system).rows[0]
    found[~(rise > 0)] = np.nan
    w[guessed] = found
    return w


def _readable_end(solved: Flags, axis: Reals, start: Reals, end: Reals) -> Reals:
    """The domain's end, drawn back so that all cells from its start up have their four corners."""
    cells = solved[:-1, :-1] & solved[1:, :-1] & solved[:-1, 1:] & solved[1:, 1:]
    lowest = np.clip((np.minimum(start[:-1], start[1:]) - axis[0]) / (axis[1] - axis[0]), 0, axis.size - 2).astype(int)
    heights = [
        axis[first + int(np.argmin(np.append(column[first:], False)))]
        for first, column in zip(lowest, cells.T, strict=True)
    ]
    bounds: Reals = np.minimum([*heights, np.inf], [np.inf, *heights])
    bounds -= 1e-9 * (axis[1] - axis[0])  # the edge belongs to the cell below it
    return np.asarray(np.maximum(np.minimum(end, bounds), start))


def _frozen_arrays(system: GraspSystem, path: PathGrid, channels: Reals) -> Arrays:
    """Per column: how much winding lies between the first stop and the last closing joint's; load there; slopes per
    load above."""
    columns = path.difference_m.size
    travel, load_N, slope = np.full(columns, 1.0), np.zeros(columns), np.zeros((columns, channels.shape[0]))
    distal = [system.joint_columns[1], system.joint_columns[3]]  # the joints that close: their stops freeze the hand
    by_load, by_excursion = load_drive(system), excursion_drive(system)
    for column, event in enumerate(path.end_event):
        state = path.end_w[column]
        if not event.endswith("distal stop") or not np.isfinite(state).all():
            continue
        closing = system.tangent(state[None], by_excursion)[0, distal, 0]
        left = (system.upper_rad[distal] - state[distal]).max()
        if (closing <= 0).any():
            continue
        travel[column] = max(0.0, left) / closing.min()
        at_stop = np.zeros((1, system.joints))
        at_stop[0, distal] = 1.0
        inside = path.w[path.mean_m < path.end_m[column], column] @ by_load.rows[0]
        load_N[column] = max(float(by_load.rows[0] @ state), float(inside.max()))
        slope[column] = channels @ system.tangent(state[None], by_load, at_stop)[0, :, 0]
    slope[~np.isfinite(slope)] = 0.0
    slope[:, :6] = 0.0  # exactly: only loads and forces still move
    return {"frozen.travel_m": travel, "frozen.load_N": load_N, "frozen.slope_per_N": slope}
