"""What tests of the daemon as its processes start and ask: an installation, a daemon in it, others on the bus."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import msgspec
import numpy as np
import zmq

from controller.client import Client
from drivers.wam.frames import get_property, parse_position, parse_property, position_request
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.properties import property_id
from drivers.wam.transmission import motor_to_joint

TIMEOUT_S = 60.0
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
