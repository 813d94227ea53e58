"""One jerk-limited path from rest or motion to rest or motion, planned once by Ruckig."""

from __future__ import annotations

from typing import Protocol

import ruckig

NO_PLAN = (ruckig.RuckigError, ValueError)
"""What Ruckig raises where it finds no plan; ValueError for results that its enumeration lacks (-101: a duration beyond
its numerical range, as after a jump of the target)."""


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
    except NO_PLAN:
        request.max_jerk = [0.999 * jerk for jerk in request.max_jerk]
        ruckig.Ruckig(degrees).calculate(request, trajectory)
    return trajectory
