"""Positions at start: kept where they are known, set where they are lost, and never set where the arm is not home."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.errors import DeviceError, NoReplyError, ProtocolError
from drivers.wam.dialogue import Dialogue
from drivers.wam.homing import Homing
from drivers.wam.motor_settings import read_motor_settings
from drivers.wam.parameters import WamParameters, load_wam_parameters
from drivers.wam.safety_puck import SafetyPuck

if TYPE_CHECKING:
    from tests.drivers.wam.conftest import ScriptedArm

MakeArm = Callable[..., "ScriptedArm"]
ALL = (1, 2, 3, 4, 5, 6, 7)
HOME_COUNTS = (0, -36833, 36832, -36728, 0, 0, 0)
ZEROING = [
    "00A#B70005000000",  # IFAULT = 5
    "00A#AA0000000000",  # ZERO = 0
    "001#B00000000000",
    "002#B0001F70FFFF",  # −36833
    "003#B000E08F0000",  # 36832
    "004#B0008870FFFF",  # −36728
    "005#B00000000000",
    "006#B00000000000",
    "007#B00000000000",
    "00A#AA0001000000",  # ZERO = 1
    "00A#B70005000000",
]
"""Reference 2.2's coding of 4.4's sequence; the two values of four bytes come from 5.2's counts."""


def _homing(arm: ScriptedArm, parameters: WamParameters | None = None) -> Homing:
    dialogue, parameters = Dialogue(arm.bus, arm.clock), parameters or load_wam_parameters()
    safety = SafetyPuck(arm.bus, arm.clock, arm.safety["VERS"])
    return Homing(dialogue, parameters, safety, read_motor_settings(dialogue, parameters))


def _silent(_: str) -> None:
    """Nobody listens."""


def test_remembered_positions_are_kept(make_arm: MakeArm) -> None:
    """Protects restarts: ZERO = 1 and no puck woken means that nothing is written but IFAULT."""
    arm = make_arm()
    arm.pucks[1].values["P"] = -13690
    found = _homing(arm).restore((), _silent)
    assert found.plan is None
    assert found.counts == (-13690, *HOME_COUNTS[1:])
    assert arm.written() == ["00A#B70005000000"]


def test_zeroing_byte_by_byte(make_arm: MakeArm) -> None:
    """Protects the order: IFAULT, P with a pause each, one reading, ZERO, IFAULT again (reference 0.7, 4.4)."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    told: list[str] = []
    found = _homing(arm).restore(ALL, told.append)
    assert found.counts == HOME_COUNTS
    assert [frame for frame in arm.written() if frame != ZEROING[0]] == [f for f in ZEROING if f != ZEROING[0]]
    assert arm.written()[-1] == ZEROING[0]
    assert "0.000 -2.000 0.000 3.130" in told[0]
    positions = [number for number, (_, identifier, _) in enumerate(arm.heard) if identifier == 0x404]
    sets = [number for number, (_, identifier, data) in enumerate(arm.heard) if data[0] == 0xB0 and identifier < 8]
    zero_1 = max(number for number, (_, _, data) in enumerate(arm.heard) if data[:3] == bytes.fromhex("AA0001"))
    assert max(sets) < positions[0] < zero_1
    assert len(positions) == 1


@pytest.mark.parametrize("lost", range(11))
def test_a_lost_order_is_given_again(make_arm: MakeArm, lost: int) -> None:
    """Protects against silent adapters: whichever SET gets lost, the arm ends zeroed and with IFAULT set."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    for node in ALL:
        arm.pucks[node].values["P"] = 3000
    seen = 0

    def loses(number: int) -> bool:
        nonlocal seen
        is_set = bool(arm.heard[number][2][0] & 0x80)
        seen += is_set
        return is_set and seen == lost + 1

    arm.loses = loses
    assert _homing(arm).restore(ALL, _silent).counts == HOME_COUNTS
    assert (arm.safety["ZERO"], arm.safety["IFAULT"]) == (1, 5)


