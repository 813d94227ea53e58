"""The driver over real CAN sockets: the seqpacket bus always, SocketCAN where the kernel has vcan.

The simulated arm sits on the same bus as a client of its own, so that both transports carry every frame.
"""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest

from drivers.clock import MonotonicClock, nanoseconds
from drivers.simulated.can_wire import Frame, is_classic_frame
from drivers.simulated.seqpacket_can import SeqpacketHub
from drivers.simulated.simple_arm import SimpleArm
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm
from drivers.wam.bus import ask_property, open_can
from drivers.wam.frames import torque_frame
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.safety_puck import ArmMode

VCAN = "vcan9"
PATIENCE_S = 5.0
PARAMETERS = load_wam_parameters()


class ArmOnBus:
    """A simulated arm that answers as a client of a python-can bus, in a thread."""

    def __init__(self, bus: can.BusABC) -> None:
        self.wam = SimulatedWam(SimpleArm(PARAMETERS, PARAMETERS.home_rad), PARAMETERS, zeroed=True)
        self._bus = bus
        self._clock = MonotonicClock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._answer)
        self._thread.start()

    def _answer(self) -> None:
        while not self._ending.is_set():
            message = self._bus.recv(0.02)
            pending = [] if message is None or not is_classic_frame(message) else [Frame.of(message)]
            while pending:
                for _, answer in self.wam.receive(pending.pop(0), self._clock.now_ns()):
                    self._bus.send(answer.message(), timeout=PATIENCE_S)
                    pending.append(answer)

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._bus.shutdown()


def _make_vcan() -> str:
    """Have a virtual CAN interface; why not, if that is not possible."""
    for words in (("add", "dev", VCAN, "type", "vcan"), ("set", "up", VCAN)):
        try:
            made = subprocess.run(["ip", "link", *words], capture_output=True, text=True, check=False)
        except OSError as error:
            return f"there is no 'ip' command ({error})"
        if made.returncode:
            return made.stderr.strip() or f"ip link {' '.join(words)} failed"
    return ""


@contextmanager
def _vcan() -> Iterator[str]:
    if reason := _make_vcan():
        pytest.skip(f"this kernel has no CAN: {reason}")
    try:
        yield VCAN
    finally:
        subprocess.run(["ip", "link", "del", VCAN], check=False)


@contextmanager
def _seqpacket(path: Path) -> Iterator[str]:
    """A hub without devices, carried by a thread."""
    hub, ending = SeqpacketHub(path, [], MonotonicClock()), threading.Event()

    def carry() -> None:
        while not ending.wait(0.0002):
            hub.step()

    carrier = threading.Thread(target=carry)
    carrier.start()
    try:
        yield str(path)
    finally:
        ending.set()
        carrier.join()
        hub.close()


@pytest.fixture(params=["seqpacket", "socketcan"])
def transport(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, str, ArmOnBus]]:
    """Interface and channel of a bus with an arm on it."""
    with _vcan() if request.param == "socketcan" else _seqpacket(tmp_path / "can") as channel:
        arm = ArmOnBus(can.Bus(interface=request.param, channel=channel))
        yield request.param, channel, arm
        arm.close()


def test_questions_are_answered(transport: tuple[str, str, ArmOnBus]) -> None:
    """Protects the way through real sockets: each puck's IPNM arrives, filtered, on a bus that the driver opened."""
    interface, channel, _ = transport
    clock = MonotonicClock()
    bus = open_can(interface, channel, clock)
    try:
        asked = [ask_property(bus, node, 86, clock.now_ns() + nanoseconds(PATIENCE_S)) for node in range(1, 8)]
    finally:
        bus.close()
    assert asked == [2700, 2700, 2700, 2700, 6500, 6500, 17474]


def test_the_driver_starts_reads_and_writes(transport: tuple[str, str, ArmOnBus]) -> None:
    """Protects start-up and cycle over real sockets: the arm is found, its home is read, torque frames are heard."""
    interface, channel, simulated = transport
    clock = MonotonicClock()
    bus = open_can(interface, channel, clock)
    try:
        arm = Arm(bus, clock, PARAMETERS)
        arm.start()
        assert arm.mode is ArmMode.IDLE
        arm.request_positions()
        sample = arm.collect_positions(clock.now_ns() + nanoseconds(PATIENCE_S))
        bus.send(torque_frame(1, [0, 0, 0, 0]))
        assert ask_property(bus, 10, 8, clock.now_ns() + nanoseconds(PATIENCE_S)) == 1
    finally:
        bus.close()
    np.testing.assert_allclose(sample.joint_rad, PARAMETERS.home_rad, atol=2e-4)
    assert simulated.wam.heard["torque"] == 1
