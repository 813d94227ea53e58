"""The cycle itself on a virtual clock: simulated pucks in front of a standing arm, and a hand that the tests play."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from controller.config import load_config
from controller.cycle.arm_model import ArmModel
from controller.cycle.attentive_clock import AttentiveClock
from controller.cycle.cycle import Cycle, CycleLinks
from controller.cycle.grasp_state import GraspEvent, GraspPhase
from controller.messages import (
    CYCLE_RECORD,
    CommandKind,
    CycleCommand,
    CycleEvent,
    EventKind,
    HandFault,
    HandMode,
    HandSetPoint,
    HandState,
    Reason,
)
from controller.service.assembly import cycle_parts
from controller.service.links import LatestReader, LatestSender, OrderedReader, OrderedSender, VirtualLink
from drivers.clock import VirtualClock
from drivers.errors import BusError
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.wam import SimulatedWam
from drivers.wam.parameters import load_wam_parameters

CONFIG = load_config()
PARAMETERS = load_wam_parameters()
READY = np.array([0.0, 0.1, 0.0, 2.3, 0.0, -0.8, 0.0])
TABLE = build_table(load_hand("t42pp", preset="fitted"), load_object("cylinder40"), GraspSpec(), nodes=9)
PERIOD_NS = 2_000_000


class StandingArm:
    """An arm that stands, whatever torque it gets."""

    def __init__(self) -> None:
        self.braking = True

    def joint_position_rad(self) -> NDArray[np.float64]:
        return READY

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        self.braking = braking


class BreakableBus:
    """A CAN bus whose cable can be pulled."""

    def __init__(self, bus: MemoryCanBus) -> None:
        self._bus = bus
        self.pulled = False

    def send(self, message: can.Message) -> None:
        self._check()
        self._bus.send(message)

    def receive(self, deadline_ns: int) -> can.Message | None:
        self._check()
        return self._bus.receive(deadline_ns)

    def close(self) -> None:
        self._bus.close()

    def _check(self) -> None:
        if self.pulled:
            raise BusError("CAN", "the cable is pulled.")


class Rig:
    """A cycle with its links and pucks; the tests are front and hand."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.wam = SimulatedWam(StandingArm(), PARAMETERS, zeroed=True)
        self.hub = MemoryCanHub([self.wam])
        attentive = AttentiveClock(self.clock)
        self.bus = BreakableBus(MemoryCanBus(self.hub, attentive))
        self.parts = cycle_parts(CONFIG, self.bus, attentive)
        self.command_link = self._link()
        event_link, record_link, state_link, set_point_link = (self._link() for _ in range(4))
        self._commands, self._events = OrderedSender(self.command_link), OrderedReader(event_link)
        self._records, self._set_points = LatestReader(record_link), LatestReader(set_point_link)
        self._states = LatestSender(state_link)
        links = CycleLinks(
            OrderedReader(self.command_link),
            OrderedSender(event_link),
            LatestSender(record_link),
            LatestReader(state_link),
            LatestSender(set_point_link),
        )
        self.said: list[str] = []
        self.cycle = Cycle(attentive, links, self.parts, say=self.said.append)
        self.cycle.start()

    def _link(self) -> VirtualLink:
        return VirtualLink(self.clock, self.clock, capacity=5000)

    def run(self, periods: int = 1, hand: HandState | None = None) -> None:
        """Periods of the cycle; with a hand state, a fresh sample of it before each."""
        for _ in range(periods):
            if hand is not None:
                self.tell_hand(hand, self.clock.now_ns())
            self.cycle.pacer.wait()
            self.cycle.step()
            self.hub.step(self.clock.now_ns())
            if self.cycle.finished:
                return

    def tell_hand(self, hand: HandState, sample_ns: int) -> None:
        self._states.send(hand.pack(), sample_ns)

    def press(self, button: str) -> None:
        self.hub.transmit(self.wam.press(button, self.clock.now_ns()), self.wam)

    def send(self, kind: CommandKind, *values: float, token: int = 1, effective_cycle: int = 0) -> None:
        command = CycleCommand(kind, token, values, effective_cycle)
        self._commands.send(command.pack(), self.clock.now_ns())

    def load_table(self, token: int) -> None:
        descriptor = TABLE.to_memfd()
        payload = CycleCommand(CommandKind.LOAD_TABLE, token).pack()
        self._commands.send_fds(payload, (descriptor,), self.clock.now_ns())
        os.close(descriptor)

    def events(self) -> list[CycleEvent]:
        events = []
        while (message := self._events.receive()) is not None:
            events.append(CycleEvent.unpack(message.payload))
        return events

    def told(self) -> list[tuple[EventKind, int, Reason]]:
        return [(event.kind, event.token, event.reason) for event in self.events()]

    def records(self) -> list[dict[str, float | list[float]]]:
        return [CYCLE_RECORD.read(payload) for payload, _ in self._records.new_values()]

    def set_point(self) -> HandSetPoint:
        newest = self._set_points.newest()
        assert newest is not None
        return HandSetPoint.unpack(newest[0])

    def hold(self) -> None:
        """As if an object were held: closing has begun and contact was found."""
        self.load_table(token=90)
        self.run(2, OPEN)
        self.press("activate")
        self.run(30, OPEN)
        self.parts.grasping.enter(GraspEvent.PREPOSITIONED)
        self.send(CommandKind.CLOSE, token=0)
        self.run(2, OPEN)
        self.parts.grasping.enter(GraspEvent.CONTACT_FOUND)
        self.send(CommandKind.HOLD, token=91)
        self.run(50, OPEN)
        assert self.phase() is GraspPhase.HOLDING
        self.events()

    def phase(self) -> GraspPhase:
        return self.parts.grasping.phase


