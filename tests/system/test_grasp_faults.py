"""One robot on virtual time through everything that can go wrong while it holds an object; and twice the same bytes.

The runs are shared between tests: each takes seconds. What a test asserts of the world is its truth, read beside it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.motion_table import MotionTable
from controller.client import Client
from controller.config import RobotConfig
from controller.messages import CYCLE_RECORD
from controller.service.assembly import configured_hand
from controller.service.commands import MAXIMUM_REQUEST_BYTES
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.truth import WorldObserver, WorldTruth
from controller.simulation.virtual_robot import VirtualRobot
from drivers.clock import VirtualClock
from drivers.errors import CommandError

pytestmark = pytest.mark.slow
Array = NDArray[np.float64]
TICK_M = 2 * np.pi / 4096 * 0.0105


class Digest:
    """Hashes every cycle record, in order."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.records = 0

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        values = [record[name] for name in CYCLE_RECORD.slices]
        self._hash.update(msgspec.msgpack.encode((values, time_ns)))
        self.records += 1

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        self._hash.update(msgspec.msgpack.encode((event, time_ns)))

    @property
    def value(self) -> tuple[int, str]:
        return self.records, self._hash.hexdigest()


class Robot:
    """A robot that has gripped the symmetric object with 40 N, begun near to it to save time."""

    def __init__(self, config: RobotConfig, case: GraspCase) -> None:
        table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
        joints = tuple(approach_joints(config, table, case))
        self.case = case
        self.digest = Digest()
        self.virtual = VirtualRobot(config, replace(case.scene, joint_rad=joints), recorder=self.digest)
        self._observer = WorldObserver(self.virtual.world, configured_hand(config))
        self.run_for = self.virtual.run_for
        self.press = self.virtual.press
        self.virtual.activate()
        self.client: Client = self.virtual.client()
        preposition(self.client, case, approach_m=0.02)
        self.client.grasp_close().wait()
        self.client.grasp_squeeze(load_N=40.0, duration_s=0.6).wait()
        self.run_for(0.1)

    def seen(self) -> Seen:
        """How things stand now."""
        truth = self._observer.truth()
        return Seen(self.client.status(), truth, truth.tendon_excursion_m.copy())

    def silence_the_hand(self, duration_s: float) -> None:
        """The tendon motors hear but do not answer for so long."""
        self.virtual.devices.motors.drop_answers(10**9)
        self.run_for(duration_s)
        self.virtual.devices.motors.drop_answers(0)


@dataclass(frozen=True)
class Seen:
    """What the daemon says and what is so."""

    status: dict[str, Any]
    truth: WorldTruth
    excursion_m: Array

    @property
    def arm(self) -> str:
        return str(self.status["state"]["arm"]["state"])

    @property
    def phase(self) -> str:
        return str(self.status["state"]["grasp"]["phase"])

    @property
    def fault(self) -> str:
        return str(self.status["state"]["grasp"]["fault"])

    @property
    def holds(self) -> bool:
        """Whether both fingers press on the object."""
        return bool((self.truth.contact_force_N > 0.5).all())


@dataclass
class Story:
    """One robot that has been through everything, and what was seen on the way."""

    gripped: tuple[int, str]
    replies: dict[str, dict[str, Any]] = field(default_factory=dict)
    seen: dict[str, Seen] = field(default_factory=dict)
    errors: dict[str, CommandError] = field(default_factory=dict)
    released: dict[str, Any] = field(default_factory=dict)


