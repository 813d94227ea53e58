"""Calibration of one finger's pad: known weights at known places, counts to newtons, and how well that holds.

A force between cells is shared and partly lost, so the finger is calibrated as a whole: F = g · d over the cells'
signals d, with g ≥ 0. Cells whose signals hardly differ would get wild gains; they are drawn towards one common gain.
What the fit is worth is judged at places that it has not seen. Pure; units: N, Pcomp counts. Source: TakkTile reference
5, 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from drivers.errors import InputError
from drivers.takktile.frames import Cell

STANDARD_GRAVITY_M_S2 = 9.80665
LEAST_PRESSES = 40
"""TakkTile reference 6."""
ACCEPTED_RESIDUAL = 0.1
"""Of the largest load: held-out residual up to which a calibration is accepted."""
_RIDGE = 1e-3
_LEAST_WARMING_COUNTS = 5.0
"""Of the temperature word, about 1 °C: with less, drift cannot be told from noise."""


@dataclass(frozen=True)
class Place:
    """Where a weight stands: above one cell, or midway between two."""

    cells: tuple[Cell, ...]

    def __str__(self) -> str:
        return " and ".join(f"{cell.row}:{cell.column}" for cell in self.cells)


@dataclass(frozen=True)
class Press:
    """One weight at one place, and what the cells said: `counts` (n,) above zero, in the order of the pad's cells."""

    place: Place
    load_N: float
    counts: tuple[float, ...]


@dataclass(frozen=True)
class TactileFit:
    """`gain_N_per_count` (n,) and how well it tells forces. Residuals are of places that were left out of their fit."""

    gain_N_per_count: tuple[float, ...]
    residual_N: float
    relative_residual: float
    """Of the largest load."""
    worst_place: Place
    worst_error: float
    """Mean relative error at the worst place: what the place alone changes."""
    silent_cells: tuple[int, ...]
    """Indices of cells that no weight moved."""

    def accepted(self, limit: float = ACCEPTED_RESIDUAL) -> bool:
        """Whether forces may be told with it."""
        return self.relative_residual <= limit


def plan(cells: Sequence[Cell], masses_kg: Sequence[float]) -> list[tuple[Place, float]]:
    """Which mass goes where, kg: each at every cell and midway between neighbours of a row, place by place.

    Raises InputError for masses that are none, or too few for a calibration.
    """
    if not masses_kg or not all(0.001 <= mass <= 10.0 for mass in masses_kg):
        raise InputError(f"masses {list(masses_kg)} kg are not accepted; expected some of 0.001 to 10 kg.")
    ordered = sorted(cells)
    places = [Place((cell,)) for cell in ordered]
    for cell, following in pairwise(ordered):
        if cell.row == following.row and following.column == cell.column + 1:
            places.append(Place((cell, following)))
    needed = -(-LEAST_PRESSES // len(places))
    if len(set(masses_kg)) < needed:
        raise InputError(
            f"{len(places)} places with {len(set(masses_kg))} masses are too few; expected {LEAST_PRESSES} presses.",
            help=f"Give at least {needed} different masses.",
        )
    return [(place, mass) for place in places for mass in sorted(set(masses_kg))]


def fit(presses: Sequence[Press]) -> TactileFit:
    """Gains of one finger from its presses. Raises InputError for presses that say nothing."""
    if len(presses) < LEAST_PRESSES:
        raise InputError(f"{len(presses)} presses are too few; expected at least {LEAST_PRESSES}.")
    counts, load_N = np.array([press.counts for press in presses]), np.array([press.load_N for press in presses])
    if counts.ndim != 2 or not np.all(np.isfinite(counts)) or not np.all(np.isfinite(load_N)) or load_N.min() <= 0.0:
        raise InputError("presses need finite counts of the same cells and loads above 0.")
    gain = _gains(counts, load_N)
    places = sorted({press.place for press in presses}, key=lambda place: place.cells)
    at_place = np.array([places.index(press.place) for press in presses])
    if len(places) < 3:
        raise InputError(f"{len(places)} places are too few; expected at least 3.")
    error_N = np.empty(len(presses))
    for index in range(len(places)):
        there = at_place == index
        error_N[there] = counts[there] @ _gains(counts[~there], load_N[~there]) - load_N[there]
    by_place = [float((error_N[at_place == index] / load_N[at_place == index]).mean()) for index in range(len(places))]
    worst = int(np.abs(by_place).argmax())
    residual_N = float(np.sqrt((error_N**2).mean()))
    largest = np.abs(counts).max(axis=0)
    return TactileFit(
        tuple(gain.tolist()),
        residual_N,
        residual_N / float(load_N.max()),
        places[worst],
        by_place[worst],
        tuple(np.flatnonzero(largest < 0.02 * largest.max()).tolist()),
    )


def fit_thermal(counts: NDArray[np.float64], temperature: NDArray[np.float64]) -> tuple[float, ...]:
    """Counts a temperature count of each cell, from a warm-up without load: `counts` and `temperature`, (m, n) each.

    Raises InputError if the cells did not change their temperature enough to tell.
    """
    if counts.shape != temperature.shape or counts.ndim != 2 or len(counts) < 10:
        raise InputError(f"a warm-up of shapes {counts.shape} and {temperature.shape} is none; expected ≥ 10 rows.")
    centred = temperature - temperature.mean(axis=0)
    span = np.ptp(temperature, axis=0)
    if span.min() < _LEAST_WARMING_COUNTS:
        raise InputError(
            f"the pads changed their temperature by {span.min() / 5.35:.1f} °C only; expected at least 1 °C.",
            help="Let the motors work, or warm the fingers by hand before they rest, and measure for longer.",
        )
    slope: NDArray[np.float64] = (centred * (counts - counts.mean(axis=0))).sum(axis=0) / (centred**2).sum(axis=0)
    return tuple(slope.tolist())


def _gains(counts: NDArray[np.float64], load_N: NDArray[np.float64]) -> NDArray[np.float64]:
    """Non-negative least squares of load over counts, drawn weakly towards the one gain that fits best for all."""
    total = counts.sum(axis=1)
    if not total @ load_N > 0.0:
        raise InputError("the pad does not answer to weights; its cells' counts do not rise.")
    common = float(total @ load_N / (total @ total))
    weight = np.sqrt(_RIDGE * (counts**2).sum() / counts.shape[1])
    rows = np.vstack([counts, weight * np.eye(counts.shape[1])])
    gain: NDArray[np.float64] = nnls(rows, np.concatenate([load_N, np.full(counts.shape[1], weight * common)]))[0]
    return gain
