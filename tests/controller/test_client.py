"""The client against a small daemon that answers by script, over ZeroMQ and over virtual time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.client import Client, Task
from controller.service.answers import encode_error, encode_event, encode_reply, error_told
from controller.service.command_socket import CommandPort, CommandSocket, MemoryCommandSocket, MemoryConnection
from controller.service.commands import COMMANDS, GraspSqueeze, RequestError, decode_request
from drivers.clock import MonotonicClock, VirtualClock, nanoseconds
from drivers.errors import CommandError


def serve(port: CommandPort) -> None:
    """Answer all that has arrived: slow commands end at once, closing fails, status is refused, holding is ignored."""
    while (received := port.receive()) is not None:
        address, data = received
        try:
            request = decode_request(data)
        except RequestError as error:
            port.send(address, encode_error(error.seq, error))
            continue
        name = request.command.name
        if name == "status":
            port.send(address, encode_error(request.seq, CommandError("busy", "The cycle is busy.", help="Wait.")))
        elif name != "grasp.hold":
            port.send(address, encode_reply(request.seq, {"command": name}))
        if name == "grasp.close":
            told = error_told(CommandError("no_contact", "No finger touched.", help="Look where the object is."))
            port.send(address, encode_event("failed", request.seq, error=told))
        elif isinstance(request.command, GraspSqueeze):
            port.send(address, encode_event("progress", request.seq, load_N=request.command.load_N / 2))
            port.send(address, encode_event("fault", None, code="stopped"))
            port.send(address, encode_event("completed", request.seq, load_N=request.command.load_N))
        elif request.command.slow and name != "grasp.release":
            port.send(address, encode_event("completed", request.seq))


class Stepped:
    """A transport that runs the daemon, in virtual time, until an answer is there."""

    def __init__(self, connection: MemoryConnection, clock: VirtualClock, step: Callable[[], None]) -> None:
        self._connection, self._clock, self._step = connection, clock, step

    def send(self, data: bytes) -> None:
        self._connection.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        self._step()
        deadline_ns = self._clock.now_ns() + nanoseconds(timeout_s)
        self._clock.wait_readable(self._connection, deadline_ns)
        return self._connection.take()

    def close(self) -> None:
        pass


@pytest.fixture
def virtual() -> Client:
    daemon_clock, clock = VirtualClock(), VirtualClock()
    port = MemoryCommandSocket(daemon_clock)

    def step() -> None:
        daemon_clock.advance_to_ns(clock.now_ns() + 2_000_000)
        serve(port)

    return Client(Stepped(port.connect(clock), clock, step), clock=clock)


@pytest.fixture
def real(tmp_path: Path) -> Iterator[Client]:
    port = CommandSocket(f"ipc://{tmp_path}/command")
    clock, ended = MonotonicClock(), threading.Event()

    def run() -> None:
        while not ended.is_set():
            serve(port)
            clock.wait_readable(port, clock.now_ns() + 5_000_000)

    daemon = threading.Thread(target=run)
    daemon.start()
    with Client(f"ipc://{tmp_path}/command", reply_timeout_s=10.0) as client:
        yield client
    ended.set()
    daemon.join()
    port.close()


@pytest.fixture(params=["real", "virtual"])
def client(request: pytest.FixtureRequest) -> Client:
    made: Client = request.getfixturevalue(request.param)
    return made


def test_every_command_has_a_method_that_the_daemon_accepts(client: Client) -> None:
    """The Python face covers the language; slow commands give tasks, quick ones results."""
    robot: Any = client
    given: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {
        "arm.move_joints": ((np.zeros(7),), {"speed": 0.2}),
        "arm.move_wrist": (([0.5, 0, 0.9], np.array([1.0, 0, 0, 0])), {}),
        "grasp.preposition": (("pp40",), {"object_xyz_m": (0.5, 0, 0.9), "object_yaw_rad": 0.3}),
        "grasp.squeeze": ((), {"load_N": np.float64(60)}),
        "table.load": (("pp40",), {}),
        "compensation.set": ((False,), {"index": "load"}),
    }
    for name, kind in COMMANDS.items():
        if name in ("status", "grasp.hold"):
            continue
        positional, named = given.get(name, ((), {}))
        answer = getattr(robot, name.replace(".", "_"))(*positional, **named)
        assert isinstance(answer, Task) == kind.slow
        assert (answer.accepted if isinstance(answer, Task) else answer) == {"command": name}


def test_a_slow_command_is_waited_for(client: Client) -> None:
    """Progress and end belong to the task; events of no command are kept for whoever asks."""
    task = client.grasp_squeeze(load_N=60.0, duration_s=1.5)
    heard: list[dict[str, Any]] = []
    assert task.wait(on_progress=heard.append)["load_N"] == 60.0
    assert heard == [{"load_N": 30.0}]
    assert task.progress == {"load_N": 30.0}
    assert task.done
    assert task.wait()["load_N"] == 60.0
    assert [(event.event, event.seq) for event in client.events] == [
        ("progress", task.seq), ("fault", None), ("completed", task.seq),
    ]  # fmt: skip


def test_a_failure_is_raised_with_code_and_help(client: Client) -> None:
    """The planner can act on the code, and its author on the help; at the request as at the end."""
    with pytest.raises(CommandError, match="The cycle is busy") as refused:
        client.status()
    assert (refused.value.code, refused.value.help) == ("busy", "Wait.")
    with pytest.raises(CommandError, match="No finger touched") as failed:
        client.grasp_close().wait()
    assert failed.value.code == "no_contact"


@pytest.mark.parametrize(
    ("name", "args", "code"),
    [
        ("grasp.squeeze", {"load_N": float("nan")}, "not_finite"),
        ("grasp.squeeze", {"load_N": "60"}, "wrong_type"),
        ("arm.move_joints", {"joint_rad": [0.0] * 6}, "out_of_range"),
        ("grasp.squeese", {}, "unknown_command"),
        ("status", {}, "not_slow"),
    ],
)
def test_a_bad_call_is_refused_before_it_is_sent(virtual: Client, name: str, args: dict[str, Any], code: str) -> None:
    """The client knows the same language as the daemon."""
    with pytest.raises(CommandError) as caught:
        virtual.start(name, **args)
    assert caught.value.code == code


def test_silence_is_told_and_a_late_reply_is_not_taken_for_the_next(virtual: Client) -> None:
    """A daemon that does not answer gives `no_reply`; a task that does not end, `timeout`; the client goes on."""
    with pytest.raises(CommandError) as silent:
        virtual.grasp_hold()
    assert silent.value.code == "no_reply"
    with pytest.raises(CommandError) as endless:
        virtual.grasp_release().wait(timeout_s=5.0)
    assert endless.value.code == "timeout"
    assert virtual.hello() == {"command": "hello"}


def test_without_a_daemon_the_client_says_how_to_start_one(tmp_path: Path) -> None:
    """And queues nothing that a daemon started later would carry out."""
    with Client(f"ipc://{tmp_path}/command") as client, pytest.raises(CommandError, match="stillgrasp run") as caught:
        client.hello()
    assert caught.value.code == "no_daemon"


def test_a_wrong_endpoint_is_refused() -> None:
    """A typing error in the endpoint is not a daemon that does not answer."""
    with pytest.raises(CommandError, match="not an endpoint"):
        Client("nowhere")
