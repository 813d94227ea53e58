"""Goals and ceilings of one tendon: refusals, holding, stall, heat, loads. No bus, no motor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.dynamixel.control_tables import MODELS, MX_28, RX_28, XM430_W350, MotorModel
from drivers.dynamixel.goal import TendonGoal
from drivers.dynamixel.load_drive import PAY_OUT_RATE_M_S, LoadPhase, first_phase
from drivers.dynamixel.load_law import LoadLaw, SpoolMotion, nominal_law
from drivers.dynamixel.motor import Inspection, MotorIdentity
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import InputError

LOAD_LAW = LoadLaw(torque_per_effort_Nm=2.4, friction_effort=0.06)


def goal_of(
    model: MotorModel = XM430_W350,
    *,
    refusal: str = "",
    may_pay_out: bool = True,
    goal_range: tuple[int, int] = (-1_000_000, 1_000_000),
    limit: int | None = None,
    ticks: int = 0,
    **settings: Any,
) -> TendonGoal:
    law = LoadLaw() if model.effort == "current" else LOAD_LAW
    identity = MotorIdentity(1, model.number, model.name, model.protocol, 45, bool(refusal), refusal)
    limit = model.registers[model.ceiling].maximum if limit is None else limit
    found = Inspection(identity, ticks, limit, goal_range, may_pay_out)
    return TendonGoal(MotorSettings(1, 1, 0, load_law=law, **settings), model, found, ticks, 40)


def take(goal: TendonGoal, excursion_m: float, cap_N: float) -> None:
    goal.take(goal.check(excursion_m, cap_N), cap_N)
    goal.derate(1.0)


@given(st.sampled_from(list(MODELS.values())), st.floats(1.0, 60.0))
def test_the_ceiling_never_exceeds_the_cap(model: MotorModel, cap_N: float) -> None:
    """Whatever the model and its unit: a winding motor at its ceiling pulls no more than was allowed."""
    goal = goal_of(model)
    take(goal, 0.0, cap_N)
    law = LoadLaw() if model.effort == "current" else LOAD_LAW
    at_ceiling_N = law.tension(goal.ceiling * model.ceiling_unit, SpoolMotion.WINDING).tension_N
    count_N = model.ceiling_unit * law.torque_per_effort_Nm / law.spool_radius_m
    assert cap_N - count_N - 1e-9 <= at_ceiling_N <= cap_N + 1e-9


@pytest.mark.parametrize(
    ("excursion_m", "cap_N", "reason"),
    [
        (math.nan, 10.0, "out of travel"),
        (math.inf, 10.0, "out of travel"),
        (0.06, 10.0, r"out of travel; expected -0.005…0.0495"),
        (0.0, math.nan, "load cap nan"),
        (0.0, -1.0, "load cap -1.0"),
        (0.0, 600.0, "needs 3.6"),
    ],
)
def test_impossible_set_points_change_nothing(excursion_m: float, cap_N: float, reason: str) -> None:
    """Refused with the value and what is accepted."""
    goal = goal_of()
    with pytest.raises(InputError, match=reason):
        goal.check(excursion_m, cap_N)
    assert (goal.ticks, goal.ceiling) == (0, 40)


def test_the_end_of_an_rx_28_s_range_is_refused() -> None:
    """Its 300° end within the tendon's travel if the spool is clamped badly: that has to be said, not run into."""
    goal = goal_of(RX_28, goal_range=(0, 1023), ticks=500)
    goal.check(0.0495, 10.0)
    goal = goal_of(RX_28, goal_range=(0, 600), ticks=500)
    with pytest.raises(InputError, match=r"is position 9\d\d; it takes 0…600.*Clamp the spool"):
        goal.check(0.0495, 10.0)


