"""The daemon as its processes: started, commanded, broken and stopped from outside, as users and systemd would.

Real time, so nothing here asserts how long something took; every wait has a generous end.
"""

from __future__ import annotations

import json
import os
import random
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import can
import msgspec
import numpy as np
import pytest
import zmq

from controller.client import Client
from drivers.errors import CommandError
from drivers.wam.frames import get_property, parse_position, parse_property, position_request
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.properties import property_id
from drivers.wam.safety_puck import Light, PendantState
from drivers.wam.transmission import motor_to_joint

TIMEOUT_S = 60.0
TARGET_RAD = [0.1, 0.15, 0.05, 2.25, 0.05, -0.75, 0.05]
ATTEMPTS = 3
"""A machine that keeps the world waiting gives the cycle good reasons for a fault."""
COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()"]


class Installation:
    """A runtime directory of its own, short enough for socket paths, and all processes that were started in it."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.runtime = directory / "stillgrasp"
        private = ("RUNTIME_DIRECTORY", "STATE_DIRECTORY", "NOTIFY_SOCKET")
        self.environment = {name: value for name, value in os.environ.items() if name not in private}
        self.environment |= {"XDG_RUNTIME_DIR": str(directory), "XDG_DATA_HOME": str(directory), "OMP_NUM_THREADS": "1"}
        # half the pace: two processes with a world between them are much for a shared machine
        self.file = directory / "robot.toml"
        self.file.write_text("[cycle]\nperiod_s = 0.004\n")
        self._started: list[Daemon] = []

    def start(self, *options: str) -> Daemon:
        daemon = Daemon(self, ["run", "--simulate", "--config", str(self.file), "--json", "--no-record", *options])
        self._started.append(daemon)
        return daemon

    def command(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*COMMAND, *arguments], env=self.environment, capture_output=True, text=True, timeout=TIMEOUT_S
        )

    def left_behind(self) -> list[str]:
        """What still lies in the runtime directory."""
        return sorted(str(path.relative_to(self.runtime)) for path in self.runtime.rglob("*"))

    def close(self) -> None:
        for daemon in self._started:
            daemon.end()


class Daemon:
    """One `stillgrasp run`; what it prints goes to a file, for the message of a test that fails."""

    def __init__(self, installation: Installation, arguments: list[str]) -> None:
        self.told = tempfile.TemporaryFile(mode="w+")  # noqa: SIM115 - closed by end()
        self.process = subprocess.Popen(
            [*COMMAND, *arguments],
            env=installation.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.told,
            text=True,
        )
        self._pidfds: dict[str, int] = {}
        self.description: dict[str, Any] = {}

    def wait_ready(self) -> Daemon:
        """Until the line of JSON; holds on to its processes, so that their ids cannot come to mean others."""
        assert self.process.stdout is not None
        assert select.select([self.process.stdout], [], [], TIMEOUT_S)[0], self.messages()
        line = self.process.stdout.readline()
        assert line, self.messages()
        self.description = json.loads(line)
        self._pidfds = {role: os.pidfd_open(pid) for role, pid in self.description["pids"].items()}
        return self

    def client(self) -> Client:
        return Client(self.description["command_endpoint"], reply_timeout_s=20.0)

    def messages(self) -> str:
        self.told.seek(0)
        return self.told.read()

    def send_signal(self, role: str, number: signal.Signals) -> None:
        signal.pidfd_send_signal(self._pidfds[role], number)

    def wait_gone(self, *roles: str) -> None:
        """Until these processes (all, if none is named) have ended."""
        for role in roles or self._pidfds:
            assert select.select([self._pidfds[role]], [], [], TIMEOUT_S)[0], f"{role} lives\n{self.messages()}"

    def exit_code(self) -> int:
        return self.process.wait(TIMEOUT_S)

    def end(self) -> None:
        """Whatever a test has left running, by its own process ids."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(20.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        for pidfd in self._pidfds.values():
            if not select.select([pidfd], [], [], 0)[0]:
                signal.pidfd_send_signal(pidfd, signal.SIGKILL)
            os.close(pidfd)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        for stream in (self.process.stdin, self.process.stdout, self.told):
            stream.close()


