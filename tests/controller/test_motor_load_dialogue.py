"""The operator's part: what is typed, what is asked again, and what is left out. No motor: a run that only notes."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, cast

import pytest

from calibration.motor_load import Reading
from calibration.motor_load_plan import LoadPlan, plan_load
from controller.motor_load_dialogue import LoadDialogue, Unit
from controller.motor_load_run import LoadRun
from controller.prompts import Prompts
from drivers.dynamixel.control_tables import XM430_W350
from drivers.dynamixel.load_law import SpoolMotion, published_law
from drivers.errors import InputError

TENSIONS_N = (9.80665, 19.6133, 39.2266, 49.03325)


class NotingRun:
    """Takes every weight, but those above `heaviest_N`, which swing."""

    def __init__(self, heaviest_N: float = 1000.0) -> None:
        self.weighed_N: list[float] = []
        self.held = 0
        self._heaviest_N = heaviest_N

    def hold(self) -> None:
        self.held += 1

    def go(self, end_m: float) -> None:
        pass

    def weigh(self, tension_N: float, step: str) -> list[Reading]:
        self.weighed_N.append(tension_N)
        if tension_N > self._heaviest_N:
            self._heaviest_N = 1000.0  # it hangs still the next time
            raise InputError(f"{step}: the load changed by 9 N within the stroke.")
        return [_reading(SpoolMotion.WINDING, tension_N)]

    def approach(self, level_N: float, motion: SpoolMotion, speed_m_s: float, place: str) -> Callable[[float], Reading]:
        if level_N > self._heaviest_N:
            raise InputError(f"{place}: not reached.")
        return lambda tension_N: _reading(motion, tension_N)


def _reading(motion: SpoolMotion, tension_N: float) -> Reading:
    return Reading(motion, tension_N, 0.3, 0.003 * motion.value, 12.0, 30.0, "step")


def dialogue(typed: str, run: NotingRun, *, unit: Unit = Unit.kg, scale: bool = False) -> tuple[list[Any], list[str]]:
    """Readings, and all that was said, of a session in which this was typed."""
    law = published_law(XM430_W350, 0.0105)
    travel_m = (-0.005, 0.0495)
    plan: LoadPlan = plan_load(
        XM430_W350, law, travel_m=travel_m, start_m=0.0, scale=scale, tensions_N=TENSIONS_N, up_only=True
    )
    read, write = os.pipe()
    os.write(write, typed.encode())
    os.close(write)
    said: list[str] = []
    talk = LoadDialogue(cast(LoadRun, run), plan, Prompts(read, said.append), unit, "right", said.append)
    try:
        return list(talk.measure()), said
    finally:
        os.close(read)


def test_enter_is_the_weight_that_was_asked_for_and_numbers_are_others() -> None:
    """With unit or without, with a comma too; skip leaves one out."""
    run = NotingRun()
    readings, said = dialogue("\n1.9\nskip\n4,9 kg\n\n", run)
    assert run.weighed_N == pytest.approx([9.80665, 1.9 * 9.80665, 4.9 * 9.80665])
    assert len(readings) == 3
    assert "step 1 of 4: hang 1 kg on the right motor's cord" in said[0]
    assert run.held >= 1


def test_newtons_where_newtons_were_said() -> None:
    """A slip of the unit is ten times the weight."""
    run = NotingRun()
    dialogue("9.8\n20N\n\n\n\n", run, unit=Unit.N)
    assert run.weighed_N[:2] == pytest.approx([9.8, 20.0])


@pytest.mark.parametrize("answer", ["two", "-1", "0", "nan", "inf", "12", "1 2"])
def test_what_is_no_weight_is_asked_for_again(answer: str) -> None:
    """12 kg are more than the plan's cap was worked out for."""
    run = NotingRun()
    _, said = dialogue(f"{answer}\n1\n\n\n\n\n", run)
    assert run.weighed_N[0] == pytest.approx(9.80665)
    assert any(repr(answer) in line and "expected above 0, to 5.25 kg" in line for line in said)


def test_a_stroke_that_was_not_steady_is_asked_for_again() -> None:
    """The weight swung: what for is said, and nothing of it is kept."""
    run = NotingRun(heaviest_N=30.0)
    readings, said = dialogue("\n\n\n\n\n\n", run)
    assert run.weighed_N == pytest.approx([*TENSIONS_N[:3], TENSIONS_N[2], TENSIONS_N[3]])
    assert len(readings) == 4
    assert any("the load changed" in line for line in said)


def test_a_scale_is_read_up_and_down_and_a_level_out_of_reach_is_left_out() -> None:
    """The topmost level cannot be reached; the others are read both ways, as the operator says."""
    readings, said = dialogue("10\n20\n40\n41\n21\n11\n\n", NotingRun(heaviest_N=45.0), unit=Unit.N, scale=True)
    assert [reading.tension_N for reading in readings] == [10.0, 20.0, 40.0, 41.0, 21.0, 11.0]
    assert [reading.motion.name for reading in readings[2:4]] == ["WINDING", "UNWINDING"]
    assert any("not reached. This step is left out" in line for line in said)


def test_nobody_there_ends_it() -> None:
    """Standard input is closed: no weight is taken for granted."""
    run = NotingRun()
    with pytest.raises(InputError, match="nobody answered"):
        dialogue("\n\n", run)
    assert len(run.weighed_N) == 2