def test_a_motor_in_another_mode_may_only_be_paid_out() -> None:
    """Trapped fingers can be freed; but nothing tightens a tendon whose ceiling is not known to work."""
    goal = goal_of(refusal="holds in operating mode 3.", ticks=500)
    assert goal.check(0.004, 10.0) < 500
    with pytest.raises(InputError, match="tendon motor 1 holds in operating mode 3"):
        goal.check(0.02, 10.0)
    with pytest.raises(InputError, match="holds in operating mode 3"):
        goal.check_load(5.0)
    wheel = goal_of(refusal="holds as a wheel.", ticks=500, may_pay_out=False)
    with pytest.raises(InputError, match="holds as a wheel"):
        wheel.check(0.0, 10.0)
    assert not wheel.takes_goals


@given(st.sampled_from([XM430_W350, MX_28, RX_28]), st.integers(-300, 300), st.floats(-0.6, 0.6))
def test_hold_keeps_the_lead_that_the_effort_needs(model: MotorModel, lead: int, effort: float) -> None:
    """Never farther from the measured position than before, never more than the present effort asks for, same side."""
    goal = goal_of(model, ticks=500 + lead)
    goal.hold(500, effort)
    kept = goal.ticks - 500
    needed = abs(effort) / model.holding_effort_per_tick(model.default_position_gain)
    assert abs(kept) <= min(abs(lead), needed + 0.5)
    assert kept * lead >= 0


def test_heat_lowers_the_ceiling_down_to_a_floor() -> None:
    """65 °C: all; 70 °C: three quarters; 90 °C: three tenths, so that a hot motor still holds."""
    settings = MotorSettings(1, 1, 0)
    assert [settings.derating(t) for t in (20.0, 65.0, 70.0, 90.0)] == pytest.approx([1.0, 1.0, 0.75, 0.3])
    goal = goal_of()
    take(goal, 0.01, 60.0)
    cool = goal.ceiling
    goal.derate(0.5)
    assert goal.ceiling == settings.ceiling_counts(30.0, XM430_W350) < cool
    goal.derate(1.0)
    assert goal.ceiling == cool


def stall(goal: TendonGoal, seconds: float, *, ticks: int = 300, effort: float, rate_m_s: float = 0.0) -> None:
    for step in range(round(seconds / 0.1)):
        goal.step(0.1 * step, 0.1, ticks=ticks, effort=effort, rate_m_s=rate_m_s)


def test_a_stalled_motor_gives_up_its_goal_and_holds() -> None:
    """At its ceiling, at rest, for the time-out: the goal comes to where it is, under the holding cap."""
    goal = goal_of(stall_timeout_s=2.0, holding_cap_N=15.0)
    take(goal, 0.03, 40.0)
    asked, ceiling_A = goal.ticks, goal.ceiling * 2.69e-3
    stall(goal, 1.9, effort=ceiling_A)
    assert (goal.stalled, goal.ticks) == (False, asked)
    stall(goal, 2.3, effort=ceiling_A)
    goal.derate(1.0)
    assert goal.stalled
    assert 300 < goal.ticks < 300 + 30
    assert goal.ceiling == MotorSettings(1, 1, 0).ceiling_counts(15.0, XM430_W350)
    take(goal, 0.03, 40.0)  # the same set-point, streamed on, does not wake it
    assert goal.stalled
    take(goal, 0.02, 40.0)
    assert not goal.stalled
    assert goal.ceiling * 2.69e-3 == pytest.approx(ceiling_A)


@pytest.mark.parametrize(("effort", "rate_m_s"), [(0.1, 0.0), (0.364, 0.005)])
def test_pulling_less_or_moving_is_no_stall(effort: float, rate_m_s: float) -> None:
    """A motor that holds below its ceiling, or still winds, may do so for ever."""
    goal = goal_of(stall_timeout_s=1.0)
    take(goal, 0.03, 40.0)
    stall(goal, 5.0, effort=effort, rate_m_s=rate_m_s)
    assert not goal.stalled


