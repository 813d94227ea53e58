"""Paths that figures show: both tendons wound in equally until a stop, a load cap or a collision ends it."""

from __future__ import annotations

import dataclasses

import numpy as np

from calibration.grasp.constraints import gaps
from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.path import STEP_M, Path, first_crossing, trace
from calibration.hand.bundle import Reals


def squeezed(system: GraspSystem, *, step_m: float = STEP_M, past_stops: bool = False) -> Path:
    """The path from first contact, clear of collisions throughout."""
    return trace(system, step_m=step_m, past_stops=past_stops, clearances=gaps(system))


def up_to_load(path: Path, mean_load_N: float) -> Path:
    """The path up to a mean load, its last point exactly there; all of it where it does not get so far."""
    row = 0.5 * path.system.load_rows().sum(0)

    def above(w: Reals) -> Reals:
        margin: Reals = w @ row - mean_load_N
        return margin

    found = first_crossing(path, above)
    if found is None:
        return path
    index, state = found
    last = index + 1
    return dataclasses.replace(
        path,
        w=np.vstack([path.w[:last], state]),
        at_stop=np.vstack([path.at_stop[:last], path.at_stop[index]]),
        stability=np.append(path.stability[:last], path.stability[index]),
        segments=path.segments[:last],
        end=f"a mean load of {mean_load_N:g} N",
    )
