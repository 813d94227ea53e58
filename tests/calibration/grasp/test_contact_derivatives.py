"""Gradients, Hessians and third derivatives of every kind of contact against central differences of the one below."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from calibration.grasp.contact_arc import ArcOnRound, ArcOnSide
from calibration.grasp.contact_jet import RollingContact
from calibration.grasp.contact_pad import PadOnRound, TipOnRound
from calibration.hand.finger import FingerModel, Reals, finger_models
from calibration.hand.parameters import load_hand
from calibration.objects import Curve, Disc, Rectangle

PEAR = Curve((0.04155, 0.0, -0.00845), (0.00080375, 0.0, -0.0015)).support
DISC = Disc(0.04).support
TURN_RAD = 0.3
KINDS: dict[str, Callable[[FingerModel], RollingContact]] = {
    "arc on disc": lambda finger: ArcOnRound(finger, DISC, TURN_RAD),
    "arc on curve": lambda finger: ArcOnRound(finger, PEAR, TURN_RAD),
    "arc on side": lambda finger: ArcOnSide(finger, Rectangle(0.04, 0.06).sides[1], TURN_RAD, 0.01),
    "pad on disc": lambda finger: PadOnRound(finger, DISC, TURN_RAD),
    "pad on curve": lambda finger: PadOnRound(finger, PEAR, TURN_RAD),
    "tip on curve": lambda finger: TipOnRound(
        ArcOnRound(finger, PEAR, TURN_RAD), PadOnRound(finger, PEAR, TURN_RAD), 0.02
    ),
}
STEP = 1e-4


def fingers(name: str, radius_m: float) -> tuple[FingerModel, FingerModel]:
    """A packaged hand's fingers with another tip radius."""
    hand = load_hand(name, "nominal")
    finger = replace(hand.right, tip=replace(hand.right.tip, radius_m=radius_m))
    return finger_models(replace(hand, right=finger, left=finger))


FINGERS = {
    (name, radius_m): fingers(name, radius_m) for name in ("t42pp", "t42pf", "t42ff") for radius_m in (0.0, 0.0105)
}


def slope(function: Callable[[Reals], Reals], z: Reals, direction: Reals) -> Reals:
    """Derivative along `direction` by central differences of sixth order."""
    one, two, three = (function(z + k * STEP * direction) - function(z - k * STEP * direction) for k in (1, 2, 3))
    difference: Reals = (45 * one - 9 * two + three) / (60 * STEP)
    return difference


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("radius_m", [0.0, 0.0105])
@pytest.mark.parametrize("name", ["t42pp", "t42pf", "t42ff"])
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_derivatives_are_those_of_the_constraints(kind: str, name: str, radius_m: float, side: int, seed: int) -> None:
    """Whatever the finger, its tip, the outline and the state: derivatives agree to 1e-9 of their size."""
    rng = np.random.default_rng(seed)
    finger = FINGERS[name, radius_m][side]
    contact, n = KINDS[kind](finger), finger.angle_row.size
    q = rng.normal(size=n) * 0.2
    q[list(finger.joint_index)] += 0.7
    # anywhere but on the finger's back, where turns are cut, or, for the whole tip, about where pad and arc meet
    from_pad = rng.choice([0.5, -0.5]) if kind == "tip on curve" else rng.uniform(-2.5, 2.5)
    pad_normal = 1j * finger.links[1].inner_side * np.exp(1j * (finger.angle_rad + q @ finger.angle_row))
    away = rng.uniform(0.055, 0.09) * pad_normal * np.exp(1j * from_pad)
    centre = complex(finger.tip.at(q[None]).value[0]) + away
    z = np.concatenate([q, [centre.real, centre.imag, rng.normal() * 0.3]])
    scale = np.array([1.0] * n + [0.03, 0.03, 1.0])
    u, v = rng.normal(size=(2, n + 3)) * scale

    def value(at: Reals) -> Reals:
        both: Reals = contact.at(at[None, :n], at[None, n:]).value[0]
        return both

    def gradient(at: Reals) -> Reals:
        scaled: Reals = contact.at(at[None, :n], at[None, n:]).gradient[0] * scale
        return scaled

    def hessian_along_u(at: Reals) -> Reals:
        along: Reals = (contact.at(at[None, :n], at[None, n:]).hessian[0] @ u) * scale
        return along

    jet = contact.at(z[None, :n], z[None, n:])
    third = contact.third(z[None, :n], z[None, n:], u[None], v[None])[0] * scale
    for analytic, numeric in (
        (jet.gradient[0] @ v, slope(value, z, v)),
        ((jet.hessian[0] @ v) * scale, slope(gradient, z, v)),
        (third, slope(hessian_along_u, z, v)),
    ):
        assert np.abs(analytic - numeric).max() <= 1e-9 * max(np.abs(analytic).max(), 0.01)
    assert jet.hessian == pytest.approx(jet.hessian.transpose(0, 1, 3, 2), abs=1e-15)
