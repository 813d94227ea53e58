"""The state stream: ZeroMQ PUB, one single-part msgpack map a sample (design 6).

Keys are nested names (`arm` → `joint_rad`) that a reader such as PlotJuggler shows as `arm/joint_rad`, beside
`timestamp`, the time of the sample in seconds since 1970. The stream takes no commands; a slow reader loses
samples.
Source: real-time-python reference 5 (telemetry), 6 (pyzmq).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec
import zmq

from controller.config import STATE_ENDPOINTS
from controller.service.answers import plain
from controller.service.ipc_endpoint import bind_ipc
from drivers.errors import ConfigurationError

_WAITING_SAMPLES = 20  # per reader: at 100 Hz a pause of 0.2 s costs nothing
_LOCAL = "tcp://127.0.0.1:"
_ENCODER = msgspec.msgpack.Encoder(enc_hook=plain)


def encode_state(state: Mapping[str, Any], timestamp_s: float) -> bytes:
    """One sample as bytes; `timestamp_s` in seconds since 1970. NumPy values are written as lists and numbers."""
    return _ENCODER.encode({"timestamp": timestamp_s, **state})


class StateOutlet(Protocol):
    """Where the front puts its state."""

    def publish(self, state: Mapping[str, Any], timestamp_s: float) -> None:
        """Send one sample to whoever listens."""
        ...

    def close(self) -> None:
        """Leave nothing behind."""
        ...


class StatePublisher:
    """PUB socket at `endpoint`; the caller keeps the rate. Raises ConfigurationError."""

    def __init__(self, endpoint: str) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SNDHWM, _WAITING_SAMPLES)
        self._path: Path | None = None
        try:
            if endpoint.startswith(_LOCAL):
                self._bind_tcp(endpoint)
            elif endpoint.startswith("ipc://"):
                self._path = bind_ipc(self._socket, "state_endpoint", endpoint)
            else:
                raise ConfigurationError("[front]", "state_endpoint", endpoint, STATE_ENDPOINTS)
        except ConfigurationError:
            self._context.destroy(linger=0)
            raise

    def _bind_tcp(self, endpoint: str) -> None:
        try:
            self._socket.bind(endpoint)
        except zmq.ZMQError as error:
            accepted = f"{_LOCAL} and a free port ({error.strerror})"
            raise ConfigurationError("[front]", "state_endpoint", endpoint, accepted) from error

    def publish(self, state: Mapping[str, Any], timestamp_s: float) -> None:
        self._socket.send(encode_state(state, timestamp_s), zmq.NOBLOCK)  # a PUB socket drops, it never refuses

    def close(self) -> None:
        self._context.destroy(linger=0)
        if self._path is not None:
            self._path.unlink(missing_ok=True)


class MemoryStateOutlet:
    """Twin of `StatePublisher` in a simulation: keeps the newest sample, as bytes like those on the wire."""

    def __init__(self) -> None:
        self.newest: bytes | None = None

    def publish(self, state: Mapping[str, Any], timestamp_s: float) -> None:
        self.newest = encode_state(state, timestamp_s)

    def close(self) -> None:
        pass
