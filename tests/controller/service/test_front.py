"""The front between clients and a cycle that the tests play."""

from __future__ import annotations

import os
from typing import Any

import msgspec
import pytest

from controller.messages import CommandKind, EventKind, Reason
from tests.controller.service.front_office import PLACE, TABLE, Office


def test_a_fast_command_is_answered_when_the_cycle_has_done_it(office: Office) -> None:
    """Yes means done, and says in which cycle."""
    office.ask("arm.hold", seq=7)
    (command,) = office.heard()
    assert command.kind is CommandKind.ARM_HOLD
    office.tell(EventKind.ACCEPTED, command.token)
    assert office.answers() == []
    office.tell(EventKind.COMPLETED, command.token)
    answer = office.only_answer()
    assert (answer["seq"], answer["ok"]) == (7, True)
    assert answer["result"]["cycle"] == office.cycle - 1


def test_a_slow_command_is_accepted_and_then_completed(office: Office) -> None:
    """The client goes on at once, and hears the end; what was applied stands beside what was desired."""
    office.planner.table = TABLE
    office.ask("grasp.squeeze", seq=3, load_N=45.0, duration_s=1.0)
    (command,) = office.heard()
    office.tell(EventKind.ACCEPTED, command.token)
    accepted = office.only_answer()
    assert accepted["result"]["accepted"] is True
    assert accepted["result"]["desired"]["load_N"] == 45.0
    office.tell(EventKind.COMPLETED, command.token, Reason.LOAD_CAP_REACHED, 0.0011, 46.5, 44.0)
    event = office.only_answer()
    assert (event["event"], event["seq"], event["command"]) == ("completed", 3, "grasp.squeeze")
    assert event["applied"] == {"mean_excursion_m": 0.0011, "measured_load_N": 46.5, "table_load_N": 44.0}
    assert event["reason"]["code"] == "load_cap_reached"
    assert event["desired"]["load_N"] == 45.0
    assert office.recorder.events == ["completed"]


def test_a_slow_command_tells_how_far_it_is_to_who_sent_it(office: Office) -> None:
    """Ten times a second from its acceptance to its end; nobody else hears it, and the recording is not filled."""
    office.planner.table = TABLE
    other = office.connect()
    office.ask("grasp.squeeze", seq=3, load_N=45.0, duration_s=1.0)
    (command,) = office.heard()
    office.beat(100)
    assert office.answers() == []
    office.tell(EventKind.ACCEPTED, command.token)
    office.beat(500)
    told = [answer for answer in office.answers() if answer.get("event") == "progress"]
    assert 9 <= len(told) <= 10
    assert {(event["seq"], event["command"], event["done"]) for event in told} == {(3, "grasp.squeeze", 0.0)}
    office.tell(EventKind.COMPLETED, command.token, Reason.NONE, 0.0011, 46.5, 44.0)
    office.beat(200)
    assert [answer["event"] for answer in office.answers()] == ["completed"]
    assert office.answers(other) == []
    assert office.recorder.events == ["completed"]


def test_where_contact_was_found_is_told(office: Office) -> None:
    """Fingers that touch too far apart are seen in the answer: found beside expected, right and left."""
    office.ask("grasp.close")
    (command,) = office.heard()
    office.tell(EventKind.ACCEPTED, command.token)
    office.tell(EventKind.COMPLETED, command.token, Reason.NONE, 0.0121, 0.0119, 0.0120, 0.0120, 0.0)
    event = office.answers()[-1]
    assert (event["contact_excursion_m"], event["expected_excursion_m"]) == ([0.0121, 0.0119], [0.0120, 0.0120])
    assert "object_offset_m" not in event


def test_an_object_off_the_hands_axis_is_told(office: Office) -> None:
    """The grasp holds, but off-centre: the event warns, and says about how far the object stood off."""
    office.ask("grasp.close")
    (command,) = office.heard()
    office.tell(EventKind.ACCEPTED, command.token)
    office.tell(EventKind.COMPLETED, command.token, Reason.OFF_CENTRE, 0.0114, 0.0121, 0.0120, 0.0120, 0.006)
    event = office.answers()[-1]
    assert (event["event"], event["reason"]["code"], event["object_offset_m"]) == ("completed", "off_centre", 0.006)


@pytest.mark.parametrize("accepted", [False, True])
def test_a_refusal_and_a_failure_say_why(office: Office, accepted: bool) -> None:
    """Refused at once it is an error reply; failed on the way it is an event with the same error."""
    office.ask("arm.move_joints", seq=4, joint_rad=[0.0] * 7)
    (command,) = office.heard()
    if accepted:
        office.tell(EventKind.ACCEPTED, command.token)
        office.answers()
    office.tell(EventKind.FAILED if accepted else EventKind.REJECTED, command.token, Reason.ARM_NOT_ACTIVE)
    answer = office.only_answer()
    assert answer["seq"] == 4
    assert answer["error"]["code"] == "arm_not_active"
    assert "pendant" in answer["error"]["help"]
    assert answer.get("event") == ("failed" if accepted else None)


