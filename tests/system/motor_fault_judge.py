"""Whether a robot did with a fault of its tendon motors what is expected: by the world and the motors' registers, and
by what every client was told. Lengths in m, times in s from the fault on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from controller.reasons import EXPLANATIONS
from tests.system.motor_fault_cases import ADVICE
from tests.system.motor_fault_matrix import REST_S, WATCH_S, Case, Cell
from tests.system.motor_fault_rig import Robot, Seen, Watch

START_S = 0.15
"""Both motors are up by then."""
SETTLE_S = 0.03
"""From when it is told until the spools stand."""
FROZEN_M, OBJECT_M = 5e-5, 1e-4
"""What spools and the object in the hand may still move then: 3 ticks."""
WRIST_M = 2e-3
"""What the wrist may still move, coming to rest: the arm does not follow tendons that hold nothing."""
SLACK_M = 2.5e-4
"""What a tendon gives way when its motor's watchdog holds it without the lead of its goal."""
SAME_M = 1e-4
"""Between a robot that goes on and one without the fault."""
LONGEST_WAIT_S = 0.06
BESIDE_M = 2e-4
"""What a sound motor gives way when the other one lets go: its load changes."""
SOFTNESS = {"XM430-W350": 1.0, "MX-28": 3.0, "XL430-W250": 4.0}
"""Of the position loops, by which these are more."""
OPENED_M = 4e-4
"""What a spool pays out, at least, while the hand is opened for a moment."""
_TEXTS = {explanation.code: explanation for explanation in EXPLANATIONS.values()}
Check = Callable[[Case, Cell, Watch, Watch], None]


def judge(case: Case, phase: str, seen: Seen, usual: Watch | None) -> None:
    """`usual`: what a robot without the fault went through."""
    cell = case.cell(phase)
    assert cell is not None
    if cell.kind == "refuses":
        refused(cell, seen)
        return
    assert seen.refusal is None
    if cell.kind == "starts":
        started(seen.watch)
        return
    assert usual is not None
    check_told(cell, seen.watch, usual)
    CHECKS[cell.kind](case, cell, seen.watch, usual)
    if seen.opened is not None:
        check_opened(case, seen.opened)
    if seen.cleared is not None:
        check_cleared(case, cell, seen)
    if seen.brought_up is not None:
        check_brought_up(seen.brought_up)


def refused(cell: Cell, seen: Seen) -> None:
    """Start-up ends with an error that says what is wrong and what to do; no motor was switched on or off."""
    assert seen.refusal is not None
    error, message, _ = seen.refusal
    assert error == cell.code
    assert cell.says in message
    if len(seen.watch.pulls):
        assert (seen.watch.pulls[-1] == seen.watch.pulls[0]).all()


def started(watch: Watch) -> None:
    """Both motors hold where they stood."""
    assert watch.pulls[-1].all()
    assert watch.told == []
    assert watch.travel_m(0.0).max() < FROZEN_M


def check_told(cell: Cell, watch: Watch, usual: Watch) -> None:
    """What was told, in time, in which words; and nothing that is not so."""
    codes = [told.code for told in watch.told]
    if not cell.code:
        assert codes == []
        assert watch.fault == usual.fault == ""
        return
    assert codes[:1] == [cell.code]
    assert set(codes) <= {cell.code, cell.then}
    assert cell.known_s <= watch.told[0].time_s <= cell.known_s + cell.within_s or cell.kind == "stops"
    for told in watch.told:
        text, (cause, cure) = _TEXTS[told.code], ADVICE[told.code]
        assert (told.message, told.help) == (text.message, text.help)
        assert cause in text.message
        assert cure in text.help
    only_warned = cell.kind in ("warns", "stops")
    assert {told.event for told in watch.told} == {"warning" if only_warned else "fault"}
    assert watch.fault == ("" if only_warned else codes[-1])


