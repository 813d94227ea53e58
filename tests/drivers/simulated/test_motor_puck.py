"""Motor pucks: boot monitor, waking, encoders, power, and what sets single pucks apart."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.simulated.puck_settings import PuckSettings

MS = 1_000_000
WAKE = "85000200"


def test_boot_monitor_answers_three_questions(talk: Callable[..., Any]) -> None:
    """Protects discovery: VERS, ROLE and STAT under monitor numbers, nothing else, no P, no MODE, no torque."""
    arm = talk(booted=False, zeroed=False)
    answers = {number: arm.say(f"003#{number:02X}") for number in range(128)}
    assert {number: reply for number, reply in answers.items() if reply} == {
        0: ["466#80000C00"],
        1: ["466#8100C001"],
        5: ["466#85000000"],
    }
    assert arm.say("404#30") == []
    assert arm.say("404#05") == []


@pytest.mark.parametrize("text", ["004#85000200", "004#850002000000", "400#85000200"])
def test_waking_takes_a_second_in_which_frames_are_lost(talk: Callable[..., Any], text: str) -> None:
    """Protects the silence of start-up: both lengths of SET STAT, and the manual's to group 0, which wakes all."""
    arm = talk(booted=False, zeroed=False)
    arm.say(text)
    arm.say("004#AB0001000000", 500 * MS)  # MT = 1, lost
    assert arm.say("004#05", 999 * MS) == []
    assert arm.say("004#05", 1000 * MS) == ["486#85000200"]
    assert arm.say("004#2B") == ["486#AB00E010"]
    assert arm.say("005#05") == (["4A6#85000200"] if text.startswith("400") else ["4A6#85000000"])


def test_talk_while_pucks_wake_is_told(talk: Callable[..., Any]) -> None:
    """Protects the bus-off at start-up: waking the next after 10 ms is quiet enough, sooner or anything else is not."""
    quiet, hasty, asking = (talk(booted=False, zeroed=False) for _ in range(3))
    for node in (1, 2, 3):
        quiet.say(f"{node:03X}#{WAKE}", 10 * node * MS)
        hasty.say(f"{node:03X}#{WAKE}", 5 * node * MS)
    asking.say(f"001#{WAKE}", 0)
    asking.say("002#05", 500 * MS)
    told = [{event for _, event in arm.wam.take_events()} for arm in (quiet, hasty, asking)]
    assert told == [{"waking"}, {"waking", "talk_while_waking"}, {"waking", "talk_while_waking"}]
    quiet.say("001#05", 1030 * MS)
    assert quiet.wam.take_events() == []


def test_mech_and_p_move_together_and_only_p_is_set(talk: Callable[..., Any]) -> None:
    """Protects zeroing with absolute encoders: a third of a turn moves both, over the wrap; SET MECH does nothing."""
    arm = talk(zeroed=False)
    turn_rad = 2 * np.pi / 18 * np.eye(7)[3]  # one turn of motor 4, ratio −18

    def counts() -> tuple[int, int]:
        (mech,), (position,) = arm.say("004#42"), arm.say("004#30")
        unsigned = int(position[4:], 16)
        return int.from_bytes(bytes.fromhex(mech[8:]), "little"), (unsigned ^ 0x200000) - 0x200000

    mech, position = counts()
    for steps in range(1, 7):
        arm.plant.joint_rad = arm.plant.joint_rad - turn_rad / 3
        new_mech, new_position = counts()
        assert abs(new_position - position - round(steps * 4096 / 3)) <= 1
        assert (new_mech - mech - (new_position - position)) % 4096 == 0
    arm.say("004#C20001000000")
    assert counts() == (new_mech, new_position)


