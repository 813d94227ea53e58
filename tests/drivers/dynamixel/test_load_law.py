"""The effort–tension law against the rows of the dynamixel reference, and its laws."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel.control_tables import MX_28, RX_28, XL430_W250, XM430_W210, XM430_W350
from drivers.dynamixel.load_law import LoadLaw, SpoolMotion, current_law, nominal_law
from drivers.errors import InputError

LAW = LoadLaw()
MX = nominal_law(MX_28, 0.0105)


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
    assert LAW.tension(LAW.effort_cap(tension_N), SpoolMotion.WINDING).tension_N == pytest.approx(tension_N, abs=1e-9)


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


@given(st.lists(st.floats(-0.002, 0.002), min_size=1, max_size=40))
def test_motion_does_not_flicker_at_the_threshold(rates_m_s: list[float]) -> None:
    """Beginning needs the still rate, ending half of it: in between a spool goes on with what it did."""
    motion = SpoolMotion.HOLDING
    for rate_m_s in rates_m_s:
        before, motion = motion, LAW.motion(rate_m_s, motion)
        if abs(rate_m_s) >= LAW.still_rate_m_s:
            assert motion.value == math.copysign(1.0, rate_m_s)
        elif abs(rate_m_s) < 0.5 * LAW.still_rate_m_s:
            assert motion is SpoolMotion.HOLDING
        elif motion is not SpoolMotion.HOLDING:
            assert motion is before


@given(st.floats(-1.0, 1.0), st.floats(0.0, 0.5), st.sampled_from(SpoolMotion))
def test_more_effort_is_more_tension(effort: float, more: float, motion: SpoolMotion) -> None:
    """Monotone on every branch, for current and for load."""
    for law in (LAW, MX):
        assert law.tension(effort + more, motion).tension_N >= law.tension(effort, motion).tension_N


@given(st.floats(0.05, 1.0), st.floats(0.0, 0.04))
def test_branches_are_mirrored_by_the_motion(effort: float, rate_m_s: float) -> None:
    """Odd symmetry: the two turning branches lie as far above as below the resting one, back-EMF included."""
    resting = MX.torque_per_effort_Nm / MX.spool_radius_m * effort
    winding = MX.tension(effort + MX.back_emf_effort_s_per_m * rate_m_s, SpoolMotion.WINDING, rate_m_s=rate_m_s)
    unwinding = MX.tension(effort - MX.back_emf_effort_s_per_m * rate_m_s, SpoolMotion.UNWINDING, rate_m_s=-rate_m_s)
    if winding.tension_N > 0.0:
        assert winding.tension_N + unwinding.tension_N == pytest.approx(2.0 * resting)


@given(st.floats(0.0, 150.0), st.floats(9.0, 19.0))
def test_cap_is_the_inverse_at_any_supply(tension_N: float, supply_V: float) -> None:
    """A load is a part of the supply: at 16 V it pulls a third more, so the cap must be a third less."""
    effort = MX.effort_cap(tension_N, supply_V=supply_V)
    assert MX.tension(effort, SpoolMotion.WINDING, supply_V=supply_V).tension_N == pytest.approx(tension_N, abs=1e-9)


@given(st.floats(9.0, 19.0), st.floats(0.0, 150.0))
def test_the_supply_of_a_cap_is_never_below_the_true_one(supply_V: float, tension_N: float) -> None:
    """Neither its noise nor its recovery may let a motor pull above its cap."""
    effort = MX.effort_cap(tension_N, supply_V=MX.cap_supply_V(supply_V))
    for actual_V in (supply_V, min(supply_V, 12.0)):
        assert MX.tension(effort, SpoolMotion.WINDING, supply_V=actual_V).tension_N <= tension_N + 1e-9
    assert LAW.cap_supply_V(supply_V) is None


@pytest.mark.parametrize(("load", "tension_N"), [(1.0, 238.0), (0.4, 95.0), (1 / 1023, 0.23)])
def test_mx_28_without_friction_gives_the_rows_of_the_reference(load: float, tension_N: float) -> None:
    """Reference 3.2, which leaves the gear's friction out."""
    law = nominal_law(MX_28, 0.0105, friction_load=0.0)
    assert law.tension(load, SpoolMotion.WINDING).tension_N == pytest.approx(tension_N, rel=0.02)


def test_no_load_speed_takes_all_output() -> None:
    """At the manual's no-load speed and voltage nothing is left for the tendon: an RX-28's is that at 18.5 V."""
    for model, supply_V in ((MX_28, 12.0), (XL430_W250, 12.0), (RX_28, 18.5)):
        law = nominal_law(model, 0.0105)
        rate_m_s = model.no_load_speed_rad_s * 0.0105
        estimate = law.tension(1.0, SpoolMotion.WINDING, rate_m_s=rate_m_s, supply_V=supply_V)
        assert estimate.tension_N == pytest.approx(0.0, abs=1e-9)


def test_a_motor_that_measures_current_has_no_law_by_load() -> None:
    """An ampere is not a part of full output."""
    with pytest.raises(InputError, match="tells its current"):
        nominal_law(XM430_W350, 0.0105)


def test_each_model_that_measures_current_has_its_own_constant() -> None:
    """Reference 3.1: a W210 gears less than a W350; by the other's constant its tension would be 38 % too high."""
    w350, w210 = current_law(XM430_W350, 0.0105), current_law(XM430_W210, 0.0105)
    assert (w350.torque_per_effort_Nm, w210.torque_per_effort_Nm) == (1.79, 1.30)
    assert current_law(XM430_W210, 0.0105, torque_constant_Nm_per_A=1.4).torque_per_effort_Nm == 1.4
    with pytest.raises(InputError, match="tells its load"):
        current_law(MX_28, 0.0105)


