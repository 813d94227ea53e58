"""Convex polygons: their sides, area, centroid and mean distance, exactly.

Vertices are complex numbers x + i y, m, counter-clockwise. A side with outward normal angle α lies at the distance h
from the reference point; along it, s = Im(p e^{−iα}) grows counter-clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class Side:
    """Flat side: outward normal angle rad, distance from the reference point m, first and last s m."""

    angle_rad: float
    distance_m: float
    start_m: float
    end_m: float


def sides(vertices: Complexes) -> list[Side]:
    """Sides of the polygon with `vertices` (K,), counter-clockwise; side k begins at vertex k."""
    found = []
    for start, end in zip(vertices, np.roll(vertices, -1), strict=True):
        normal = -1j * (end - start) / abs(end - start)
        s_start, s_end = start / normal, end / normal
        found.append(Side(float(np.angle(normal)), s_start.real, s_start.imag, s_end.imag))
    return found


def exterior_angles_rad(vertices: Complexes) -> NDArray[np.float64]:
    """Turn at each vertex (K,), in (−π, π], positive to the left; NaN where a side has no length."""
    along = np.roll(vertices, -1) - vertices
    with np.errstate(invalid="ignore", divide="ignore"):
        turns: NDArray[np.float64] = np.angle(along / np.roll(along, 1))
    return turns


def area_m2(vertices: Complexes) -> float:
    """Area, m², positive for counter-clockwise vertices."""
    return float((vertices.conj() * np.roll(vertices, -1)).imag.sum()) / 2


def centroid_m(vertices: Complexes) -> complex:
    """Centroid of the area, m."""
    following = np.roll(vertices, -1)
    doubled = (vertices.conj() * following).imag
    return complex(((vertices + following) * doubled).sum() / (3 * doubled.sum()))


def mean_distance_m(vertices: Complexes) -> float:
    """Mean distance of the area's points from the reference point, m.

    Each side and the reference point span a triangle, over which ∫|p| dA = (h³/3) ∫ sec³ = [h s d + h³ arsinh(s/h)]/6
    between the side's ends, d = √(h² + s²).
    """
    total = 0.0
    for side in sides(vertices):
        h, s = side.distance_m, np.array([side.start_m, side.end_m])
        if h != 0:
            ends = h * s * np.hypot(h, s) + h**3 * np.arcsinh(s / abs(h))
            total += float(ends[1] - ends[0]) / 6
    return total / area_m2(vertices)
