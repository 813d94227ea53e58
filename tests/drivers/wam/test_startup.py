"""Start-up from power-on to the loop, against literal pucks: order, silences, prompts, time-outs, old firmware."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError, StillgraspError
from drivers.wam.arm import Arm
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.safety_puck import ArmMode, SafetyPuck
from drivers.wam.startup import ArmIdentity, Operator, Prompt, PromptKind, StartUp

if TYPE_CHECKING:
    from tests.drivers.wam.conftest import ScriptedArm

MakeArm = Callable[..., "ScriptedArm"]
ALL = (1, 2, 3, 4, 5, 6, 7)
NEVER_NS = 10**15
SECOND_NS = 1_000_000_000
HOME_COUNTS = (0, -36833, 36832, -36728, 0, 0, 0)


def _start(arm: ScriptedArm, operator: Operator | None = None) -> ArmIdentity:
    safety = SafetyPuck(arm.bus, arm.clock)
    return StartUp(arm.bus, arm.clock, load_wam_parameters(), safety, operator).run()


def _set_frames(arm: ScriptedArm) -> list[tuple[int, int, bytes]]:
    return [entry for entry in arm.heard if entry[2][0] & 0x80]


def _estop(arm: ScriptedArm) -> None:
    """The power of the motor pucks goes, and with it what they knew."""
    arm.safety.update(MODE=0, ZERO=0)
    arm.sleep(*ALL)
    for node in ALL:
        arm.pucks[node].silent_until_ns = NEVER_NS


def _power_up(arm: ScriptedArm) -> None:
    for node in ALL:
        arm.pucks[node].silent_until_ns = 0


def test_a_zeroed_idle_arm_is_ready_at_once(make_arm: MakeArm) -> None:
    """Protects restarts: limits, idle, IFAULT, and nothing else is written; ready within 0.6 s; no torque yet."""
    arm = make_arm()
    found = _start(arm)
    assert arm.written() == [
        *(f"00A#{text}" for text in ("A0002D000000", "9F002D000000", "A0002E000000", "9F002E000000")),
        *(f"00A#{text}" for text in ("A0002F000000", "9F002F000000", "A00030000000", "9F0030000000")),
        "00A#AE0000180000",  # VL2 = 6144, 1.5 m/s
        "00A#AD0099150000",  # VL1 = 5529, 0.9 of it
        "00A#B0000A140000",  # TL2 = 5130, 1.9 N·m
        "00A#AF0009120000",  # TL1 = 4617
        "404#880000000000",  # MODE = 0
        "00A#B70005000000",  # IFAULT = 5
    ]
    assert (found.woken, found.zeroed_at_home, found.notes) == ((), False, ())
    assert found.first_counts == HOME_COUNTS
    assert arm.clock.now_ns() < 0.6 * SECOND_NS
    assert not any(len(data) == 8 for _, _, data in arm.heard)


def test_settings_of_the_safety_puck_are_paced(make_arm: MakeArm) -> None:
    """Protects its receive buffer: a GET STAT after every SET, and at least 10 ms between SETs (reference 2.2)."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    _start(arm)
    times = [time_ns for time_ns, identifier, _ in _set_frames(arm) if identifier == 0x00A]
    assert min(later - sooner for sooner, later in pairwise(times)) >= 10_000_000
    for number, (_, identifier, data) in enumerate(arm.heard):
        if identifier < 0x400 and data[0] & 0x80:
            assert arm.heard[number + 1][1:] == (identifier, b"\x05")