@pytest.mark.parametrize("cap_N", [math.nan, math.inf, -1.0])
def test_cap_refuses_what_is_no_tension(cap_N: float) -> None:
    """NaN in a cap must not become a current."""
    with pytest.raises(InputError, match="load cap"):
        LAW.effort_cap(cap_N)


def test_law_refuses_impossible_constants() -> None:
    """A law with a zero slope would divide by it."""
    with pytest.raises(InputError, match="not a load law"):
        LoadLaw(torque_per_effort_Nm=0.0)


CALIBRATED = replace(LAW, slope_uncertainty=0.02, friction_uncertainty=0.01, temperature_C=30.0, scatter_N=0.8)
CALIBRATED_MX = replace(MX, slope_uncertainty=0.02, friction_uncertainty=0.005, temperature_C=30.0, scatter_N=0.8)
laws = st.sampled_from([LAW, MX, CALIBRATED, CALIBRATED_MX])


@given(laws, st.floats(0.0, 150.0), st.floats(9.0, 19.0), st.floats(-10.0, 90.0))
def test_cap_is_the_inverse_at_any_supply_and_temperature(
    law: LoadLaw, tension_N: float, supply_V: float, temperature_C: float
) -> None:
    """Whatever is known of the motor's state goes both ways."""
    effort = law.effort_cap(tension_N, supply_V=supply_V, temperature_C=temperature_C)
    winding = law.tension(effort, SpoolMotion.WINDING, supply_V=supply_V, temperature_C=temperature_C)
    assert winding.tension_N == pytest.approx(tension_N, abs=1e-9)


@given(laws, st.floats(0.0, 1.0), st.floats(0.0, 0.5), st.sampled_from(SpoolMotion), st.floats(-10.0, 90.0))
def test_more_effort_is_more_tension_at_any_heat(
    law: LoadLaw, effort: float, more: float, motion: SpoolMotion, temperature_C: float
) -> None:
    """Monotone, and the upper end of the band too."""
    low = law.tension(effort, motion, temperature_C=temperature_C)
    high = law.tension(effort + more, motion, temperature_C=temperature_C)
    assert high.tension_N >= low.tension_N
    assert high.high_N >= low.high_N


@given(st.sampled_from([CALIBRATED, CALIBRATED_MX]), st.floats(0.1, 0.8), st.floats(0.0, 30.0), st.floats(0.0, 30.0))
def test_a_hotter_motor_pulls_less(law: LoadLaw, effort: float, rise_K: float, more_K: float) -> None:
    """Magnets and winding: the same effort means less tension the hotter it is; and the colder truth stays within."""
    warm = law.tension(effort, SpoolMotion.HOLDING, temperature_C=30.0 + rise_K)
    hot = law.tension(effort, SpoolMotion.HOLDING, temperature_C=30.0 + rise_K + more_K)
    cold = law.tension(effort, SpoolMotion.HOLDING, temperature_C=30.0)
    assert hot.tension_N <= warm.tension_N <= cold.tension_N
    half_corrected_N = 0.5 * (cold.tension_N + hot.tension_N)
    assert hot.low_N <= half_corrected_N <= hot.high_N


def test_heat_is_that_of_copper_and_magnets() -> None:
    """Reference 3.4, and copper's 0.39 %/K: 40 K more take 4 % of a current's torque, and 17 % of a load's."""
    at_rest = SpoolMotion.HOLDING
    for law, part in ((CALIBRATED, 0.96), (CALIBRATED_MX, 0.96 / 1.156)):
        hot = law.tension(0.5, at_rest, temperature_C=70.0).tension_N
        assert hot / law.tension(0.5, at_rest, temperature_C=30.0).tension_N == pytest.approx(part)
    assert LAW.tension(0.5, at_rest, temperature_C=70.0) == LAW.tension(0.5, at_rest)  # nobody knows at which it holds


@given(laws, st.floats(0.0, 1.0), st.sampled_from(SpoolMotion), st.floats(0.0, 20.0))
def test_scatter_widens_the_band_by_twice_itself(
    law: LoadLaw, effort: float, motion: SpoolMotion, scatter_N: float
) -> None:
    """What the calibration's own readings did not agree on is not known afterwards."""
    wider = replace(law, scatter_N=law.scatter_N + scatter_N).tension(effort, motion)
    before = law.tension(effort, motion)
    assert wider.high_N - before.high_N == pytest.approx(2.0 * scatter_N, abs=1e-9)


@pytest.mark.parametrize(
    "wrong", [{"temperature_C": math.nan}, {"temperature_C": 200.0}, {"scatter_N": -1.0}, {"scatter_N": math.inf}]
)
def test_a_calibration_refuses_impossible_conditions(wrong: dict[str, float]) -> None:
    """They would spread into every tension."""
    with pytest.raises(InputError, match="not a load law"):
        replace(LAW, **wrong)


@given(st.sampled_from([CALIBRATED, CALIBRATED_MX]), st.floats(-10.0, 90.0), st.floats(0.0, 150.0))
def test_a_cap_holds_for_a_motor_as_cold_as_it_is(law: LoadLaw, temperature_C: float, tension_N: float) -> None:
    """Measured at 30 °C, started in a cold hall: it must not pull above its cap; nor when a hot one has cooled."""
    effort = law.effort_cap(tension_N, temperature_C=law.cap_temperature_C(temperature_C))
    for actual_C in (temperature_C, max(temperature_C, 30.0)):
        assert law.tension(effort, SpoolMotion.WINDING, temperature_C=actual_C).tension_N <= tension_N + 1e-9
    assert LAW.cap_temperature_C(temperature_C) is None
