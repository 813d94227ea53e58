"""Planar outlines of objects, in the object's own axes: origin at the centroid, metres, angles counter-clockwise.

A shape is data, checked once, here; how fingertips touch it is `calibration/grasp/contact.py`. Two families: round
outlines (`Disc`, `Sphere`, `Curve`) have a support function (`support.py`), polygons (`Rectangle`, `Polygon`) have
sides (`polygon.py`). `mean_pressure_distance_m` is the mean distance of the patch that presses on the table from its
centroid (hand-mechanics reference 8). Outlines are those of the section in the closing plane; the patch is taken as
equally large, except under a sphere, which stands on a point.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from calibration.objects import polygon
from calibration.objects.polygon import Complexes, Side
from calibration.objects.support import SupportFunction
from calibration.toml_files import FieldError

Size = Annotated[float, Meta(gt=0, le=1)]
Coordinate = Annotated[float, Meta(ge=-1, le=1)]
Outline = NDArray[np.float64]

CENTROID_WITHIN_M = 1e-5
"""The centroid may be this far from the origin: vertices are written in hundredths of a millimetre."""
SMALLEST_TURN_RAD = 1e-3
"""A vertex that turns by less is no corner: rounded figures would make it reflex."""
SHORTEST_SIDE_M = 1e-4
MOST_VERTICES = 100
HIGHEST_ORDER = 12


class Round(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """What shapes with a smooth outline share."""

    @property
    def support(self) -> SupportFunction:
        """Support function of the outline."""
        raise NotImplementedError

    @property
    def area_m2(self) -> float:
        """Area of the outline, m²."""
        return self.support.area_m2

    @property
    def mean_pressure_distance_m(self) -> float:
        """Mean distance of the pressed patch from its centroid, m."""
        return self.support.mean_distance_m

    def extent_m(self, angle_rad: float) -> float:
        """Extent along the direction at `angle_rad` in the object's axes, m."""
        return float(self.support.derivatives(np.array([angle_rad, angle_rad + math.pi]), 0)[1].sum())

    def outline_m(self, points: int) -> Outline:
        """`points` points of the outline, counter-clockwise, equal normal angles apart; (points, 2) m."""
        return _columns(self.support.point(2 * np.pi * np.arange(points) / points))


class Flat(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """What shapes with flat sides share."""

    @property
    def corners(self) -> Complexes:
        """Vertices x + i y, m, counter-clockwise."""
        raise NotImplementedError

    @property
    def sides(self) -> list[Side]:
        """Sides, counter-clockwise; side k begins at vertex k."""
        return polygon.sides(self.corners)

    @property
    def area_m2(self) -> float:
        """Area of the outline, m²."""
        return polygon.area_m2(self.corners)

    @property
    def mean_pressure_distance_m(self) -> float:
        """Mean distance of the pressed patch from its centroid, m."""
        return polygon.mean_distance_m(self.corners)

    def extent_m(self, angle_rad: float) -> float:
        """Extent along the direction at `angle_rad` in the object's axes, m."""
        return float(np.ptp((self.corners * np.exp(-1j * angle_rad)).real))

    def outline_m(self, points: int) -> Outline:
        """`points` points of the outline, counter-clockwise, equal arcs apart, from vertex 0; (points, 2) m."""
        corners = self.corners
        closed = np.append(corners, corners[0])
        travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(closed)))])
        return _columns(np.interp(travelled[-1] * np.arange(points) / points, travelled, closed))


class Disc(Round, frozen=True, tag="disc"):
    """A circle about the reference point: a cylinder that stands upright to the hand plane."""

    diameter_m: Size

    @property
    def radius_m(self) -> float:
        """Half the diameter, m."""
        return self.diameter_m / 2

    @property
    def support(self) -> SupportFunction:
        """Constant: the radius."""
        return SupportFunction((self.radius_m,))

    @property
    def mean_pressure_distance_m(self) -> float:
        """2R/3."""
        return 2 * self.radius_m / 3


class Sphere(Round, frozen=True, tag="sphere"):
    """A sphere whose centre is in the hand plane."""

    diameter_m: Size

    @property
    def radius_m(self) -> float:
        """Half the diameter, m."""
        return self.diameter_m / 2

    @property
    def support(self) -> SupportFunction:
        """Constant: the radius."""
        return SupportFunction((self.radius_m,))

    @property
    def mean_pressure_distance_m(self) -> float:
        """0: it stands on a point."""
        return 0.0


