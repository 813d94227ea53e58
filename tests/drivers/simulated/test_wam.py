"""The simulated WAM against the rules of the WAM reference 4 and its worked frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.errors import InputError
from drivers.simulated.can_wire import Frame
from drivers.simulated.wam import SimulatedWam
from drivers.wam.parameters import load_wam_parameters

_HOME = np.array([0.0, -2.0, 0.0, 3.13, 0.0, 0.0, 0.0])
_MS = 1_000_000


class StillPlant:
    """Joints that do not move; records the torques."""

    def __init__(self) -> None:
        self.joint_rad = _HOME.copy()
        self.torque_Nm = np.zeros(7)
        self.braking = False
        self.at_ns = -1

    def joint_position_rad(self) -> NDArray[np.float64]:
        return self.joint_rad

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        self.torque_Nm, self.braking, self.at_ns = torque_Nm, braking, at_ns


def _arm(*, booted: bool = True, zeroed: bool = True, safety_firmware: int = 197) -> tuple[SimulatedWam, StillPlant]:
    plant = StillPlant()
    parameters = load_wam_parameters()
    return SimulatedWam(plant, parameters, booted=booted, zeroed=zeroed, safety_firmware=safety_firmware), plant


def _say(wam: SimulatedWam, identifier: int, data: str, now_ns: int = 0) -> list[str]:
    """What the arm answers to a frame; it hears its own answers, as on the wire."""
    pending, said = wam.receive(Frame(identifier, bytes.fromhex(data)), now_ns), []
    while pending:
        ready_ns, frame = pending.pop(0)
        said.append(_text(frame))
        pending += wam.receive(frame, ready_ns)
    return said


def _text(frame: Frame) -> str:
    return f"{frame.identifier:03X}#{frame.data.hex().upper()}"


def test_home_gives_the_reference_counts() -> None:
    """Protects the encoders: a zeroed arm at home reports the floored counts of reference 5.2, in node order."""
    wam, _ = _arm()
    expected = ["423#000000", "443#3F701F", "463#008FE0", "483#3F7088", "4A3#000000", "4C3#000000", "4E3#000000"]
    assert _say(wam, 0x404, "30") == expected
    assert _say(wam, 0x004, "30") == ["483#3F7088"]


def test_position_is_unrelated_until_it_is_set() -> None:
    """Protects zeroing: before it P is the angle within a turn; SET P moves P and leaves MECH."""
    wam, _ = _arm(zeroed=False)
    before = _say(wam, 0x002, "42")
    assert _say(wam, 0x002, "30") != ["443#3F701F"]
    assert _say(wam, 0x002, "B0001F70FFFF") == []
    assert _say(wam, 0x002, "30") == ["443#3F701F"]
    assert _say(wam, 0x002, "42") == before
    assert _say(wam, 0x00A, "2A") == ["546#AA000000"]


def test_property_replies_have_the_reference_bytes() -> None:
    """Protects addressing and widths: node, group, absent property."""
    wam, _ = _arm()
    assert _say(wam, 0x003, "00") == ["466#8000C800"]
    assert _say(wam, 0x007, "01") == ["4E6#8100C001"]
    assert _say(wam, 0x00A, "01") == ["546#81008200"]
    assert _say(wam, 0x00A, "08") == ["546#88000100"]
    assert _say(wam, 0x002, "44") == ["446#C40000100000"]
    assert _say(wam, 0x005, "56") == ["4A6#D6006419"]
    assert [text[:3] for text in _say(wam, 0x402, "05")] == ["4A6", "4C6", "4E6", "546"]
    assert _say(wam, 0x00A, "2B") == ["546#AB0049123F0D"]
    assert _say(wam, 0x001, "7F") == []
    assert _say(wam, 0x009, "05") == []


def test_torques_reach_the_plant_only_in_torque_mode() -> None:
    """Protects the rule that an idle puck brakes; active, the units become joint torques by the formulas of 5.2."""
    wam, plant = _arm()
    frame = "AA000031FF48C292"  # units 0, 799, -733, 658
    _say(wam, 0x401, frame, _MS)
    assert plant.braking
    assert not plant.torque_Nm.any()
    wam.press("activate", 2 * _MS)
    _say(wam, 0x401, frame, 3 * _MS)
    assert not plant.braking
    assert plant.at_ns == 3 * _MS
    T2, T3, T4 = 799 / 2700, -733 / 2700, 658 / 2700
    expected = [0, 28.25 * (T2 - T3), -28.25 / 1.68 * (T2 + T3), -18 * T4, 0, 0, 0]
    np.testing.assert_allclose(plant.torque_Nm, expected, rtol=3e-6)
    _say(wam, 0x400, frame.replace("AA", "AB", 1), 3 * _MS)  # another property number: no torque
    np.testing.assert_allclose(plant.torque_Nm, expected, rtol=3e-6)


def test_puck_limits_torque_to_mt() -> None:
    """Protects the motors' own limit: 5000 units become 4860 on motor 1."""
    wam, plant = _arm()
    wam.press("activate", 0)
    _say(wam, 0x401, "AA4E200000000000")
    assert plant.torque_Nm[0] == pytest.approx(-42 * 4860 / 2700)


