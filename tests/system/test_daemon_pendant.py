"""The daemon as its processes, and the operator at the simulated pendant.

Real time, so nothing here asserts how long something took; every wait has a generous end.
"""

from __future__ import annotations

import signal
import time

import pytest

from drivers.errors import CommandError
from tests.system.daemon_rig import TIMEOUT_S, Installation, active, heard, until

TARGET_RAD = [0.1, 0.15, 0.05, 2.25, 0.05, -0.75, 0.05]


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