def bad_requests(other_table: str) -> dict[str, bytes]:
    """Requests that must be refused: broken ones, and sound ones at the wrong time."""

    def request(command: str, **args: Any) -> bytes:
        return msgspec.msgpack.encode({"v": 1, "seq": 1, "command": command, "args": args})

    return {
        "noise": bytes(range(256)) * (MAXIMUM_REQUEST_BYTES // 256 - 1),
        "a megabyte": b"\xc1" * 1_000_000,
        "unknown": request("grasp.crush"),
        "missing key": request("grasp.squeeze"),
        "extra key": request("grasp.close", hard=True),
        "wrong type": request("grasp.squeeze", load_N="much"),
        "not a number": request("grasp.squeeze", load_N=float("nan")),
        "out of range": request("grasp.squeeze", load_N=1e6),
        "above cap": request("grasp.squeeze", load_N=130.0),
        "beyond table": request("grasp.squeeze", load_N=1.0),
        "joints": request("arm.move_joints", joint_rad=[0.0] * 7),
        "close": request("grasp.close"),
        "compensation": request("compensation.set", enabled=False),
        "no such table": request("table.load", table="nothing"),
        "table": request("table.load", table=other_table),
    }


@pytest.fixture(scope="module")
def story(config: RobotConfig, symmetric_case: GraspCase, split_case: GraspCase) -> Story:
    """Gripped; asked for nonsense; hand silent in a squeeze; arm idled; released in a fault."""
    robot = Robot(config, symmetric_case)
    story = Story(robot.digest.value)

    def see(name: str) -> None:
        story.seen[name] = robot.seen()

    def ask(name: str, request: bytes) -> None:
        clock = VirtualClock(robot.virtual.time.now_ns)
        raw = robot.virtual.socket.connect(clock)
        raw.send(request)
        robot.run_for(0.03)
        clock.advance_to_ns(robot.virtual.time.now_ns)
        story.replies[name] = msgspec.msgpack.decode(raw.take() or b"\x80")

    see("gripped")
    requests = bad_requests(table_name(split_case))
    table_request = requests.pop("table")
    for name, request in requests.items():
        ask(name, request)
    see("asked for nonsense")
    ask("table", table_request)
    see("asked for another table")

    task = robot.client.start("grasp.squeeze", load_N=66.0, duration_s=1.2)
    robot.run_for(0.4)
    see("squeezing on")
    robot.silence_the_hand(0.2)
    see("hand silent")
    robot.run_for(0.3)
    see("hand silent, later")
    with pytest.raises(CommandError) as failed:
        task.wait(0.1)
    story.errors["squeeze"] = failed.value
    robot.client.fault_clear()
    robot.run_for(0.3)
    see("cleared")

    robot.press("idle")
    robot.run_for(0.3)
    see("idle")
    robot.press("activate")
    robot.run_for(0.01)
    see("active again")
    robot.run_for(0.3)
    see("active again, later")
    robot.client.fault_clear()
    robot.run_for(0.1)
    see("cleared again")

    robot.silence_the_hand(0.15)
    see("silent again")
    story.released = robot.client.grasp_release().wait()
    robot.run_for(0.2)
    see("released")
    return story


def test_the_same_run_twice_gives_the_same_bytes(story: Story, config: RobotConfig, symmetric_case: GraspCase) -> None:
    """On virtual time every record of every cycle is the same, whatever the machine is doing."""
    records, digest = Robot(config, symmetric_case).digest.value
    assert records > 2000
    assert (records, digest) == story.gripped


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("noise", "not_msgpack"),
        ("a megabyte", "too_large"),
        ("unknown", "unknown_command"),
        ("missing key", "missing_key"),
        ("extra key", "extra_key"),
        ("wrong type", "wrong_type"),
        ("not a number", "not_finite"),
        ("out of range", "out_of_range"),
        ("above cap", "load_above_cap"),
        ("beyond table", "outside_table"),
        ("joints", "wrong_phase"),
        ("close", "wrong_phase"),
        ("compensation", "wrong_phase"),
        ("no such table", "no_table"),
        ("table", "wrong_phase"),
    ],
)
def test_bad_commands_are_answered(story: Story, name: str, code: str) -> None:
    """Whatever comes in, the answer says what was wrong with it."""
    reply = story.replies[name]
    assert reply["ok"] is False
    assert reply["error"]["code"] == code


