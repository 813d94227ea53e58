"""What the front tells without being asked: a lost cycle, faults, warnings, a link that is full."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from controller.messages import CommandKind, EventKind, Reason
from tests.controller.service.front_office import COMMANDS_WAITING, Office


def dies(office: Office) -> None:
    office.event_link.close()
    office.beat(2, record=False)


def falls_silent(office: Office) -> None:
    office.beat(9, record=False)
    assert office.idled == []
    office.beat(5, record=False)


@pytest.mark.parametrize("lose", [dies, falls_silent])
def test_a_lost_cycle_has_its_arm_idled_once(office: Office, lose: Callable[[Office], None]) -> None:
    """Dead or silent for 20 ms: the safety puck is asked for idle, everybody is told, and what was under way fails."""
    other = office.connect()
    other.send(msgspec.msgpack.encode({"v": 1, "seq": 1, "command": "hello", "args": {}}))
    office.ask("arm.move_joints", seq=4, joint_rad=[0.0] * 7)
    (command,) = office.heard()
    office.tell(EventKind.ACCEPTED, command.token)
    office.answers()
    office.answers(other)
    lose(office)
    assert len(office.idled) == 1
    fault, failed = office.answers()
    assert (fault["event"], fault["code"]) == ("fault", "cycle_lost")
    assert "is asked for idle" in fault["message"]
    assert (failed["event"], failed["seq"], failed["error"]["code"]) == ("failed", 4, "cycle_lost")
    assert [answer["event"] for answer in office.answers(other)] == ["fault"]
    assert any("cycle_lost" in text or "arm" in text for text in office.said)
    office.beat(100, record=False)
    assert len(office.idled) == 1
    office.ask("arm.hold", seq=5)
    assert office.only_answer()["error"]["code"] == "cycle_lost"
    office.ask("status", seq=6)
    assert "is asked for idle" in office.only_answer()["result"]["cycle_lost"]


def test_a_cycle_that_has_ended_is_not_lost(office: Office) -> None:
    """After an orderly stop nobody is alarmed by its silence."""
    office.front.shut_down()
    (command,) = office.heard()
    assert command.kind is CommandKind.SHUTDOWN
    office.tell(EventKind.STOPPED, 0)
    office.event_link.close()
    office.beat(50, record=False)
    assert office.front.stopped
    assert office.idled == []


def test_a_fault_is_told_to_every_client(office: Office) -> None:
    """Whoever has spoken to the daemon hears of a fault, with what to do; so does the log."""
    other = office.connect()
    for connection in (office.client, other):
        connection.send(msgspec.msgpack.encode({"v": 1, "seq": 1, "command": "hello", "args": {}}))
    office.beat()
    for connection in (office.client, other):
        office.answers(connection)
    office.tell(EventKind.FAULT, 0, Reason.COLLISION)
    for connection in (office.client, other):
        (event,) = office.answers(connection)
        assert (event["event"], event["seq"], event["code"]) == ("fault", None, "collision")
        assert event["help"]
    assert office.said
    assert office.recorder.events == ["fault"]


def test_a_full_link_refuses_and_recovers(office: Office) -> None:
    """A cycle that does not listen makes the front say so, not wait; afterwards all is as before."""
    for seq in range(COMMANDS_WAITING + 1):
        office.ask("arm.hold", seq=seq)
    answer = office.only_answer()
    assert (answer["seq"], answer["ok"]) == (COMMANDS_WAITING, False)
    assert len(office.heard()) == COMMANDS_WAITING
    office.ask("arm.hold", seq=50)
    (command,) = office.heard()
    office.tell(EventKind.COMPLETED, command.token)
    assert office.only_answer()["ok"] is True


def test_a_warning_is_told_once_and_stays_in_the_status(office: Office) -> None:
    """Who connects later must find out too what is amiss with a device; twenty at most, the newest."""
    office.ask("hello")
    office.only_answer()
    for _ in range(2):
        office.front.warn("hand_motor", "tendon motor 1 is hot.")
    told = office.only_answer()
    assert (told["event"], told["code"], told["message"]) == ("warning", "hand_motor", "tendon motor 1 is hot.")
    for number in range(25):
        office.front.warn("hand_motor", f"number {number}.")
    office.answers()
    office.ask("status", seq=2)
    warnings = office.only_answer()["result"]["warnings"]
    assert [warning["message"] for warning in warnings] == [f"number {number}." for number in range(5, 25)]
