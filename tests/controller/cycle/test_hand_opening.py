"""hand.open is completed when the hand is open, not when it was told to."""

from __future__ import annotations

import pytest

from controller.cycle.hand_opening import OPEN_M, PATIENCE_S, HandOpening
from controller.cycle.outcome import Outcome
from controller.messages import EventKind, HandState, Reason

PERIOD_NS = 2_000_000


def wound(right_m: float, left_m: float) -> HandState:
    return HandState((right_m, left_m), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@pytest.fixture
def outcomes() -> list[Outcome]:
    return []


@pytest.fixture
def opening(outcomes: list[Outcome]) -> HandOpening:
    return HandOpening(outcomes)


def test_the_command_waits_until_both_fingers_are_open(opening: HandOpening, outcomes: list[Outcome]) -> None:
    """A planner that moves the arm away after hand.open would drag the object along."""
    opening.begin(7)
    for step in range(2000):
        way_m = 0.02 - 1e-5 * step
        opening.step(wound(way_m, 0.5 * way_m), step * PERIOD_NS)
        assert outcomes == [] or way_m <= OPEN_M
    assert outcomes == [Outcome(EventKind.COMPLETED, 7)]
    assert opening.wanted


@pytest.mark.parametrize("hand", [None, wound(0.012, 0.0)])
def test_a_hand_that_gets_no_nearer_fails_the_command(
    hand: HandState | None, opening: HandOpening, outcomes: list[Outcome]
) -> None:
    """A stuck finger, a motor that let go, a silent hand: the planner is told instead of waiting for ever."""
    opening.begin(7)
    steps = round(PATIENCE_S * 1e9 / PERIOD_NS)
    for step in range(steps):
        opening.step(hand, step * PERIOD_NS)
    assert outcomes == []
    for step in range(steps, steps + 3):
        opening.step(hand, step * PERIOD_NS)
    assert outcomes == [Outcome(EventKind.FAILED, 7, Reason.HAND_NOT_OPEN)]
    assert opening.wanted  # it goes on trying


def test_closing_and_a_second_command_supersede_it(opening: HandOpening, outcomes: list[Outcome]) -> None:
    """Every command that was accepted comes to an end."""
    opening.begin(7)
    opening.begin(8)
    opening.end()
    assert outcomes == [
        Outcome(EventKind.FAILED, 7, Reason.SUPERSEDED),
        Outcome(EventKind.FAILED, 8, Reason.SUPERSEDED),
    ]
    assert not opening.wanted
    opening.step(wound(0.0, 0.0), 0)
    assert len(outcomes) == 2
