"""The simulated WAM against the rules of the WAM reference 4 and its worked frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.simulated.can_wire import Frame

_MS = 1_000_000


def test_home_gives_the_reference_counts(talk: Callable[..., Any]) -> None:
    """Protects the encoders: a zeroed arm at home reports the floored counts of reference 5.2, in node order."""
    arm = talk()
    expected = ["423#000000", "443#3F701F", "463#008FE0", "483#3F7088", "4A3#000000", "4C3#000000", "4E3#000000"]
    assert arm.say("404#30") == expected
    assert arm.say("004#30") == ["483#3F7088"]


def test_position_is_unrelated_until_it_is_set(talk: Callable[..., Any]) -> None:
    """Protects zeroing: before it P is the angle within a turn; SET P moves P and leaves MECH."""
    arm = talk(zeroed=False)
    before = arm.say("002#42")
    assert arm.say("002#30") != ["443#3F701F"]
    assert arm.say("002#B0001F70FFFF") == []
    assert arm.say("002#30") == ["443#3F701F"]
    assert arm.say("002#42") == before
    assert arm.say("00A#2A") == ["546#AA000000"]


def test_property_replies_have_the_reference_bytes(talk: Callable[..., Any]) -> None:
    """Protects addressing and widths: node, group, absent property."""
    arm = talk()
    assert arm.say("003#00") == ["466#8000C800"]
    assert arm.say("007#01") == ["4E6#8100C001"]
    assert arm.say("00A#01") == ["546#81008200"]
    assert arm.say("00A#08") == ["546#88000100"]
    assert arm.say("002#44") == ["446#C40000100000"]
    assert arm.say("005#56") == ["4A6#D6006419"]
    assert [text[:3] for text in arm.say("402#05")] == ["4A6", "4C6", "4E6", "546"]
    assert arm.say("00A#2B") == ["546#AB0049123F0D"]
    assert arm.say("001#7F") == []
    assert arm.say("009#05") == []


def test_torques_reach_the_plant_only_in_torque_mode(talk: Callable[..., Any]) -> None:
    """Protects the rule that an idle puck brakes; active, the units become joint torques by the formulas of 5.2."""
    arm = talk()
    frame = "AA000031FF48C292"  # units 0, 799, -733, 658
    arm.say(f"401#{frame}", _MS)
    assert arm.plant.braking
    assert not arm.plant.torque_Nm.any()
    arm.press("activate")
    arm.say(f"401#{frame}", 3 * _MS)
    assert not arm.plant.braking
    assert arm.plant.at_ns == 3 * _MS
    T2, T3, T4 = 799 / 2700, -733 / 2700, 658 / 2700
    expected = [0, 28.25 * (T2 - T3), -28.25 / 1.68 * (T2 + T3), -18 * T4, 0, 0, 0]
    np.testing.assert_allclose(arm.plant.torque_Nm, expected, rtol=3e-6)
    arm.say("400#" + frame.replace("AA", "AB", 1))  # another property number: no torque
    np.testing.assert_allclose(arm.plant.torque_Nm, expected, rtol=3e-6)


def test_puck_limits_torque_to_mt(talk: Callable[..., Any]) -> None:
    """Protects the motors' own limit: 5000 units become 4860 on motor 1."""
    arm = talk()
    arm.press("activate")
    arm.say("401#AA4E200000000000")
    assert arm.plant.torque_Nm[0] == pytest.approx(-42 * 4860 / 2700)


def test_host_lowers_the_mode_and_never_raises_it(talk: Callable[..., Any]) -> None:
    """Protects the pendant: idle on request from firmware 197 on; no request raises the mode."""
    arm = talk()
    arm.say("00A#880002000000")
    arm.say("404#880002000000")
    assert arm.wam.mode == 1
    assert arm.plant.braking
    arm.press("activate")
    assert arm.say("00A#880001000000") == ["540#88000000"]
    assert arm.wam.mode == 1
    assert arm.plant.braking
    old = talk(safety_firmware=190)
    old.press("activate")
    assert old.say("00A#880001000000") == []
    assert old.wam.mode == 2


def test_pendant_follows_the_operator(talk: Callable[..., Any]) -> None:
    """Protects the life cycle of reference 4.1, and that E-stop costs power, positions and ZERO."""
    arm = talk()
    assert arm.press("activate") == ["540#88000200"]
    assert arm.press("activate") == []
    arm.press("estop")
    assert (arm.wam.mode, arm.plant.braking) == (0, True)
    assert arm.say("404#30") == []
    assert arm.say("00A#2B") == ["546#AB0049427900"]
    arm.press("idle")
    arm.press("release")
    assert arm.wam.mode == 0
    arm.press("activate")
    assert arm.wam.mode == 0
    arm.press("idle")
    assert arm.wam.mode == 1
    assert arm.say("001#05") == ["426#85000000"]
    assert arm.say("00A#2A") == ["546#AA000000"]
    with pytest.raises(InputError, match="expected one of"):
        arm.press("start")


@given(frames=st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=30))
def test_noise_never_upsets_the_arm(talk: Callable[..., Any], frames: list[tuple[int, bytes]]) -> None:
    """Law: whatever is on the bus, nothing raises, the arm is not activated, and the plant's torque stays finite."""
    arm = talk()
    for now_ns, (identifier, data) in enumerate(frames):
        arm.wam.receive(Frame(identifier, data), now_ns)
    assert arm.wam.mode != 2
    assert np.isfinite(arm.plant.torque_Nm).all()