@pytest.mark.parametrize("accepted", [False, True])
def test_a_deadline_ends_the_command_and_stops_the_robot(office: Office, accepted: bool) -> None:
    """What takes longer than the client allows is stopped, and its later end is nobody's any more."""
    office.ask("arm.move_joints", seq=4, deadline_s=0.05, joint_rad=[0.0] * 7)
    (command,) = office.heard()
    if accepted:
        office.tell(EventKind.ACCEPTED, command.token)
        office.answers()
    office.beat(20)
    assert office.answers() == []
    office.beat(10)
    answer = office.only_answer()
    assert answer["error"]["code"] == "deadline"
    assert answer.get("event") == ("failed" if accepted else None)
    (stop,) = office.heard()
    assert stop.kind is CommandKind.STOP
    office.tell(EventKind.COMPLETED, stop.token)
    office.tell(EventKind.FAILED, command.token, Reason.STOPPED_BY_COMMAND)
    assert office.answers() == []


def test_a_preposition_goes_step_by_step(office: Office) -> None:
    """Table, approach, arrival: each only when the one before is done; the client hears one answer and one end."""
    office.ask("grasp.preposition", seq=9, table="mug", **PLACE)
    kinds = []
    for _ in range(3):
        (command,) = office.heard()
        kinds.append(command.kind)
        office.tell(EventKind.ACCEPTED, command.token)
        assert office.heard() == []
        office.tell(EventKind.COMPLETED, command.token)
    assert kinds[0] is CommandKind.LOAD_TABLE
    assert kinds[2] is CommandKind.PREPOSITION
    reply, end = office.answers()
    assert reply["result"]["accepted"] is True
    assert (end["event"], end["seq"]) == ("completed", 9)
    office.ask("status", seq=10)
    assert office.only_answer()["result"]["table"] == "mug"


def test_a_step_that_fails_ends_the_chain(office: Office) -> None:
    """Stopped on the approach, the hand does not go in."""
    office.ask("grasp.preposition", table="mug", **PLACE)
    for ending, reason in ((EventKind.COMPLETED, Reason.NONE), (EventKind.FAILED, Reason.STOPPED_BY_COMMAND)):
        (command,) = office.heard()
        office.tell(EventKind.ACCEPTED, command.token)
        office.tell(ending, command.token, reason)
    assert office.heard() == []
    assert office.answers()[-1]["error"]["code"] == "stopped"


@pytest.mark.parametrize(
    ("command", "args", "code"),
    [
        ("grasp.preposition", {"table": "stranger", **PLACE}, "bad_table"),
        ("table.load", {"table": "stranger"}, "bad_table"),
        ("table.load", {"table": "cup"}, "no_table"),
        ("grasp.squeeze", {"load_N": 45.0}, "no_table"),
        ("grasp.squeeze", {"load_N": float("nan")}, "not_finite"),
        ("grasp.crush", {}, "unknown_command"),
    ],
)
def test_what_the_front_refuses_never_reaches_the_cycle(
    office: Office, command: str, args: dict[str, Any], code: str
) -> None:
    """A table for another hand, or none, or nonsense: an answer with the reason, and no command."""
    office.ask(command, seq=5, **args)
    answer = office.only_answer()
    assert (answer["seq"], answer["ok"], answer["error"]["code"]) == (5, False, code)
    assert office.heard() == []


def test_a_table_is_in_force_only_once_the_cycle_has_it(office: Office) -> None:
    """While something is gripped the cycle refuses another table: squeezes go on by the one it has."""
    office.planner.table, office.planner.table_name = TABLE, "the one in force"
    office.ask("table.load", table="mug")
    (command,) = office.heard()
    office.tell(EventKind.REJECTED, command.token, Reason.WRONG_PHASE)
    assert office.only_answer()["error"]["code"] == "wrong_phase"
    assert office.planner.table_name == "the one in force"


def test_an_index_is_chosen_only_once_the_cycle_has_it(office: Office) -> None:
    """A refused choice of index is not the default of the next one."""
    office.ask("compensation.set", enabled=True, index="fused")
    (command,) = office.heard()
    office.tell(EventKind.REJECTED, command.token, Reason.WRONG_PHASE)
    office.ask("compensation.set", enabled=True)
    (again,) = office.heard()
    assert again.values != command.values


def test_answers_at_once_what_it_knows(office: Office) -> None:
    """Hello and tables need no cycle; the state is the newest record's."""
    office.ask("hello")
    hello = office.only_answer()["result"]
    assert hello["tables"] == ["mug", "stranger"]
    assert "grasp.release" in hello["commands"]
    office.ask("table.list")
    assert [table["usable"] for table in office.only_answer()["result"]["tables"]] == [True, False]
    office.ask("status")
    assert office.only_answer()["result"]["state"]["cycle"]["number"] == office.cycle - 1


def test_every_cycle_is_recorded_and_some_are_published(office: Office) -> None:
    """The recorder misses nothing; the stream has its own rate and says wall time."""
    office.beat(200)
    numbers = [number for number, _ in office.recorder.cycles]
    assert numbers == list(range(1, office.cycle + 1))
    assert office.publisher.newest is not None
    state = msgspec.msgpack.decode(office.publisher.newest)
    assert state["timestamp"] == 7.0
    assert office.cycle - 5 <= state["cycle"]["number"] <= office.cycle


def test_handing_tables_over_leaks_no_descriptor(office: Office) -> None:
    """A day of grasps does not use up the process's files."""
    before = len(os.listdir("/proc/self/fd"))
    for seq in range(20):
        office.ask("table.load", seq=seq, table="mug")
        (command,) = office.heard()
        office.tell(EventKind.ACCEPTED, command.token)
        office.tell(EventKind.COMPLETED, command.token)
    assert len(os.listdir("/proc/self/fd")) == before
