"""Firmware generations: every number and reply of the reference's tables, byte by byte, and whole arms of each.

The rows of `puck_replies.txt` are literal, so that driver and simulation cannot agree on a wrong table.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import InputError
from drivers.simulated.puck_settings import PuckSettings

HOME = ["423#000000", "443#3F701F", "463#008FE0", "483#3F7088", "4A3#000000", "4C3#000000", "4E3#000000"]
"""Of 4096 counts a turn, reference 5.2."""
REPLIES: dict[tuple[int, str], list[list[str]]] = defaultdict(list)
for line in Path(__file__).with_name("puck_replies.txt").read_text().splitlines():
    if not line.startswith("#"):
        REPLIES[int(line.split()[0]), line.split()[1]].append(line.split())


@pytest.mark.parametrize(("firmware", "kind"), list(REPLIES))
def test_every_property_answers_with_the_reference_bytes(talk: Callable[..., Any], firmware: int, kind: str) -> None:
    """Protects the numbers of each firmware: some 500 literal requests and replies, widths included."""
    rows = REPLIES[firmware, kind]
    node = 2 if kind == "motor" else 10
    values = PuckSettings(firmware=firmware, properties={row[2]: int(row[3]) for row in rows})
    arm = talk(zeroed=False, pucks={node: values})
    assert [(row[4], arm.say(row[4])) for row in rows] == [(row[4], [row[5]]) for row in rows]


@pytest.mark.parametrize(
    ("firmware", "request_position", "answers"),
    [
        (200, "404#30", HOME),
        (141, "404#30", HOME),
        (118, "404#30", HOME),
        # ten times the counts: floor(40960 / 2π × 56.5) = 368322, of −56.5 −368323, of −56.34 −367280
        (60, "404#1A", ["423#000000", "443#3A613D", "463#059EC2", "483#3A6550"]),
        (60, "405#1A", ["4A3#000000", "4C3#000000", "4E3#000000"]),
    ],
)
def test_home_of_each_generation(
    talk: Callable[..., Any], firmware: int, request_position: str, answers: list[str]
) -> None:
    """Protects the position cycle of old arms: another number for P, ten times the counts, a wrist in group 5."""
    assert talk(motor_firmware=firmware).say(request_position) == answers


@pytest.mark.parametrize(
    ("firmware", "replies", "of_safety_puck", "reply"),
    [
        (200, "466#8000C800 4E6#8100C001 546#8000C500", "00A#2B", "546#AB0049123F0D"),
        (141, "466#80008D00 4E6#8100C001 546#80008D00", "00A#2B", "546#AB0000000000"),
        (118, "466#80007600 4E6#8100C001 546#80007600", "00A#2A", "546#AA000100"),
        (60, "466#80003C00 4E6#8100C000 546#80003C00", "00A#37", "546#B7000100"),
    ],
)
def test_identity_of_each_generation(
    talk: Callable[..., Any], firmware: int, replies: str, of_safety_puck: str, reply: str
) -> None:
    """Protects start-up's checks: versions, ROLE with and without absolute encoder, PEN or ZERO where they are."""
    arm = talk(motor_firmware=firmware)
    assert [*arm.say("003#00"), *arm.say("007#01"), *arm.say("00A#00")] == replies.split()
    assert arm.say(of_safety_puck) == [reply]


@pytest.mark.parametrize(("firmware", "frame", "other"), [(200, "AA", "89"), (60, "89", "AA")])
def test_torques_of_each_generation(talk: Callable[..., Any], firmware: int, frame: str, other: str) -> None:
    """Protects T: property 42 today, 9 in firmware 50 to 60; the other generation's number moves nothing."""
    arm = talk(motor_firmware=firmware)
    arm.press("activate")
    arm.say(f"401#{other}04B00000000000")
    assert not arm.plant.torque_Nm.any()
    arm.say(f"401#{frame}04B00000000000")  # 300 units, 2700 a N·m, ratio −42
    assert arm.plant.torque_Nm[0] == pytest.approx(-42 * 300 / 2700)


def test_unknown_firmware_nodes_and_properties_are_refused(talk: Callable[..., Any]) -> None:
    """Protects tests and users from an arm that is not what they asked for."""
    with pytest.raises(InputError, match="expected version 32 or later"):
        talk(motor_firmware=20)
    with pytest.raises(InputError, match=r"pucks \[9\] do not exist"):
        talk(pucks={9: PuckSettings()})
    with pytest.raises(InputError, match="no property 'JP'"):
        talk(motor_firmware=118, pucks={3: PuckSettings(properties={"JP": 1})})