def test_brown_out_is_a_puck_in_its_monitor_without_position(talk: Callable[..., Any]) -> None:
    """Protects against a dip of the supply: silent at first, then STAT 0, no P, no torque; the others go on."""
    arm = talk()
    arm.press("activate")
    arm.say("401#AA04B012C0000000")
    torque_Nm = arm.plant.torque_Nm.copy()
    arm.wam.brown_out((1,), 0, down_s=0.05)
    assert arm.plant.torque_Nm[0] == 0.0
    np.testing.assert_array_equal(arm.plant.torque_Nm[1:], torque_Nm[1:])
    assert arm.say("001#05", 49 * MS) == []
    assert arm.say("001#05", 50 * MS) == ["426#85000000"]
    assert [text[:3] for text in arm.say("404#30")] == ["443", "463", "483", "4A3", "4C3", "4E3"]
    arm.say(f"001#{WAKE}")
    assert arm.say("001#30", 1100 * MS) != ["423#000000"]


def test_power_comes_back_after_its_time(talk: Callable[..., Any]) -> None:
    """Protects the wait after E-stop: pucks are silent until they have started."""
    arm = talk(power_up_s=3.0)
    arm.press("estop")
    arm.press("release")
    arm.press("idle")
    assert arm.say("007#05", 2999 * MS) == []
    assert arm.say("007#05", 3000 * MS) == ["4E6#85000000"]


def test_joint_encoders_make_six_bytes_and_know_zero_after_their_index(talk: Callable[..., Any]) -> None:
    """Protects the long replies: joints 1 to 4 of the reference's counts; before the index, a count without meaning."""
    arm = talk(joint_encoders=True)
    # joint 2 at −2 rad: −2 × 655360 / 2π = −208607.6; joint 4 at 3.13 rad: 163235.4
    assert arm.say("404#30") == [
        "423#000000000000",
        "443#3F701F3CD120",
        "463#008FE0000000",
        "483#3F7088027DA3",
        "4A3#000000",
        "4C3#000000",
        "4E3#000000",
    ]
    assert arm.say("002#60") == ["447#3CD120"]
    assert arm.say("002#01") == ["446#8100C041"]
    new = talk(joint_encoders=True, zeroed=False)
    assert new.say("002#60") == ["447#000000"]
    assert new.say("002#65") == ["446#E5000000"]
    new.plant.joint_rad = np.array([0.0, 0.001, 0.0, 3.13, 0.0, 0.0, 0.0])
    assert new.say("002#60") == ["447#000068"]  # 0.001 × 655360 / 2π
    assert new.say("002#65") != ["446#E5000000"]


def test_single_pucks_can_differ(talk: Callable[..., Any]) -> None:
    """Protects start-up's checks: firmware, PIDX, GRPC, MT and ROLE of single pucks, silent, asleep and failed ones."""
    arm = talk(
        pucks={
            1: PuckSettings(firmware=118),
            2: PuckSettings(properties={"PIDX": 3}),
            3: PuckSettings(silent=True),
            4: PuckSettings(asleep=True),
            5: PuckSettings(properties={"STAT": 1}),
            6: PuckSettings(properties={"GRPC": 5}),
            7: PuckSettings(properties={"ROLE": 5, "MT": 100}),
        }
    )
    assert arm.say("001#00") == ["426#80007600"]
    assert arm.say("003#05") == []
    assert arm.say("004#05") == ["486#85000000"]
    assert arm.say("005#05") == ["4A6#85000100"]
    assert arm.say("005#30") == []
    assert arm.say("405#30") == ["4C3#000000"]
    assert arm.say("007#01") == ["4E6#81000500"]
    arm.press("activate")
    arm.say("401#AA000000004B0000")  # 300 units at place 3: of pucks 2 and 3
    assert arm.plant.torque_Nm[2] == pytest.approx(-16.8155 * 600 / 2700)
    arm.say("402#AA000000004B0000")
    assert arm.plant.torque_Nm[6] == pytest.approx(-14.93 * 100 / 17474)


def test_pucks_lose_settings_that_come_too_fast(talk: Callable[..., Any]) -> None:
    """Protects pacing of zeroing: a second setting within 0.3 ms is lost, another puck's is not."""
    arm = talk(set_gap_s=0.0003)
    arm.say("001#AB0001000000", 0)
    arm.say("002#AB0001000000", 120_000)
    arm.say("001#AB0002000000", 240_000)
    assert [*arm.say("001#2B"), *arm.say("002#2B")] == ["426#AB000100", "446#AB000100"]
