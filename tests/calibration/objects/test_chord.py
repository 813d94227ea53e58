"""Chords of outlines: ends on the outline, normals square to it, and lines that have none."""

import math

import numpy as np
import pytest

from calibration.objects import Disc, Polygon, Rectangle, Shape, load_object
from calibration.objects.chord import chord
from drivers.errors import MechanicsError

SHAPES = [
    Disc(0.04),
    Rectangle(0.058, 0.095),
    load_object("pear").shape,
    Polygon(((0.03, -0.01), (0, 0.03), (-0.03, -0.02))),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize(("direction_rad", "level_m"), [(0.0, 0.0), (0.3, 0.004), (-1.1, -0.006), (2.9, 0.002)])
def test_ends_lie_on_line_and_outline(shape: Shape, direction_rad: float, level_m: float) -> None:
    """Both ends are where the sampled outline crosses the line, with its outward normals there."""
    outline = shape.outline_m(400000) @ [1, 1j] * np.exp(-1j * direction_rad)
    crossing = np.flatnonzero((outline.imag < level_m) != (np.roll(outline, -1).imag < level_m))
    assert crossing.size == 2
    for end, index in zip(
        chord(shape, direction_rad, level_m), sorted(crossing, key=lambda i: -outline[i].real), strict=True
    ):
        along = outline[(index + 1) % outline.size] - outline[index]
        assert end.point.imag == pytest.approx(level_m, abs=1e-15)
        assert end.point == pytest.approx(complex(outline[index]), abs=2e-6)
        assert end.normal == pytest.approx(complex(-1j * along / abs(along)), abs=2e-4)


def test_chord_of_a_disc_is_exactly_symmetric() -> None:
    """Symmetric grasps stay symmetric to the last digit."""
    front, back = chord(Disc(0.04), 0.3, 0.005)
    assert front.point == -back.point.conjugate()
    assert front.normal == -back.normal.conjugate()
    assert abs(front.point) == pytest.approx(0.02, rel=1e-15)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_a_line_beside_the_object_says_what_would_meet_it(shape: Shape) -> None:
    """The offsets that the error names are the outline's extent."""
    with pytest.raises(MechanicsError, match="beside the object") as caught:
        chord(shape, 0.0, 0.06)
    assert caught.value.parameter == "object_offset_m"
    outline = shape.outline_m(100000)[:, 1]
    assert f"between {-outline.max() * 1e3:.1f} and {-outline.min() * 1e3:.1f} mm" in caught.value.help


@pytest.mark.parametrize(("direction_rad", "level_m"), [(math.pi / 4, 0.0), (0.0, 0.02 - 5e-6)])
def test_corners_are_refused(direction_rad: float, level_m: float) -> None:
    """A line through or nearly through a corner has no normal there."""
    with pytest.raises(MechanicsError, match="corner"):
        chord(Rectangle(0.04, 0.04), direction_rad, level_m)