def test_host_lowers_the_mode_and_never_raises_it() -> None:
    """Protects the pendant: idle on request from firmware 197 on; no request raises the mode."""
    wam, plant = _arm()
    _say(wam, 0x00A, "880002000000")
    _say(wam, 0x404, "880002000000")
    assert wam.mode == 1
    assert plant.braking
    wam.press("activate", 0)
    assert _say(wam, 0x00A, "880001000000") == ["540#88000000"]
    assert wam.mode == 1
    assert plant.braking
    old, _ = _arm(safety_firmware=190)
    old.press("activate", 0)
    assert _say(old, 0x00A, "880001000000") == []
    assert old.mode == 2


def test_pendant_follows_the_operator() -> None:
    """Protects the life cycle of reference 4.1, and that E-stop costs power, positions and ZERO."""
    wam, plant = _arm()
    assert [_text(frame) for _, frame in wam.press("activate", 0)] == ["540#88000200"]
    assert wam.press("activate", 0) == []
    wam.press("estop", 0)
    assert (wam.mode, plant.braking) == (0, True)
    assert _say(wam, 0x404, "30") == []
    assert _say(wam, 0x00A, "2B") == ["546#AB0049427900"]
    wam.press("idle", 0)
    wam.press("release", 0)
    assert wam.mode == 0
    wam.press("activate", 0)
    assert wam.mode == 0
    wam.press("idle", 0)
    assert wam.mode == 1
    assert _say(wam, 0x001, "05") == ["426#85000000"]
    assert _say(wam, 0x00A, "2A") == ["546#AA000000"]
    with pytest.raises(InputError, match="expected one of"):
        wam.press("start", 0)


def test_boot_monitor_knows_only_its_own_numbers() -> None:
    """Protects start-up: before waking no P, no groups, another VERS; STAT 2 wakes after a second of silence."""
    wam, _ = _arm(booted=False, zeroed=False)
    assert _say(wam, 0x404, "30") == []
    assert _say(wam, 0x003, "00") != ["466#8000C800"]
    assert _say(wam, 0x003, "05") == ["466#85000000"]
    assert _say(wam, 0x003, "85000200") == []
    assert _say(wam, 0x003, "05", 999 * _MS) == []
    assert _say(wam, 0x003, "05", 1000 * _MS) == ["466#85000200"]
    assert _say(wam, 0x003, "00", 1000 * _MS) == ["466#8000C800"]
    assert [text[:3] for text in _say(wam, 0x404, "30", 1000 * _MS)] == ["463"]


def test_missing_heartbeat_idles_an_active_arm() -> None:
    """Protects against a host that died: 100 ms after the last position reply the arm is idle, until then it is not."""
    wam, plant = _arm()
    wam.press("activate", 0)
    assert wam.tick(10_000 * _MS) == []
    _say(wam, 0x404, "30", 10_000 * _MS)
    assert wam.tick(10_100 * _MS) == []
    assert [_text(frame) for _, frame in wam.tick(10_101 * _MS)] == ["540#88000000"]
    assert plant.braking
    assert _say(wam, 0x00A, "2B", 10_101 * _MS) == ["546#AB0049183F0D"]
    wam.press("activate", 10_102 * _MS)
    assert wam.mode == 1
    wam.press("idle", 10_103 * _MS)
    wam.press("activate", 10_104 * _MS)
    assert wam.mode == 2


def test_limits_are_stored_and_restored() -> None:
    """Protects SAVE, DEF and LOAD: the defaults come back as the vendor's library restores them."""
    wam, _ = _arm()
    _say(wam, 0x00A, "AE0000180000")
    assert _say(wam, 0x00A, "2E") == ["546#AE000018"]
    _say(wam, 0x00A, "A0002E000000")
    _say(wam, 0x00A, "9F002E000000")
    assert _say(wam, 0x00A, "2E") == ["546#AE000010"]


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=30))
def test_noise_never_upsets_the_arm(frames: list[tuple[int, bytes]]) -> None:
    """Law: whatever is on the bus, nothing raises, the arm is not activated, and the plant's torque stays finite."""
    wam, plant = _arm()
    for now_ns, (identifier, data) in enumerate(frames):
        wam.receive(Frame(identifier, data), now_ns)
    assert wam.mode != 2
    assert np.isfinite(plant.torque_Nm).all()
