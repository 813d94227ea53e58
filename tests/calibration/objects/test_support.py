"""Support functions: points, arcs and nearest points against plain sampling."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.objects.support import SupportFunction

PEAR = SupportFunction((0.04155, 0.0, -0.00845), (0.00080375, 0.0, -0.0015))
FINE = np.linspace(-np.pi, np.pi, 400001)
OUTLINE = PEAR.point(FINE)


def test_derivatives_are_derivatives() -> None:
    """∫h, h, h', …: each is the slope of the one before."""
    psi, step = np.linspace(-3, 3, 7), 1e-5
    ahead, behind, here = (PEAR.derivatives(psi + shift, 4) for shift in (step, -step, 0.0))
    for level in range(5):
        assert (ahead[level] - behind[level]) / (2 * step) == pytest.approx(here[level + 1], abs=1e-10)
    assert PEAR.derivatives(np.array([0.0]), 0)[0] == pytest.approx([0.0], abs=1e-18)


def test_arc_length_is_travelled_along_the_outline() -> None:
    """h' + ∫h is the length of the polyline through the outline's points."""
    integral, _, slope = PEAR.derivatives(FINE, 1)
    travelled = integral + slope
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(OUTLINE)))])
    assert np.abs(travelled - travelled[0] - length).max() < 1e-10


@given(angle=st.floats(-3.1, 3.1), distance=st.floats(-0.002, 0.2))
def test_foot_is_the_nearest_point(angle: float, distance: float) -> None:
    """From outside, and from slightly inside, the foot's point is the nearest of the outline."""
    place = PEAR.point(np.array([angle])) + distance * np.exp(1j * angle)
    foot = PEAR.foot(place)
    assert np.exp(1j * foot) == pytest.approx(np.exp(1j * np.array([angle])), abs=1e-11)
    if distance > 0:
        assert abs(PEAR.point(foot) - place)[0] <= np.abs(OUTLINE - place).min() + 1e-12


def test_foot_of_a_circle_is_the_direction() -> None:
    """A constant support function needs no search."""
    places = np.array([0.05 + 0.01j, -0.03 - 0.03j])
    assert SupportFunction((0.02,)).foot(places) == pytest.approx(np.angle(places))


def test_smallest_radius_is_a_bound_and_near() -> None:
    """The bound lies below every sampled radius of curvature, by less than a micrometre."""
    h, _, curve = PEAR.derivatives(FINE, 2)[1:]
    assert (h + curve).min() - 1e-6 < PEAR.smallest_radius_m <= (h + curve).min()
