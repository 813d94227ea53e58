"""How two tendon motors are mounted: worked out from where their spools stand while an operator moves the fingers.

With torque off, the operator opens both fingers until both tendons are just taut, closes the right one by its spool as
far as it may ever go, then the left one, then opens both again. The motor that turned belongs to that finger; the way
it turned is its tightening sign, how far is its travel; where it stood open is its zero, and the second opening says
how well that repeats. Ticks are the motor's position register; excursion is tendon pulled in, m.

Pure. Source: dynamixel reference 1.3, 1.4 (nothing of this is the same on two hands; below one turn of the spool).
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.dynamixel.bus import motor_name
from drivers.dynamixel.control_tables import MotorModel
from drivers.errors import InputError

TAUT = "open both fingers, each tendon just taut on its spool, and let go,"
CLOSE_RIGHT = "close the right finger by its spool, as far as it may ever go, and keep it there,"
CLOSE_LEFT = "now close the left finger in the same way and keep it there (the right one may go),"
TAUT_AGAIN = "open both fingers again, each tendon just taut on its spool, and let go,"
STEPS = (TAUT, CLOSE_RIGHT, CLOSE_LEFT, TAUT_AGAIN)

LEAST_TRAVEL_M = 0.010
"""A finger that is closed by less was not closed."""
LARGEST_TRAVEL_M = 0.150
LARGEST_SLIP_M = 0.003
"""The other finger's tendon may be moved by this much while one is closed."""
LARGEST_REPEAT_M = 0.0015
"""Between the two openings; an error of the zero is one of every excursion."""
ROUNDED_M = 1e-4

Ticks = tuple[int, int]


@dataclass(frozen=True, slots=True)
class MotorSetup:
    """One finger's motor."""

    motor_id: int
    tightening_sign: int
    zero_ticks: int
    """Mean of both openings."""
    travel_m: tuple[float, float]
    """Excursions that may be commanded: the slack, as a negative number, and the closed finger's."""
    repeat_m: float
    """Between the two openings."""
    notes: tuple[str, ...] = ()


def work_out(
    readings: tuple[Ticks, Ticks, Ticks, Ticks],
    motor_ids: tuple[int, int],
    model: MotorModel,
    *,
    spool_radius_m: tuple[float, float],
    slack_m: tuple[float, float],
) -> tuple[MotorSetup, MotorSetup]:
    """The right and the left finger's motor. `readings`: positions of both `motor_ids` at each of `STEPS`.

    `spool_radius_m` and `slack_m` (≥ 0, how far below taut a tendon may be paid out): right, left. InputError that says
    what was not done, for readings that are no such procedure.
    """
    taut, right_closed, left_closed, _ = readings
    for motor_id, ticks in zip(motor_ids, taut, strict=True):
        if not 0 <= ticks < model.ticks_per_revolution:
            raise InputError(
                f"{motor_name(motor_id)} stands at {ticks} ticks; expected 0…{model.ticks_per_revolution - 1}, as it "
                "will after it was switched on.",
                help="Switch the motors off and on with the hand open, then start again.",
            )
    tick_m = [model.tick_rad * radius_m for radius_m in spool_radius_m]
    moved_m = [abs(closed - open_) * tick_m[0] for closed, open_ in zip(right_closed, taut, strict=True)]
    right = 0 if moved_m[0] >= moved_m[1] else 1
    left = 1 - right
    _check_closed("right", moved_m[right])
    if moved_m[left] > LARGEST_SLIP_M:
        raise InputError(
            f"both spools were turned, by {moved_m[right] * 1e3:.1f} and {moved_m[left] * 1e3:.1f} mm of tendon, when "
            f"the right finger was closed; expected one alone, the other within {LARGEST_SLIP_M * 1e3:g} mm.",
            help="Start again, and leave the left finger as it is while you close the right one.",
        )
    _check_closed("left", abs(left_closed[left] - taut[left]) * tick_m[1])
    return (
        _setup("right", right, motor_ids[right], readings, right_closed, model, tick_m[0], slack_m[0]),
        _setup("left", left, motor_ids[left], readings, left_closed, model, tick_m[1], slack_m[1]),
    )


def _check_closed(side: str, moved_m: float) -> None:
    if not LEAST_TRAVEL_M <= moved_m <= LARGEST_TRAVEL_M:
        raise InputError(
            f"the {side} finger's tendon was pulled in by {moved_m * 1e3:.1f} mm; expected "
            f"{LEAST_TRAVEL_M * 1e3:g} to {LARGEST_TRAVEL_M * 1e3:g} mm.",
            help=f"Start again, and turn the {side} finger's spool until the finger is closed.",
        )


def _setup(
    side: str,
    index: int,
    motor_id: int,
    readings: tuple[Ticks, Ticks, Ticks, Ticks],
    closed: Ticks,
    model: MotorModel,
    tick_m: float,
    slack_m: float,
) -> MotorSetup:
    first, last = readings[0][index], readings[-1][index]
    repeat_m = abs(last - first) * tick_m
    if repeat_m > LARGEST_REPEAT_M:
        raise InputError(
            f"the {side} finger's tendon was taut at {first} and then at {last} ticks, {repeat_m * 1e3:.1f} mm apart; "
            f"expected within {LARGEST_REPEAT_M * 1e3:g} mm.",
            help="Start again; if it stays so, the tendon slips on its spool or the finger sticks.",
        )
    zero_ticks = round((first + last) / 2)
    sign = 1 if closed[index] > zero_ticks else -1
    upper_m = abs(closed[index] - zero_ticks) * tick_m
    slack_ticks = round(slack_m / tick_m)
    ends = sorted((zero_ticks - sign * slack_ticks, closed[index]))
    return MotorSetup(
        motor_id,
        sign,
        zero_ticks,
        (-slack_m, round(upper_m / ROUNDED_M) * ROUNDED_M),
        repeat_m,
        _notes(side, ends, model),
    )


def _notes(side: str, ends: list[int], model: MotorModel) -> tuple[str, ...]:
    """What will trouble the hand though it can be calibrated."""
    notes = []
    goal, turn = model.registers["goal_position"], model.ticks_per_revolution
    if ends[0] < goal.minimum or ends[1] > goal.maximum:
        notes.append(
            f"the {side} finger's travel, {ends[0]} to {ends[1]} ticks, leaves the motor's range of {goal.minimum} to "
            f"{goal.maximum}: clamp the spool so that it lies within, and calibrate again"
        )
    elif ends[0] < 0 or ends[1] >= turn:
        notes.append(
            f"the {side} finger's travel, {ends[0]} to {ends[1]} ticks, leaves the motor's turn of 0 to {turn - 1}: "
            "switched on in that part, it would not know its turn and be refused. Clamp the spool so that it lies "
            "within, or switch on with the hand open"
        )
    if ends[1] - ends[0] > turn:
        notes.append(f"the {side} finger's travel is more than one turn: the tendon lies on itself, its arm grows")
    return tuple(notes)
