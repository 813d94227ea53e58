"""Which motor is whose, and how it is mounted, from four readings; the readings are made here from a known mounting."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.motor_setup import STEPS, MotorSetup, Ticks, work_out
from drivers.dynamixel.control_tables import MX_28, RX_28, XM430_W350, MotorModel
from drivers.errors import InputError

RADIUS_M = 0.0105
XM_TICK_M = 2 * math.pi / 4096 * RADIUS_M


def solve(
    taut: Ticks,
    right_closed: Ticks,
    left_closed: Ticks,
    again: Ticks | None = None,
    *,
    ids: tuple[int, int] = (1, 2),
    model: MotorModel = XM430_W350,
    slack_m: float = 0.005,
) -> tuple[MotorSetup, MotorSetup]:
    readings = (taut, right_closed, left_closed, again or taut)
    return work_out(readings, ids, model, spool_radius_m=(RADIUS_M,) * 2, slack_m=(slack_m,) * 2)


@given(
    swapped=st.booleans(),
    signs=st.tuples(st.sampled_from((1, -1)), st.sampled_from((1, -1))),
    zeros=st.tuples(st.integers(0, 4095), st.integers(0, 4095)),
    turned=st.tuples(st.integers(650, 4000), st.integers(650, 4000)),
    jitter=st.integers(-40, 40),
)
def test_any_mounting_is_found(
    swapped: bool, signs: tuple[int, int], zeros: tuple[int, int], turned: tuple[int, int], jitter: int
) -> None:
    """Whichever motor is the right one, wherever its zero and whichever way it tightens: it comes out as it was."""
    zeros = (max(40, min(4055, zeros[0])), max(40, min(4055, zeros[1])))
    closed = [zero + sign * ticks for zero, sign, ticks in zip(zeros, signs, turned, strict=True)]
    rows = [zeros, (closed[0], zeros[1]), (zeros[0], closed[1]), (zeros[0] + jitter, zeros[1] - jitter)]
    ids = (7, 3)
    if swapped:
        rows, ids = [(left, right) for right, left in rows], (3, 7)
    found = solve(*rows, ids=ids)
    assert [motor.motor_id for motor in found] == [7, 3]
    for motor, sign, zero, ticks in zip(found, signs, zeros, turned, strict=True):
        assert motor.tightening_sign == sign
        assert abs(motor.zero_ticks - zero) <= abs(jitter) / 2 + 1
        assert motor.travel_m[0] == -0.005
        assert motor.travel_m[1] == pytest.approx(ticks * XM_TICK_M, abs=21 * XM_TICK_M + 1e-4)
        assert motor.repeat_m == pytest.approx(abs(jitter) * XM_TICK_M)


@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        (((100, 100), (100, 100), (100, 3000)), r"right finger's tendon was pulled in by 0.0 mm; expected 10 to 150"),
        (((100, 100), (3000, 100), (3000, 200)), "left finger's tendon was pulled in by 1.6 mm"),
        (((100, 100), (3000, 2500), (3000, 2500)), "both spools were turned, by 46.7 and 38.7 mm"),
        (((100, 100), (3000, 100), (100, 3000), (220, 100)), "taut at 100 and then at 220 ticks, 1.9 mm apart"),
        (((5000, 100), (8000, 100), (5000, 3000)), r"motor 1 stands at 5000 ticks; expected 0…4095"),
        (((-3, 100), (3000, 100), (-3, 3000)), r"motor 1 stands at -3 ticks"),
        (((100, 100), (30000, 100), (100, 3000)), "expected 10 to 150 mm"),
    ],
)
def test_what_was_not_done_is_said(rows: tuple[Ticks, ...], reason: str) -> None:
    """A step that was left out or done with the wrong finger must not become a calibration."""
    with pytest.raises(InputError, match=reason):
        solve(*rows)


def test_a_spool_that_leaves_its_turn_is_told() -> None:
    """Switched on closed, such a motor would not know its turn; an RX-28 cannot go there at all."""
    inside = solve((500, 600), (3500, 600), (500, 3600))
    assert inside[0].notes == inside[1].notes == ()
    outside = solve((3000, 600), (6000, 600), (3000, 3600))
    assert "leaves the motor's turn of 0 to 4095" in outside[0].notes[0]
    beyond = solve((900, 60), (1400, 60), (900, 700), model=RX_28)
    assert "leaves the motor's range of 0 to 1023" in beyond[0].notes[0]
    assert "leaves the motor's range" in beyond[1].notes[0]  # 5 mm of slack below tick 60 of 53.7 µm each
    assert "more than one turn" in solve((3000, 600), (7500, 600), (3000, 3600), model=MX_28)[0].notes[-1]


def test_the_steps_can_be_read_aloud() -> None:
    """The operator sees these words and nothing else."""
    assert len(STEPS) == 4
    assert all("finger" in step and step.endswith(",") for step in STEPS)