def until(daemon: Daemon, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first sample of the state stream for which `condition` holds."""
    with zmq.Context() as context, context.socket(zmq.SUB) as stream:
        stream.setsockopt(zmq.LINGER, 0)
        stream.setsockopt(zmq.SUBSCRIBE, b"")
        stream.connect(daemon.description["state_endpoint"])
        deadline_s = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline_s:
            if stream.poll(1000):
                state: dict[str, Any] = msgspec.msgpack.decode(stream.recv())
                if condition(state):
                    return state
                assert not state["grasp"]["fault"], daemon.messages()
    raise AssertionError(f"it never came to that\n{daemon.messages()}")


def active(daemon: Daemon) -> Daemon:
    """Wait until the arm is active."""
    until(daemon, lambda state: state["arm"]["state"] == "active")
    return daemon


def heard(client: Client, daemon: Daemon, name: str, code: str) -> None:
    """Wait until the client has been told of an event."""
    while not any(event.event == name and event.fields.get("code") == code for event in client.events):
        assert client.receive_until(client.clock.now_ns() + int(TIMEOUT_S * 1e9)), daemon.messages()


class ThirdClient:
    """Somebody else on the arm's bus, who asks the pucks directly."""

    def __init__(self, daemon: Daemon) -> None:
        self.bus = can.Bus(**daemon.description["can"])

    def safety(self, name: str) -> int:
        """A property of the safety puck."""
        number = property_id(name, 197, "safety")
        for _ in range(10):
            while self.bus.recv(0.0) is not None:
                pass  # what was said before, to the daemon's own questions too
            self.bus.send(get_property(10, number))
            reply = self._first(lambda message: message.arbitration_id == 0x546 and message.data[0] & 0x7F == number)
            if reply is not None:
                return parse_property(reply).value
        raise AssertionError("the safety puck keeps silent")

    def joint_rad(self) -> list[float]:
        """Joint angles by the motors' own encoders."""
        counts: dict[int, int] = {}
        for _ in range(20):
            self.bus.send(position_request())
            while len(counts) < 7:
                message = self._first(lambda message: message.arbitration_id & 0x41F == 0x403)
                if message is None:
                    break
                position = parse_position(message)
                counts[position.node] = position.motor_counts
        turns = np.array([counts[node] for node in range(1, 8)]) / load_wam_parameters().counts_per_turn
        angles: list[float] = motor_to_joint(2.0 * np.pi * turns).tolist()
        return angles

    def _first(self, wanted: Callable[[can.Message], bool]) -> can.Message | None:
        deadline_s = time.monotonic() + 1.0
        while time.monotonic() < deadline_s:
            message = self.bus.recv(0.2)
            if message is not None and wanted(message):
                return message
        return None


class _Shutting:
    """A python-can bus as a context."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._bus.shutdown()


@pytest.fixture
def installation() -> Iterator[Installation]:
    with tempfile.TemporaryDirectory(prefix="sg-") as directory, closing(Installation(Path(directory))) as place:
        yield place


def test_a_dead_cycle_leaves_an_idle_arm(installation: Installation) -> None:
    """The front's guard idles the arm before the safety puck's own heartbeat would, says so, and fails."""
    daemon = active(installation.start().wait_ready())
    third = ThirdClient(daemon)
    with daemon.client() as client, _Shutting(third.bus):
        client.hello()
        assert third.safety("MODE") == 2
        daemon.send_signal("cycle", signal.SIGKILL)
        heard(client, daemon, "fault", "cycle_lost")
        assert third.safety("MODE") == 1
        assert PendantState.from_value(third.safety("PEN")).heartbeat is Light.SAFE
        status = client.status()
        assert "the arm is idle" in status["cycle_lost"]
        with pytest.raises(CommandError, match="died"):
            client.arm_hold()
    assert daemon.exit_code() == 1
    daemon.wait_gone()
    assert installation.left_behind() == []


def test_a_dead_front_takes_its_children_with_it(installation: Installation) -> None:
    """Nobody can clean up after kill -9 of the front but its children; the next start finds its place."""
    daemon = active(installation.start().wait_ready())
    daemon.send_signal("front", signal.SIGKILL)
    daemon.wait_gone()
    assert set(installation.left_behind()) <= {"command", "state"}
    again = installation.start().wait_ready()
    with again.client() as client:
        assert client.hello()["name"] == "stillgrasp"


def test_sigterm_in_motion_stops_in_order(installation: Installation) -> None:
    """The arm comes to rest along its path, goes idle, and nothing is left: no process, socket, pty or directory."""
    daemon = active(installation.start().wait_ready())
    with daemon.client() as client:
        client.arm_move_joints([-1.2, 0.1, 0.0, 2.3, 0.0, -0.8, 0.0], speed=0.2)
        until(daemon, lambda state: state["arm"]["joint_command_rad"][0] < -0.02)
        daemon.send_signal("front", signal.SIGTERM)
        daemon.send_signal("front", signal.SIGTERM)
        heard(client, daemon, "stopped", "none")  # now: ZeroMQ drops what was not read when the daemon has gone
        assert daemon.exit_code() == 0, daemon.messages()
        assert [event.error.code for event in client.events if event.error is not None] == ["stopped"]
    daemon.wait_gone()
    assert installation.left_behind() == []


def test_a_dead_hand_is_told_and_the_rest_goes_on(installation: Installation) -> None:
    """Motors hold by themselves; the arm must not drop because the hand's process did. Shutdown still works."""
    daemon = active(installation.start().wait_ready())
    with daemon.client() as client:
        client.hello()
        daemon.send_signal("hand", signal.SIGKILL)
        heard(client, daemon, "fault", "hand_lost")
        status = client.status()
        assert "hand process" in status["hand_lost"]
        assert status["state"]["arm"]["state"] == "active"
        client.shutdown()
    assert daemon.exit_code() == 0
    daemon.wait_gone()
    assert installation.left_behind() == []


def test_a_dead_world_is_the_end(installation: Installation) -> None:
    """Without the simulated devices there is nothing left to run."""
    daemon = installation.start().wait_ready()
    daemon.send_signal("world", signal.SIGKILL)
    assert daemon.exit_code() == 1
    daemon.wait_gone()
    assert "world" in daemon.messages()
    assert installation.left_behind() == []


@pytest.mark.parametrize("moment", ["directory", "socket"])
def test_ctrl_c_while_starting_leaves_nothing(installation: Installation, moment: str) -> None:
    """The operator may change his mind at any time."""
    daemon = installation.start()
    wanted = "simulated-*" if moment == "directory" else "simulated-*/can"
    deadline_s = time.monotonic() + TIMEOUT_S
    while not list(installation.runtime.glob(wanted)):
        assert time.monotonic() < deadline_s, daemon.messages()
        select.select([], [], [], 0.005)
    daemon.process.send_signal(signal.SIGINT)
    assert daemon.exit_code() == 0, daemon.messages()
    assert installation.left_behind() == []
    assert "Traceback" not in daemon.messages()


def test_a_manual_pendant_is_the_operators(installation: Installation) -> None:
    """With --pendant manual nothing activates the arm but the word on standard input."""
    daemon = installation.start("--pendant", "manual", "--seed", "3").wait_ready()
    assert daemon.process.stdin is not None
    with daemon.client() as client:
        until(daemon, lambda state: state["arm"]["state"] == "idle" and state["cycle"]["number"] > 100)
        with pytest.raises(CommandError, match="not active"):
            client.arm_move_joints(TARGET_RAD)
        print("aktivieren\nactivate", file=daemon.process.stdin, flush=True)
        active(daemon)
        print("idle", file=daemon.process.stdin, flush=True)
        until(daemon, lambda state: state["arm"]["state"] == "idle")
    assert "'aktivieren' is unknown" in daemon.messages()
    daemon.process.send_signal(signal.SIGINT)
    assert daemon.exit_code() == 0
    assert installation.left_behind() == []


def test_estop_costs_the_positions_and_not_the_daemon(installation: Installation) -> None:
    """After E-stop the arm is woken and zeroed while all processes live; prompts reach clients; torque waits for the
    operator's Activate."""
    daemon = installation.start("--pendant", "manual").wait_ready()
    assert daemon.process.stdin is not None

    def press(*buttons: str) -> None:
        print(*buttons, sep="\n", file=daemon.process.stdin, flush=True)

    with daemon.client() as client:
        client.hello()

        def until_arm(state: str) -> None:
            deadline_s = time.monotonic() + TIMEOUT_S
            while client.status()["state"]["arm"]["state"] != state:
                assert time.monotonic() < deadline_s, daemon.messages()

        until_arm("idle")
        press("activate")
        until_arm("active")
        press("estop")
        heard(client, daemon, "fault", "estop")
        with pytest.raises(CommandError) as refused:
            client.fault_clear()
        assert refused.value.code == "estop"
        press("release", "idle")
        until_arm("idle")
        client.fault_clear()
        heard(client, daemon, "prompt", "zeroing")
        status = client.status()
        assert status["cycle_lost"] == ""
        press("activate")
        until_arm("active")
        client.shutdown()
    assert daemon.exit_code() == 0, daemon.messages()
    assert "taken for home" in daemon.messages()


@pytest.fixture(scope="module")
def shared() -> Iterator[tuple[Installation, Daemon]]:
    """One running daemon with an active arm, for the tests that leave it as it was; they come last, so that it runs
    beside no other."""
    with tempfile.TemporaryDirectory(prefix="sg-") as directory, closing(Installation(Path(directory))) as place:
        yield place, active(place.start().wait_ready())


def test_it_comes_up_and_says_where(shared: tuple[Installation, Daemon]) -> None:
    """One line of JSON tells a program all it needs, the socket directory is private, and the daemon knows itself."""
    installation, daemon = shared
    assert set(daemon.description["pids"]) == {"front", "cycle", "hand", "world"}
    assert daemon.description["pids"]["front"] == daemon.process.pid
    channel = Path(daemon.description["can"]["channel"])
    assert channel.is_socket()
    assert channel.parent.stat().st_mode & 0o777 == 0o700
    assert Path(daemon.description["tendons"]["port"]).is_char_device()
    with daemon.client() as client:
        assert client.hello()["name"] == "stillgrasp"
        assert client.status()["state"]["arm"]["state"] == "active"
    shown = installation.command("status")
    assert (shown.returncode, shown.stdout.split()[:2]) == (0, ["arm", "active,"])


def test_bad_input_is_answered_and_changes_nothing(shared: tuple[Installation, Daemon]) -> None:
    """Noise and wrong commands get an error that helps; the cycle does not even notice."""
    installation, daemon = shared
    with daemon.client() as client:
        before = client.status()
        with zmq.Context() as context, context.socket(zmq.DEALER) as noisy:
            noisy.setsockopt(zmq.LINGER, 0)
            noisy.connect(daemon.description["command_endpoint"])
            for noise in (random.Random(1).randbytes(1_000_000), b"", b"\xc1", msgspec.msgpack.encode({"v": 1})):
                noisy.send(noise)
                assert noisy.poll(20_000)
                assert msgspec.msgpack.decode(noisy.recv())["ok"] is False
        after = client.status()
    for part in ("hand", "grasp"):
        states = [status["state"][part]["state" if part == "hand" else "phase"] for status in (before, after)]
        assert states[0] == states[1]
    assert np.allclose(before["state"]["arm"]["joint_command_rad"], after["state"]["arm"]["joint_command_rad"])
    for arguments, named in (
        (["arm.move_joints", "joint_rad=[0, 0, 0, 0, 0, 0, NaN]"], "joint_rad[6]"),
        (["arm.move_joints", "angle=1"], "angle"),
        (["arm.mvoe_joints"], "arm.move_joints"),
        (["arm.hold", "nonsense"], "KEY=VALUE"),
    ):
        refused = installation.command("send", *arguments)
        assert refused.returncode == 2
        assert named in refused.stderr
        assert "Traceback" not in refused.stderr
    refused = installation.command("send", "grasp.close")
    assert (refused.returncode, refused.stdout) == (1, "")


def test_a_motion_completes_at_its_target(shared: tuple[Installation, Daemon]) -> None:
    """Front, cycle, bus and world together: the arm's own encoders say that it is where it was sent."""
    installation, daemon = shared
    joints = f"joint_rad={json.dumps(TARGET_RAD)}"
    for _ in range(ATTEMPTS):
        moved = installation.command("send", "arm.move_joints", joints, "speed=0.2", "--wait", "--json")
        if moved.returncode == 0:
            break
        installation.command("send", "fault.clear")
    assert moved.returncode == 0, moved.stderr + daemon.messages()
    assert json.loads(moved.stdout)["command"] == "arm.move_joints"
    third = ThirdClient(daemon)
    with _Shutting(third.bus):
        assert np.allclose(third.joint_rad(), TARGET_RAD, atol=0.03)


def test_a_second_daemon_is_refused(shared: tuple[Installation, Daemon]) -> None:
    """Two daemons at one endpoint would take commands from each other."""
    installation, daemon = shared
    second = installation.command("run", "--simulate", "--no-record")
    assert second.returncode == 2
    assert "one is running there already" in second.stderr
    with daemon.client() as client:
        assert client.hello()["name"] == "stillgrasp"
