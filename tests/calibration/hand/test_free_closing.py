"""Free closing: balance of springs and tendon for every law, both branches and at the stops."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

from calibration.hand.bundle import Reals
from calibration.hand.finger import FingerModel, finger_model
from calibration.hand.parameters import (
    FlexureJoint,
    PinJoint,
    StraightTendonAtFlexure,
    StraightTendonAtPin,
    Tip,
    load_hand,
)

OFFSET_M = 0.008
PIN = PinJoint(
    stiffness_Nm_per_rad=0.029, flexion_limit_deg=(-10, 60), tendon=StraightTendonAtPin(before_m=0.005, after_m=0.007)
)
FLEXURE = FlexureJoint(
    length_m=0.010, bending_stiffness_Nm2=7.26e-4, flexion_limit_deg=(0, 60), tendon=StraightTendonAtFlexure()
)
STRAIGHT = msgspec.structs.replace(load_hand("t42pf").right, proximal_joint=PIN, distal_joint=FLEXURE)


def model(routing_friction: float = 0.0, name: str = "") -> FingerModel:
    finger = load_hand(name, "nominal").right if name else STRAIGHT
    return finger_model(msgspec.structs.replace(finger, routing_friction=routing_friction), 0.03, mirrored=False)


def moment_Nm(finger: FingerModel, q: Reals, load_N: float, branch_sign: float) -> Reals:
    """What is left of k q − Σ T_j ∇l_j when the tension falls or rises by exp(∓c) between the joints."""
    tensions = load_N * np.array([1.0, math.exp(-branch_sign * finger.routing_loss)])
    left: Reals = finger.stiffness_Nm_per_rad * q - tensions @ finger.tendon.at(q[None]).gradient[0]
    return left


@pytest.mark.parametrize("name", ["", "t42pp", "t42pf", "t42ff"])
@given(load_N=st.floats(0, 3.0), loss=st.floats(0, 0.5))
def test_every_joint_balances_its_own_tension(name: str, load_N: float, loss: float) -> None:
    """k q = T_j ∇l_j at every coordinate, T_D = T exp(−c) while winding, T exp(c) while unwinding."""
    finger = model(loss, name)
    winding, unwinding = finger.free_closing(load_N), finger.free_closing(load_N, "unwinding")
    assert moment_Nm(finger, winding, load_N, 1.0) == pytest.approx(0.0, abs=1e-14)
    assert moment_Nm(finger, unwinding, load_N, -1.0) == pytest.approx(0.0, abs=1e-14)


@given(load_N=st.floats(0.1, 3.6))
def test_a_pin_turns_as_its_closed_form_says(load_N: float) -> None:
    """k θ = T × distance of the straight line from the pin, solved by bracketing."""

    def unbalanced(angle: float) -> float:
        first, last = complex(-0.005, OFFSET_M), complex(0.007, OFFSET_M) * complex(np.exp(1j * angle))
        return float(0.029 * angle - load_N * (last.conjugate() * first).imag / abs(last - first))

    angle = brentq(unbalanced, 0.0, 1.2, xtol=1e-15, rtol=1e-14)
    assert model().free_closing(load_N)[0] == pytest.approx(min(angle, math.radians(60)), abs=1e-12)


def test_a_flexure_under_a_straight_tendon_has_the_least_energy() -> None:
    """V − T l over angle and shape, minimised without derivatives and with its own integral of the curve."""
    load_N, nodes, weights = 6.0, *np.polynomial.legendre.leggauss(30)

    def energy(a: Reals) -> float:
        turned = np.polynomial.legendre.Legendre(a).integ(lbnd=-1)
        end = 0.010 * complex((weights * np.exp(0.5j * turned(nodes))).sum() / 2)
        guides = end + 1j * OFFSET_M * (np.exp(1j * a[0]) - 1)
        bending = 0.5 * 0.0726 * float(a @ (a / np.array([1, 3, 5])))
        return float(1e3 * (bending - load_N * (0.010 - abs(guides))))

    found = minimize(energy, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-14}).x
    q = model().free_closing(load_N)[1:]
    assert q == pytest.approx(found, abs=1e-5)
    assert q[1] == pytest.approx(0.0, abs=1e-12)
    assert abs(q[2]) > 1e-3


@pytest.mark.parametrize("name", ["t42pf", "t42ff", "t42pf_tactile"])
@given(load_N=st.floats(0, 200))
def test_constant_offset_excites_no_shape(name: str, load_N: float) -> None:
    """The tendon bends a flexure to a circular arc: T r / k at the joint angles, clipped at the stops."""
    finger = finger_model(load_hand(name).left, 0.03, mirrored=True)
    q, joints = finger.free_closing(load_N), list(finger.joint_index)
    expected = np.minimum(load_N * OFFSET_M / finger.stiffness_Nm_per_rad[joints], finger.upper_rad[joints])
    assert q[joints] == pytest.approx(expected)
    assert not np.delete(q, joints).any()


@pytest.mark.parametrize("name", ["", "t42pp", "t42ff"])
def test_work_of_the_tendon_is_stored(name: str) -> None:
    """dV = Σ T_j dl_j along free closing, by central differences; with no loss dV/dl = T."""
    finger, load_N, step_N = model(0.0, name), 3.0, 1e-3
    after, before = (finger.free_closing(load_N + sign * step_N) for sign in (1, -1))
    stored = 0.5 * float(finger.stiffness_Nm_per_rad @ (after**2 - before**2))
    wound = float((finger.tendon.at(after[None]).value - finger.tendon.at(before[None]).value).sum())
    assert stored / wound == pytest.approx(load_N, rel=1e-7)


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("name", ["", "t42pp", "t42ff"])
def test_stiffness_is_the_slope_of_load_over_excursion(name: str, loss: float) -> None:
    """At rest, while winding."""
    finger, load_N = model(loss, name), 1e-5
    wound = float(finger.tendon.at(finger.free_closing(load_N)[None]).value.sum())
    assert finger.free_closing_stiffness_N_per_m == pytest.approx(load_N / wound, rel=1e-5)


def test_straight_tendons_stop_at_the_stops() -> None:
    """The angle grows steadily with the load up to its stop; then nothing moves any more, not even at 500 N."""
    finger = model()
    loads_N = np.append(np.linspace(0, 20, 41), 500.0)
    q = np.array([finger.free_closing(load_N) for load_N in loads_N])
    angles, stops = q[:, list(finger.joint_index)], finger.upper_rad[list(finger.joint_index)]
    moving = angles[:-1] < stops
    assert np.all(np.diff(angles, axis=0)[moving] > 0)
    assert q[-1] == pytest.approx(q[-2])
    assert angles[-1] == pytest.approx(stops)
    met_N = brentq(lambda load_N: finger.free_closing(load_N)[1] - stops[1] + 1e-9, 5.0, 20.0)
    assert finger.free_closing(met_N) == pytest.approx(q[-1], abs=1e-8)


@pytest.mark.parametrize(
    ("name", "diameter_m", "load_N", "height_m"),
    [
        ("t42pp", 0.030, 4.07, 0.0964),
        ("t42pp", 0.045, 3.83, 0.0973),
        ("t42pf", 0.030, 4.08, 0.0979),
        ("t42pf", 0.045, 3.84, 0.0987),
        ("t42ff", 0.030, 4.58, 0.0948),
        ("t42ff", 0.045, 4.32, 0.0968),
    ],
)
def test_fingers_meet_where_the_reference_says(name: str, diameter_m: float, load_N: float, height_m: float) -> None:
    """Load and height at which tip arcs of 6 mm first touch a disc (reference 10, nominal): rest angles, roots,
    lengths and springs of all three hands at once."""
    hand = load_hand(name, "nominal")
    finger = msgspec.structs.replace(hand.right, tip=Tip(0.006))
    right = finger_model(finger, hand.root_half_distance_m, mirrored=False)

    def tip(load_N: float) -> complex:
        return complex(right.tip.at(right.free_closing(load_N)[None]).value[0])

    touching_N = brentq(lambda load_N: tip(load_N).real - diameter_m / 2 - 0.006, 2.0, 6.0)
    assert touching_N == pytest.approx(load_N, abs=0.011)
    assert tip(touching_N).imag == pytest.approx(height_m, abs=6e-5)
