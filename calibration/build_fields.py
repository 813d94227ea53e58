"""States of a grid as the fields of a motion table: channels with their slopes, and what is known of every node.

Channels are linear in a state: object motion since first contact (6-D, hand frame), tendon loads, contact forces;
finger order right, left. Source: design 4.
"""

from __future__ import annotations

import numpy as np

from calibration.build_load_grid import LoadGrid
from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.path_grid import PathGrid
from calibration.grasp.path_grid_domain import readable
from calibration.grasp.path_grid_events import ROUNDING
from calibration.hand.finger import Reals
from calibration.motion_table import POSE
from calibration.table_file import Arrays
from calibration.table_grid import GridNodes

CHANNELS = [
    *POSE,
    *(f"{side}_{what}_N" for what in ("tension", "normal", "tangential") for side in ("right", "left")),
]
NOT_SOLVED, BESIDE_DOMAIN, IN_DOMAIN, LEFT_OUT = 0, 1, 2, -1
"""Of a node: not wanted; solved, but beside the domain; in the domain; wanted, but no solution on the branch found."""


def channel_rows(system: GraspSystem) -> Reals:
    """(channels, size): rows that make the table's channels of a state (before the contact pose is taken off)."""
    n = system.unknowns
    pose = np.zeros((6, system.size))
    for channel, unknown in ((0, n - 3), (1, n - 2), (5, n - 1)):
        pose[channel, unknown] = 1.0
    contacts = system.contact_rows()
    return np.concatenate([pose, system.load_rows(), contacts[[0, 2]], contacts[[1, 3]]])


def excursion_fields(system: GraspSystem, path: PathGrid) -> Arrays:
    """Arrays of the native grid."""
    solved, axes, ends = path.solutions, path.solutions.axes, path.domain
    arrays = _nodes("excursion", system, solved.nodes)
    value = arrays["excursion.value"]
    start, end = readable(solved.solved, axes.mean_m, ends.start_m, ends.end_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        friction = np.abs(value[:, :, 10:12] / value[:, :, 8:10]).max(2)
        pressed = (value[:, :, 8:10] > ROUNDING).all(2)
        stops = solved.margins[:, :, :8] < 0
    inside = solved.solved & (axes.mean_m[:, None] >= start) & (axes.mean_m[:, None] <= end)
    validity = np.where(path.left_out, LEFT_OUT, np.where(inside, IN_DOMAIN, solved.solved)).astype(np.int8)
    wrench = np.zeros((*axes.shape, 3)) if solved.wrench is None else solved.wrench.value
    return arrays | {
        "excursion.axis_0": axes.mean_m,
        "excursion.axis_1": axes.difference_m,
        "excursion.start": start,
        "excursion.end": end,
        "excursion.validity": validity,
        "excursion.joint_rad": solved.w[:, :, : system.joints],
        "excursion.required_friction": np.where(inside, np.where(pressed, friction, 0.0), np.nan),
        "excursion.stability": solved.stability,
        "excursion.active_stop": np.where(stops.any(2), stops.argmax(2) // 2, -1).astype(np.int8),
        "excursion.support_wrench": wrench,
    }


def load_fields(system: GraspSystem, grid: LoadGrid, path: PathGrid) -> Arrays:
    """Arrays of the grid on mean load."""
    return _nodes("load", system, grid.nodes) | {
        "load.axis_0": grid.load_N,
        "load.axis_1": path.solutions.axes.difference_m,
        "load.start": grid.start_N,
        "load.end": grid.end_N,
    }


def _nodes(name: str, system: GraspSystem, nodes: GridNodes) -> Arrays:
    channels = channel_rows(system)
    contact = channels @ system.first_state()
    contact[6:] = 0.0  # loads and forces are stored as they are, only the pose is relative
    return {
        f"{name}.value": nodes.value @ channels.T - contact,
        f"{name}.along_0": nodes.along_0 @ channels.T,
        f"{name}.along_1": nodes.along_1 @ channels.T,
        f"{name}.mixed": nodes.mixed @ channels.T,
    }