class Curve(Round, frozen=True, tag="curve"):
    """Smooth convex outline h(ψ) = c_0 + Σ (c_k cos kψ + s_k sin kψ): `support_cos_m` = [c_0, c_1, …],
    `support_sin_m` = [s_1, …]."""

    support_cos_m: Annotated[tuple[Coordinate, ...], Meta(min_length=1, max_length=HIGHEST_ORDER + 1)]
    support_sin_m: Annotated[tuple[Coordinate, ...], Meta(max_length=HIGHEST_ORDER)] = ()

    def __post_init__(self) -> None:
        if len(self.support_cos_m) < 1:
            raise FieldError("support_cos_m", "at least the mean distance c_0")
        if not all(map(math.isfinite, self.support_cos_m + self.support_sin_m)):
            raise FieldError("support_cos_m", "finite coefficients")
        support = self.support
        if not self.support_cos_m[0] > 0 or not support.smallest_radius_m > 0:
            raise FieldError(
                "support_cos_m",
                "a convex, smooth outline: radius of curvature h + h'' > 0 everywhere "
                f"(smallest now {support.smallest_radius_m * 1e3:.3g} mm)",
            )
        _refuse_off_centre("support_cos_m", support.centroid_m, "less c_1 and s_1")

    @property
    def support(self) -> SupportFunction:
        """The support function as it stands in the file."""
        return SupportFunction(self.support_cos_m, self.support_sin_m)


class Rectangle(Flat, frozen=True, tag="rectangle"):
    """A rectangle about the reference point: `width_m` along its x axis, `depth_m` along y."""

    width_m: Size
    depth_m: Size

    @property
    def corners(self) -> Complexes:
        """Vertices, counter-clockwise from the one at +x, −y: side 0 looks along +x."""
        x, y = self.width_m / 2, self.depth_m / 2
        return np.array([x - 1j * y, x + 1j * y, -x + 1j * y, -x - 1j * y])


class Polygon(Flat, frozen=True, tag="polygon"):
    """Convex polygon with counter-clockwise `vertices_m` (x, y), centroid at the origin."""

    vertices_m: Annotated[tuple[tuple[Coordinate, Coordinate], ...], Meta(min_length=3, max_length=MOST_VERTICES)]

    def __post_init__(self) -> None:
        if len(self.vertices_m) < 3:
            raise FieldError("vertices_m", "three vertices or more")
        corners = self.corners
        if not np.isfinite(corners).all():
            raise FieldError("vertices_m", "finite coordinates")
        if np.abs(np.roll(corners, -1) - corners).min() < SHORTEST_SIDE_M:
            raise FieldError(
                "vertices_m", f"vertices at least {SHORTEST_SIDE_M * 1e3:g} mm apart, the first not repeated"
            )
        turns = polygon.exterior_angles_rad(corners)
        if turns.max() < 0 or (polygon.area_m2(corners) < 0 and turns.sum() < 0):
            raise FieldError("vertices_m", "counter-clockwise vertices (these are clockwise)")
        if turns.min() < SMALLEST_TURN_RAD or turns.sum() > 2 * math.pi + 1e-6:
            worst = int(np.argmin(turns))
            raise FieldError(
                "vertices_m",
                f"a convex polygon that turns left at every vertex (it turns by {math.degrees(turns[worst]):.3g}° at "
                f"vertex {worst}, {math.degrees(turns.sum()):.0f}° in all)",
            )
        _refuse_off_centre("vertices_m", polygon.centroid_m(corners), "subtracted from every vertex")

    @property
    def corners(self) -> Complexes:
        """Vertices as in the file."""
        return np.array([complex(x, y) for x, y in self.vertices_m])


Shape = Disc | Sphere | Rectangle | Polygon | Curve
"""Every outline that a file may hold."""


def _refuse_off_centre(key: str, centroid_m: complex, cure: str) -> None:
    if abs(centroid_m) > CENTROID_WITHIN_M:
        raise FieldError(
            key,
            f"the centroid at the origin within {CENTROID_WITHIN_M * 1e3:g} mm "
            f"(it is at ({centroid_m.real:.6f}, {centroid_m.imag:.6f}) m; {cure}, this cures it)",
        )


def _columns(points: Complexes) -> Outline:
    return np.stack([points.real, points.imag], axis=1)
