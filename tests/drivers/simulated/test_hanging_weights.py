"""Weights on cords against what a pendulum bob's equations say: statics, a bounce's frequency, energy."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.simulated.hanging_weights import HangingWeights

G = 9.80665


def held(mass_kg: float) -> HangingWeights:
    """One weight on a spool that gear friction holds."""
    return HangingWeights((mass_kg,), friction_Nm=100.0, inertia_kgm2=0.0125)


@given(st.floats(0.05, 20.0))
def test_a_weight_that_hangs_still_pulls_by_its_weight(mass_kg: float) -> None:
    """And goes on doing so."""
    weights = held(mass_kg)
    for _ in range(50):
        weights.step(5e-4)
    assert weights.tension_N(0) == pytest.approx(G * mass_kg, rel=1e-9)


def test_a_bounce_has_the_frequency_of_mass_and_cord() -> None:
    """ω² = k/m, and it dies away."""
    weights = HangingWeights((4.0,), friction_Nm=100.0, inertia_kgm2=0.0125, cord_N_per_m=1e4)
    weights.hang(0, 4.0, 0.002)
    pulls_N = []
    for _ in range(20_000):
        weights.step(1e-4)
        pulls_N.append(weights.tension_N(0) - 4.0 * G)
    rising = [i for i in range(1, len(pulls_N)) if pulls_N[i - 1] < 0.0 <= pulls_N[i]]
    period_s = (rising[10] - rising[0]) * 1e-4 / 10
    assert period_s == pytest.approx(2.0 * math.pi * math.sqrt(4.0 / 1e4), rel=0.01)
    assert max(map(abs, pulls_N[-1000:])) < 0.1 * max(map(abs, pulls_N[:1000]))


def test_a_spool_that_turns_evenly_lifts_at_constant_pull() -> None:
    """What the calibration relies on: at an even speed the tension is the weight."""
    weights = HangingWeights((2.0,), friction_Nm=0.2, inertia_kgm2=0.0125)
    for _ in range(20_000):
        wanted_rad_s = 0.3
        torque_Nm = 0.2 + 2.0 * G * 0.0105 + 5.0 * (wanted_rad_s - weights.shaft_velocity_rad_s(0))
        weights.set_shaft_torque_Nm(0, torque_Nm)
        weights.step(1e-4)
    assert weights.shaft_velocity_rad_s(0) == pytest.approx(0.3, rel=1e-3)
    assert weights.tension_N(0) == pytest.approx(2.0 * G, rel=1e-3)


@pytest.mark.parametrize("mass_kg", [-1.0, math.nan, math.inf, 1000.0])
def test_no_such_mass(mass_kg: float) -> None:
    """Told, and what hung there stays."""
    weights = held(1.0)
    with pytest.raises(InputError, match="cannot hang there"):
        weights.hang(0, mass_kg)
    assert weights.tension_N(0) == pytest.approx(G)


@pytest.mark.parametrize("key", ["friction_Nm", "inertia_kgm2", "spool_radius_m", "cord_N_per_m"])
def test_no_such_spool(key: str) -> None:
    """NaN in a plant would spread."""
    with pytest.raises(InputError, match=r"(hanging weights|spools) with"):
        HangingWeights((1.0,), **{"friction_Nm": 0.1, "inertia_kgm2": 0.01, key: math.nan})
