"""Rolling contact: geometry against plain trigonometry, derivatives against central differences."""

import numpy as np
import pytest

from calibration.grasp.contact import RollingContact, rolling_contact
from calibration.hand.finger import Reals, finger_models
from calibration.hand.parameters import load_hand
from calibration.objects import Disc

RADIUS_M = 0.02
FINGERS = finger_models(load_hand("t42pp"))


def touching(side: int) -> tuple[RollingContact, Reals]:
    """A contact, and its unknowns (joints, then object pose) at first contact."""
    finger, q = FINGERS[side], np.array([0.9, 0.5])
    direction = np.exp(0.1j) * (-1 if side == 0 else 1)
    centre = complex(finger.tip.at(q[None]).value[0]) + (RADIUS_M + finger.tip_radius_m) * direction
    pose = np.array([centre.real, centre.imag, 0.0])
    return rolling_contact(finger, Disc(2 * RADIUS_M), q, pose), np.concatenate([q, pose])


@pytest.mark.parametrize("side", [0, 1])
def test_gap_and_rolling_mean_what_they_say(side: int) -> None:
    """Rolling round a held tip by an angle turns the disc by (R + ρ)/R of it; a shift along the normal is a gap."""
    contact, z = touching(side)
    finger = FINGERS[side]
    distance, angle = RADIUS_M + finger.tip_radius_m, 0.8
    tip = complex(finger.tip.at(z[None, :2]).value[0])
    assert contact.at(z[None, :2], z[None, 2:]).value == pytest.approx(np.zeros((1, 2)), abs=1e-16)
    rolled = tip + (complex(z[2], z[3]) - tip) * np.exp(1j * angle)
    pose = np.array([[rolled.real, rolled.imag, angle * distance / RADIUS_M]])
    assert contact.at(z[None, :2], pose).value == pytest.approx(np.zeros((1, 2)), abs=1e-15)
    apart = tip + (rolled - tip) * (1 + 1e-6)
    gap = contact.at(z[None, :2], np.array([[apart.real, apart.imag, pose[0, 2]]])).value[0, 0]
    assert gap == pytest.approx(1e-6 * distance, rel=1e-5)


@pytest.mark.parametrize("side", [0, 1])
def test_derivatives_are_those_of_the_constraints(side: int) -> None:
    """Gradient, Hessian and directed third derivative, each against central differences of the one below."""
    contact, start = touching(side)
    rng = np.random.default_rng(side)
    z = start + rng.normal(size=5) * [0.05, 0.05, 1e-3, 1e-3, 0.1]
    u, v = rng.normal(size=(2, 5)) * [1, 1, 0.03, 0.03, 1]

    jet = contact.at(z[None, :2], z[None, 2:])
    for k in range(5):
        step = 1e-5 if k in (0, 1, 4) else 1e-7
        shift = np.eye(5)[k] * step
        ahead = contact.at((z + shift)[None, :2], (z + shift)[None, 2:])
        behind = contact.at((z - shift)[None, :2], (z - shift)[None, 2:])
        slope = (ahead.value - behind.value) / (2 * step)
        assert slope == pytest.approx(jet.gradient[:, :, k], abs=1e-8)
        curve = (ahead.gradient - behind.gradient) / (2 * step)
        assert curve == pytest.approx(jet.hessian[:, :, k], rel=1e-7, abs=1e-7)
    step = 1e-5
    ahead, behind = (contact.at((z + sign * step * v)[None, :2], (z + sign * step * v)[None, 2:]) for sign in (1, -1))
    change = (ahead.hessian - behind.hessian) / (2 * step)
    third = contact.third(z[None, :2], z[None, 2:], u[None], v[None])
    assert np.einsum("bcjk,k->bcj", change, u) == pytest.approx(third, rel=1e-5, abs=1e-6)
