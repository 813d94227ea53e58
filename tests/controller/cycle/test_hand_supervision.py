"""What of the hand's faults is told, and when: played to a grasp that holds nothing, or something."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from controller.cycle.following import FollowingWatch
from controller.cycle.hand_supervision import WELL_CYCLES, HandSupervision
from controller.cycle.outcome import Outcome
from controller.cycle.safety import SafetyLimits, SafetyMonitor
from controller.messages import EventKind, HandFault, HandState, Reason


@dataclass
class PlayedGrasp:
    """As much of a grasp as is looked at."""

    compensated: bool = False
    lost: bool = False
    following: FollowingWatch = field(default_factory=FollowingWatch)
    outcomes: list[Outcome] = field(default_factory=list)


@dataclass
class PlayedOrders:
    """Takes faults as the orders do."""

    fault: Reason = Reason.NONE
    hand_fault: Reason = Reason.NONE
    told: list[Reason] = field(default_factory=list)

    def fail_hand(self, reason: Reason) -> None:
        self.told.append(reason)
        self.fault = reason


class Rig:
    def __init__(self) -> None:
        self.grasp, self.orders = PlayedGrasp(), PlayedOrders()
        monitor = SafetyMonitor(SafetyLimits(), 0.002)
        self.supervision = HandSupervision(monitor, cast(Any, self.grasp), cast(Any, self.orders))

    def look(self, fault: HandFault, cycles: int = 1) -> None:
        zero = (0.0, 0.0)
        for _ in range(cycles):
            self.supervision.look(HandState(zero, zero, zero, zero, fault=fault), 0.0)

    def warned(self) -> list[Reason]:
        assert {outcome.kind for outcome in self.grasp.outcomes} <= {EventKind.WARNING}
        return [outcome.reason for outcome in self.grasp.outcomes]


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_what_is_worse_is_told_behind_what_stood(rig: Rig) -> None:
    """A motor that comes back from silence without torque: the operator hears that the object may have been dropped."""
    rig.grasp.compensated = True
    rig.look(HandFault.NO_REPLY | HandFault.ONE_SILENT, 3)
    rig.look(HandFault.TORQUE_LOST | HandFault.RESTARTED, 3)
    rig.look(HandFault.NO_REPLY, 3)
    assert rig.orders.told == [Reason.HAND_MOTOR_SILENT, Reason.HAND_RESTARTED]
    assert rig.grasp.lost


def test_an_empty_hand_only_warns_and_once(rig: Rig) -> None:
    """A loose plug that comes and goes stops no arm and fills no screen; after a while without it, it is news again."""
    for _ in range(5):
        rig.look(HandFault.BUS_LOST)
        rig.look(HandFault.NONE)
    assert rig.warned() == [Reason.HAND_BUS_LOST]
    assert rig.orders.told == []
    rig.look(HandFault.NONE, WELL_CYCLES)
    rig.look(HandFault.BUS_LOST)
    assert rig.warned() == [Reason.HAND_BUS_LOST] * 2


def test_no_sample_yet_is_nothing_to_tell(rig: Rig) -> None:
    """The hand's process may start later than the cycle's."""
    rig.supervision.look(None, 100.0)
    assert rig.orders.hand_fault is Reason.NONE
    assert rig.warned() == []


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (HandFault.NO_REPLY, Reason.HAND_SILENT),
        (HandFault.HARDWARE | HandFault.TORQUE_LOST, Reason.HAND_TORQUE_LOST),
        (HandFault.HARDWARE | HandFault.VOLTAGE, Reason.NONE),
    ],
)
def test_what_still_stands_forbids_clearing(rig: Rig, fault: HandFault, reason: Reason) -> None:
    """Nobody goes on lifting with a motor that is silent or has let go; a motor that holds on with an error that only a
    reboot, which lets go, would end may be carried to a safe place."""
    rig.grasp.compensated = True
    rig.look(fault)
    assert rig.supervision.clear() is reason


def test_a_known_error_is_not_told_again_but_a_worse_one_is(rig: Rig) -> None:
    """After clearing, the same standing error is no new fault; letting go is."""
    rig.grasp.compensated = True
    rig.look(HandFault.HARDWARE | HandFault.VOLTAGE)
    rig.supervision.clear()
    rig.orders.fault = Reason.NONE
    rig.look(HandFault.HARDWARE | HandFault.VOLTAGE, 10)
    assert rig.orders.told == [Reason.HAND_VOLTAGE]
    rig.look(HandFault.NO_REPLY | HandFault.HARDWARE | HandFault.VOLTAGE)
    assert rig.orders.told == [Reason.HAND_VOLTAGE, Reason.HAND_SILENT]


def test_a_spool_that_was_elsewhere_is_not_cleared_with_something_in_the_hand(rig: Rig) -> None:
    """Where it has moved the object is not known; open first."""
    rig.grasp.compensated = True
    for cycle in range(100):
        rig.grasp.following.want((0.01, 0.01), (0.0, 0.0), cycle * 2_000_000)
        rig.grasp.following.take((0.02, 0.01))
    rig.look(HandFault.NONE)
    assert rig.orders.told == [Reason.HAND_NOT_FOLLOWING]
    rig.grasp.following.forget()
    rig.look(HandFault.NONE)
    assert rig.supervision.clear() is Reason.HAND_NOT_FOLLOWING
    rig.grasp.compensated = False
    assert rig.supervision.clear() is Reason.NONE


def test_heat_is_a_warning_even_with_something_in_the_hand(rig: Rig) -> None:
    """A lowered cap stops nothing by itself; that the motor lets go then is a fault."""
    rig.grasp.compensated = True
    rig.look(HandFault.HOT, 10)
    assert rig.warned() == [Reason.HAND_HOT]
    assert rig.orders.hand_fault is Reason.NONE
    rig.look(HandFault.HOT | HandFault.HARDWARE | HandFault.OVERHEATED | HandFault.TORQUE_LOST)
    assert rig.orders.told == [Reason.HAND_OVERHEATED]


def test_an_empty_hand_never_forbids_clearing(rig: Rig) -> None:
    """After hand.open the arm may be moved away, whatever the motors are like."""
    rig.look(HandFault.TORQUE_LOST)
    assert rig.supervision.clear() is Reason.NONE
