"""`stillgrasp simulate`: each simulated device alone, talked to by programs that know nothing of this project."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import can
import dynamixel_sdk
import pytest

TIMEOUT_S = 60.0
COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()", "simulate"]
MODE_REQUEST = can.Message(arbitration_id=0x00A, data=[8], is_extended_id=False)
"""Host 0 asks node 10 for property 8, MODE (WAM reference 2, 4.1)."""
POSITION_REQUEST = can.Message(arbitration_id=0x404, data=[48], is_extended_id=False)


class Simulation:
    """One `stillgrasp simulate`."""

    def __init__(self, directory: Path, *arguments: str) -> None:
        environment = {**os.environ, "XDG_RUNTIME_DIR": str(directory), "OMP_NUM_THREADS": "1"}
        environment.pop("RUNTIME_DIRECTORY", None)
        self.told = tempfile.TemporaryFile(mode="w+")  # noqa: SIM115 - closed by close()
        self.process = subprocess.Popen(
            [*COMMAND, *arguments, "--json"],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.told,
            text=True,
        )
        assert self.process.stdout is not None
        assert select.select([self.process.stdout], [], [], TIMEOUT_S)[0]
        self.bus: dict[str, Any] = json.loads(self.process.stdout.readline() or "null")

    def press(self, word: str) -> None:
        assert self.process.stdin is not None
        print(word, file=self.process.stdin, flush=True)

    def messages(self) -> str:
        self.told.seek(0)
        return self.told.read()

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        for stream in (self.process.stdin, self.process.stdout, self.told):
            stream.close()


@pytest.fixture
def directory() -> Iterator[Path]:
    """A short path: sockets have at most 107 bytes for theirs."""
    with tempfile.TemporaryDirectory(prefix="sg-") as path:
        yield Path(path)


def answer(bus: can.BusABC, request: can.Message, identifier: int) -> can.Message:
    """The next frame `identifier` after `request`."""
    for _ in range(20):
        bus.send(request)
        while (message := bus.recv(1.0)) is not None:
            if message.arbitration_id == identifier:
                return message
    raise AssertionError(f"no {identifier:#x}")


def mode(bus: can.BusABC) -> int:
    """MODE of the safety puck: 0 E-stop, 1 idle, 2 active; its reply goes from node 10 to group 6."""
    return answer(bus, MODE_REQUEST, 0x546).data[2]


def test_the_arm_is_a_can_bus_to_python_can(directory: Path) -> None:
    """A plain python-can client finds seven motors and a safety puck that only the pendant activates."""
    with closing(Simulation(directory, "wam")) as simulation:
        assert set(simulation.bus) == {"interface", "channel"}
        with can.Bus(**simulation.bus) as bus:
            assert mode(bus) == 1
            heard: set[int] = set()
            for _ in range(20):
                bus.send(POSITION_REQUEST)
                while len(heard) < 7 and (message := bus.recv(1.0)) is not None:
                    heard.add(message.arbitration_id)
            assert {0x403 | node << 5 for node in range(1, 8)} <= heard
            simulation.press("jump")
            simulation.press("estop")
            assert _becomes(lambda: mode(bus), 0)
            simulation.press("activate")
            simulation.press("release\nidle")
            assert _becomes(lambda: mode(bus), 1)
            assert simulation.process.stdin is not None
            simulation.process.stdin.close()  # the end of the pendant's words is not the arm's
            assert mode(bus) == 1
        assert "'jump' is unknown; expected one of idle, activate, estop, release" in simulation.messages()
        simulation.process.send_signal(signal.SIGINT)
        assert simulation.process.wait(TIMEOUT_S) == 0
        assert list((directory / "stillgrasp").iterdir()) == []


def test_an_arm_after_power_up_at_a_named_channel(directory: Path) -> None:
    """Asleep and without positions, as start-up code has to find it; ended by SIGTERM, the socket is gone."""
    channel = directory / "arm"
    with closing(Simulation(directory, "wam", "--channel", str(channel), "--asleep", "--not-zeroed")) as simulation:
        assert simulation.bus == {"interface": "seqpacket", "channel": str(channel)}
        with can.Bus(**simulation.bus) as bus:
            stat = answer(bus, can.Message(arbitration_id=0x001, data=[5], is_extended_id=False), 0x426)
            assert stat.data[2] == 0  # in the boot monitor (WAM reference 4.2)
        simulation.process.send_signal(signal.SIGTERM)
        assert simulation.process.wait(TIMEOUT_S) == 0
        assert not channel.exists()


def test_the_tendon_motors_are_dynamixels_to_the_vendors_sdk(directory: Path) -> None:
    """ROBOTIS's own port and packet handlers find two XM430 and turn one against its spring."""
    with closing(Simulation(directory, "dynamixel", "--ids", "3", "7")) as simulation:
        port = dynamixel_sdk.PortHandler(simulation.bus["port"])
        assert port.openPort()
        try:
            motors = dynamixel_sdk.PacketHandler(2.0)
            for motor in (3, 7):
                # the SDK waits for 34 ms of wall time, which a shared machine may take to answer
                assert _becomes(partial(motors.ping, port, motor), (1020, 0, 0))
            assert _becomes(lambda: motors.write1ByteTxRx(port, 3, 64, 1), (0, 0))
            assert _becomes(lambda: motors.write4ByteTxRx(port, 3, 116, 300), (0, 0))
            assert _becomes(lambda: motors.read4ByteTxRx(port, 3, 132)[0] > 200, True)
        finally:
            port.closePort()
        simulation.process.send_signal(signal.SIGTERM)
        assert simulation.process.wait(TIMEOUT_S) == 0


def _becomes(read: Callable[[], object], value: object) -> bool:
    """Whether it reads `value` within some hundred askings; each takes the device's own time."""
    return any(read() == value or select.select([], [], [], 0.02)[0] for _ in range(500))
