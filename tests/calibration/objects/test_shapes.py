"""Outlines: measures against formulae and sampling, and what is no outline."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibration.objects import Curve, Disc, Polygon, Rectangle, Shape, Sphere, load_object
from calibration.toml_files import FieldError

PEAR = load_object("pear").shape
TRIANGLE = Polygon(((0.03, -0.01), (0.0, 0.03), (-0.03, -0.02)))
SHAPES: list[Shape] = [Disc(0.04), Sphere(0.05), Rectangle(0.058, 0.095), TRIANGLE, PEAR]


def regular(sides: int, radius_m: float) -> Polygon:
    """Regular polygon about a circle of `radius_m`."""
    points = radius_m / math.cos(math.pi / sides) * np.exp(2j * np.pi * (np.arange(sides) + 0.5) / sides)
    return Polygon(tuple((point.real, point.imag) for point in points))


def sampled(shape: Shape) -> NDArray[np.float64]:
    """Centres of small equal squares within the outline (K, 2), by crossing counts of a fine polyline."""
    outline = shape.outline_m(2000)
    reach = np.abs(outline).max()
    step = 2 * reach / 400
    grid = np.arange(-reach + step / 2, reach, step)
    inside = []
    for x in grid:
        start, end = outline, np.roll(outline, -1, axis=0)
        crossed = (start[:, 0] <= x) != (end[:, 0] <= x)
        share = (x - start[crossed, 0]) / (end[crossed, 0] - start[crossed, 0])
        heights = start[crossed, 1] + share * (end[crossed, 1] - start[crossed, 1])
        if heights.size:
            held = grid[(grid > heights.min()) & (grid < heights.max())]
            inside.append(np.stack([np.full(held.size, x), held], axis=1))
    return np.concatenate(inside)


@pytest.mark.parametrize("shape", [Disc(0.04), Rectangle(0.058, 0.095), TRIANGLE, PEAR], ids=lambda s: type(s).__name__)
def test_area_centroid_and_mean_distance_are_those_of_the_points_inside(shape: Shape) -> None:
    """Measures agree with a count of small squares, and the centroid is the reference point."""
    points = sampled(shape)
    square_m2 = (2 * np.abs(shape.outline_m(2000)).max() / 400) ** 2
    assert shape.area_m2 == pytest.approx(len(points) * square_m2, rel=3e-3)
    assert points.mean(0) == pytest.approx([0, 0], abs=5e-5)
    assert shape.mean_pressure_distance_m == pytest.approx(np.hypot(*points.T).mean(), rel=2e-3)


def test_mean_pressure_distances_of_the_reference() -> None:
    """2R/3 for a disc, 29.8 mm for 58 × 95 mm, 0.3826 of a square's side (hand-mechanics reference 8)."""
    assert Disc(0.06).mean_pressure_distance_m == pytest.approx(0.02)
    assert Rectangle(0.058, 0.095).mean_pressure_distance_m == pytest.approx(0.0298, abs=5e-5)
    assert Rectangle(0.1, 0.1).mean_pressure_distance_m == pytest.approx(0.03826, abs=1e-6)
    assert Sphere(0.06).mean_pressure_distance_m == 0.0


@given(half_width=st.floats(0.005, 0.2), half_depth=st.floats(0.005, 0.2))
def test_rectangle_obeys_the_formula_of_the_reference(half_width: float, half_depth: float) -> None:
    """The integral over triangles is the closed form that hand-mechanics reference 8 gives."""
    a, b, d = half_width, half_depth, math.hypot(half_width, half_depth)
    expected = d / 3 + a * a / (6 * b) * math.log((b + d) / a) + b * b / (6 * a) * math.log((a + d) / b)
    assert Rectangle(2 * a, 2 * b).mean_pressure_distance_m == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("angle_rad", [0.0, 0.7, 2.0, -1.3])
