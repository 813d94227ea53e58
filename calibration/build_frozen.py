"""What lies beyond all stops: the hand is frozen while loads and contact forces still rise with the mean load.

With pins nothing moves any more. Flexures keep a little softness in their shapes: there the pose creeps on, linear in
the load up to where the table says so. Hand frame, SI. Source: design 4, hand-mechanics reference 6 and 14.
"""

from __future__ import annotations

import numpy as np

from calibration.build_fields import channel_rows
from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import GraspSystem, excursion_drive, load_drive
from calibration.grasp.path_grid import PathGrid
from calibration.grasp.path_grid_solutions import in_column
from calibration.hand.finger import Reals
from calibration.table_file import Arrays

FROZEN_TRAVEL_M = 2e-5
"""Stops that are met within this much winding of one another are met together (about 0.1 mm of object motion)."""
LINEAR_WITHIN = np.array([5e-6, 5e-6, 8e-5])
"""Largest error of the pose taken as linear in the load: m, m, rad."""
STILL = np.array([1e-9, 1e-9, 1e-9])
"""A pose that moves by less up to the load cap stands still."""


def frozen_fields(system: GraspSystem, path: PathGrid) -> Arrays:
    """Per column: winding between the first stop and the last closing joint's; where that is next to nothing, the mean
    load there, slopes per load above, and up to which mean load they hold (no further than the first load cap)."""
    channels, ends, by_load = channel_rows(system), path.domain, load_drive(system)
    columns = ends.end_m.size
    travel, load_N, end_N = np.full(columns, 1.0), np.zeros(columns), np.zeros(columns)
    slope = np.zeros((columns, channels.shape[0]))
    closing = list(system.joint_columns[1::2])  # the joints whose stops freeze the hand
    met = np.flatnonzero([event.endswith("distal stop") for event in ends.end_event] & (ends.end_m > ends.start_m))
    speed = system.tangent(ends.end_w[met], excursion_drive(system))[:, closing, 0]
    left = (system.upper_rad[closing] - ends.end_w[met][:, closing]).max(1)
    travel[met] = np.where((speed > 0).all(1), np.maximum(left, 0.0) / np.abs(speed).min(1), 1.0)
    chosen = np.flatnonzero(travel <= FROZEN_TRAVEL_M)
    if chosen.size:
        w, wrench = ends.end_w[chosen], _wrench_at_end(path, chosen)
        at_stop = np.zeros((chosen.size, system.joints))
        at_stop[:, closing] = 1.0
        tangent = system.tangent(w, by_load, at_stop)[:, :, 0]
        span_N = _to_cap_N(system, w, tangent)
        here = w @ by_load.rows.T
        there = here + span_N[:, None] * [1.0, 0.0]
        pulls = None if wrench is None else (wrench, wrench)
        pose = slice(system.joints, system.unknowns)
        moved = (advance(system, w, by_load, here, there, stops=True, wrench=pulls) - w)[:, pose]
        error = np.abs(moved - span_N[:, None] * tangent[:, pose])
        share = np.sqrt(
            np.min(LINEAR_WITHIN / np.maximum(error, LINEAR_WITHIN), axis=1)
        )  # the error grows as its square
        tangent[:, pose] = np.where(np.abs(tangent[:, pose]) * span_N[:, None] < STILL, 0.0, tangent[:, pose])
        before = np.where(
            path.solutions.axes.mean_m[:, None] < ends.end_m[chosen], path.solutions.w[:, chosen] @ by_load.rows[0], 0.0
        )
        load_N[chosen] = np.maximum(here[:, 0], np.nanmax(before, axis=0))
        end_N[chosen] = here[:, 0] + np.nan_to_num(share) * span_N
        slope[chosen] = tangent @ channels.T
    return {"frozen.travel_m": travel, "frozen.load_N": load_N, "frozen.end_N": end_N, "frozen.slope_per_N": slope}


def _to_cap_N(system: GraspSystem, w: Reals, tangent: Reals) -> Reals:
    """(B,) rise of the mean load until one tendon is at its cap."""
    loads, rises = w @ system.load_rows().T, tangent @ system.load_rows().T
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = np.where(rises > 0, (system.load_cap_N - loads) / rises, np.inf).min(1)
    return np.asarray(np.clip(rise, 0.0, system.load_cap_N))


def _wrench_at_end(path: PathGrid, columns: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Reals | None:
    solved, field = path.solutions, path.solutions.wrench
    if field is None:
        return None
    place = solved.share(path.domain.end_m[columns])
    return in_column(field.value, field.along_0, solved.axes.steps_m[0], place, columns)
