"""The command socket: it answers whatever a client throws at it, and owns its path."""

from __future__ import annotations

import os
import select
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zmq

from controller.service.answers import encode_error, encode_reply
from controller.service.command_socket import CommandPort, CommandSocket, MemoryCommandSocket
from controller.service.commands import RequestError, decode_request
from drivers.clock import VirtualClock
from drivers.errors import ConfigurationError

STATUS = msgspec.msgpack.encode({"v": 1, "seq": 1, "command": "status", "args": {}})
LIMIT_S = 10.0  # a test that waits longer has failed; nothing is asserted about time


@pytest.fixture
def endpoint(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}/command"


@pytest.fixture
def context() -> Iterator[zmq.Context[zmq.Socket[bytes]]]:
    made: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    yield made
    made.destroy(linger=0)


def client_of(context: zmq.Context[zmq.Socket[bytes]], endpoint: str, kind: int = zmq.DEALER) -> zmq.Socket[bytes]:
    client = context.socket(kind)
    client.setsockopt(zmq.RCVTIMEO, round(LIMIT_S * 1000))
    client.connect(endpoint)
    return client


def serve_one(port: CommandPort) -> bytes:
    """What the front does with one message; returns the message."""
    while (received := port.receive()) is None:
        assert select.select([port], [], [], LIMIT_S)[0]
    address, data = received
    try:
        answer = encode_reply(decode_request(data).seq, {"phase": "none"})
    except RequestError as error:
        answer = encode_error(error.seq, error)
    port.send(address, answer)
    return data


def test_a_megabyte_of_noise_is_answered_and_the_next_command_works(
    endpoint: str, context: zmq.Context[zmq.Socket[bytes]]
) -> None:
    """Noise gets an error reply on the same connection, which stays good."""
    port = CommandSocket(endpoint)
    client = client_of(context, endpoint)
    client.send(os.urandom(1_000_000))
    assert len(serve_one(port)) == 1_000_000
    reply = msgspec.msgpack.decode(client.recv())
    assert (reply["ok"], reply["error"]["code"]) == (False, "too_large")
    assert "65536" in reply["error"]["message"]
    client.send(STATUS)
    serve_one(port)
    assert msgspec.msgpack.decode(client.recv()) == {"v": 1, "seq": 1, "ok": True, "result": {"phase": "none"}}
    port.close()


@pytest.mark.parametrize("noise", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 64, bytes(range(256)) * 100])
def test_noise_below_zeromq_does_not_hurt_the_daemon(
    endpoint: str, context: zmq.Context[zmq.Socket[bytes]], noise: bytes
) -> None:
    """A program that does not speak ZeroMQ, or an ancient one, is hung up on or refused; the others are served."""
    port = CommandSocket(endpoint)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as stranger:
        stranger.connect(endpoint.removeprefix("ipc://"))
        stranger.send(noise)
        client = client_of(context, endpoint)
        client.send(STATUS)
        while serve_one(port) != STATUS:
            pass
        assert msgspec.msgpack.decode(client.recv())["ok"]
    port.close()


def test_a_req_client_and_one_with_an_empty_message_are_served(
    endpoint: str, context: zmq.Context[zmq.Socket[bytes]]
) -> None:
    """Clients in other languages often use REQ, whose envelope has an empty part."""
    port = CommandSocket(endpoint)
    asking = client_of(context, endpoint, zmq.REQ)
    asking.send(STATUS)
    assert serve_one(port) == STATUS
    assert msgspec.msgpack.decode(asking.recv())["ok"]
    empty = client_of(context, endpoint)
    empty.send(b"")
    assert serve_one(port) == b""
    assert msgspec.msgpack.decode(empty.recv())["error"]["code"] == "not_msgpack"
    port.close()


def test_a_client_that_has_gone_is_told(endpoint: str) -> None:
    """An event to nobody is counted, and does not stop the front."""
    port = CommandSocket(endpoint)
    assert port.send((b"nobody",), b"event") is False
    assert port.undelivered == 1
    port.close()


def test_the_path_is_for_owner_and_group_and_is_removed(endpoint: str) -> None:
    """Only the group of the daemon may command; nothing is left behind; the umask is as before."""
    umask = os.umask(0o022)
    try:
        port = CommandSocket(endpoint)
        path = Path(endpoint.removeprefix("ipc://"))
        assert stat.S_IMODE(path.stat().st_mode) == 0o660
        port.close()
        assert not path.exists()
    finally:
        assert os.umask(umask) == 0o022


def test_a_path_in_use_is_refused_and_a_dead_one_is_taken(endpoint: str, tmp_path: Path) -> None:
    """A second daemon does not steal the first one's clients; a killed daemon's socket is no obstacle."""
    port = CommandSocket(endpoint)
    with pytest.raises(ConfigurationError, match="running there already"):
        CommandSocket(endpoint)
    port.close()
    dead = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    dead.bind(str(tmp_path / "command"))
    dead.close()
    CommandSocket(endpoint).close()
    (tmp_path / "command").write_text("a file of the user's")
    with pytest.raises(ConfigurationError, match="no other file"):
        CommandSocket(endpoint)


@pytest.mark.parametrize("endpoint", ["tcp://127.0.0.1:5555", "ipc://relative", "ipc:///tmp/" + "x" * 200, "5555"])
def test_other_endpoints_are_refused(endpoint: str) -> None:
    """Commands over tcp need keys; a path that is too long is not cut."""
    with pytest.raises(ConfigurationError) as caught:
        CommandSocket(endpoint)
    assert (caught.value.key, caught.value.value) == ("command_endpoint", endpoint)
    assert "ipc://" in caught.value.accepted


def test_the_twin_delivers_in_order_of_virtual_time() -> None:
    """Two clients on their own clocks: the earlier message first, none before its time, answers to whom they belong."""
    clock, early, late = VirtualClock(), VirtualClock(2_000), VirtualClock(5_000)
    port = MemoryCommandSocket(clock)
    second, first = port.connect(late), port.connect(early)
    second.send(b"second")
    first.send(b"first")
    assert port.receive() is None
    assert clock.wait_readable(port, deadline_ns=10_000)
    assert clock.now_ns() == 2_000
    received = port.receive()
    assert received is not None
    address, data = received
    assert data == b"first"
    assert port.receive() is None
    port.send(address, b"answer")
    assert first.take() == b"answer"
    assert second.take() is None
    clock.advance_to_ns(5_000)
    received = port.receive()
    assert received is not None
    assert received[1] == b"second"
