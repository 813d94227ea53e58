"""The fault matrix: every fault of the arm and its bus, in every phase, against a whole robot on virtual time.

Front, cycle, hand and world are the daemon's own; each fault meets the same prepared robot (`wam_fault_rig.py`). After
each the arm has stopped by command, is idle or without power within the stated time, or, where the bus is lost, the
daemon says what the pucks do; no torque frame is older than its period; nothing hangs; name and advice are right.
What is expected stands in `wam_fault_cases.py`, which also prints the matrix of docs/faults.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

import pytest

from controller.config import RobotConfig
from controller.reasons import EXPLANATIONS
from controller.simulation.demo_cases import GraspCase
from tests.system.fault_page import PAGE, written
from tests.system.wam_fault_cases import ADVICE, CASES
from tests.system.wam_fault_matrix import BEGIN, END, PHASES, Case, Cell, matrix
from tests.system.wam_fault_rig import PERIOD_NS, Robot, Seen, split

pytestmark = pytest.mark.slow
HEARTBEAT_S = 0.1
"""Of the simulated safety puck."""
POSITION_BOUND_RAD = 0.005
"""Of a position that counts as complete: what the fastest joint moves in two periods."""
_TEXTS = {explanation.code: explanation for explanation in EXPLANATIONS.values()}


@pytest.fixture(scope="module")
def robot_in(config: RobotConfig, symmetric_case: GraspCase) -> Callable[[str], Robot]:
    """A robot that has been brought to a phase; made when it is first asked for."""
    robots: dict[str, Robot] = {}

    def robot(phase: str) -> Robot:
        if phase not in robots:
            robots[phase] = Robot(config, symmetric_case, at_home=phase == "start-up")
            if phase != "start-up":
                getattr(robots[phase], f"to_{phase}")()
        return robots[phase]

    return robot


ENTRIES = [
    pytest.param(case, phase, id=f"{phase}-{case.name}") for phase in PHASES for case in CASES if case.cell(phase)
]


@pytest.mark.parametrize(("case", "phase"), ENTRIES)
def test_fault(case: Case, phase: str, robot_in: Callable[[str], Robot]) -> None:
    """Protects the arm, who stands beside it, and the operator who reads what happened."""
    seen = split(robot_in(phase), case.faults, case.duration_s)
    cell = case.cell(phase)
    assert cell is not None
    if cell.kind == "refuses":
        check_refusal(cell, seen)
        return
    assert seen.refusal is None
    check_nothing_hung(seen)
    check_torques(case, seen)
    assert seen.position_error_rad < POSITION_BOUND_RAD, "a wrong position was accepted"
    check_name_and_advice(cell, phase, seen)
    CHECKS[cell.kind](cell, phase, seen)


def check_refusal(cell: Cell, seen: Seen) -> None:
    """Start-up ends at once, with an error that says what is wrong and what to do."""
    assert seen.refusal is not None
    error, message, help_text = seen.refusal
    assert error == cell.code
    assert cell.says in message
    assert help_text
    assert seen.virtual_s < 3.0
    assert not seen.torque_frames


def check_nothing_hung(seen: Seen) -> None:
    """Every period that was due has had its cycle, and the front has answered."""
    assert seen.cycles >= seen.duration_s / (PERIOD_NS * 1e-9) - 2
    assert seen.status["cycle_lost"] == ""


def check_torques(case: Case, seen: Seen) -> None:
    """What the pucks heard in each period is what that period's cycle has computed."""
    if not case.foreign_torques:
        assert seen.stale_torques == []


def check_name_and_advice(cell: Cell, phase: str, seen: Seen) -> None:
    """The fault has its name, and clients were told cause and cure in words; before start-up there is none."""
    assert seen.fault == cell.code
    told = [event for event in seen.told if event["event"] == "fault"]
    if not cell.code:
        assert told == []
        return
    text = _TEXTS[cell.code]
    if phase != "start-up":
        said = [event for event in told if event["code"] == cell.code]
        assert said, told
        assert (said[-1]["message"], said[-1]["help"]) == (text.message, text.help)
    cause, cure = ADVICE[cell.code]
    assert cause in text.message
    assert cure in text.help


def goes_on(cell: Cell, phase: str, seen: Seen) -> None:
    """As if nothing had been."""
    assert len(seen.modes) == 1
    if phase == "moving":
        assert seen.command_still_s > seen.duration_s - 0.01
    if phase == "squeezing":
        assert seen.status["state"]["grasp"]["phase"] in ("squeezing", "holding")


def starts(cell: Cell, phase: str, seen: Seen) -> None:
    """Idle under control."""
    assert seen.started
    assert seen.arm == "idle"


def holds(cell: Cell, phase: str, seen: Seen) -> None:
    """Active, at rest by command, and the joints with it."""
    assert [mode for _, mode in seen.modes] == [2]
    assert seen.arm in ("active", "offline")
    assert seen.command_still_s <= cell.within_s
    assert seen.still_s <= cell.within_s


def in_mode(wanted: int, cell: Cell, phase: str, seen: Seen) -> None:
    """The safety puck is in that mode, in time, and the daemon says so as far as it can know."""
    assert seen.mode == wanted
    assert seen.modes[-1][0] <= cell.within_s + 0.001
    assert seen.arm in (("estop", "idle")[wanted], "offline")
    if cell.code and phase != "start-up":
        assert seen.fault_s is not None
        assert seen.fault_s <= cell.within_s + 0.01


def lost(cell: Cell, phase: str, seen: Seen) -> None:
    """Nobody can command anything; the safety puck's heartbeat ends it, and until then the daemon claims no stop."""
    assert seen.fault_s is not None
    assert seen.fault_s <= cell.within_s
    text = _TEXTS[cell.code]
    assert "last torque until the safety puck's heartbeat" in text.message
    assert not re.search(r"stopped|stands|holds|is idle|went idle", text.message)
    if phase != "idle":
        assert [mode for _, mode in seen.modes] == [2, 1]
        assert seen.modes[-1][0] <= HEARTBEAT_S + 0.01


CHECKS: dict[str, Callable[[Cell, str, Seen], None]] = {
    "goes on": goes_on,
    "starts": starts,
    "holds": holds,
    "idles": partial(in_mode, 1),
    "unpowered": partial(in_mode, 0),
    "lost": lost,
}


def test_the_matrix_is_large_enough() -> None:
    """Protects its extent: at least forty faults, each in every phase where it makes sense."""
    assert len(CASES) >= 40
    assert len({case.name for case in CASES}) == len(CASES)
    assert len(ENTRIES) >= 160


def test_the_matrix_is_in_the_docs() -> None:
    """Protects the reader of docs/faults.md: it holds what these tests hold. Else: python -m
    tests.system.wam_fault_cases --write"""
    page = PAGE.read_text(encoding="utf-8")
    assert page == written(page, BEGIN, END, matrix(CASES))