def test_a_load_is_pulled_with_a_short_lead() -> None:
    """Winding to a load, the goal stays just ahead of the spool: if the object is gone, nothing snaps shut."""
    goal = goal_of()
    goal.pull(20.0, 0.1)
    goal.derate(1.0)
    for ticks in (100, 200, 300):
        goal.step(0.0, 0.005, ticks=ticks, effort=0.2, rate_m_s=0.01)
        lead = goal.ticks - ticks
        full_A = lead * XM430_W350.holding_effort_per_tick(800)
        assert goal.ceiling * 2.69e-3 <= full_A <= goal.ceiling * 2.69e-3 + 0.2 * 2.3 + 0.03  # a fifth of its speed


def test_a_smaller_load_is_paid_out_to() -> None:
    """Gear friction holds the tendon: to pull less, the spool has to turn back until the unwinding branch says so."""
    goal = goal_of(ticks=400)
    goal.take_cap(60.0)
    goal.derate(1.0)
    law, effort = LoadLaw(), 0.48
    goal.pull(20.0, effort)
    ticks, steps = 380, 0
    while law.tension(effort, SpoolMotion.UNWINDING).tension_N > 20.0:
        before = goal.ticks
        goal.step(0.01 * steps, 0.01, ticks=ticks, effort=effort, rate_m_s=-0.005)
        assert (before - goal.ticks) * XM430_W350.tick_rad * 0.0105 <= 1.5 * PAY_OUT_RATE_M_S * 0.01 + 1e-3
        ticks, effort, steps = ticks - 2, effort - 0.01, steps + 1
    reached = goal.ticks
    stall(goal, 1.0, ticks=ticks, effort=effort)
    assert goal.ticks == reached < 400


def test_a_cap_is_checked_at_the_supply_that_was_told() -> None:
    """At 14.8 V an MX-28 may be asked for what it cannot give at 12 V, and takes fewer counts for it."""
    law = nominal_law(MX_28, 0.0105)
    identity = MotorIdentity(1, MX_28.number, MX_28.name, 1, 40, False, "")
    found = Inspection(identity, 0, 1023, (0, 4095), True)
    goal = TendonGoal(MotorSettings(1, 1, 0, load_law=law), MX_28, found, 0, 40)
    with pytest.raises(InputError, match=r"needs 1\.0"):
        goal.check_cap(230.0)
    goal.derate(1.0, 14.8)
    goal.check_cap(230.0)
    ceilings = []
    for supply_V in (12.0, 14.8):
        goal.take(100, 60.0)
        goal.derate(1.0, supply_V)
        ceilings.append(goal.ceiling)
    assert ceilings[1] == pytest.approx(ceilings[0] * 12.0 / 15.0, abs=1.0)  # rounded up to half volts


def test_a_cold_motor_gets_a_lower_ceiling() -> None:
    """Calibrated at 40 °C, a load at 15 °C pulls an eighth more than it did then."""
    law = replace(nominal_law(MX_28, 0.0105), temperature_C=40.0)
    identity = MotorIdentity(1, MX_28.number, MX_28.name, 1, 40, False, "")
    goal = TendonGoal(
        MotorSettings(1, 1, 0, load_law=law), MX_28, Inspection(identity, 0, 1023, (0, 4095), True), 0, 40
    )
    ceilings = []
    for temperature_C in (70.0, 40.0, 15.0):
        goal.take(100, 60.0)
        goal.derate(1.0, 12.0, temperature_C)
        ceilings.append(goal.ceiling)
    assert ceilings[0] == ceilings[1]
    assert ceilings[2] == pytest.approx(ceilings[1] * (1.0 - 0.0039 * 25.0) / 1.025, abs=1.0)


def test_paying_out_to_a_load_is_judged_at_the_supply() -> None:
    """A load of 30 % is a fifth more tension at 14.8 V: to be paid out to what 12 V would already call reached."""
    law = nominal_law(MX_28, 0.0105)
    effort = law.effort_cap(50.0)
    assert first_phase(law, effort, 55.0, 12.0) is LoadPhase.WINDING
    assert first_phase(law, effort, 55.0, 14.8) is LoadPhase.PAYING_OUT