def test_waking_keeps_its_silences(make_arm: MakeArm) -> None:
    """Protects the bus while pucks come on: 10 ms between them, then not one frame for a second (reference 4.2)."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    arm.sleep(*ALL)
    found = _start(arm)
    assert (found.woken, found.zeroed_at_home, found.first_counts) == (ALL, True, HOME_COUNTS)
    wakes = [number for number, (_, _, data) in enumerate(arm.heard) if data == bytes.fromhex("850002000000")]
    assert [arm.heard[number][1] for number in wakes] == list(ALL)
    assert wakes == list(range(wakes[0], wakes[0] + 7))
    times = [arm.heard[number][0] for number in wakes]
    assert all(later - sooner >= 10_000_000 for sooner, later in pairwise(times))
    assert arm.heard[wakes[-1] + 1][0] - times[-1] >= SECOND_NS + 10_000_000
    versions = [number for number, (_, identifier, data) in enumerate(arm.heard) if identifier < 8 and data == b"\x00"]
    assert max(versions) > wakes[-1]  # VERS is read again


def test_a_brown_out_is_woken_and_told(make_arm: MakeArm) -> None:
    """Protects an arm of which some pucks were reset: only those are woken, the operator hears of it."""
    arm = make_arm()
    arm.sleep(2, 6)
    found = _start(arm)
    assert found.woken == (2, 6)
    assert "pucks [2, 6] had been reset" in found.notes[0]
    assert "brown-out" in found.notes[0]
    assert found.first_counts == HOME_COUNTS


def test_the_safety_puck_itself_may_have_to_be_woken(make_arm: MakeArm) -> None:
    """Protects the power-up of everything at once: nothing is asked of a monitor that only the firmware knows."""
    arm = make_arm()
    arm.sleep(10)
    assert _start(arm).safety_firmware == 197


def test_a_slow_puck_gets_a_second_silence(make_arm: MakeArm) -> None:
    """Protects pucks that need 1.2 s, as the most patient driver allows them."""
    arm = make_arm()
    arm.sleep(3)
    arm.pucks[3].wakes_in_ns = round(1.2 * SECOND_NS)
    assert _start(arm).woken == (3,)


def test_a_puck_that_does_not_wake_is_an_error(make_arm: MakeArm) -> None:
    """Protects the operator from waiting for ever: after two tries the puck is named."""
    arm = make_arm()
    arm.sleep(5)
    arm.pucks[5].name = lambda number: {5: "STAT", 0: "VERS", 1: "ROLE"}.get(number, "")  # type: ignore[method-assign]  # stays
    arm.pucks[5].refuses = {"STAT"}
    with pytest.raises(DeviceError, match=r"STAT of pucks \[5\] is not 2 after waking"):
        _start(arm)
    assert arm.clock.now_ns() < 4 * SECOND_NS


@pytest.mark.parametrize(
    ("prepare", "error", "words", "advice", "longest_s"),
    [
        (_estop, DeviceError, "in E-stop", "Release E-stop", 0.6),
        (lambda arm: arm.safety.update(MODE=2), DeviceError, "active", "Shift-Idle", 0.6),
        (lambda arm: arm.safety.update(MODE=7), ProtocolError, "MODE 7", "", 0.6),
        (lambda arm: arm.pucks.pop(10), NoReplyError, "while nodes", "cable", 0.6),
        (lambda arm: arm.pucks.clear(), NoReplyError, "nor from any other", "power supply", 0.6),
        (lambda arm: arm.pucks.pop(7), NoReplyError, r"pucks \[7\]", "cables", 0.9),
        (lambda arm: arm.safety.update(GRPB=5), ProtocolError, r"groups \[1, 5, 3\]", "btutil", 0.6),
        (lambda arm: arm.pucks[10].refuses.add("VL2"), ProtocolError, "VL2 reads 4096 after 6144", "relied", 0.6),
        (lambda arm: arm.pucks[10].refuses.add("TL1"), ProtocolError, "TL1 reads 4731", "relied", 0.6),
        (lambda arm: arm.pucks[3].values.update(VERS=60), ProtocolError, "numbers property P", "updated", 1.5),
        (lambda arm: arm.bus.close(), BusError, "closed", "", 0.1),
    ],
)
def test_every_unfit_arm_is_one_named_error_in_time(
    make_arm: MakeArm,
    prepare: Callable[[ScriptedArm], object],
    error: type[StillgraspError],
    words: str,
    advice: str,
    longest_s: float,
) -> None:
    """Protects the operator: what is wrong, what to do, soon; and neither torque nor zeroing came of it."""
    arm = make_arm()
    prepare(arm)
    with pytest.raises(error, match=words) as caught:
        _start(arm)
    assert advice in caught.value.help
    assert arm.clock.now_ns() <= longest_s * SECOND_NS
    assert not any(len(data) == 8 or (data[0] in (0xB0, 0xAA) and identifier < 8) for _, identifier, data in arm.heard)


def test_the_operator_is_led_from_estop_to_ready(make_arm: MakeArm) -> None:
    """Protects a start in E-stop: release and Shift+Idle asked once, power waited for, zeroing told, then ready."""
    arm = make_arm()
    _estop(arm)
    arm.at(20.0, lambda: arm.safety.update(MODE=1))
    arm.at(22.5, lambda: _power_up(arm))
    told: list[Prompt] = []
    found = _start(arm, Operator(on_prompt=told.append, wait_s=60.0))
    kinds = [prompt.kind for prompt in told]
    assert kinds == [PromptKind.RELEASE_ESTOP, PromptKind.AWAIT_POWER, PromptKind.ZEROING]
    assert "Shift+Idle" in told[0].text
    assert (found.woken, found.zeroed_at_home) == (ALL, True)
    assert 23 * SECOND_NS < arm.clock.now_ns() < 25.5 * SECOND_NS
    polls = sum(identifier == 0x00A and data == b"\x08" for _, identifier, data in arm.heard)
    assert 70 < polls < 90  # every 250 ms


def test_an_active_arm_is_left_to_the_operator(make_arm: MakeArm) -> None:
    """Protects the pendant's rule: an arm that another program left active is idled by Shift+Idle alone."""
    arm = make_arm()
    arm.safety["MODE"] = 2
    arm.at(3.0, lambda: arm.safety.update(MODE=1))
    told: list[Prompt] = []
    _start(arm, Operator(on_prompt=told.append, wait_s=10.0))
    assert [prompt.kind for prompt in told] == [PromptKind.PRESS_IDLE]


