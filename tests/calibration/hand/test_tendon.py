"""Tendon laws against the reference's closed forms and numbers, and against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.hand.bundle import Reals
from calibration.hand.joints import JointModel, joint_model
from calibration.hand.parameters import FlexureJoint, PinJoint
from calibration.hand.tendon import StraightRun, TendonModel, constant_offset, straight_run

OFFSET_M = 0.008
FLEXURE = joint_model(
    FlexureJoint(length_m=0.010, bending_stiffness_Nm2=7.26e-4, coordinates=3, flexion_limit_deg=(0, 60))
)
PIN = joint_model(PinJoint(stiffness_Nm_per_rad=0.029, flexion_limit_deg=(0, 60)))
PAST_FLEXURE = straight_run(FLEXURE, OFFSET_M)
PAST_PIN = straight_run(PIN, OFFSET_M, 0.005, 0.005)
MODEL = TendonModel((PAST_PIN, PAST_FLEXURE), (slice(0, 1), slice(1, 4)))
STEP = 1e-3


def slope(function: Callable[[Reals], Reals], q: Reals, direction: Reals) -> Reals:
    """Directional derivative by the five-point rule; its error is of order STEP⁴."""
    f = [function(q + k * STEP * direction) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * STEP)


def arm_m(law: StraightRun, angle: float, size: int) -> float:
    """dl/dθ with the flexure bent to a circular arc."""
    return float(law.at(np.eye(1, size) * angle).gradient[0, 0])


@pytest.mark.parametrize(("angle", "arm_mm"), [(0.0, 8.0), (0.2, 8.13), (0.5, 8.17), (1.0, 7.83), (1.2499, 7.49)])
def test_arm_past_a_flexure(angle: float, arm_mm: float) -> None:
    """Values of reference 4 for a 10 mm flexure and 8 mm offset."""
    assert 1e3 * arm_m(PAST_FLEXURE, angle, 3) == pytest.approx(arm_mm, abs=0.006)


@given(angle=st.floats(0.01, 1.2))
def test_excursion_past_a_flexure(angle: float) -> None:
    """Closed form for circular bending: l = L − 2 (L/θ − r) sin(θ/2)."""
    expected = 0.010 - 2 * (0.010 / angle - OFFSET_M) * np.sin(angle / 2)
    assert PAST_FLEXURE.at(np.array([[angle, 0.0, 0.0]])).value[0] == pytest.approx(expected, abs=1e-15)


def test_straight_and_constant_meet_where_the_guides_do() -> None:
    """At θ = L/r both laws have taken up the flexure's whole length."""
    q = np.array([[0.010 / OFFSET_M, 0.0, 0.0]])
    with np.errstate(all="ignore"):
        straight = PAST_FLEXURE.at(q).value[0]
    assert straight == pytest.approx(constant_offset(FLEXURE, OFFSET_M).at(q).value[0], abs=1e-15)
    assert straight == pytest.approx(0.010, abs=1e-15)


@given(angle=st.floats(-1.0, 1.0), before=st.floats(0.004, 0.02), after=st.floats(0.004, 0.02))
def test_past_a_pin_the_arm_is_the_distance_of_the_tendon(angle: float, before: float, after: float) -> None:
    """dl/dθ is the distance of the straight line from the pin: twice the triangle's area by its base."""
    law = straight_run(PIN, OFFSET_M, before, after)
    first, last = complex(-before, OFFSET_M), complex(after, OFFSET_M) * np.exp(1j * angle)
    distance = (last.conjugate() * first).imag / abs(last - first)
    assert arm_m(law, angle, 1) == pytest.approx(distance, abs=1e-12)
    rest = before + after
    assert law.at(np.array([[angle]])).value[0] == pytest.approx(rest - abs(last - first), abs=1e-15)


def test_past_a_pin_the_arm_grows() -> None:
    """8.0 → 9.4 mm at 1 rad with guides 5 mm before and behind the pin (reference 4)."""
    assert 1e3 * arm_m(PAST_PIN, 0.0, 1) == pytest.approx(8.0)
    assert 1e3 * arm_m(PAST_PIN, 1.0, 1) == pytest.approx(9.4, abs=0.05)


@given(seed=st.integers(0, 10**6))
def test_derivatives_are_those_of_the_excursion(seed: int) -> None:
    """Gradient, Hessian and directed third derivative of the whole tendon, with bent shapes, to 1e-9."""
    rng = np.random.default_rng(seed)
    q = rng.uniform([[-0.3, -0.3, -0.5, -0.5]], [[0.9, 1.0, 0.5, 0.5]])
    u, v = rng.uniform(-1, 1, (2, 1, 4))
    jet = MODEL.at(q)
    assert slope(lambda x: MODEL.at(x).value, q, u) == pytest.approx(jet.gradient @ u[0], abs=1e-11)
    curved = jet.hessian @ u[0]
    assert slope(lambda x: MODEL.at(x).gradient, q, u) == pytest.approx(curved, rel=1e-9, abs=1e-10)
    twice = slope(lambda x: MODEL.at(x).hessian @ u[0], q, v)
    assert twice == pytest.approx(MODEL.third(q, u, v), rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("joint", [FLEXURE, PIN])
def test_constant_offset_is_linear_in_the_angle(joint: JointModel) -> None:
    """l = r Δθ whatever the flexure's shape; no second or third derivative."""
    law = constant_offset(joint, OFFSET_M)
    q = np.random.default_rng(0).normal(size=(5, joint.size))
    jet = law.at(q)
    assert law.linear
    assert jet.value == pytest.approx(OFFSET_M * q[:, 0])
    assert not jet.hessian.any()
    assert not law.third(q, q, q).any()
