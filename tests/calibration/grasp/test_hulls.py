"""Distances of convex bodies, against a fine search over all directions and against plain geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.grasp.hulls import Hull, SmoothBody, separation_m
from calibration.hand.finger import Complexes, Reals
from calibration.objects.support import SupportFunction

ALL_ROUND: Complexes = np.exp(1j * np.linspace(0, 2 * np.pi, 8001))[None]
SHALLOW = -0.1
"""Deeper than this nobody asks how deep: a motion ends where bodies begin to overlap."""
SEARCHED = 2e-3
"""Half a step of 8e-4 rad times the 4 m or so that bodies of this test are apart or large."""


def by_search(first: Hull | SmoothBody, second: Hull) -> float:
    """Largest gap seen from 8000 directions; short of the truth by less than `SEARCHED`."""
    return float((-second.reach_m(-ALL_ROUND) - first.reach_m(ALL_ROUND)).max())


def hull(seed: int, corners: int, centre: complex, radius: float) -> Hull:
    random = np.random.default_rng(seed)
    spread = random.uniform(-0.3, 0.3, corners)  # no corner within the rounded one
    angles = np.arange(corners) * 2 * np.pi / corners + spread + random.uniform(0, 2 * np.pi)
    radii: Reals = np.zeros(corners)
    radii[0] = radius
    return Hull((centre + np.exp(1j * angles))[None], radii)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), x=st.floats(-3, 3), y=st.floats(-3, 3), radius=st.floats(0, 0.5))
def test_sign_and_depth_are_those_of_all_directions(seed: int, x: float, y: float, radius: float) -> None:
    """Never more than the truth; equal to it where hulls begin to overlap, so that a crossing is found where it is."""
    first, second = hull(seed, 4, 0j, radius), hull(seed + 1, 3, complex(x, y), 0.0)
    found, truth = float(separation_m(first, second)[0]), by_search(first, second)
    assert found <= truth + SEARCHED
    assert abs(truth) < SEARCHED or (found > 0) == (truth > 0)
    if SHALLOW < truth < 0:
        assert found == pytest.approx(truth, abs=SEARCHED)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), x=st.floats(-3, 3), y=st.floats(-3, 3), turn=st.floats(-3, 3))
def test_smooth_outline_against_a_hull(seed: int, x: float, y: float, turn: float) -> None:
    """The same for an outline given by its support function, wherever it stands and however it is turned."""
    outline = SmoothBody(
        SupportFunction((0.8, 0.0, 0.1, 0.03), (0.0, 0.05)), np.array([complex(x, y)]), np.array([turn])
    )
    other = hull(seed, 4, 0j, 0.0)
    found, truth = float(separation_m(outline, other)[0]), by_search(outline, other)
    assert found <= truth + SEARCHED
    assert abs(truth) < SEARCHED or (found > 0) == (truth > 0)


def test_discs_are_as_far_apart_as_their_rims() -> None:
    """Two discs and a disc over an edge: schoolbook distances."""
    disc = Hull(np.array([[3 + 4j]]), np.array([1.0]))
    assert separation_m(Hull(np.array([[0j]]), np.array([1.5])), disc) == pytest.approx([2.5])
    square = Hull(np.array([[0, 2, 2 + 2j, 2j]]), np.zeros(4))
    assert separation_m(disc, square) == pytest.approx([np.hypot(1, 2) - 1])
    assert separation_m(Hull(np.array([[1 + 2.5j]]), np.array([1.0])), square) == pytest.approx([-0.5])
