"""The Python face of the daemon, for a task planner (design 6).

    from controller.client import Client

    with Client() as robot:
        robot.hello()
        robot.grasp_preposition("cylinder40", object_xyz_m=(0.6, 0.0, 0.9)).wait()
        robot.grasp_close().wait()
        robot.grasp_squeeze(load_N=60.0, duration_s=1.5).wait()

One method a command. Quick commands return their result; slow ones return a `Task` as soon as the daemon has accepted
them, and `wait()` until their end. Whatever the daemon refuses, or cannot finish, is a CommandError with code and help.
SI units; frames and finger order as in `controller/service/commands.py`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Literal, Protocol, Self

import numpy as np
import zmq
from numpy.typing import NDArray

from controller.config import load_config
from controller.service.answers import ENDINGS, ErrorTold, Event, Reply, decode_answer
from controller.service.commands import Request, encode_request, make_command
from drivers.clock import Clock, MonotonicClock, nanoseconds, seconds
from drivers.errors import CommandError

Vector = Sequence[float] | NDArray[np.float64]
_KEPT_EVENTS = 1000


class Transport(Protocol):
    """What carries the client's bytes: ZeroMQ, or a simulation that runs until an answer is there."""

    def send(self, data: bytes) -> None:
        """Send one request. Raises CommandError if nobody listens."""
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next answer or event; None if none came within `timeout_s`. 0 = do not wait."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...


