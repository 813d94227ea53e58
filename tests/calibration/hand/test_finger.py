"""Finger kinematics against plain trigonometry and central differences."""

import math

import numpy as np
import pytest

from calibration.hand.finger import finger_models
from calibration.hand.parameters import load_hand

HAND = load_hand("t42pp")


@pytest.mark.parametrize(("side", "sign"), [(0, 1.0), (1, -1.0)])
def test_tip_is_where_trigonometry_puts_it(side: int, sign: float) -> None:
    """Rest angles, link lengths, the tip's arc and the mirroring of the left finger."""
    finger, q = HAND.fingers[side], (0.7, 0.4)
    first = math.radians(15) + q[0]
    second = first + math.radians(15) + q[1]
    x = HAND.root_half_distance_m + finger.proximal_link_m * math.cos(first)
    x += (finger.distal_link_m - finger.tip.radius_m) * math.cos(second)
    y = finger.proximal_link_m * math.sin(first) + (finger.distal_link_m - finger.tip.radius_m) * math.sin(second)
    model = finger_models(HAND)[side]
    assert complex(model.tip.at(np.array([q])).value[0]) == pytest.approx(complex(sign * x, y), abs=1e-15)
    angle = model.angle_rad + model.angle_row @ np.array(q)
    assert angle == pytest.approx(second if side == 0 else math.pi - second)


@pytest.mark.parametrize("side", [0, 1])
def test_derivatives_are_those_of_the_point(side: int) -> None:
    """Gradient, Hessian and directed third derivative, each against central differences of the one below."""
    tip, step = finger_models(HAND)[side].tip, 1e-5
    rng = np.random.default_rng(side)
    q, u, v = rng.uniform(0, 1.5, (1, 2)), rng.normal(size=(1, 2)), rng.normal(size=(1, 2))
    jet = tip.at(q)
    for k, shift in enumerate(np.eye(2) * step):
        ahead, behind = tip.at(q + shift), tip.at(q - shift)
        assert (ahead.value - behind.value) / (2 * step) == pytest.approx(jet.gradient[:, k], abs=1e-10)
        assert (ahead.gradient - behind.gradient) / (2 * step) == pytest.approx(jet.hessian[:, k], abs=1e-10)
    change = (tip.at(q + step * v).hessian - tip.at(q - step * v).hessian) / (2 * step)
    assert np.einsum("bjk,bk->bj", change, u) == pytest.approx(tip.third(q, u, v), abs=1e-9)


def test_free_closing_balances_spring_and_tendon() -> None:
    """T r = k q at both joints, excursion r Σ q, and the stops hold."""
    model, load = finger_models(HAND)[0], 20.0
    q = model.free_closing(load)
    assert model.stiffness_Nm_per_rad * q == pytest.approx(model.tendon_arm_m * load)
    assert model.free_closing_stiffness_N_per_m == pytest.approx(load / float(model.tendon_arm_m @ q))
    assert np.all(model.free_closing(1e4) == model.upper_rad)
