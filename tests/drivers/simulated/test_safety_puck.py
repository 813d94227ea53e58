"""The safety puck's watch: speeds against another kinematics, torques, life signs, supply, pendant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.simulated.elbow_speed import elbow_speeds_m_s
from drivers.simulated.puck_settings import PuckSettings
from drivers.simulated.safety_watch import SafetySettings

MS = 1_000_000
IFAULT_FIVE = "00A#B70005000000"
IDLE_ORDER = "540#88000000"
_angles = st.lists(st.floats(-2.5, 2.5), min_size=4, max_size=4)


def _up(z_m: float) -> pinocchio.SE3:
    return pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, z_m]))


def _chain() -> tuple[pinocchio.Model, int, int]:
    """Joints 1 to 4 about z, y, z, y with the elbow and the point beyond it as frames."""
    model = pinocchio.Model()
    joint = 0
    for kind, length_m in (("RZ", 0.0), ("RY", 0.0), ("RZ", 0.55), ("RY", 0.0)):
        joint = model.addJoint(joint, getattr(pinocchio, f"JointModel{kind}")(), _up(length_m), f"j{joint + 1}")
    frames = [
        model.addFrame(pinocchio.Frame(name, joint, 0, _up(z), pinocchio.FrameType.OP_FRAME))
        for name, z in (("elbow", 0.0), ("beyond", 0.35))
    ]
    return model, frames[0], frames[1]


MODEL, ELBOW, BEYOND = _chain()


@given(q=_angles, v=_angles)
def test_speeds_are_those_of_the_points(q: list[float], v: list[float]) -> None:
    """Law: the two speeds are those of elbow and point beyond it in Pinocchio's kinematics of the same chain."""
    data = MODEL.createData()
    pinocchio.forwardKinematics(MODEL, data, np.array(q), np.array(v))
    expected = [
        np.linalg.norm(pinocchio.getFrameVelocity(MODEL, data, frame, pinocchio.LOCAL_WORLD_ALIGNED).linear)
        for frame in (ELBOW, BEYOND)
    ]
    np.testing.assert_allclose(elbow_speeds_m_s(q, v), expected, atol=1e-9)


def _turn(arm: Any, joint: int, speed_rad_s: float, cycles: int = 1) -> None:
    """Ask for positions every 2 ms while one joint turns."""
    for _ in range(cycles):
        arm.plant.joint_rad = arm.plant.joint_rad + 0.002 * speed_rad_s * np.eye(7)[joint]
        arm.say("404#30", arm.now_ns + 2 * MS)


def _mode_and_lights(arm: Any) -> tuple[int, int]:
    """MODE, and the lights of PEN: velocity, torque, voltage, heartbeat, other, in octal from the right."""
    (reply,) = arm.say("00A#2B")
    return arm.wam.mode, int.from_bytes(bytes.fromhex(reply[8:]), "little") & 0o77777


@pytest.fixture
def active(talk: Callable[..., Any]) -> Any:
    """An active arm that stands straight up and is asked for its positions."""
    arm = talk()
    arm.plant.joint_rad = np.zeros(7)
    arm.say("404#30")
    arm.press("activate")
    _turn(arm, 0, 0.0)
    return arm


def test_too_fast_at_the_elbow_is_idle_and_stays_red(active: Any) -> None:
    """Protects VL2 after zeroing, 1 m/s: joint 2 swings the point 0.9 m away; red until Shift-Idle, then on again."""
    _turn(active, 1, 0.5, cycles=10)
    assert _mode_and_lights(active) == (2, 0o11111)
    _turn(active, 1, 0.7, cycles=10)  # 0.63 m/s: a warning
    assert _mode_and_lights(active) == (2, 0o11112)
    _turn(active, 1, 1.15)  # 1.04 m/s
    assert _mode_and_lights(active) == (1, 0o11114)
    assert active.plant.braking
    assert active.press("activate") == []
    _turn(active, 1, 0.0, cycles=300)
    assert _mode_and_lights(active) == (1, 0o11114)
    active.press("idle")
    assert _mode_and_lights(active) == (1, 0o11111)
    active.press("activate")
    assert active.wam.mode == 2
    assert active.say("00A#2A") == ["546#AA000100"]  # the positions are still good


