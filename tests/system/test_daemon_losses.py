"""The daemon as its processes, broken and stopped from outside, as the kernel and systemd would.

Real time, so nothing here asserts how long something took; every wait has a generous end.
"""

from __future__ import annotations

import select
import signal
import time

import pytest

from drivers.errors import CommandError
from drivers.wam.safety_puck import Light, PendantState
from tests.system.daemon_rig import TIMEOUT_S, Installation, ThirdClient, active, heard, until


def test_a_dead_cycle_leaves_an_idle_arm(installation: Installation) -> None:
    """The front's guard idles the arm before the safety puck's own heartbeat would, says so, and fails."""
    daemon = active(installation.start().wait_ready())
    third = ThirdClient(daemon)
    with daemon.client() as client, third.bus:
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
