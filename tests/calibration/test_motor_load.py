"""The fit of a load law: against laws that made the readings, another solver, and readings that hold none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.motor_load import Acceptance, Reading, fit_load_law
from drivers.dynamixel.control_tables import MODELS, MX_28, XM430_W350, MotorModel
from drivers.dynamixel.load_law import LoadLaw, SpoolMotion, published_law
from drivers.errors import InputError

RADIUS_M = 0.0105
MASSES_KG = (0.5, 1.0, 2.0, 4.0, 6.0)
BOTH = (SpoolMotion.WINDING, SpoolMotion.UNWINDING)
LOAD_SPEEDS_M_S = (0.003, 0.008)


def readings_of(
    law: LoadLaw,
    *,
    noise: float = 0.0,
    supply_V: float = 12.0,
    temperature_C: tuple[float, float] = (33.0, 33.0),
    speeds_m_s: tuple[float, ...] = LOAD_SPEEDS_M_S,
    masses_kg: tuple[float, ...] = MASSES_KG,
) -> list[Reading]:
    """What a motor of this law tells under each mass: the inverse of the law, written out again here."""
    random = np.random.default_rng(4)
    readings: list[Reading] = []
    warm_C = np.linspace(*temperature_C, len(masses_kg))
    for mass_kg, now_C in zip(masses_kg, warm_C.tolist(), strict=True):
        for speed_m_s in speeds_m_s:
            for motion in BOTH:
                rate_m_s, tension_N = motion.value * speed_m_s, 9.80665 * mass_kg
                rise_K = now_C - float(warm_C.mean())
                hot = 1.0 - 0.001 * rise_K
                if law.voltage_V is not None:
                    hot /= 1.0 + 0.0039 * rise_K
                shaft_Nm = tension_N * RADIUS_M + motion.value * law.torque_per_effort_Nm * law.friction_effort
                effort = shaft_Nm / law.torque_per_effort_Nm / hot + law.back_emf_effort_s_per_m * rate_m_s
                effort += random.normal(0.0, noise)
                if law.voltage_V is not None:
                    effort *= law.voltage_V / supply_V
                place = f"line {len(readings) + 2}"
                readings.append(Reading(motion, tension_N, effort, rate_m_s, supply_V, now_C, place))
    return readings


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(list(MODELS.values())),
    st.floats(0.6, 1.6),
    st.floats(0.3, 2.0),
    st.floats(10.0, 14.8),
    st.floats(25.0, 60.0),
)
def test_the_law_that_made_the_readings_comes_back(
    model: MotorModel, slope: float, friction: float, supply_V: float, hot_C: float
) -> None:
    """Law: for every model, at any supply, and while it warms up, K, I0 and back-EMF are found."""
    published = published_law(model, RADIUS_M)
    true = replace(
        published,
        torque_per_effort_Nm=slope * published.torque_per_effort_Nm,
        friction_effort=friction * published.friction_effort,
        back_emf_effort_s_per_m=1.3 * published.back_emf_effort_s_per_m,
    )
    fit = fit_load_law(readings_of(true, supply_V=supply_V, temperature_C=(25.0, hot_C)), model, RADIUS_M)
    assert fit.law.torque_per_effort_Nm == pytest.approx(true.torque_per_effort_Nm, rel=1e-4)
    assert fit.law.friction_effort == pytest.approx(true.friction_effort, rel=1e-3)
    assert fit.law.back_emf_effort_s_per_m == pytest.approx(true.back_emf_effort_s_per_m, rel=1e-3)
    assert fit.rms_N < 1e-3
    assert fit.refusal(Acceptance()) == ""


def test_without_outliers_it_is_least_squares() -> None:
    """Another solver: robustness costs nothing where nothing is wrong."""
    readings = readings_of(published_law(XM430_W350, RADIUS_M), noise=0.004)
    fit = fit_load_law(readings, XM430_W350, RADIUS_M)
    rows = np.array([[reading.tension_N, reading.motion.value] for reading in readings])
    (slope, friction), *_ = np.linalg.lstsq(rows, np.array([reading.effort for reading in readings]), rcond=None)
    assert fit.law.torque_per_effort_Nm == pytest.approx(RADIUS_M / slope, rel=0.005)
    assert fit.law.friction_effort == pytest.approx(friction, rel=0.02)


@pytest.mark.parametrize("model", [XM430_W350, MX_28], ids=lambda model: model.name)
def test_what_it_says_of_itself_is_true(model: MotorModel) -> None:
    """Over many noisy calibrations, K and I0 lie within the uncertainties that are stored, and the scatter is that."""
    true, noise = published_law(model, RADIUS_M), 0.004
    for seed in range(20):
        random = np.random.default_rng(seed)
        noisy = [replace(one, effort=one.effort + random.normal(0.0, noise)) for one in readings_of(true)]
        law = fit_load_law(noisy, model, RADIUS_M).law
        slope_error = abs(law.torque_per_effort_Nm / true.torque_per_effort_Nm - 1.0)
        assert slope_error <= 2.0 * law.slope_uncertainty
        assert abs(law.friction_effort - true.friction_effort) <= 2.0 * law.friction_uncertainty
        scatter_N = noise * true.torque_per_effort_Nm / RADIUS_M
        assert 0.4 * scatter_N < law.scatter_N < 1.6 * scatter_N


def test_a_slip_is_named_by_its_line_and_does_not_bend_the_law() -> None:
    """Somebody hung 4 kg and typed 2: the law is that of the others, and is refused with the line."""
    true = published_law(XM430_W350, RADIUS_M)
    readings = readings_of(true, noise=0.002)
    readings[9] = replace(readings[9], tension_N=2.0 * readings[9].tension_N)
    fit = fit_load_law(readings, XM430_W350, RADIUS_M)
    assert fit.outliers == (9,)
    assert fit.law.torque_per_effort_Nm == pytest.approx(true.torque_per_effort_Nm, rel=0.02)
    assert fit.refusal(Acceptance()).startswith("line 11 is off by -19")
    assert "the other readings do not agree" in fit.refusal(Acceptance())


def test_scatter_beyond_what_is_accepted_is_refused() -> None:
    """A gear that binds here and there has no law that a grasp could rely on."""
    fit = fit_load_law(readings_of(published_law(XM430_W350, RADIUS_M), noise=0.04), XM430_W350, RADIUS_M)
    assert "accepted are 5.0%" in fit.refusal(Acceptance())
    assert fit.refusal(Acceptance(rms=0.5, worst=1.0)) == ""
    assert "of the span; accepted are 1.0%" in fit.refusal(Acceptance(rms=0.5, worst=0.01))


def test_one_speed_leaves_the_back_emf_to_the_data_sheet() -> None:
    """At one speed friction and back-EMF are one number: it is not split by chance."""
    true = replace(published_law(MX_28, RADIUS_M), friction_effort=0.08)
    fit = fit_load_law(readings_of(true, speeds_m_s=(0.004,)), MX_28, RADIUS_M)
    assert not fit.back_emf_fitted
    assert fit.law.back_emf_effort_s_per_m == true.back_emf_effort_s_per_m
    assert fit.law.friction_effort == pytest.approx(0.08, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda all_: [one for one in all_ if one.motion is SpoolMotion.WINDING], "0 different tensions while unwind"),
        (lambda all_: all_[:8], "2 different tensions while winding; expected 3"),
        (lambda all_: [], "0 different tensions while winding"),
        (lambda all_: [replace(one, tension_N=0.1 * one.tension_N) for one in all_], "within 5.4 N, 0.5 (line 2)"),
        (lambda all_: [replace(one, tension_N=9.81 * one.tension_N) for one in all_], "in the unit that was said"),
        (lambda all_: [replace(one, effort=-one.effort) for one in all_], "tightening_sign"),
    ],
)
def test_readings_that_hold_no_law_are_refused(change: object, told: str) -> None:
    """Too few, too narrow, in another unit, of the wrong sign: nothing comes out that looks like a law."""
    assert callable(change)
    readings = change(readings_of(published_law(XM430_W350, RADIUS_M)))
    with pytest.raises(InputError) as refused:
        fit_load_law(readings, XM430_W350, RADIUS_M)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("effort", math.nan, "is no reading"),
        ("tension_N", -1.0, "is no reading"),
        ("voltage_V", 0.0, "is no reading"),
        ("rate_m_s", -0.003, "is not winding"),
        ("motion", SpoolMotion.HOLDING, "is not holding"),
    ],
)
def test_a_reading_is_checked_where_it_enters(key: str, value: object, told: str) -> None:
    """NaN, a negative weight, a spool that turned the other way: named by their line."""
    good = readings_of(published_law(XM430_W350, RADIUS_M))[0]
    with pytest.raises(InputError, match=f"line 2: .*{told}"):
        replace(good, **{key: value})  # type: ignore[arg-type]  # wrong on purpose
