"""`stillgrasp calibrate zero` as a user types it, on real bytes against a simulated arm."""

from __future__ import annotations

import json
import select
import tempfile
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from controller.calibrate_commands import app
from drivers.clock import MonotonicClock, seconds
from drivers.errors import DeviceError, InputError
from drivers.simulated.seqpacket_can import SeqpacketHub
from drivers.simulated.wam import SimulatedWam
from drivers.wam.bus import open_can
from drivers.wam.frames import position_request
from drivers.wam.parameters import load_wam_parameters

RUN = CliRunner()
HOME = [0.0, -1.995, 0.01, 3.12, 0.0, 0.0, 0.0]


class HomePlant:
    """An arm that was put in its home pose."""

    def joint_position_rad(self) -> NDArray[np.float64]:
        return np.array(HOME)

    def set_joint_torque_Nm(self, torque_Nm: NDArray[np.float64], braking: bool, at_ns: int) -> None:
        assert not torque_Nm.any()


class ServedArm:
    """A simulated arm behind a seqpacket socket, served by a thread."""

    def __init__(self, directory: Path) -> None:
        self.channel = str(directory / "can")
        self.wam = SimulatedWam(HomePlant(), load_wam_parameters(), zeroed=True)
        self._clock = MonotonicClock()
        self._hub = SeqpacketHub(self.channel, [self.wam], self._clock)
        self._ended = threading.Event()
        self._pressed: list[str] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def press(self, button: str) -> None:
        """Before any client is there."""
        self._pressed.append(button)
        while self._pressed:
            self._ended.wait(0.001)

    def _serve(self) -> None:
        while not self._ended.is_set():
            due_ns = self._hub.next_due_ns()
            wait_s = 0.005 if due_ns is None else max(0.0, seconds(due_ns - self._clock.now_ns()))
            select.select(self._hub.filenos(), [], [], min(wait_s, 0.005))
            if self._pressed:
                self._hub.transmit(self.wam.press(self._pressed[0], self._clock.now_ns()), self.wam)
                self._pressed.pop()
            self._hub.step(self._clock.now_ns())

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._hub.close()


@pytest.fixture
def arm() -> Iterator[ServedArm]:
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:  # a short path: sockets have at most 107 bytes
        served = ServedArm(Path(directory))
        yield served
        served.close()


def _zero(arm: ServedArm | None, *arguments: str, answer: str = "") -> Result:
    bus = ["--interface", "seqpacket", "--channel", "nowhere" if arm is None else arm.channel]
    return RUN.invoke(app, ["zero", *bus, *arguments], input=answer)


def test_the_arms_own_file_is_written_and_the_arm_zeroed(arm: ServedArm, tmp_path: Path) -> None:
    """Protects the operator's plan from prompt to file: pose told, Enter awaited, other keys and the old file kept."""
    file = tmp_path / "arm.toml"
    file.write_text("safety_velocity_m_s = 1.2\nhome_rad = [0, 0, 0, 0, 0, 0, 0]\n")
    before = file.read_text()
    home = ["--home", *map(str, HOME)]
    result = _zero(arm, "-o", str(file), *home, "--json", answer="\n")
    assert result.exit_code == 0, result.exception
    assert "place the arm in the pose 0.000 -1.995 0.010 3.120" in result.stderr
    told = json.loads(result.stdout)
    content = tomllib.loads(file.read_text())
    assert content["safety_velocity_m_s"] == 1.2
    assert content["home_rad"] == told["home_rad"] == HOME
    assert content["zero_angle_rad"] == told["zero_angle_rad"]
    assert all(0 <= angle < 6.2832 for angle in content["zero_angle_rad"])
    assert told["absolute_encoders"] == [1, 2, 3, 4, 5, 6, 7]
    assert (tmp_path / "arm.toml.bak").read_text() == before
    assert load_wam_parameters(own=file).home_rad.tolist() == HOME
    assert arm.wam.mode == 1
    assert arm.wam.heard["torque"] == 0


def test_the_installation_names_file_and_bus(arm: ServedArm, tmp_path: Path) -> None:
    """Protects the short form: --config alone says where bus and file are; text shows angles by motor."""
    file, config = tmp_path / "arm.toml", tmp_path / "robot.toml"
    config.write_text(f'[arm]\ninterface = "seqpacket"\nchannel = "{arm.channel}"\nown_file = "{file}"\n')
    result = RUN.invoke(app, ["zero", "--config", str(config), "--yes"])
    assert result.exit_code == 0, result.exception
    assert "home_rad and zero_angle_rad written; the arm is zeroed" in result.stdout
    assert len(tomllib.loads(file.read_text())["zero_angle_rad"]) == 7


@pytest.mark.parametrize(("button", "words"), [("activate", "the arm is active"), ("estop", "in E-stop")])
def test_an_arm_that_is_not_idle_is_refused(arm: ServedArm, tmp_path: Path, button: str, words: str) -> None:
    """Protects hands on an arm that could move, or one without power: nothing is written."""
    arm.press(button)
    result = _zero(arm, "-o", str(tmp_path / "arm.toml"), "--yes")
    assert isinstance(result.exception, DeviceError)
    assert words in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_a_running_daemon_is_noticed(arm: ServedArm, tmp_path: Path) -> None:
    """Protects a robot at work: somebody asks for positions, so nothing is asked, written or changed."""
    clock, ended = MonotonicClock(), threading.Event()

    def cycle() -> None:
        bus = open_can("seqpacket", arm.channel, clock)
        while not ended.wait(0.01):
            bus.send(position_request())
        bus.close()

    daemon = threading.Thread(target=cycle)
    daemon.start()
    try:
        result = _zero(arm, "-o", str(tmp_path / "arm.toml"), "--yes")
    finally:
        ended.set()
        daemon.join()
    assert isinstance(result.exception, DeviceError)
    assert "another program controls the arm" in str(result.exception)
    assert list(tmp_path.iterdir()) == []


def test_nobody_at_the_keyboard_writes_nothing(arm: ServedArm, tmp_path: Path) -> None:
    """Protects against a script that forgot --yes: the end of the input is no Enter."""
    result = _zero(arm, "-o", str(tmp_path / "arm.toml"))
    assert isinstance(result.exception, InputError)
    assert "nobody pressed Enter" in str(result.exception)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "not said where"),
        (["-o", "{}/arm.toml", "--home", "0", "0", "0", "nan", "0", "0", "0"], "not a pose"),
        (["-o", "{}/arm.toml", "--home", "0", "0", "0", "99", "0", "0", "0"], "not a pose"),
        (["-o", "{}/bad.toml"], "bad.toml: home"),
        (["-o", "{}/arm.toml", "--config", "{}/none.toml"], "none.toml"),
        (["-o", "{}/arm.toml"], "cannot be opened"),
    ],
)
def test_bad_input_is_one_clear_error(tmp_path: Path, arguments: list[str], words: str) -> None:
    """Protects against wrong files, poses and buses: each is named before anything is asked of the operator."""
    (tmp_path / "bad.toml").write_text("home = 3\n")
    result = _zero(None, *(argument.format(tmp_path) for argument in arguments), "--yes")
    assert result.exception is not None
    assert words in str(result.exception)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.toml"]
