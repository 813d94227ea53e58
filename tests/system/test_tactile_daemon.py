"""The daemon with pads as its processes: the tactile process is one of them, and its loss is no end of the others.

Real time, so nothing here asserts how long something took; every wait has a generous end.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from contextlib import closing
from pathlib import Path

import pytest

from controller.client import Client

pytestmark = pytest.mark.slow
COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()"]
TIMEOUT_S = 60.0
ROBOT = """
[cycle]
period_s = 0.004
[tactile]
interface = "usb"
right_cells = [[0, 0], [0, 1], [0, 2], [0, 3], [0, 4], [1, 0], [1, 1], [1, 2]]
left_cells = [[2, 0], [2, 1], [2, 2], [2, 3], [2, 4], [3, 0], [3, 1], [3, 2]]
"""


def test_the_tactile_process_comes_and_may_go() -> None:
    """In simulation the configured USB pads are simulated ones; killed, the loss is told and the arm goes on."""
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:
        Path(directory, "robot.toml").write_text(ROBOT)
        environment = {name: value for name, value in os.environ.items() if name != "RUNTIME_DIRECTORY"}
        process = subprocess.Popen(
            [*COMMAND, "run", "--simulate", "--json", "--no-record", "--config", f"{directory}/robot.toml"],
            env=environment | {"XDG_RUNTIME_DIR": directory, "XDG_DATA_HOME": directory},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert process.stdout is not None
        try:
            assert select.select([process.stdout], [], [], TIMEOUT_S)[0]
            told = json.loads(process.stdout.readline())
            assert set(told["pids"]) == {"front", "world", "hand", "tactile", "cycle"}
            with closing(Client(told["command_endpoint"])) as client:
                assert client.status()["tactile_lost"] == ""
                os.kill(told["pids"]["tactile"], signal.SIGKILL)
                while not (status := client.status())["tactile_lost"]:
                    pass
                assert "motors' load finds contact" in status["tactile_lost"]
                assert status["cycle_lost"] == status["hand_lost"] == ""
                client.request("shutdown")
            assert process.wait(TIMEOUT_S) == 0
        finally:
            process.kill()
            process.wait()
        assert not list(Path(directory, "stillgrasp").rglob("pads"))