@pytest.mark.parametrize("wait_s", [0.0, 5.0])
def test_waiting_ends_in_time(make_arm: MakeArm, wait_s: float) -> None:
    """Protects against a start that hangs: E-stop that nobody releases, and pucks whose power never comes."""
    arm = make_arm()
    _estop(arm)
    with pytest.raises(DeviceError, match="E-stop"):
        _start(arm, Operator(wait_s=wait_s))
    assert arm.clock.now_ns() < (wait_s + 0.9) * SECOND_NS
    arm.safety["MODE"] = 1
    began_ns = arm.clock.now_ns()
    with pytest.raises(NoReplyError, match="no motor puck answers"):
        _start(arm, Operator(wait_s=wait_s))
    assert arm.clock.now_ns() - began_ns < (min(wait_s, 4.0) + 1.2) * SECOND_NS


def test_a_start_that_nobody_wants_any_more_ends(make_arm: MakeArm) -> None:
    """Protects Ctrl-C while waiting: the next poll ends it."""
    arm = make_arm()
    _estop(arm)
    with pytest.raises(DeviceError, match="ended while the arm is estop"):
        _start(arm, Operator(wait_s=3600.0, still_wanted=lambda: arm.clock.now_ns() < 2 * SECOND_NS))
    assert arm.clock.now_ns() < 2.6 * SECOND_NS


def test_foreign_nodes_are_told_and_let_be(make_arm: MakeArm) -> None:
    """Protects other devices: a fresh puck at 15 is reported, and never written to."""
    arm = make_arm()
    arm.pucks[15] = make_arm().pucks[1]
    arm.pucks[15].values.update(GRPA=9, GRPB=9, GRPC=9)
    found = _start(arm)
    assert found.notes == ("node 15 (ROLE 0x01c0) does not belong to the arm; it is let be",)
    assert not any(identifier == 15 for _, identifier, _ in _set_frames(arm))


