"""How far a table is from the equilibria it stands for: look-ups against direct solutions at random places.

Places are drawn evenly (seeded) from the domain at least one cell away from its edges. Each is solved anew for its
excursions; its mean load then asks the load grid. m, rad. Source: design 4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.build_load_grid import LoadGrid
from calibration.grasp.equilibrium import GraspSystem, load_drive
from calibration.grasp.path_grid import PathGrid
from calibration.hand.finger import Reals
from calibration.table_grid import read_nodes

POINTS = 300
SEED = 20


@dataclass(frozen=True)
class InterpolationError:
    """Largest error of the pose, m and rad, over the places compared, by either index; 0 places prove nothing."""

    excursion_m: float
    excursion_rad: float
    load_m: float
    load_rad: float
    places: int
    load_places: int


def interpolation_error(
    system: GraspSystem, path: PathGrid, load: LoadGrid, points: int = POINTS
) -> InterpolationError:
    """Compare both grids with direct solutions at `points` random places."""
    solved, axes = path.solutions, path.solutions.axes
    rng = np.random.default_rng(SEED)
    range_1 = axes.difference_m[1], axes.difference_m[-2]
    difference = rng.uniform(*range_1, points)
    start, end = (np.interp(difference, axes.difference_m, edge) for edge in (path.domain.start_m, path.domain.end_m))
    low, high = start + axes.steps_m[0], end - axes.steps_m[0]
    mean, difference = (values[high > low] for values in (rng.uniform(low, np.maximum(low, high)), difference))
    places = solved.share(mean), (difference - axes.difference_m[0]) / axes.steps_m[1]
    guess = read_nodes(solved.nodes, axes.steps_m, *places)
    wrench = None if solved.wrench is None else read_nodes(solved.wrench, axes.steps_m, *places)
    known = np.isfinite(guess).all(1)
    target = axes.origin + np.column_stack([mean, difference])
    states = system.solve(guess[known], axes.drive, target[known], wrench=None if wrench is None else wrench[known])
    w = states.w[states.converged]
    by_excursion = _errors(system, guess[known][states.converged], w)
    mean_N = w @ load_drive(system).rows[0]
    difference = difference[known][states.converged]
    start, end = (np.interp(difference, axes.difference_m, edge) for edge in (load.start_N, load.end_N))
    step = float(load.load_N[1] - load.load_N[0])
    within = (mean_N > start + step) & (mean_N < end - step)
    places = (mean_N[within] - load.load_N[0]) / step, (difference[within] - axes.difference_m[0]) / axes.steps_m[1]
    read = read_nodes(load.nodes, (step, axes.steps_m[1]), *places)
    whole = np.isfinite(read).all(1)
    by_load = _errors(system, read[whole], w[within][whole])
    return InterpolationError(*by_excursion, *by_load, w.shape[0], int(whole.sum()))


def _errors(system: GraspSystem, read: Reals, w: Reals) -> tuple[float, float]:
    """Largest error of position, m, and angle, rad."""
    away = np.abs(read - w)[:, system.joints : system.unknowns]
    return float(np.hypot(away[:, 0], away[:, 1]).max(initial=0.0)), float(away[:, 2].max(initial=0.0))