OPEN = HandState((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_every_period_leaves_one_record_and_one_set_point(rig: Rig) -> None:
    """Front and hand can count on one message a period, in order, from the first on."""
    rig.run(20)
    records = rig.records()
    assert [record["cycle"] for record in records] == list(range(20))
    assert {record["can_replies"] for record in records} == {7.0}
    assert rig.set_point().mode is HandMode.FREEZE


def test_an_idle_arm_gets_its_gravity_torque(rig: Rig) -> None:
    """Activation finds the right torque already streamed, and the command where the arm is."""
    rig.run(20)
    record = rig.records()[-1]
    model = ArmModel(
        hand=load_hand("t42pp", preset="fitted").body,
        T_wrist_hand=CONFIG.T_wrist_hand,
        T_world_base=CONFIG.T_world_base,
    )
    np.testing.assert_allclose(record["joint_torque_Nm"], model.gravity(READY), atol=0.02)
    rig.press("activate")
    rig.run(30)
    for record in rig.records():
        np.testing.assert_allclose(record["joint_command_rad"], READY, atol=1e-3)
        np.testing.assert_allclose(record["joint_torque_Nm"], model.gravity(READY), atol=0.5)


def test_an_arm_activated_before_the_first_period_stands(rig: Rig) -> None:
    """The operator may press Activate just as the daemon starts: the command still begins where the arm is."""
    rig.press("activate")
    rig.run(30)
    for record in rig.records()[1:]:
        np.testing.assert_allclose(record["joint_command_rad"], READY, atol=1e-3)


def test_a_command_waits_for_its_cycle(rig: Rig) -> None:
    """Commands carry the cycle they take effect in, so that a replay does the same; those behind it wait too."""
    rig.send(CommandKind.HOLD, token=1, effective_cycle=5)
    rig.send(CommandKind.ARM_HOLD, token=2)
    rig.run(5)
    assert rig.events() == []
    rig.run(1)
    assert [(event.kind, event.token, event.cycle) for event in rig.events()] == [
        (EventKind.REJECTED, 1, 5),
        (EventKind.ACCEPTED, 2, 5),
        (EventKind.COMPLETED, 2, 5),
    ]


def test_missed_periods_are_counted_and_not_caught_up(rig: Rig) -> None:
    """A pause of the machine costs its periods, and no burst of torques follows."""
    rig.run(5)
    rig.clock.advance_to_ns(rig.clock.now_ns() + 7 * PERIOD_NS)
    rig.run(3)
    assert [record["missed_periods"] for record in rig.records()[-3:]] == [6.0, 6.0, 6.0]
    assert rig.cycle.number == 8


def test_a_table_is_refused_while_something_is_held(rig: Rig) -> None:
    """The table in force stays in force until the object is let go."""
    rig.hold()
    rig.load_table(token=5)
    rig.run(1, OPEN)
    assert rig.told() == [(EventKind.REJECTED, 5, Reason.WRONG_PHASE)]


def test_handing_tables_over_leaks_no_descriptor(rig: Rig) -> None:
    """A day of grasps does not use up the cycle's files."""
    rig.load_table(token=90)
    rig.run(1)  # the table in force keeps its memory mapped
    before = len(os.listdir("/proc/self/fd"))
    for token in range(10):
        rig.load_table(token)
        rig.run(1)
    assert len(os.listdir("/proc/self/fd")) == before


def test_without_a_front_the_cycle_ends_in_idle(rig: Rig) -> None:
    """The front's end of the link is gone: stop, hold, ask for idle, and end; what is held stays held."""
    rig.hold()
    rig.command_link.close()
    rig.run(200, OPEN)
    assert rig.cycle.finished
    assert rig.wam.mode == 1
    assert rig.told()[-1] == (EventKind.STOPPED, 0, Reason.NONE)
    assert rig.phase() is not GraspPhase.RELEASING


def silent(rig: Rig) -> None:
    rig.wam.silent_nodes.update(range(1, 8))


def pulled(rig: Rig) -> None:
    rig.bus.pulled = True


@pytest.mark.parametrize(("fail", "reason"), [(silent, Reason.ARM_SILENT), (pulled, Reason.BUS_FAILED)])
def test_a_lost_arm_is_one_fault_and_the_object_stays_held(
    rig: Rig, fail: Callable[[Rig], None], reason: Reason
) -> None:
    """Pucks that do not answer, or no bus at all: told once, records go on, and the hand keeps what it has."""
    rig.hold()
    rig.records()
    fail(rig)
    rig.run(40, OPEN)
    assert rig.told() == [(EventKind.FAULT, 0, reason)]
    assert len(rig.records()) == 40
    assert rig.phase() is GraspPhase.FAULT


def test_an_arm_that_reports_no_positions_goes_idle(rig: Rig) -> None:
    """Protects whoever stands beside it: feedback on positions of long ago would push blindly, so the arm is idled."""
    rig.hold()
    assert rig.wam.mode == 2
    rig.wam.silent_nodes.add(3)
    rig.run(40, OPEN)
    assert rig.wam.mode == 1
    assert (EventKind.FAULT, 0, Reason.ARM_SILENT) in rig.told()
    assert rig.phase() is GraspPhase.FAULT


def test_fingers_come_free_without_the_arms_bus(rig: Rig) -> None:
    """The hand has a bus of its own: with the arm's gone, release is still heard and carried out."""
    rig.hold()
    rig.bus.pulled = True
    rig.run(20, OPEN)
    rig.events()
    rig.send(CommandKind.RELEASE, token=7)
    rig.run(20, OPEN)
    assert rig.told() == [(EventKind.ACCEPTED, 7, Reason.NONE), (EventKind.COMPLETED, 7, Reason.NONE)]
    assert rig.phase() is GraspPhase.NONE
    assert rig.set_point().mode is HandMode.OPEN


def test_the_cycle_ends_without_the_arms_bus(rig: Rig) -> None:
    """A daemon whose CAN adapter was pulled can be shut down, and says that it does not know the arm idle."""
    rig.run(5)
    rig.bus.pulled = True
    rig.run(5)
    rig.events()
    rig.send(CommandKind.SHUTDOWN, token=7)
    rig.run(1000)
    assert rig.cycle.finished
    assert (EventKind.STOPPED, 0, Reason.ARM_SILENT) in rig.told()


def test_a_refused_set_point_is_told_as_such(rig: Rig) -> None:
    """The hand process refuses a set-point before it takes a new sample: the reason must arrive all the same."""
    rig.hold()
    sample_ns = rig.clock.now_ns()
    rig.tell_hand(OPEN, sample_ns)
    rig.run(1)
    refused = replace(OPEN, mode=HandMode.TRACK, fault=HandFault.REFUSED)
    for _ in range(100):
        rig.tell_hand(refused, sample_ns)
        rig.run(1)
    assert rig.told() == [(EventKind.FAULT, 0, Reason.HAND_REFUSED)]


def test_fingers_come_free_while_the_arm_is_started(rig: Rig) -> None:
    """Trapped fingers do not wait for pucks to wake: release is carried out in the middle of a start-up."""
    rig.hold()
    rig.press("estop")
    rig.run(30, OPEN)
    rig.press("release")
    rig.press("idle")
    rig.run(60, OPEN)
    rig.events()
    rig.records()
    first = rig.cycle.number
    rig.send(CommandKind.FAULT_CLEAR, token=7)
    rig.send(CommandKind.FAULT_CLEAR, token=8, effective_cycle=first + 50)
    rig.send(CommandKind.RELEASE, token=9, effective_cycle=first + 100)
    rig.run(1, OPEN)
    records = rig.records()
    assert len(records) > 500  # over a second, and a record every period
    assert np.all(np.diff([record["cycle"] for record in records]) == 1)
    told = {(event.kind, event.token, event.reason): event.cycle - first for event in rig.events()}
    assert told[EventKind.REJECTED, 8, Reason.BUSY] == 50
    assert told[EventKind.ACCEPTED, 9, Reason.NONE] == 100
    assert told[EventKind.COMPLETED, 7, Reason.NONE] > 500
    rig.run(20, OPEN)
    assert rig.set_point().mode is HandMode.OPEN
    assert rig.wam.mode == 1


def test_an_arm_that_cannot_be_started_keeps_its_fault(rig: Rig) -> None:
    """The operator hears why, the fault stands, and clearing it may be tried again."""
    rig.hold()
    rig.wam.silent_nodes.update({2, 3})
    rig.run(40, OPEN)
    rig.events()
    rig.send(CommandKind.FAULT_CLEAR, token=7)
    rig.run(1, OPEN)
    assert (EventKind.REJECTED, 7, Reason.ARM_NOT_READY) in rig.told()
    assert any("[2, 3]" in text for text in rig.said)
    rig.wam.silent_nodes.clear()
    rig.run(2, OPEN)
    rig.send(CommandKind.FAULT_CLEAR, token=8)
    rig.run(1, OPEN)
    assert (EventKind.COMPLETED, 8, Reason.NONE) in rig.told()
    assert rig.parts.orders.fault is Reason.NONE