@pytest.mark.parametrize(
    ("motor", "safety", "request_data", "torque_head", "mode_frame", "limits"),
    [
        (200, 197, "30", 0xAA, "404#880000000000", ["AE", "AD", "B0", "AF"]),
        (141, 141, "30", 0xAA, "404#880000000000", ["AE", "AD", "B0", "AF"]),
        (118, 118, "30", 0xAA, "404#880000000000", ["AE", "AD", "B0", "AF"]),
        (60, 60, "1A", 0x89, "404#880000000000", ["DB", "DA", "DD", "DC"]),
        (32, 32, "1A", 0x8A, "404#880000000000", ["DB", "DA", "DD", "DC"]),
    ],
)
def test_every_firmware_generation_runs(
    make_arm: MakeArm,
    motor: int,
    safety: int,
    request_data: str,
    torque_head: int,
    mode_frame: str,
    limits: list[str],
) -> None:
    """Protects old arms: woken, zeroed, read and driven by their own property numbers; what they lack is told."""
    arm = make_arm(motor, safety)
    arm.safety["ZERO"] = 0
    arm.sleep(*ALL)
    driver = Arm(arm.bus, arm.clock, load_wam_parameters())
    found = driver.start()
    assert found.zeroed_at_home
    assert driver.mode is ArmMode.IDLE
    assert mode_frame in arm.written()
    written = [frame[4:6] for frame in arm.written() if frame.startswith("00A#")]
    assert [head for head in written if head in limits] == limits
    told = " ".join(found.notes)
    assert ("takes no idle request" in told) == (safety < 197)
    arm.heard.clear()
    driver.request_positions()
    sample = driver.collect_positions(arm.clock.now_ns() + 1_500_000)
    assert sample.complete
    assert sample.joint_rad.tolist() == pytest.approx([0, -2, 0, 3.13, 0, 0, 0], abs=2e-4)
    driver.write_torques([0.0] * 7)
    assert [(identifier, data.hex().upper()[:2]) for _, identifier, data in arm.heard] == [
        (0x404, request_data),
        (0x401, f"{torque_head:02X}"),
        (0x402, f"{torque_head:02X}"),
    ]


def test_wrist_pucks_in_group_5_are_idled_and_asked(make_arm: MakeArm) -> None:
    """Protects arms as the 2008 manual has them: groups 4 and 5 both get MODE = 0 and the position request."""
    arm = make_arm()
    for node in (5, 6, 7):
        arm.pucks[node].values["GRPC"] = 5
    driver = Arm(arm.bus, arm.clock, load_wam_parameters())
    driver.start()
    assert {"404#880000000000", "405#880000000000"} <= set(arm.written())
    driver.request_positions()
    assert driver.collect_positions(arm.clock.now_ns() + 1_500_000).complete


def test_a_motor_that_applies_less_torque_limits_the_driver(make_arm: MakeArm) -> None:
    """Protects the model of what the arm can do: MT of a puck below the parameters' limit is the limit."""
    arm = make_arm()
    arm.pucks[4].values["MT"] = 100
    driver = Arm(arm.bus, arm.clock, load_wam_parameters())
    driver.start()
    arm.heard.clear()
    driver.write_torques([0, 0, 0, -20.0, 0, 0, 0])
    assert int.from_bytes(arm.heard[0][2][-2:], "big") & 0x3FFF == 100


@pytest.mark.slow
def test_no_single_lost_frame_spoils_a_start(make_arm: MakeArm) -> None:
    """Law: whichever one frame of the host gets lost, start-up from the boot monitor ends with the same arm."""
    arm = make_arm()
    arm.safety["ZERO"] = 0
    arm.sleep(*ALL)
    _start(arm)
    sent = len(arm.heard)
    assert sent > 150
    for lost in range(sent):
        arm = make_arm()
        arm.safety["ZERO"] = 0
        arm.sleep(*ALL)
        arm.loses = lambda number, lost=lost: number == lost  # type: ignore[misc]  # bound now
        found = _start(arm)
        assert found.first_counts == HOME_COUNTS, lost
        assert found.woken == ALL, lost
        assert (arm.safety["ZERO"], arm.safety["IFAULT"]) == (1, 5), lost
        assert [arm.safety[name] for name in ("VL2", "VL1", "TL2", "TL1")] == [6144, 5529, 5130, 4617], lost