def test_still_too_fast_half_a_second_later_is_estop(active: Any) -> None:
    """Protects the second stage: power goes, and with it positions and ZERO."""
    _turn(active, 1, 1.3, cycles=248)
    assert _mode_and_lights(active) == (1, 0o11114)
    _turn(active, 1, 1.3, cycles=5)
    assert _mode_and_lights(active) == (0, 0o41114)
    assert active.say("404#30") == []
    assert active.say("00A#2A") == ["546#AA000000"]


def test_wrist_is_not_watched_and_zero_limit_never_faults(active: Any) -> None:
    """Protects two exceptions: wrist motion does not count, VL2 = 0 switches the fault off."""
    _turn(active, 5, 50.0, cycles=3)
    assert _mode_and_lights(active) == (2, 0o11111)
    active.say("00A#AE0000000000")
    _turn(active, 1, 5.0, cycles=3)
    assert _mode_and_lights(active) == (2, 0o11112)


@pytest.mark.parametrize(("prepare", "lights"), [((), 0o11114), ((IFAULT_FIVE,), 0o11111)])
def test_setting_positions_faults_without_ifault(
    talk: Callable[..., Any], prepare: tuple[str, ...], lights: int
) -> None:
    """Protects the order of zeroing: P written makes the arm seem to jump; IFAULT = 5 covers it, for five readings."""
    arm = talk(zeroed=False)
    arm.say("404#30")
    for text in prepare:
        arm.say(text)
    arm.say("002#B0001F70FFFF", 2 * MS)
    _turn(arm, 0, 0.0)
    assert _mode_and_lights(arm) == (1, lights)
    assert arm.say("00A#37") == ["546#B7000400" if prepare else "546#B7000000"]
    _turn(arm, 0, 0.0, cycles=5)
    assert arm.say("00A#37") == ["546#B7000000"]
    _turn(arm, 3, 1.1)  # before zeroing the limit means a joint's rad/s
    assert _mode_and_lights(arm) == (1, 0o11114)


def test_arm_moved_by_hand_between_programs_faults(active: Any) -> None:
    """Protects a pitfall that users report: the way since the last program counts as if it had been gone at once."""
    active.press("idle")
    active.plant.joint_rad = active.plant.joint_rad + 0.1 * np.eye(7)[1]
    active.say("404#30", active.now_ns + 5000 * MS)
    assert _mode_and_lights(active) == (1, 0o11114)


@pytest.mark.parametrize(
    ("frame", "mode", "lights"),
    [
        ("401#AA49EC0000000000", 2, 0o11111),  # 4731, TL1 itself
        ("401#AA49F00000000000", 2, 0o11121),  # 4732
        ("401#AA00000000000000", 2, 0o11111),
        ("402#AA51540000000000", 1, 0o11141),  # 5205 = TL2 + 1, motor 5
        ("401#AA0002BAAC000000", 1, 0o11141),  # -5205, motor 2
        ("402#AB51540000000000", 2, 0o11111),  # another property
        ("404#AA51540000000000", 2, 0o11111),  # a group that it does not hear
    ],
)
def test_torque_limits_are_for_every_motor(active: Any, frame: str, mode: int, lights: int) -> None:
    """Protects TL1 and TL2: commanded units of any motor, either sign; a single frame beyond TL2 idles the arm."""
    active.say(frame)
    assert _mode_and_lights(active) == (mode, lights)


def test_torque_limit_beyond_the_frame_never_faults(active: Any) -> None:
    """Protects the way to switch it off: limits above 8191."""
    active.say("00A#B000A00F")  # TL2 = 4000
    active.say("00A#B0000020")  # 8192
    active.say("401#AA7FFC0000000000")  # 8191
    assert _mode_and_lights(active) == (2, 0o11121)


