"""The state stream as its readers see it: newest samples of a running daemon, checked (design 6).

What is read here is a part of `state.py`'s map; keys beside it are passed over. SI units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

import msgspec
import zmq

from drivers.errors import CommandError, ProtocolError

_Joints = tuple[float, float, float, float, float, float, float]


class ArmSeen(msgspec.Struct, frozen=True):
    """The arm: its state, and measured angles (7, rad) and commanded torques (7, N·m) of the same cycle."""

    state: str
    joint_rad: _Joints
    joint_torque_Nm: _Joints


class HandSeen(msgspec.Struct, frozen=True):
    """The hand: offline, open, gripping."""

    state: str


class GraspSeen(msgspec.Struct, frozen=True):
    """The grasp: phase, and the code of a fault, empty if there is none."""

    phase: str
    fault: str


class CycleSeen(msgspec.Struct, frozen=True):
    """Which cycle the sample is of."""

    number: int


class StateSeen(msgspec.Struct, frozen=True):
    """One sample of the stream."""

    arm: ArmSeen
    hand: HandSeen
    grasp: GraspSeen
    cycle: CycleSeen


class StateStream(Protocol):
    """Where samples come from: ZeroMQ, or a simulation that runs until one is there."""

    def next(self, timeout_s: float) -> StateSeen | None:
        """The next sample; None if none came within `timeout_s`. Raises ProtocolError on one that cannot be read."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...


def as_seen(state: Mapping[str, Any]) -> StateSeen:
    """A state map as a sample. Raises ProtocolError if it is none."""
    try:
        return msgspec.convert(state, StateSeen)
    except msgspec.ValidationError as error:
        raise ProtocolError(
            "daemon",
            f"its state cannot be read ({error}).",
            help="Both sides must come from the same version of stillgrasp.",
        ) from error


class StateSubscriber:
    """SUB socket to `endpoint`. A slow reader gets samples late, and loses some: see `CycleSeen.number`."""

    def __init__(self, endpoint: str) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        try:
            self._socket.connect(endpoint)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            problem = f"{endpoint} is not an endpoint that can be connected to ({error.strerror})."
            raise CommandError("bad_endpoint", problem, help="Give one such as ipc:///run/stillgrasp/state.") from error

    def next(self, timeout_s: float) -> StateSeen | None:
        if not self._socket.poll(math.ceil(timeout_s * 1000)):
            return None
        try:
            content = msgspec.msgpack.decode(self._socket.recv())
        except msgspec.DecodeError:
            content = None
        return as_seen(content if isinstance(content, dict) else {})

    def close(self) -> None:
        self._context.destroy(linger=0)
