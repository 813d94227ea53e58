"""Points of all hands: derivatives against differences, the left finger against the mirror image of the right one."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.hand.bundle import Bundle, Complexes, Reals
from calibration.hand.finger import FingerModel, finger_models
from calibration.hand.parameters import load_hand

HANDS = ("t42pp", "t42pf", "t42ff", "t42pf_tactile")
POINTS: dict[str, Callable[[FingerModel], Bundle]] = {
    "tip": lambda finger: finger.tip,
    "pad": lambda finger: finger.links[1].point(0.02, 0.006),
    "knuckle": lambda finger: finger.links[0].point(*finger.links[0].inner_corners_m[1]),
}
STEP = 1e-3


@cache
def fingers(name: str) -> tuple[FingerModel, FingerModel]:
    return finger_models(load_hand(name))


def vectors(seed: int, finger: FingerModel) -> Reals:
    """Configuration and two directions, (3, 1, n): joint angles to both sides of rest, shapes bent as in use."""
    return np.random.default_rng(seed).uniform(-1.0, 1.5, (3, 1, finger.stiffness_Nm_per_rad.size))


def slope(function: Callable[[Reals], Complexes], q: Reals, direction: Reals) -> Complexes:
    """Directional derivative by the five-point rule; its error is of order STEP⁴."""
    f = [function(q + k * STEP * direction) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * STEP)


@pytest.mark.parametrize("name", HANDS)
@pytest.mark.parametrize("point", POINTS)
@given(seed=st.integers(0, 10**6), side=st.sampled_from([0, 1]))
def test_derivatives_are_those_of_the_point(name: str, point: str, seed: int, side: int) -> None:
    """Gradient, Hessian and directed third derivative, each to 1e-9 of the finger's 0.1 m."""
    finger = fingers(name)[side]
    bundle = POINTS[point](finger)
    q, u, v = vectors(seed, finger)
    jet = bundle.at(q)
    assert slope(lambda x: bundle.at(x).value, q, u) == pytest.approx((jet.gradient * u).sum(1), abs=1e-10)
    curved = np.einsum("bjk,bk->bj", jet.hessian, u)
    assert slope(lambda x: bundle.at(x).gradient, q, u) == pytest.approx(curved, abs=1e-10)
    twice = slope(lambda x: np.einsum("bjk,bk->bj", bundle.at(x).hessian, u), q, v)
    assert twice == pytest.approx(bundle.third(q, u, v), abs=1e-10)


@pytest.mark.parametrize("name", HANDS)
@given(seed=st.integers(0, 10**6))
def test_left_finger_mirrors_the_right_one(name: str, seed: int) -> None:
    """Every point x + iy of the right finger stands at −x + iy in the left one, and links turn the other way."""
    right, left = fingers(name)
    q = vectors(seed, right)[0]
    for point in POINTS.values():
        there, here = point(right).at(q), point(left).at(q)
        assert here.value == pytest.approx(-there.value.conj(), abs=1e-16)
        assert here.gradient == pytest.approx(-there.gradient.conj(), abs=1e-16)
    turned = right.angle_rad + q @ right.angle_row
    assert left.angle_rad + q @ left.angle_row == pytest.approx(np.pi - turned, abs=1e-14)
