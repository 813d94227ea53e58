"""The fault matrix of the tendon motors, like `test_motor_faults.py`: while an object is held,
and a hand process that begins anew then."""

from __future__ import annotations

import pytest

from drivers.dynamixel.tendons import TendonSample, TendonSetPoint
from tests.system.motor_fault_matrix import XM, Case
from tests.system.motor_fault_rig import Robot
from tests.system.motor_fault_runs import RobotIn, case_named, entries, live_through

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("case", "phase"), entries((XM,), ("holding", "adoption")))
def test_fault(case: Case, phase: str, robot_in: RobotIn) -> None:
    """Protects the object, the fingers in the hand, and the operator who reads what happened."""
    live_through(case, phase, robot_in)


def test_the_judge_sees_a_daemon_that_does_not_react(robot_in: RobotIn) -> None:
    """Protects the matrix from agreeing with everything: a cycle that does not look at the hand's faults fails it."""
    with pytest.raises(AssertionError, match="hand_motor_silent"):
        live_through(case_named("one motor silent"), "holding", robot_in, spoil=deafen)


def test_the_judge_sees_a_hand_that_does_not_freeze(robot_in: RobotIn) -> None:
    """Told, but not held: a robot whose motors go on winding behind the fault fails the matrix."""
    with pytest.raises(AssertionError, match="travel_m"):
        live_through(case_named("voltage error"), "holding", robot_in, spoil=wind_on)


def deafen(robot: Robot) -> None:
    """The cycle sees a sound hand."""
    robot.virtual.cycle._hand_supervision.look = lambda *_: None  # type: ignore[method-assign]  # what is to be spoilt


def wind_on(robot: Robot) -> None:
    """Both motors follow goals of their own, a tick every exchange."""
    tendons = robot.virtual.hand._tendons
    exchange = tendons.exchange

    def exchange_and_wind(set_point: TendonSetPoint | None = None) -> TendonSample:
        for tendon in tendons._tendons:
            tendon.goal.ticks += tendon.settings.tightening_sign
        return exchange(set_point)

    tendons.exchange = exchange_and_wind  # type: ignore[method-assign]  # what is to be spoilt