def goes_on(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """As if nothing had been."""
    assert watch.phase == usual.phase
    assert watch.pulls.all()
    np.testing.assert_allclose(watch.spool_m[-1], usual.spool_m[-1], atol=SAME_M)
    assert watch.looks[-1].gripped == usual.looks[-1].gripped


def waited(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """As if nothing had been, but later: both spools are where they usually were one wait before."""
    assert watch.phase == usual.phase
    assert watch.pulls.all()
    waits_s = np.arange(0.0, LONGEST_WAIT_S, 1e-3)
    before = [np.interp(usual.time_s[-1] - waits_s, usual.time_s, spool_m) for spool_m in usual.spool_m.T]
    off_m = np.abs(np.array(before).T - watch.spool_m[-1]).max(axis=1)
    assert off_m.min() < SAME_M
    assert waits_s[off_m.argmin()] > 0.0


def warned(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """The grasp goes on; sound motors do what they did."""
    assert watch.phase == usual.phase
    sound = sound_motors(case)
    assert watch.pulls[:, sound].all()
    np.testing.assert_allclose(watch.spool_m[-1][sound], usual.spool_m[-1][sound], atol=SLACK_M)


def stopped(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """Both hold before the squeeze's own end, together, and it is told as completed."""
    assert watch.phase == "holding"
    assert watch.pulls.all()
    assert watch.travel_m(WATCH_S - 0.05).max() < FROZEN_M
    assert np.ptp(watch.spool_m[-1] - watch.spool_m[0]) < SAME_M
    assert watch.looks[-1].gripped


def held(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """Both excursions stay where they are; what was gripped stays gripped, and where it is in the hand."""
    assert watch.phase in ("fault", "none")
    assert watch.pulls.all()
    if usual.phase == "closing":
        return  # nothing is held yet: the fingers come to rest, wherever
    after_s = watch.told[0].time_s + SETTLE_S
    assert watch.wrist_travel_m(after_s) < WRIST_M
    softness = SOFTNESS[case.model]
    assert watch.travel_m(after_s).max() < softness * (FROZEN_M + (SLACK_M if not case.opens else 0.0))
    assert watch.object_travel_m(after_s) < softness * OBJECT_M or not case.opens
    assert watch.looks[-1].gripped


def slackened(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """Nobody can command the motors; they hold by themselves, and the object stays in the hand."""
    assert watch.phase == "fault"
    assert watch.pulls.all()
    after_s = watch.told[0].time_s + SETTLE_S
    assert watch.travel_m(after_s).max() < SOFTNESS[case.model] * SLACK_M
    assert watch.travel_m(WATCH_S - 0.02).max() < SOFTNESS[case.model] * FROZEN_M
    assert watch.looks[-1].gripped


def let_go(case: Case, cell: Cell, watch: Watch, usual: Watch) -> None:
    """It is said that the object may be gone; the sound motor holds its excursion."""
    assert watch.phase == ("fault" if usual.phase != "open" else usual.phase)
    assert any(words in watch.told[0].message for words in ("may have been dropped", "is not known"))
    sound = sound_motors(case)
    assert watch.pulls[:, sound].all()
    after_s = watch.told[0].time_s + SETTLE_S
    assert (watch.travel_m(after_s)[sound] < SOFTNESS[case.model] * BESIDE_M).all()
    assert watch.wrist_travel_m(after_s) < WRIST_M


def check_opened(case: Case, opened: Watch) -> None:
    """Trapped fingers come free in a fault too, as far as motors can hear: spools pay out at once."""
    assert opened.phase == "releasing"
    if case.opens:
        paid_out_m = opened.spool_m[0] - opened.spool_m[-1]
        assert (paid_out_m[sound_motors(case)] > OPENED_M).all()


def check_cleared(case: Case, cell: Cell, seen: Seen) -> None:
    """With its cause gone a fault is cleared and nothing is let go; with a motor that let go it is not."""
    cleared = seen.cleared
    assert cleared is not None
    if case.after == "clear":
        assert seen.clear_error == ""
        assert cleared.fault == ""
        assert cleared.pulls.all()
        if seen.watch.looks[-1].gripped:
            assert cleared.phase == "holding"
            assert all(look.gripped for look in cleared.looks)
            assert cleared.travel_m(0.0).max() < SOFTNESS[case.model] * SLACK_M
        return
    assert seen.clear_error in {cell.code, *seen.told_later}
    sound = sound_motors(case)
    assert cleared.pulls[:, sound].all()


def check_brought_up(robot_after: Watch) -> None:
    """After hand.open a motor that had let go pulls again, and the fault is cleared."""
    assert robot_after.pulls[-1].all()
    assert (robot_after.fault, robot_after.phase) == ("", "none")


def sound_motors(case: Case) -> list[int]:
    """Those that did not let go."""
    return [motor for motor in (0, 1) if motor not in case.let_go]


CHECKS: dict[str, Check] = {
    "goes on": goes_on,
    "waits": waited,
    "warns": warned,
    "stops": stopped,
    "holds": held,
    "slackens": slackened,
    "lets go": let_go,
}


def suffer(robot: Robot, case: Case, phase: str) -> Seen:
    """Let the robot, which is in this phase, have the case's faults."""
    cell = case.cell(phase)
    assert cell is not None
    in_hand = phase in ("squeezing", "holding") and cell.kind in ("holds", "slackens", "lets go")
    brought_up = phase == "squeezing" and case.after == "open"
    clears = case.after and (brought_up or phase == "holding" or case.cell("holding") is None)
    return robot.suffer(
        case.faults,
        case.watch_s if phase != "start-up" else START_S,
        rest_s=REST_S if in_hand and clears else 0.0,
        mend=case.mend,
        opening_s=0.15 if in_hand and phase == "squeezing" else 0.0,
        bring_up_s=1.8 if in_hand and brought_up else 0.0,
    )
