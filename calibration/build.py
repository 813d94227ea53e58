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

from calibration.build_accuracy import interpolation_error
from calibration.build_fields import CHANNELS, excursion_fields, load_fields
from calibration.build_frozen import FROZEN_TRAVEL_M, frozen_fields
from calibration.build_load_grid import LEAST_LOAD_SLOPE, solve_load_grid
from calibration.grasp.equilibrium import TOLERANCE, grasp_system
from calibration.grasp.friction import sliding
from calibration.grasp.path_grid import solve_path_grid
from calibration.grasp.path_grid_drag import SupportDrag
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Hand
from calibration.motion_table import FORMAT_VERSION, GRIDS, ContactData, MotionTable, TableHeader, described
from calibration.objects import GraspObject
from drivers.errors import MechanicsError, TableError

MODEL_VERSION = 4
"""Raise it when the equations change, so that stored tables are built again."""
NODES = 41
DIFFERENCE_RANGE_M = 2e-3
"""The table covers differences of ± this; two fingers wound at equal rate stay well inside."""

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
    drag = None
    if grasp.supported and not grasp.compensated and object.support is not None and object.support.friction > 0:
        limits = sliding(object)
        drag = SupportDrag(limits.force_N, limits.moment_Nm)
    columns = nodes + 1 - nodes % 2  # the equal difference is a column of its own
    path = solve_path_grid(
        system,
        nodes=nodes,
        columns=columns,
        difference_range_m=DIFFERENCE_RANGE_M,
        drag=drag,
        progress=lambda done: report(0.7 * done),
    )
    load = solve_load_grid(system, path, nodes)
    report(0.9)
    arrays = excursion_fields(system, path) | load_fields(system, load, path) | frozen_fields(system, path)
    error = interpolation_error(system, path, load)
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
            "largest_residual": max(path.solutions.residual, load.residual),
            "solved_share": float(path.solutions.solved.mean()),
            "failed_nodes": float(path.left_out.sum()),
            "largest_required_friction": float(np.nanmax(arrays["excursion.required_friction"][:, columns // 2])),
            "interpolation_error_m": error.excursion_m,
            "interpolation_error_rad": error.excursion_rad,
            "load_interpolation_error_m": error.load_m,
            "load_interpolation_error_rad": error.load_rad,
            "interpolation_places": float(error.places),
            "load_interpolation_places": float(error.load_places),
        },
        axes={name: list(axes) for name, axes in GRIDS.items()},
        tendons=["right", "left"],
        channels=CHANNELS,
        contact=ContactData(
            excursion_m=start.tendon_excursion_m.tolist(),
            tension_N=start.tendon_load_N.tolist(),
            pose=[*start.object_pose[:2].tolist(), 0.0, 0.0, 0.0, float(start.object_pose[2])],
            free_closing_stiffness_N_per_m=start.free_closing_stiffness_N_per_m.tolist(),
        ),
        column_end=list(path.domain.end_event),
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
