"""What motor pucks of every generation say of themselves, and what is refused before any torque."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from drivers.errors import NoReplyError, ProtocolError
from drivers.wam.dialogue import Dialogue
from drivers.wam.motor_settings import MotorSettings, read_motor_settings
from drivers.wam.parameters import load_wam_parameters

if TYPE_CHECKING:
    from tests.drivers.wam.conftest import ScriptedArm

MakeArm = Callable[..., "ScriptedArm"]


def _read(arm: ScriptedArm) -> MotorSettings:
    return read_motor_settings(Dialogue(arm.bus, arm.clock), load_wam_parameters())


@pytest.mark.parametrize(
    ("firmware", "position_id", "torque_id", "notes"),
    [(200, 48, 42, 0), (141, 48, 42, 0), (118, 48, 42, 0), (63, 48, 42, 0), (60, 26, 9, 0), (32, 26, 10, 2)],
)
def test_every_generation_tells_its_settings(
    make_arm: MakeArm, firmware: int, position_id: int, torque_id: int, notes: int
) -> None:
    """Protects old arms: numbers of P and T by reference 3.1; where IPNM and POLES do not exist yet, it is said."""
    arm = make_arm(firmware, 60 if firmware < 61 else 197)
    found = _read(arm)
    assert found.firmware == (firmware,) * 7
    assert (found.position_id, found.torque_id) == (position_id, torque_id)
    assert found.units_per_Nm == (2700, 2700, 2700, 2700, 6500, 6500, 17474)
    assert found.torque_limit_units == (4860, 4860, 4860, 4320, 3900, 3900, 1600)
    assert found.absolute_encoder == (firmware >= 118,) * 7
    assert len(found.notes) == notes


def test_wrist_pucks_in_group_5_are_asked_there(make_arm: MakeArm) -> None:
    """Protects older arms (reference 0.5): GRPC 5 of pucks 5 to 7 works, and says so."""
    arm = make_arm()
    for node in (5, 7):
        arm.pucks[node].values["GRPC"] = 5
    found = _read(arm)
    assert found.position_groups == (4, 5)
    assert "group 5" in found.notes[0]


def test_counts_of_old_encoders(make_arm: MakeArm) -> None:
    """Protects 40960-count pucks: as 32 bits, and as 16, where the number reads negative."""
    arm = make_arm(60, 60)
    for node in range(1, 8):
        arm.pucks[node].values["CTS"] = 40960 if node < 5 else 40960 - 65536
    assert _read(arm).counts_per_turn == (40960,) * 7


@pytest.mark.parametrize(
    ("node", "name", "value", "words"),
    [
        (4, "GRPA", 3, r"GRPA .* expected 0, 0"),
        (2, "GRPB", 2, "GRPB"),
        (3, "GRPC", 5, r"GRPC .* 4, 4, 4, 4, 4 or 5"),
        (6, "GRPC", 3, r"GRPC of pucks 1 to 7"),
        (2, "PIDX", 3, "PIDX"),
        (2, "IPNM", 0, "IPNM"),
        (7, "MT", -5, "MT"),
        (1, "CTS", 4095, "4096 or 40960"),
        (7, "POLES", 8, "gimbals"),
        (7, "POLES", 2, "wrist"),
        (3, "ROLE", 0x0105, "not an arm motor's"),
        (3, "VERS", 60, "2 ways"),
    ],
)
def test_settings_that_make_no_arm_are_refused(make_arm: MakeArm, node: int, name: str, value: int, words: str) -> None:
    """Protects against a puck that would take another's torque, or count in other units."""
    arm = make_arm()
    arm.pucks[node].values[name] = value
    with pytest.raises(ProtocolError, match=words) as caught:
        _read(arm)
    assert caught.value.help


def test_a_puck_that_falls_silent_is_named(make_arm: MakeArm) -> None:
    """Protects the operator: node and property, after three questions of 50 ms."""
    arm = make_arm()
    arm.pucks[6].numbers = {name: number for name, number in arm.pucks[6].numbers.items() if name != "PIDX"}
    with pytest.raises(NoReplyError, match=r"puck 6: no reply to PIDX within 50 ms, asked 3 times"):
        _read(arm)
