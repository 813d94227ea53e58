"""One jerk-limited path from rest or motion to rest or motion, planned once by Ruckig."""

from __future__ import annotations

from typing import Protocol

import ruckig


class Trajectory(Protocol):
    """A planned path: position, velocity and acceleration (lists, one number a degree of freedom) at its own time."""

    duration: float

    def at_time(self, time: float) -> tuple[list[float], list[float], list[float]]: ...


def planned(request: ruckig.InputParameter, degrees: int) -> Trajectory:
    """The quickest path that `request` allows.

    Where two kinds of profile meet to the last bit Ruckig finds none; a thousandth less jerk steps aside of that.
    """
    trajectory: Trajectory = ruckig.Trajectory(degrees)
    try:
        ruckig.Ruckig(degrees).calculate(request, trajectory)
    except ruckig.RuckigError:
        request.max_jerk = [0.999 * jerk for jerk in request.max_jerk]
        ruckig.Ruckig(degrees).calculate(request, trajectory)
    return trajectory
