"""The daemon as its processes, running: what it says of itself, and how it answers good input and bad.

Real time, so nothing here asserts how long something took; every wait has a generous end.
"""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zmq

from tests.system.daemon_rig import Daemon, Installation, ThirdClient, active

TARGET_RAD = [0.1, 0.15, 0.05, 2.25, 0.05, -0.75, 0.05]
ATTEMPTS = 3
"""A machine that keeps the world waiting gives the cycle good reasons for a fault."""


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
    with third.bus:
        assert np.allclose(third.joint_rad(), TARGET_RAD, atol=0.03)


def test_a_second_daemon_is_refused(shared: tuple[Installation, Daemon]) -> None:
    """Two daemons at one endpoint would take commands from each other."""
    installation, daemon = shared
    second = installation.command("run", "--simulate", "--no-record")
    assert second.returncode == 2
    assert "one is running there already" in second.stderr
    with daemon.client() as client:
        assert client.hello()["name"] == "stillgrasp"
