"""One grid of a motion table: C¹ look-up with derivatives, and the curves between which it may be read.

Bicubic Hermite cells over two index axes: values, both slopes and the mixed derivative agree at every node, so value
and slopes are continuous everywhere. The domain lies between a start and an end curve over the second axis (straight
between its nodes). A cell with a missing corner is never read. Units are those of the axes and channels (see
`motion_table`). Source: design 4; cubic Hermite interpolation is textbook.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.errors import InputError

Reals = NDArray[np.float64]


class Place(Enum):
    """Where an index that cannot be read lies relative to the domain."""

    BEFORE_START = "before start"
    BEYOND_END = "beyond end"
    BESIDE = "beside"
    HOLE = "hole"


@dataclass(frozen=True)
class GridNodes:
    """What is known at the nodes, (n0, n1, channels) each; NaN where there is no solution."""

    value: Reals
    along_0: Reals
    along_1: Reals
    mixed: Reals

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n0, n1) nodes with a solution."""
        return np.asarray(np.isfinite(self.value).all(2), np.bool_)


def cell_coefficients(nodes: GridNodes, step_0: float, step_1: float) -> Reals:
    """Polynomial coefficients per cell, (n0 − 1, n1 − 1, power of axis 1, power of axis 0, channels); NaN in a hole."""
    n0, n1, channels = nodes.value.shape
    along_0 = _powers(nodes.value, nodes.along_0 * step_0, 0)  # cubics along axis 0 at every node of axis 1,
    turning = _powers(nodes.along_1 * step_1, nodes.mixed * (step_0 * step_1), 0)  # and their slopes along it
    result = np.empty((n0 - 1, n1 - 1, 4, 4, channels))
    for power_0, (value, slope) in enumerate(zip(along_0, turning, strict=True)):
        for power_1, coefficient in enumerate(_powers(value, slope, 1)):
            result[:, :, power_1, power_0] = coefficient
    return result


def _powers(value: Reals, slope: Reals, axis: int) -> tuple[Reals, Reals, Reals, Reals]:
    """Coefficients of the powers 0…3 of the share of each cell along an axis, from values and slopes per cell."""
    near, far = (slice(None),) * axis + (slice(None, -1),), (slice(None),) * axis + (slice(1, None),)
    rest, leaving, arriving = value[far] - value[near], slope[near], slope[far]
    return value[near], leaving, 3 * rest - 2 * leaving - arriving, leaving + arriving - 2 * rest


def read_nodes(nodes: GridNodes, steps: tuple[float, float], share_0: Reals, share_1: Reals) -> Reals:
    """Bicubic Hermite values (P, channels) at places (P,) counted in nodes along both axes, many at once; NaN beside a
    missing node. Beyond the nodes the outermost cell is continued."""
    i = np.clip(share_0.astype(int), 0, nodes.value.shape[0] - 2)
    j = np.clip(share_1.astype(int), 0, nodes.value.shape[1] - 2)
    weights_0, weights_1 = (_hermite(share - cell) for share, cell in ((share_0, i), (share_1, j)))
    result = np.zeros((share_0.size, nodes.value.shape[2]))
    for down in (0, 1):
        for aside in (0, 1):
            corner = (i + down, j + aside)
            (value_0, slope_0), (value_1, slope_1) = weights_0[down], weights_1[aside]
            slope_0, slope_1 = slope_0 * steps[0], slope_1 * steps[1]
            result += (value_0 * value_1)[:, None] * nodes.value[corner]
            result += (slope_0 * value_1)[:, None] * nodes.along_0[corner]
            result += (value_0 * slope_1)[:, None] * nodes.along_1[corner]
            result += (slope_0 * slope_1)[:, None] * nodes.mixed[corner]
    return result


def _hermite(t: Reals) -> tuple[tuple[Reals, Reals], tuple[Reals, Reals]]:
    """Weights of value and slope at the near and at the far end of a cell, at the share `t` of it."""
    smooth = t * t * (3 - 2 * t)
    return (1 - smooth, t * (1 - t) ** 2), (smooth, t * t * (t - 1))