class ZeroMQTransport:
    """DEALER socket to `endpoint`."""

    def __init__(self, endpoint: str, connect_timeout_s: float = 1.0) -> None:
        self._endpoint = endpoint
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        # Without a daemon nothing is queued: a command must not be carried out by whoever starts later.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self._socket.setsockopt(zmq.SNDTIMEO, round(connect_timeout_s * 1000))
        try:
            self._socket.connect(endpoint)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            problem = f"{endpoint} is not an endpoint that can be connected to ({error.strerror})."
            raise CommandError(
                "bad_endpoint", problem, help="Give one such as ipc:///run/stillgrasp/command."
            ) from error

    def send(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except zmq.Again as error:
            raise CommandError(
                "no_daemon", f"No daemon listens at {self._endpoint}.", help="Start one: stillgrasp run --simulate"
            ) from error

    def receive(self, timeout_s: float) -> bytes | None:
        if not self._socket.poll(math.ceil(timeout_s * 1000)):
            return None
        return self._socket.recv()

    def close(self) -> None:
        self._context.destroy(linger=0)


class Task:
    """A slow command under way. `accepted` is what the daemon answered at once."""

    def __init__(self, client: Client, seq: int, name: str) -> None:
        self.seq = seq
        self.name = name
        self.accepted: dict[str, Any] = {}
        self.progress: dict[str, Any] = {}
        """How far it is, as of the newest event that has come in (`controller/service/progress.py` has the keys)."""
        self._client = client
        self._ending: Event | None = None

    @property
    def done(self) -> bool:
        """True once the command has ended; does not wait."""
        self._client.poll()
        return self._ending is not None

    def wait(
        self, timeout_s: float = 60.0, *, on_progress: Callable[[dict[str, Any]], None] | None = None
    ) -> dict[str, Any]:
        """Wait for the end and return what the daemon says of it; `on_progress` is called with each progress event.

        Raises CommandError if the command failed, and with code `timeout` if it has not ended after `timeout_s`; it
        then goes on, and can be waited for again.
        """
        deadline_ns = self._client.clock.now_ns() + nanoseconds(timeout_s)
        seen = self.progress
        while self._ending is None:
            if not self._client.receive_until(deadline_ns):
                problem = f"{self.name} has not ended after {timeout_s:g} s."
                raise CommandError("timeout", problem, help="Wait longer, or send stop.")
            if on_progress is not None and self.progress is not seen:
                seen = self.progress
                on_progress(seen)
        if self._ending.event == "failed":
            told = self._ending.error
            raise told.as_error() if told else CommandError("failed", f"{self.name} failed.")
        return self._ending.fields

    def hear(self, event: Event) -> None:
        """For the client: an event about this command has arrived."""
        if event.event in ENDINGS:
            self._ending = event
        elif event.event == "progress":
            self.progress = event.fields


class Client:
    """A connection to the daemon; without `connection` to the endpoint of the default configuration.

    `events` keeps the last thousand events in order, of all commands and of none; `poll()` brings in what has arrived.
    Every method may raise CommandError: refused by the daemon (its code), `no_daemon`, `no_reply`, `bad_answer`.
    """

    def __init__(
        self, connection: str | Transport | None = None, *, clock: Clock | None = None, reply_timeout_s: float = 2.0
    ) -> None:
        if connection is None:
            connection = load_config().front.command_endpoint
        self.clock: Clock = clock or MonotonicClock()
        self.events: deque[Event] = deque(maxlen=_KEPT_EVENTS)
        self._transport: Transport = ZeroMQTransport(connection) if isinstance(connection, str) else connection
        self._reply_timeout_s = reply_timeout_s
        self._seq = 0
        self._reply: Reply | None = None
        self._tasks: dict[int, Task] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the connection; tasks under way go on in the daemon."""
        self._transport.close()

    def hello(self, client: str = "") -> dict[str, Any]:
        """Versions, arm, hand and tables of the daemon."""
        return self.request("hello", client=client)

    def status(self) -> dict[str, Any]:
        """States, faults and applied values."""
        return self.request("status")

    def stop(self) -> dict[str, Any]:
        """Stop arm and winding along their path and hold."""
        return self.request("stop")

    def fault_clear(self) -> dict[str, Any]:
        """Leave the fault once its cause is gone."""
        return self.request("fault.clear")

    def shutdown(self) -> dict[str, Any]:
        """End the daemon; the hand does not open."""
        return self.request("shutdown")

    def arm_hold(self) -> dict[str, Any]:
        """Stop the arm along its path and hold there."""
        return self.request("arm.hold")

    def arm_move_joints(self, joint_rad: Vector, *, speed: float = 0.5) -> Task:
        """Move to joint angles (7), rad; `speed` is a part of the configured joint velocity limits."""
        return self.start("arm.move_joints", joint_rad=joint_rad, speed=speed)

    def arm_move_wrist(self, xyz_m: Vector, quaternion_wxyz: Vector, *, speed: float = 0.5) -> Task:
        """Move the wrist to a pose in the world: position (3), m, and quaternion (4), w x y z."""
        pose = {"xyz_m": xyz_m, "quaternion_wxyz": quaternion_wxyz}
        return self.start("arm.move_wrist", T_world_wrist=pose, speed=speed)

    def hand_open(self) -> Task:
        """Pay out both tendons to the open position; also in a fault."""
        return self.start("hand.open")

    def grasp_preposition(
        self,
        table: str,
        *,
        object_xyz_m: Vector,
        object_yaw_rad: float | None = None,
        object_quaternion_wxyz: Vector | None = None,
        approach_m: float = 0.1,
        speed: float = 0.5,
    ) -> Task:
        """Bring the open hand to where the table's grasp starts, around an object at a pose in the world."""
        return self.start(
            "grasp.preposition",
            table=table,
            object_xyz_m=object_xyz_m,
            object_yaw_rad=object_yaw_rad,
            object_quaternion_wxyz=object_quaternion_wxyz,
            approach_m=approach_m,
            speed=speed,
        )

    def grasp_close(self, *, rate_m_s: float | None = None) -> Task:
        """Wind in until the fingers touch."""
        return self.start("grasp.close", rate_m_s=rate_m_s)

    def grasp_squeeze(self, *, load_N: float, duration_s: float | None = None) -> Task:
        """Wind in to a mean tendon load."""
        return self.start("grasp.squeeze", load_N=load_N, duration_s=duration_s)

    def grasp_hold(self) -> dict[str, Any]:
        """Stop winding and hold both excursions."""
        return self.request("grasp.hold")

    def grasp_release(self) -> Task:
        """Pay out, compensating backwards, until the object is free; also in a fault."""
        return self.start("grasp.release")

    def table_list(self) -> dict[str, Any]:
        """The motion tables in the daemon's directory."""
        return self.request("table.list")

    def table_load(self, table: str) -> dict[str, Any]:
        """Hand a motion table, by name or path, to the cycle."""
        return self.request("table.load", table=table)

    def compensation_set(
        self, enabled: bool, *, index: Literal["load", "excursion", "fused"] | None = None
    ) -> dict[str, Any]:
        """Switch the compensation on or off and choose its index."""
        return self.request("compensation.set", enabled=enabled, index=index)

    def request(self, command: str, *, deadline_s: float | None = None, **args: Any) -> dict[str, Any]:
        """Send any command by name and return the daemon's answer; does not wait for the end of a slow one."""
        self._seq += 1
        return self._exchange(Request(self._seq, make_command(command, args), deadline_s))

    def start(self, command: str, *, deadline_s: float | None = None, **args: Any) -> Task:
        """Send a slow command by name."""
        self._seq += 1
        request = Request(self._seq, make_command(command, args), deadline_s)
        if not request.command.slow:
            raise CommandError("not_slow", f"{command} ends with its answer.", help="Use request().")
        task = self._tasks[self._seq] = Task(self, self._seq, command)  # before sending: its end may come at once
        try:
            task.accepted = self._exchange(request)
        except CommandError:
            self._tasks.pop(request.seq, None)
            raise
        return task

    def poll(self) -> None:
        """Bring in the events that have arrived, without waiting."""
        while self.receive_until(self.clock.now_ns()):
            pass

    def receive_until(self, deadline_ns: int) -> bool:
        """Take in the next answer or event; False if none came until `deadline_ns` of the client's clock."""
        data = self._transport.receive(max(0.0, seconds(deadline_ns - self.clock.now_ns())))
        if data is None:
            return False
        answer = decode_answer(data)
        if isinstance(answer, Reply):
            self._reply = answer
            return True
        self.events.append(answer)
        task = self._tasks.get(answer.seq) if answer.seq is not None else None
        if task is not None:
            task.hear(answer)
            if answer.event in ENDINGS:
                del self._tasks[task.seq]
        return True

    def _exchange(self, request: Request) -> dict[str, Any]:
        self._reply = None
        self._transport.send(encode_request(request))
        deadline_ns = self.clock.now_ns() + nanoseconds(self._reply_timeout_s)
        # A reply to an earlier request that was given up is passed over; one without a number can only be to this.
        while self._reply is None or self._reply.seq not in (request.seq, None):
            if not self.receive_until(deadline_ns):
                problem = f"The daemon did not answer {request.command.name} within {self._reply_timeout_s:g} s."
                raise CommandError("no_reply", problem, help="Look at the daemon's log, or start it again.")
        if self._reply.error is not None or not self._reply.ok:
            raise (self._reply.error or ErrorTold("failed", f"{request.command.name} was refused.")).as_error()
        return self._reply.result
