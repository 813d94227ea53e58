"""Plans of a load calibration: nothing that a motor may not carry, nothing outside its travel."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.motor_load_plan import HORN_N, LoadPlan, plan_load
from drivers.dynamixel.control_tables import MODELS, MX_28, XL430_W250, XM430_W350, MotorModel
from drivers.dynamixel.load_law import SpoolMotion, published_law
from drivers.errors import InputError

TRAVEL_M = (-0.005, 0.0495)


def plan(model: MotorModel = XM430_W350, **wanted: Any) -> LoadPlan:
    wanted = {"travel_m": TRAVEL_M, "start_m": 0.0, **wanted}
    return plan_load(model, published_law(model, 0.0105), **wanted)


def test_weights_go_up_and_down_again() -> None:
    """Each weight but the heaviest twice: what changed meanwhile shows."""
    steps_kg = [step_N / 9.80665 for step_N in plan().steps_N]
    assert steps_kg == pytest.approx([0.5, 1, 2, 4, 6, 4, 2, 1, 0.5])
    assert [step_N / 9.80665 for step_N in plan(up_only=True).steps_N] == pytest.approx([0.5, 1, 2, 4, 6])


@given(st.sampled_from(list(MODELS.values())), st.booleans())
def test_no_plan_asks_for_more_than_40_percent_of_stall(model: MotorModel, scale: bool) -> None:
    """Reference 3.2: beyond, a motor is not to be loaded for minutes; and its cap lies below the stall."""
    stall_N = model.stall_torque_Nm(12.0) / 0.0105
    made = plan(model, scale=scale)
    assert max(made.steps_N) <= 0.45 * stall_N  # an XM430's published slope is not quite its stall point's
    assert max(made.steps_N) < made.cap_N < 1.1 * stall_N
    assert any(f"{HORN_N:g} N that a horn" in note for note in made.notes) == (max(made.steps_N) > HORN_N)


def test_a_scale_is_approached_from_below_and_then_from_above() -> None:
    """Both branches at each level but the topmost; two speeds in turn where load is told."""
    made = plan(MX_28, scale=True)
    top = made.steps_N.index(max(made.steps_N))
    assert [made.motion(step) for step in (0, top, top + 1)] == [
        SpoolMotion.WINDING,
        SpoolMotion.WINDING,
        SpoolMotion.UNWINDING,
    ]
    assert {made.speed_m_s(step) for step in range(2)} == {0.003, 0.008}
    assert made.stroke_m == TRAVEL_M[1]


@pytest.mark.parametrize(
    ("model", "wanted", "told"),
    [
        (XL430_W250, {"tensions_N": (10.0, 20.0, 80.0)}, "above 0, to 57 N (5.8 kg), 40 % of its stall"),
        (XM430_W350, {"tensions_N": (-1.0, 20.0, 30.0)}, "with -1.0 to 30.0 N"),
        (XM430_W350, {"tensions_N": (10.0, 20.0)}, "2 different tensions; expected 3"),
        (XM430_W350, {"tensions_N": (10.0, 20.0, 30.0), "scale": True}, "3 different tensions; expected 4"),
        (XM430_W350, {"start_m": 0.045}, "a stroke of 10.0 mm from 45.0 mm of excursion"),
        (XM430_W350, {"stroke_m": 0.002}, "expected 4 mm or more within the travel, -5.0 to 49.5 mm"),
        (XM430_W350, {"start_m": -0.02}, "within the travel"),
        (XM430_W350, {"speeds_m_s": (0.0005,)}, "speeds of 0.5 mm/s; expected 1.2 to 20 mm/s"),
    ],
)
def test_what_cannot_be_done_is_refused(model: MotorModel, wanted: dict[str, Any], told: str) -> None:
    """Before anything moves: with the number that was asked for, and what is possible."""
    with pytest.raises(InputError) as refused:
        plan(model, **wanted)
    assert told in str(refused.value)


def test_one_speed_is_remarked_where_load_is_told() -> None:
    """The operator knows that the back-EMF will be the data sheet's."""
    assert any("back-EMF" in note for note in plan(MX_28, speeds_m_s=(0.004,)).notes)
    assert not any("back-EMF" in note for note in plan(speeds_m_s=(0.004,)).notes)