class TableGrid:
    """A readable grid over two index axes. Not for several threads at once: look-ups share a buffer."""

    def __init__(
        self, origin: tuple[float, float], step: tuple[float, float], coefficients: Reals, start: Reals, end: Reals
    ) -> None:
        """`coefficients` as from `cell_coefficients`; `start` and `end` (n1,) on axis 0 at the nodes of axis 1."""
        n0, n1, _, _, channels = coefficients.shape
        if start.shape != (n1 + 1,) or end.shape != (n1 + 1,):
            raise InputError(f"start and end have shapes {start.shape}, {end.shape}; expected ({n1 + 1},).")
        self.coefficients = coefficients
        self.origin, self.step = origin, step
        self._start: list[float] = start.tolist()
        self._end: list[float] = end.tolist()
        self._last: tuple[int, int] = (n0 - 1, n1 - 1)
        flat = coefficients.reshape(n0, n1, 16, channels)
        known = np.asarray(np.isfinite(flat).all((2, 3)))
        self._cells = [[flat[i, j] if known[i, j] else None for j in range(n1)] for i in range(n0)]
        self._inverse = 1.0 / step[0], 1.0 / step[1]
        self._memory = bytearray(48 * 8)
        self._powers = np.frombuffer(self._memory).reshape(3, 16)
        self._pack = struct.Struct("48d").pack_into

    @property
    def range_0(self) -> tuple[float, float]:
        """Smallest start and largest end on axis 0."""
        return min(self._start), max(self._end)

    @property
    def range_1(self) -> tuple[float, float]:
        """First and last node on axis 1."""
        return self.origin[1], self.origin[1] + self.step[1] * (self._last[1] + 1)

    def start_at(self, index_1: float) -> float:
        """Start of the domain on axis 0 at a position of axis 1, clamped to its ends."""
        return self._on_curve(self._start, index_1)

    def end_at(self, index_1: float) -> float:
        """End of the domain on axis 0 at a position of axis 1, clamped to its ends."""
        return self._on_curve(self._end, index_1)

    def inside(self, index_0: float, index_1: float) -> Reals | None:
        """(3, channels) value and slopes along axes 0 and 1 where the domain can be read, else None; the fast way."""
        origin_0, origin_1 = self.origin
        share = (index_1 - origin_1) * self._inverse[1]
        last_0, last_1 = self._last
        if not 0.0 <= share <= last_1 + 1:
            return None
        j = int(share)
        if j > last_1:
            j = last_1
        v = share - j
        curve = self._start
        if index_0 < curve[j] + (curve[j + 1] - curve[j]) * v:
            return None
        curve = self._end
        if not index_0 <= curve[j] + (curve[j + 1] - curve[j]) * v:
            return None
        share = (index_0 - origin_0) * self._inverse[0]
        i = int(share)
        if i > last_0:
            i = last_0
        cell = self._cells[i][j]
        return None if cell is None else self._rows(cell, share - i, v)

    def place(self, index_0: float, index_1: float) -> tuple[Place, float, float]:
        """Where the index lies, and the nearest index of the domain along axis 1, then axis 0. Not finite:
        InputError."""
        if not math.isfinite(index_0 + index_1):
            raise InputError(f"index ({index_0}, {index_1}) of a motion table is not finite.")
        low, high = self.range_1
        near_1 = min(max(index_1, low), high)
        start, end = self.start_at(near_1), self.end_at(near_1)
        if index_0 < start:
            return Place.BEFORE_START, start, near_1
        if near_1 != index_1:
            return Place.BESIDE, min(index_0, end), near_1
        if index_0 > end:
            return Place.BEYOND_END, end, near_1
        return Place.HOLE, index_0, near_1

    def nearest(self, index_0: float, index_1: float) -> Reals | None:
        """As `inside`, for an index that `place` gave: on an edge, rounding does not matter. None in a hole."""
        last_0, last_1 = self._last
        share_0 = min(max((index_0 - self.origin[0]) * self._inverse[0], 0.0), last_0 + 1.0)
        share_1 = min(max((index_1 - self.origin[1]) * self._inverse[1], 0.0), last_1 + 1.0)
        i, j = min(int(share_0), last_0), min(int(share_1), last_1)
        cell = self._cells[i][j]
        return None if cell is None else self._rows(cell, share_0 - i, share_1 - j)

    def _rows(self, cell: Reals, u: float, v: float) -> Reals:
        """Value and slopes in a cell at the shares `u` of axis 0 and `v` of axis 1: one small product, written out."""
        a, b = self._inverse
        u2, v2 = u * u, v * v
        u3, v3 = u2 * u, v2 * v
        f2, f3 = 2.0 * a * u, 3.0 * a * u2
        g2, g3 = 2.0 * b * v, 3.0 * b * v2
        self._pack(
            self._memory, 0,
            1.0, u, u2, u3, v, v * u, v * u2, v * u3, v2, v2 * u, v2 * u2, v2 * u3, v3, v3 * u, v3 * u2, v3 * u3,
            0.0, a, f2, f3, 0.0, v * a, v * f2, v * f3, 0.0, v2 * a, v2 * f2, v2 * f3, 0.0, v3 * a, v3 * f2, v3 * f3,
            0.0, 0.0, 0.0, 0.0, b, b * u, b * u2, b * u3, g2, g2 * u, g2 * u2, g2 * u3, g3, g3 * u, g3 * u2, g3 * u3,
        )  # fmt: skip
        rows: Reals = np.dot(self._powers, cell)
        return rows

    def _on_curve(self, curve: list[float], index_1: float) -> float:
        share = (index_1 - self.origin[1]) / self.step[1]
        j = min(max(int(share), 0), len(curve) - 2)
        t: float = min(max(share - j, 0.0), 1.0)
        return curve[j] + (curve[j + 1] - curve[j]) * t
