"""Who is on the bus, asked of literal pucks."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from drivers.errors import DeviceError, NoReplyError, ProtocolError
from drivers.wam.dialogue import Dialogue
from drivers.wam.discovery import Survey, require_motors, require_safety_puck, survey

if TYPE_CHECKING:
    from tests.drivers.wam.conftest import ScriptedArm

MakeArm = Callable[..., "ScriptedArm"]
NEVER_NS = 10**15


def _survey(arm: ScriptedArm) -> Survey:
    return survey(Dialogue(arm.bus, arm.clock))


def test_a_whole_arm_is_found_with_roles_and_versions(make_arm: MakeArm) -> None:
    """Protects the enumeration: nodes 1 to 31 asked once and in order, answers of all eight, in a tenth of a second."""
    arm = make_arm()
    arm.sleep(4)
    found = _survey(arm)
    assert [identifier for _, identifier, data in arm.heard if data == b"\x05"] == list(range(1, 32))
    assert [puck.node for puck in found.pucks] == [1, 2, 3, 4, 5, 6, 7, 10]
    assert [puck.firmware for puck in found.motors] == [200, 200, 200, 12, 200, 200, 200]
    assert found.asleep == (4,)
    assert found.foreign == ()
    require_motors(found)
    assert require_safety_puck(found).firmware == 197
    assert arm.clock.now_ns() < 150_000_000


def test_a_lost_question_is_repeated(make_arm: MakeArm) -> None:
    """Protects against adapters that drop a frame: an arm node that seemed absent is asked again."""
    arm = make_arm()
    arm.loses = lambda number: number == 2
    assert [puck.node for puck in _survey(arm).motors] == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("silent", "words"),
    [((3, 5), r"pucks \[3, 5\] of 1 to 7"), ((5, 6, 7), r"pucks \[5, 6, 7\]"), (tuple(range(1, 8)), "no motor puck")],
)
def test_missing_pucks_are_named(make_arm: MakeArm, silent: tuple[int, ...], words: str) -> None:
    """Protects the operator: which nodes are silent, and that E-stop and cables are to be looked at."""
    arm = make_arm()
    for node in silent:
        arm.pucks[node].silent_until_ns = NEVER_NS
    with pytest.raises(NoReplyError, match=words) as caught:
        require_motors(_survey(arm))
    assert "E-stop" in caught.value.help
    assert "cables" in caught.value.help


def test_a_missing_safety_puck_tells_who_else_is_there(make_arm: MakeArm) -> None:
    """Protects the search for the fault: a dead bus and a missing safety puck read differently."""
    arm = make_arm()
    del arm.pucks[10]
    with pytest.raises(NoReplyError, match=r"nodes \[1, 2, 3, 4, 5, 6, 7\] answer"):
        require_safety_puck(_survey(arm))
    arm.pucks.clear()
    with pytest.raises(NoReplyError, match="nor from any other") as caught:
        require_safety_puck(_survey(arm))
    assert "1 Mbit/s" in caught.value.help


@pytest.mark.parametrize(
    ("node", "name", "value", "error", "words"),
    [
        (6, "STAT", 1, DeviceError, "reports an error"),
        (6, "STAT", 7, ProtocolError, "STAT 7"),
        (6, "ROLE", 0x0082, ProtocolError, "0x0082 is not an arm motor's"),
        (5, "ROLE", 0x0141, ProtocolError, "gimbals"),
    ],
)
def test_pucks_that_are_no_arm_motor_are_refused(
    make_arm: MakeArm, node: int, name: str, value: int, error: type[DeviceError], words: str
) -> None:
    """Protects the arm from a puck in the wrong place or in trouble."""
    arm = make_arm()
    arm.pucks[node].values[name] = value
    with pytest.raises(error, match=words):
        require_motors(_survey(arm))


def test_a_motor_at_the_safety_node_is_refused(make_arm: MakeArm) -> None:
    """Protects the operator's stop: without a true safety puck nothing runs."""
    arm = make_arm()
    arm.safety["ROLE"] = 0x01C0
    with pytest.raises(ProtocolError, match="safety puck's"):
        require_safety_puck(_survey(arm))


def test_hand_sensor_and_foreign_nodes_are_told_apart(make_arm: MakeArm) -> None:
    """Protects other devices on the bus: known ones have their place, others are reported and let be."""
    arm = make_arm()
    for node, role in ((8, 0x0006), (11, 0x0105), (12, 0x01C0), (15, 0x0100), (20, 0x0003)):
        arm.pucks[node] = make_arm().pucks[1]
        arm.pucks[node].values["ROLE"] = role
    found = _survey(arm)
    assert found.force_sensor is not None
    assert [puck.node for puck in found.hand] == [11]
    assert [puck.node for puck in found.foreign] == [12, 15, 20]
    require_motors(found)


def test_a_puck_in_its_monitor_need_not_tell_its_role(make_arm: MakeArm) -> None:
    """Protects against old monitors (reference 8.6): an unknown role is checked after waking, not refused here."""
    arm = make_arm()
    arm.sleep(2)
    arm.pucks[2].name = lambda number: {5: "STAT", 0: "VERS"}.get(number, "")  # type: ignore[method-assign]  # mute ROLE
    found = _survey(arm)
    assert found.motors[1].role is None
    require_motors(found)
