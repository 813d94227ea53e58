"""The state stream: what a subscriber that is not ours reads."""

from __future__ import annotations

import socket
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zmq

from controller.service.telemetry import MemoryStateOutlet, StatePublisher
from drivers.errors import ConfigurationError

STATE = {"arm": {"mode": "active", "joint_rad": np.arange(7.0)}, "late_us": np.float64(12.5)}


@pytest.mark.parametrize("endpoint", ["ipc://{directory}/state", "tcp://127.0.0.1:{port}"])
def test_a_subscriber_reads_single_part_maps(tmp_path: Path, endpoint: str) -> None:
    """PlotJuggler's ZeroMQ subscriber takes one part, a msgpack map with a timestamp and nested names."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = endpoint.format(directory=tmp_path, port=probe.getsockname()[1])
    publisher = StatePublisher(endpoint)
    subscriber = context.socket(zmq.SUB)
    subscriber.connect(endpoint)
    subscriber.subscribe(b"")
    parts: list[bytes] = []
    for number in range(1000):  # a subscription takes a while to arrive; what is sent before it is lost
        publisher.publish(STATE, timestamp_s=1e9 + number)
        if subscriber.poll(20):
            parts = subscriber.recv_multipart()
            break
    assert len(parts) == 1
    state = msgspec.msgpack.decode(parts[0])
    assert state["timestamp"] >= 1e9
    assert state["arm"] == {"mode": "active", "joint_rad": [0, 1, 2, 3, 4, 5, 6]}
    assert state["late_us"] == 12.5
    publisher.close()
    context.destroy(linger=0)
    assert not (tmp_path / "state").exists()


def test_nobody_listening_costs_nothing() -> None:
    """The twin keeps only the newest; samples without a reader do not pile up."""
    outlet = MemoryStateOutlet()
    for number in range(3):
        outlet.publish(STATE, timestamp_s=float(number))
    assert outlet.newest is not None
    assert msgspec.msgpack.decode(outlet.newest)["timestamp"] == 2.0


@pytest.mark.parametrize(
    "endpoint", ["tcp://0.0.0.0:9872", "tcp://*:9872", "tcp://127.0.0.1:none", "udp://x", "ipc://x"]
)
def test_other_endpoints_are_refused(endpoint: str) -> None:
    """The state does not go out on the network."""
    with pytest.raises(ConfigurationError) as caught:
        StatePublisher(endpoint)
    assert caught.value.key == "state_endpoint"
