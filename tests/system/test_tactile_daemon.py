"""The daemon with pads as its processes: the tactile process is one of them, and no loss of pads is the others' end.

Real time, so nothing here asserts how long something took; every wait has a generous end.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

import pytest

from controller.client import Client
from tests.system.daemon_rig import TIMEOUT_S, Daemon, Installation, heard

pytestmark = pytest.mark.slow
TACTILE = """
[tactile]
interface = "usb"
right_cells = [[0, 0], [0, 1], [0, 2], [0, 3], [0, 4], [1, 0], [1, 1], [1, 2]]
left_cells = [[2, 0], [2, 1], [2, 2], [2, 3], [2, 4], [3, 0], [3, 1], [3, 2]]
"""


def until(daemon: Daemon, client: Client, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first status for which `condition` holds."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline_s:
        if condition(status := client.status()):
            return status
    raise AssertionError(daemon.messages())


def test_pads_and_their_process_come_and_may_go(installation: Installation) -> None:
    """In simulation the configured USB pads are simulated ones. Their bridge unplugged, it is told and found again; the
    process killed, that is told, and the arm goes on."""
    installation.file.write_text(installation.file.read_text() + TACTILE)
    daemon = installation.start("--pendant", "manual").wait_ready()
    assert set(daemon.description["pids"]) == {"front", "world", "hand", "tactile", "cycle"}
    assert daemon.process.stdin is not None
    with daemon.client() as client:
        until(daemon, client, lambda status: status["state"].get("tactile", {}).get("present"))
        assert client.status()["tactile_lost"] == ""
        shown = installation.command("status").stdout
        assert "touching: none" in shown
        assert shown.count("no zero") == 16
        daemon.process.stdin.write('pads {"action": {"kind": "unplug"}, "for_s": 1.0}\n')
        daemon.process.stdin.flush()
        heard(client, daemon, "warning", "tactile_lost")
        heard(client, daemon, "information", "tactile_found")
        assert until(daemon, client, lambda status: status["state"]["tactile"]["present"])["tactile_lost"] == ""
        daemon.send_signal("tactile", signal.SIGKILL)
        status = until(daemon, client, lambda status: status["tactile_lost"])
        assert "motors' load finds contact" in status["tactile_lost"]
        assert status["cycle_lost"] == status["hand_lost"] == ""
        client.shutdown()
    assert daemon.exit_code() == 0
    daemon.wait_gone()
    assert installation.left_behind() == []