def steady(seen: Seen) -> dict[str, Any]:
    """What of the status a refused command may not change; measured values move by themselves."""
    state = seen.status["state"]
    settled = {
        "plan": np.round(state["arm"]["wrist_plan_xyz_m"], 9).tolist(),
        "grasp": {name: state["grasp"][name] for name in ("phase", "fault", "winding_m")},
        "compensation": {name: state["compensation"][name] for name in ("enabled", "index")},
    }
    return {
        "table": seen.status["table"],
        "cycle_lost": seen.status["cycle_lost"],
        "arm": state["arm"]["state"],
    } | settled


def test_bad_commands_change_nothing(story: Story) -> None:
    """After all of them the robot holds what it held, where it held it."""
    before, after = story.seen["gripped"], story.seen["asked for nonsense"]
    assert steady(after) == steady(before)
    np.testing.assert_allclose(after.excursion_m, before.excursion_m, atol=TICK_M)
    np.testing.assert_allclose(after.truth.T_world_wrist, before.truth.T_world_wrist, atol=2e-4)
    assert after.holds


def test_a_refused_table_is_not_in_force(story: Story) -> None:
    """While something is gripped another table is refused, by the front's own notion of it too."""
    assert steady(story.seen["asked for another table"]) == steady(story.seen["gripped"])


def test_a_silent_hand_is_a_fault_that_keeps_the_object(story: Story) -> None:
    """In the midst of a squeeze the samples end: winding ends with them, and both excursions stay where they are."""
    before, silent, later = (story.seen[name] for name in ("squeezing on", "hand silent", "hand silent, later"))
    assert (before.phase, silent.phase, silent.fault) == ("squeezing", "fault", "hand_silent")
    assert story.errors["squeeze"].code == "hand_silent"
    assert np.all(silent.excursion_m > before.excursion_m)
    np.testing.assert_allclose(later.excursion_m, silent.excursion_m, atol=TICK_M)
    assert later.holds


def test_a_cleared_fault_leads_back_to_holding(story: Story) -> None:
    """Once the cause is gone the operator goes on with the object in hand: nothing jumps."""
    silent, cleared = story.seen["hand silent, later"], story.seen["cleared"]
    assert (cleared.phase, cleared.fault, cleared.arm) == ("holding", "", "active")
    np.testing.assert_allclose(cleared.excursion_m, silent.excursion_m, atol=3 * TICK_M)
    assert cleared.holds


def test_an_idled_arm_keeps_the_object(story: Story) -> None:
    """The pendant is the operator's: idle is a fault while something is held, and the hand goes on holding."""
    before, idle = story.seen["cleared"], story.seen["idle"]
    assert (idle.arm, idle.phase, idle.fault) == ("idle", "fault", "arm_idled")
    np.testing.assert_allclose(idle.excursion_m, before.excursion_m, atol=3 * TICK_M)
    assert idle.holds
    again = story.seen["cleared again"]
    assert (again.arm, again.phase, again.fault) == ("active", "holding", "")
    assert again.holds


def test_an_arm_that_is_activated_again_stands(story: Story) -> None:
    """Activation with an object in the hand moves nothing: the command is the measured pose, offset and all."""
    before, after = story.seen["active again"], story.seen["active again, later"]
    moved_m = np.linalg.norm(after.truth.T_world_wrist[:3, 3] - before.truth.T_world_wrist[:3, 3])
    assert moved_m < 1e-3


def test_release_works_in_a_fault(story: Story) -> None:
    """Trapped fingers come free without clearing anything first."""
    assert story.seen["silent again"].fault == "hand_silent"
    assert story.released["command"] == "grasp.release"
    released = story.seen["released"]
    assert (released.phase, released.fault) == ("none", "hand_silent")
    assert not released.truth.contact_force_N.any()
    assert np.all(released.excursion_m < 1e-4)