def test_extent_is_that_of_the_outline(shape: Shape, angle_rad: float) -> None:
    """The extent along a direction is what the outline's points span there; the outline runs counter-clockwise."""
    outline = shape.outline_m(40000)
    along = outline @ [math.cos(angle_rad), math.sin(angle_rad)]
    assert shape.extent_m(angle_rad) == pytest.approx(np.ptp(along), rel=1e-4)
    following = np.roll(outline, -1, axis=0)
    assert (outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]).sum() > 0


def test_constant_support_function_is_a_disc() -> None:
    """A curve with the radius as its only coefficient measures what the disc does."""
    curve, disc = Curve((0.02,)), Disc(0.04)
    assert curve.area_m2 == pytest.approx(disc.area_m2, rel=1e-14)
    assert curve.mean_pressure_distance_m == pytest.approx(disc.mean_pressure_distance_m, rel=1e-14)
    assert curve.extent_m(0.3) == pytest.approx(disc.extent_m(0.3), rel=1e-14)


def test_polygon_with_many_sides_becomes_the_disc() -> None:
    """A regular polygon's measures approach the circle's with the square of the side."""
    coarse, fine = regular(20, 0.02), regular(40, 0.02)
    errors = [shape.mean_pressure_distance_m - 0.04 / 3 for shape in (coarse, fine)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.02)
    assert abs(errors[1]) < 3e-5


@pytest.mark.parametrize(
    ("vertices", "said"),
    [
        (((0, 0), (0.1, 0)), "three vertices"),
        (((-0.02, -0.01), (0.0, 0.02), (0.02, -0.01)), "clockwise"),
        (((0.03, 0.0), (0.0, 0.03), (-0.03, 0.0), (0.0, 0.01)), "turns left at every vertex"),
        (((0.03, -0.03), (0.03, 0.0), (0.03, 0.03), (-0.03, 0.03), (-0.03, -0.03)), "turns left at every vertex"),
        (tuple((0.03 * math.cos(a), 0.03 * math.sin(a)) for a in 4 * np.pi / 5 * np.arange(5)), "720° in all"),
        (((0.03, 0.0), (0.03, 0.00001), (0.0, 0.03), (-0.03, 0.0)), "apart"),
        (((0.0, 0.0), (0.03, 0.0), (0.0, 0.03)), "it is at (0.010000, 0.010000) m"),
        (((math.inf, 0.0), (0.0, 0.03), (-0.03, 0.0)), "finite"),
    ],
)
def test_what_is_no_convex_polygon_is_refused(vertices: tuple[tuple[float, float], ...], said: str) -> None:
    """Clockwise, reflex, straight, star-shaped, doubled or off-centre vertices say which they are."""
    with pytest.raises(FieldError) as caught:
        Polygon(vertices)
    assert caught.value.key == "vertices_m"
    assert said in caught.value.accepted


@pytest.mark.parametrize(
    ("cos_m", "sin_m", "said"),
    [
        ((), (), "mean distance"),
        ((-0.02,), (), "convex"),
        ((0.02, 0.0, 0.0067), (), "convex"),
        ((0.02, 0.0, 0.0), (0.0, 0.0, 0.0026), "convex"),
        ((0.02, 0.001), (), "it is at (0.001000, 0.000000) m"),
        ((0.02, math.nan), (), "finite"),
    ],
)
def test_what_is_no_convex_curve_is_refused(cos_m: tuple[float, ...], sin_m: tuple[float, ...], said: str) -> None:
    """h + h'' ≤ 0 anywhere, an off-centre centroid and missing coefficients say what they are."""
    with pytest.raises(FieldError) as caught:
        Curve(cos_m, sin_m)
    assert caught.value.key == "support_cos_m"
    assert said in caught.value.accepted


def test_the_limit_of_convexity_is_sharp() -> None:
    """h = R + a cos 2ψ is convex up to a = R/3, and accepted up to there."""
    Curve((0.03, 0.0, 0.00999))
    with pytest.raises(FieldError):
        Curve((0.03, 0.0, 0.01001))
