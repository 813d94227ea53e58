"""One grasp in real time, as a user would run it: the daemon's processes, links and sockets, for the timing figures.

The figures describe the machine, its load included; nothing is asserted of them.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np

from calibration.motion_table import MotionTable
from controller.client import Client
from controller.config import RobotConfig
from controller.service.assembly import index_name
from controller.simulation.demo_cases import GraspCase, approach_joints, command_grasp, table_name
from drivers.errors import CommandError, DeviceError, StillgraspError

START_TIMEOUT_S = 30.0
STOP_TIMEOUT_S = 10.0


def real_time_figures(
    config: RobotConfig, case: GraspCase, recording: Path, say: Callable[[str], None], *, attempts: int = 2
) -> dict[str, Any]:
    """The cycle's figures of one grasp in real time. A machine that stalls may well make the daemon stop with a fault:
    then it is run again; after the last attempt the figures are those up to the fault, with its message beside them.
    """
    for attempt in range(1, attempts + 1):
        try:
            return run_in_real_time(config, case, recording, say)
        except StillgraspError as error:
            say(f"real time, attempt {attempt} of {attempts}: {error.message}")
            interrupted = error.message
    figures = cycle_figures(recording) if recording.exists() else _figures([], [], 0)
    return {**figures, "interrupted": interrupted}


def run_in_real_time(
    config: RobotConfig, case: GraspCase, recording: Path, say: Callable[[str], None]
) -> dict[str, Any]:
    """Run `stillgrasp run --simulate`, command one grasp over ZeroMQ, stop it; returns the cycle's figures.

    Raises StillgraspError if the daemon does not come up, refuses or fails.
    """
    table_file = Path(config.tables.directory) / f"{table_name(case)}.npz"
    joints = approach_joints(config, MotionTable.load(table_file), case)
    recording.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="stillgrasp-demo-") as directory:
        installation = Path(directory) / "robot.toml"
        endpoint = f"ipc://{directory}/command"
        installation.write_text(
            f'[front]\ncommand_endpoint = "{endpoint}"\nstate_endpoint = "ipc://{directory}/state"\n'
            f'[tables]\ndirectory = "{Path(config.tables.directory).resolve()}"\n',
            encoding="utf-8",
        )
        messages = (Path(directory) / "messages").open("w+", encoding="utf-8")
        daemon = _start(installation, case, recording, messages)
        try:
            say("real time: front, cycle, hand and world run as processes")
            with Client(endpoint, reply_timeout_s=5.0) as client:
                _wait_until_active(client)
                squeezed = command_grasp(client, case, joints, index=index_name(config), compensated=True)
                say(f"real time: squeezed, {_applied(squeezed)}")
        finally:
            _stop(daemon)
            messages.close()
    return cycle_figures(recording)


def cycle_figures(recording: Path) -> dict[str, Any]:
    """Periods, missed ones, processor time and lateness (µs; median and 99th percentile) of a recording."""
    from mcap.reader import make_reader

    cpu_us, late_us, missed = [], [], 0
    with recording.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(topics=["/cycle"]):
            record = msgspec.json.decode(message.data)
            cpu_us.append(record["cpu_us"])
            late_us.append(record["late_us"])
            missed = int(record["missed_periods"])
    return _figures(cpu_us, late_us, missed)


def _figures(cpu_us: list[float], late_us: list[float], missed: int) -> dict[str, Any]:
    return {
        "periods": len(cpu_us),
        "missed": missed,
        "cpu_us": _percentiles(cpu_us),
        "late_us": _percentiles(late_us),
    }


def _percentiles(values: list[float]) -> dict[str, float]:
    middle, high = np.percentile(values, (50, 99)) if values else (0.0, 0.0)
    return {"p50": float(middle), "p99": float(high)}


def _start(installation: Path, case: GraspCase, recording: Path, messages: IO[str]) -> subprocess.Popen[str]:
    x, y, z = case.object_xyz_m
    command = [sys.executable, "-c", "from controller.cli import main; main()", "run", "--simulate", "--json"]
    command += ["--config", str(installation), "--object", case.scene.object]
    command += ["--object-xyz", str(x), str(y), str(z), "--object-yaw", str(case.object_yaw_rad)]
    command += ["--record", str(recording.resolve())]
    daemon = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=messages, text=True)
    assert daemon.stdout is not None
    line = daemon.stdout.readline()  # comes when it runs, or ends when it does not
    try:
        json.loads(line)
    except ValueError as error:
        _stop(daemon)
        messages.seek(0)
        raise DeviceError("daemon", f"did not come up; it said: {messages.read().strip() or 'nothing'}") from error
    return daemon


def _wait_until_active(client: Client) -> None:
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline_s:
        state = client.status()["state"]
        if state and state["arm"]["state"] == "active":
            return
        time.sleep(0.05)
    raise CommandError("arm_not_active", f"The arm was not active within {START_TIMEOUT_S:g} s.")


def _stop(daemon: subprocess.Popen[str]) -> None:
    if daemon.poll() is None:
        daemon.send_signal(signal.SIGTERM)
        try:
            daemon.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            daemon.kill()
            daemon.wait()


def _applied(squeezed: dict[str, Any]) -> str:
    applied = squeezed.get("applied", {})
    return f"{applied.get('mean_excursion_m', 0.0) * 1e3:.2f} mm of winding"