def test_a_puck_that_takes_no_position_is_named(make_arm: MakeArm) -> None:
    """Protects the arm from a joint believed elsewhere: ZERO is not set to 1."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    arm.pucks[4].values["P"] = 0
    arm.pucks[4].refuses = {"P"}
    with pytest.raises(DeviceError, match=r"pucks \[4\] do not take"):
        _homing(arm).restore(ALL, _silent)
    assert arm.safety["ZERO"] == 0


def test_zero_that_stays_0_is_an_error(make_arm: MakeArm) -> None:
    """Protects the tip's speed limit, which the safety puck applies only from ZERO = 1 on."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    arm.pucks[10].refuses = {"ZERO"}
    with pytest.raises(ProtocolError, match="ZERO reads 0"):
        _homing(arm).restore(ALL, _silent)


def test_all_positions_lost_are_zeroed_whatever_zero_says(make_arm: MakeArm) -> None:
    """Protects against a ZERO that outlives the power (reference 8.4): woken pucks know nothing."""
    arm = make_arm()
    for node in ALL:
        arm.pucks[node].values["P"] = 111 * node
    assert _homing(arm).restore(ALL, _silent).counts == HOME_COUNTS


def test_after_a_brown_out_only_an_arm_at_home_is_zeroed(make_arm: MakeArm) -> None:
    """Protects an arm somewhere in the room: pucks that kept their positions tell that it is not home."""
    arm = make_arm()
    arm.pucks[6].values["P"] = 555
    assert _homing(arm).restore((6,), _silent).counts == HOME_COUNTS
    arm.pucks[6].values["P"] = 555
    arm.pucks[4].values["P"] = -36728 - int(0.2 * 18 * 4096 / (2 * pi))
    before = len(arm.heard)
    with pytest.raises(DeviceError, match=r"\[6\] lost their positions, and motor 4"):
        _homing(arm).restore((6,), _silent)
    assert not any(data[0] == 0xB0 and identifier < 8 for _, identifier, data in arm.heard[before:])


def test_absolute_encoders_correct_a_sloppy_home(make_arm: MakeArm) -> None:
    """Protects hand-placed arms: with zero angles, counters say where the arm is, not where it should be."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    parameters = replace(load_wam_parameters(), zero_angle_rad=np.full(7, 1.0))
    off = 0.03 * 42 * 4096 / (2 * pi)  # joint 1 stands 30 mrad past home: motor 1 has turned back by 1.26 rad
    zero_counts = 4096 / (2 * pi)
    for node in ALL:
        arm.pucks[node].values["MECH"] = int(HOME_COUNTS[node - 1] + zero_counts + 1 - off * (node == 1)) % 4096
    found = _homing(arm, parameters).restore(ALL, _silent)
    assert found.plan is not None
    assert found.plan.corrected == ALL
    assert found.plan.joint_rad[0] == pytest.approx(0.03, abs=1e-4)
    assert found.counts[0] == pytest.approx(-off, abs=2)
    assert found.counts[3] == pytest.approx(HOME_COUNTS[3], abs=2)


def test_an_arm_that_is_nearly_half_a_turn_off_is_refused(make_arm: MakeArm) -> None:
    """Protects against zeroing a whole motor turn wrong: near half a turn nobody knows the direction."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    parameters = replace(load_wam_parameters(), zero_angle_rad=np.zeros(7))
    arm.pucks[5].values["MECH"] = 2000
    with pytest.raises(DeviceError, match=r"motors \[5\] stand almost half a turn") as caught:
        _homing(arm, parameters).restore(ALL, _silent)
    assert "closer to home" in caught.value.help
    assert arm.safety["ZERO"] == 0


def test_mech_beyond_its_turn_is_refused(make_arm: MakeArm) -> None:
    """Protects zeroing from an encoder that says what it cannot mean."""
    arm = make_arm()
    arm.pucks[2].values["MECH"] = 4096
    with pytest.raises(ProtocolError, match="MECH is 4096; expected 0 to 4095"):
        _homing(arm).restore(ALL, _silent)


def test_silent_positions_are_named(make_arm: MakeArm) -> None:
    """Protects the start of the loop: a puck that answers questions but reports no position."""
    arm = make_arm()
    homing = _homing(arm)
    arm.pucks[3].values["GRPC"] = 9
    with pytest.raises(NoReplyError, match=r"pucks \[3\] report no position"):
        homing.restore((), _silent)
