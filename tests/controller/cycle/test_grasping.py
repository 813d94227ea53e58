"""Closing in the cycle, with a hand that does at once what it is told: when the arm follows, and how closing ends."""

from __future__ import annotations

import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from controller.cycle.contact_search import expectation
from controller.cycle.grasp_state import GraspEvent, GraspPhase
from controller.cycle.grasping import Grasping, GraspSettings
from controller.messages import EventKind, HandState, Pair, Reason

TABLE = build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(), nodes=9)
PERIOD_S, PERIOD_NS = 0.002, 2_000_000
OPEN_HAND = HandState((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
TOKEN = 7


class Closing:
    """A grasp that closes at a rate on an object that comes this much later than the table has it, or never."""

    def __init__(self, rate_m_s: float, later_m: float | None) -> None:
        self.grasping = Grasping(PERIOD_S, GraspSettings())
        self.grasping.use_table(TABLE)
        self.grasping.enter(GraspEvent.PREPOSITIONED)
        assert self.grasping.close(TOKEN, OPEN_HAND, rate_m_s) is Reason.NONE
        self.later_m = later_m
        self.hand = OPEN_HAND
        self.step = 0
        self.fastest_m_s = 0.0

    def run(self) -> None:
        """To the end of the command."""
        while not self.grasping.outcomes and self.step < 20_000:
            self.turn()

    def turn(self) -> None:
        """One period."""
        self.step += 1
        now_ns = self.step * PERIOD_NS
        wanted_m = self.grasping.step(self.hand, now_ns, now_ns, 1.0).excursion_m
        rate_m_s = (wanted_m[0] - self.hand.excursion_m[0]) / PERIOD_S
        self.fastest_m_s = max(self.fastest_m_s, rate_m_s)
        self.hand = HandState(wanted_m, (rate_m_s, rate_m_s), self.tension_N(wanted_m), (0.0, 0.0))

    def tension_N(self, excursion_m: Pair) -> Pair:
        """The free line, and beyond contact the loaded one."""
        table = self.grasping.table
        assert table is not None
        tension = []
        for finger, at_m in enumerate(excursion_m):
            wanted = expectation(table, finger)
            load_N = wanted.free_slope_N_per_m * at_m
            if self.later_m is not None and at_m > wanted.contact_wound_m + self.later_m:
                rise = wanted.loaded_slope_N_per_m - wanted.free_slope_N_per_m
                load_N += wanted.contact_step_N + rise * (at_m - wanted.contact_wound_m - self.later_m)
            tension.append(load_N)
        return tension[0], tension[1]


@pytest.mark.parametrize("rate_m_s", [0.002, 0.010, 0.020])
def test_it_closes_as_fast_as_it_is_told(rate_m_s: float) -> None:
    """No rate is cut in silence, and contact is found at each."""
    closing = Closing(rate_m_s, 0.0)
    closing.run()
    assert closing.fastest_m_s == pytest.approx(rate_m_s, rel=0.15)
    (outcome,) = closing.grasping.outcomes
    assert (outcome.kind, outcome.token, outcome.reason) == (EventKind.COMPLETED, TOKEN, Reason.NONE)
    assert outcome.values[:2] == pytest.approx(TABLE.contact_excursion_m, abs=2e-5)
    assert outcome.values[2:4] == pytest.approx(TABLE.contact_excursion_m)


@pytest.mark.parametrize("later_m", [0.0, 6e-4, None])
def test_the_arm_does_not_follow_where_no_object_is(later_m: float | None) -> None:
    """From the expected contact on the table is in force; while contact is overdue the arm waits. The object is never
    more than 0.35 mm of excursion ahead of where its contact says."""
    closing = Closing(0.020, later_m)
    grasping, farthest_m = closing.grasping, 0.0
    while grasping.phase is GraspPhase.CLOSING and not grasping.outcomes:
        closing.turn()
        if grasping.phase is GraspPhase.CLOSING:
            x_m, y_m, _ = grasping.offset_target.pose
            farthest_m = max(farthest_m, (x_m**2 + y_m**2) ** 0.5)
    assert grasping.table is not None
    _, ahead_m, _ = grasping.table.at_excursion(3.5e-4, 0.0).pose
    _, start_m, _ = grasping.table.contact_pose
    assert 0.0 < farthest_m < abs(ahead_m - start_m)
    if later_m is not None:
        grasping.outcomes.clear()
        closing.run()
        assert grasping.phase is GraspPhase.CONTACT
    else:
        assert [outcome.reason for outcome in grasping.outcomes] == [Reason.NO_CONTACT]


@pytest.mark.parametrize("later_m", [1.5e-4, 6e-4])
def test_what_the_arm_moved_before_the_touch_is_not_taken_back(later_m: float) -> None:
    """Contact comes late, the arm has begun to move: going back would carry the object along, which is gripped now."""
    closing = Closing(0.010, later_m)
    grasping = closing.grasping
    ahead_m = 0.0
    while grasping.phase is GraspPhase.CLOSING:
        before_m = ahead_m
        closing.turn()
        ahead_m = grasping.offset_target.pose[1]
        assert ahead_m >= before_m - 1e-5
    for _ in range(100):
        closing.turn()
        assert grasping.offset_target.pose[1] >= before_m - 5e-5
