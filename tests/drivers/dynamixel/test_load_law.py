"""The current–tension law against the rows of the dynamixel reference."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel.load_law import LoadLaw, SpoolMotion
from drivers.errors import InputError

LAW = LoadLaw()


@pytest.mark.parametrize(
    ("current_A", "tension_N"), [(0.2, 12), (0.347, 37), (0.5, 63), (0.697, 97), (1.0, 148), (1.743, 275)]
)
def test_winding_gives_the_rows_of_the_reference(current_A: float, tension_N: float) -> None:
    """Reference 3.2: tensions worked out there for known currents, to its rounding."""
    assert LAW.tension(current_A, SpoolMotion.WINDING).tension_N == pytest.approx(tension_N, abs=0.8)


def test_holding_band_is_the_gear_friction() -> None:
    """Reference 3.3: a standing spool tells the tension to ±22 N and no better."""
    estimate = LoadLaw(slope_uncertainty=0.0).tension(0.5, SpoolMotion.HOLDING)
    assert estimate.high_N - estimate.tension_N == pytest.approx(22, abs=0.5)
    assert LAW.friction_tension_N == pytest.approx(22, abs=0.5)


@given(st.floats(0.0, 300.0))
def test_cap_is_the_inverse_of_winding(tension_N: float) -> None:
    """A motor that stalls at the cap's current while winding pulls with the cap."""
    assert LAW.tension(LAW.current_cap_A(tension_N), SpoolMotion.WINDING).tension_N == pytest.approx(
        tension_N, abs=1e-9
    )


@given(st.floats(-3.0, 3.0), st.sampled_from(SpoolMotion))
def test_estimate_lies_in_its_band_and_never_pushes(current_A: float, motion: SpoolMotion) -> None:
    """A tendon cannot push, and friction puts holding between winding and unwinding."""
    estimate = LAW.tension(current_A, motion)
    assert 0.0 <= estimate.low_N <= estimate.tension_N <= estimate.high_N
    winding, unwinding = (LAW.tension(current_A, m).tension_N for m in (SpoolMotion.WINDING, SpoolMotion.UNWINDING))
    assert winding <= LAW.tension(current_A, SpoolMotion.HOLDING).tension_N <= unwinding


def test_motion_follows_the_rate() -> None:
    """One count of velocity (0.25 mm/s) is not motion."""
    motions = [LAW.motion(rate) for rate in (0.01, 0.00025, 0.0, -0.00025, -0.01)]
    holding = SpoolMotion.HOLDING
    assert motions == [SpoolMotion.WINDING, holding, holding, holding, SpoolMotion.UNWINDING]


@pytest.mark.parametrize("cap_N", [math.nan, math.inf, -1.0])
def test_cap_refuses_what_is_no_tension(cap_N: float) -> None:
    """NaN in a cap must not become a current."""
    with pytest.raises(InputError, match="load cap"):
        LAW.current_cap_A(cap_N)


def test_law_refuses_impossible_constants() -> None:
    """A law with a zero slope would divide by it."""
    with pytest.raises(InputError, match="not a load law"):
        LoadLaw(torque_constant_Nm_per_A=0.0)