@pytest.mark.parametrize(
    ("volts", "mode", "lights"),
    [(48, 2, 0o11111), (35, 2, 0o11211), (29, 1, 0o11411), (55, 2, 0o11211), (58, 1, 0o11411)],
)
def test_supply_has_limits_on_both_sides(active: Any, volts: int, mode: int, lights: int) -> None:
    """Protects VOLTL1, VOLTL2, VOLTH1, VOLTH2: 36, 30, 54 and 57 V."""
    active.wam.set_supply_V(volts, active.now_ns)
    assert _mode_and_lights(active) == (mode, lights)
    assert active.say("001#15") == [f"426#9500{volts:02X}00"]


@pytest.mark.parametrize("estop", [False, True])
def test_one_silent_puck_is_a_missing_heartbeat(talk: Callable[..., Any], estop: bool) -> None:
    """Protects against a lost puck: when one of those that reported falls silent for 100 ms; never before the first."""
    arm = talk(safety=SafetySettings(heartbeat_estop=estop))
    arm.press("activate")
    assert arm.wam.tick(10_000 * MS) == []
    _turn(arm, 0, 0.0, cycles=3)
    arm.wam.silent_nodes.add(6)
    _turn(arm, 0, 0.0, cycles=49)
    assert arm.wam.mode == 2
    _turn(arm, 0, 0.0, cycles=3)
    assert _mode_and_lights(arm) == ((0, 0o44111) if estop else (1, 0o14111))


def test_limits_come_back_with_def_and_load(talk: Callable[..., Any]) -> None:
    """Protects how the vendor's library opens it: factory limits by DEF and LOAD; SAVE keeps what was set."""
    arm = talk()
    arm.say("00A#AE0000180000")
    arm.say("00A#9E002E000000")  # SAVE VL2
    arm.say("00A#AE0000080000")
    arm.say("00A#9F002E000000")  # LOAD VL2
    assert arm.say("00A#2E") == ["546#AE000018"]
    arm.say("00A#A0002E000000")  # DEF VL2
    arm.say("00A#9F002E000000")
    assert arm.say("00A#2E") == ["546#AE000010"]


def test_settings_that_follow_too_closely_are_lost(talk: Callable[..., Any]) -> None:
    """Protects pacing: with 10 ms asked for, a setting 9 ms after another is lost, one 10 ms after is taken."""
    arm = talk(safety=SafetySettings(set_gap_s=0.01))
    arm.say("00A#AE0000180000", 0)
    arm.say("00A#AD0099150000", 9 * MS)
    arm.say("00A#AF0008070000", 19 * MS)
    limits = [reply for number in ("2E", "2D", "2F") for reply in arm.say(f"00A#{number}")]
    assert limits == [
        "546#AE000018",
        "546#AD000008",
        "546#AF000807",
    ]
    assert arm.wam.heard["lost_set"] == 1


def test_pendant_shows_the_button_that_was_pressed(talk: Callable[..., Any]) -> None:
    """Protects PEN's coding of buttons by the reference's rows; names as on the pendant work too."""
    arm = talk()
    assert arm.press("shift-activate") == ["540#88000200"]
    assert arm.say("00A#2B") == ["546#AB0049123F06"]
    assert arm.say("00A#2B", 101 * MS) == ["546#AB0049123F0E"]
    assert arm.press("shift-idle") == [IDLE_ORDER]
    assert arm.say("00A#2B") == ["546#AB0049123F09"]
    assert arm.press("e-stop") == [IDLE_ORDER]
    assert arm.say("00A#2B", 900 * MS) == ["546#AB0049427900"]
    with pytest.raises(InputError, match="expected one of idle"):
        arm.press("stop")


def test_groups_decide_what_it_hears(talk: Callable[..., Any]) -> None:
    """Protects start-up's check of its groups: a safety puck without group 3 sees no speed."""
    arm = talk(pucks={10: PuckSettings(properties={"GRPC": 0})})
    arm.say("404#30")
    _turn(arm, 1, 3.0, cycles=3)
    assert _mode_and_lights(arm) == (1, 0o11111)
