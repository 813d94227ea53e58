"""`stillgrasp calibrate gravity` as a user types it, over ZeroMQ, against a small daemon whose arm jumps to its goal.

Its cycles are counted fifty at a time, so that minutes of measuring pass in a second.
"""

from __future__ import annotations

import json
import re
import tempfile
import threading
import tomllib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import controller.service.calibrate
from controller.calibrate_commands import app
from controller.config import RobotConfig, load_config
from controller.cycle.arm_model import ArmModel
from controller.service.answers import encode_event, encode_reply, error_told
from controller.service.assembly import arm_model, arm_parameters, configured_hand
from controller.service.command_socket import CommandSocket
from controller.service.commands import ArmMoveJoints, decode_request
from controller.service.telemetry import StatePublisher
from drivers.clock import MonotonicClock
from drivers.errors import CommandError, DeviceError, InputError
from drivers.wam.parameters import load_wam_parameters

RUN = CliRunner()
CYCLES_A_SAMPLE = 50
COULOMB = np.array([1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05])
OTHER_MU = ArmModel().gravity_mu_kg_m * 1.07 + 0.02
OTHER_ARM = ArmModel(parameters=replace(load_wam_parameters(), gravity_mu_kg_m=OTHER_MU))
OWN = "safety_velocity_m_s = 1.2\n"
FASTEST = ("--sampling-s", "2.2", "--yes")


class SmallDaemon:
    """Serves commands and state in a thread. The arm weighs what `OTHER_MU` and the configured hand say.

    trouble  "" or "gripping", "fault" and "gone" at the fifth move, "blocked" short of pose 3, "cable" in pose 3
    """

    def __init__(self, config: RobotConfig, trouble: str = "") -> None:
        parameters = arm_parameters(config)
        hand = configured_hand(config)
        self._bare = ArmModel(parameters=parameters)
        self._with_hand = arm_model(config, hand)
        self._trouble = trouble
        self._port = CommandSocket(config.front.command_endpoint)
        self._publisher = StatePublisher(config.front.state_endpoint)
        self._clock = MonotonicClock()
        self._ended = threading.Event()
        self._moves = 0
        self._cycle = 0
        self._fault = ""
        self._joint_rad = np.zeros(7)
        self._direction = np.zeros(7)
        self.commands: list[str] = []
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _serve(self) -> None:
        with closing(self._port), closing(self._publisher):
            self._run()

    def _run(self) -> None:
        while not self._ended.is_set():
            while (received := self._port.receive()) is not None:
                self._answer(*received)
            if self._trouble == "gone" and self._moves >= 5:
                return
            self._cycle += CYCLES_A_SAMPLE
            self._publisher.publish(self._state(), 0.0)
            self._clock.wait_readable(self._port, self._clock.now_ns() + 500_000)

    def _answer(self, address: tuple[bytes, ...], data: bytes) -> None:
        request = decode_request(data)
        command = request.command
        self.commands.append(command.name)
        result = {"state": self._state()} if command.name == "status" else {}
        self._port.send(address, encode_reply(request.seq, result))
        if not isinstance(command, ArmMoveJoints):
            return
        self._moves += 1
        if self._trouble == "fault" and self._moves == 5:
            self._fault = "collision"
            told = error_told(CommandError("collision", "Something is in the way."))
            self._port.send(address, encode_event("failed", request.seq, error=told))
            return
        goal = np.array(command.joint_rad)
        self._direction = np.sign(goal - self._joint_rad)
        self._joint_rad = goal + (0.05 if self._trouble == "blocked" and self._moves == 10 else 0.0)
        self._port.send(address, encode_event("completed", request.seq))

    def _state(self) -> dict[str, Any]:
        q = self._joint_rad
        torque = OTHER_ARM.gravity(q) + self._with_hand.gravity(q) - self._bare.gravity(q)
        torque = torque + self._direction * COULOMB
        if self._trouble == "cable" and self._moves in (9, 10, 11, 12):
            torque[1] += 7.0
        gripping = self._trouble == "gripping"
        return {
            "arm": {"state": "active", "joint_rad": q, "joint_torque_Nm": torque, "else": 1},
            "hand": {"state": "gripping" if gripping else "open"},
            "grasp": {"phase": "holding" if gripping else "none", "fault": self._fault},
            "cycle": {"number": self._cycle},
        }


@pytest.fixture
def place() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:  # a short path: sockets have at most 107 bytes
        file = Path(directory) / "robot.toml"
        file.write_text(
            f'[front]\ncommand_endpoint = "ipc://{directory}/command"\nstate_endpoint = "ipc://{directory}/state"\n'
            f'[arm]\nown_file = "{directory}/arm.toml"\n'
        )
        (Path(directory) / "arm.toml").write_text(OWN)
        yield Path(directory)


def calibrated(place: Path, *arguments: str, trouble: str = "") -> tuple[Result, list[str]]:
    """Run the command against a small daemon; the result, and the commands that came."""
    config = place / "robot.toml"
    with closing(SmallDaemon(load_config(config), trouble)) as daemon:
        result = RUN.invoke(app, ["gravity", "--config", str(config), *FASTEST, *arguments])
    return result, daemon.commands


def test_the_arms_own_file_is_written_and_makes_the_model_right(place: Path) -> None:
    """Protects the way from plan to file: other keys and the old file are kept, friction has cancelled, the hand's
    weight is not counted twice, and the arm model that reads the file holds this arm."""
    own = place / "arm.toml"
    result, commands = calibrated(place, "--json")
    assert result.exit_code == 0, result.exception
    told = json.loads(result.stdout)
    content = tomllib.loads(own.read_text())
    assert content["safety_velocity_m_s"] == 1.2
    assert (place / "arm.toml.bak").read_text() == OWN
    np.testing.assert_allclose(content["gravity_mu_kg_m"], told["gravity_mu_kg_m"], atol=1e-8)
    assert told["accepted"] is True
    np.testing.assert_allclose(told["friction_Nm"], COULOMB, rtol=1e-6)
    assert max(told["rms_Nm"]) < 1e-3 < 0.1 < max(told["rms_nominal_Nm"])
    assert commands == ["status", *["arm.move_joints"] * 36]
    assert "pose 9 of 9, from below" in result.stderr
    model = ArmModel(parameters=load_wam_parameters(own=own))
    for q in np.random.default_rng(2).uniform(-1.5, 1.5, (20, 7)):
        np.testing.assert_allclose(model.gravity(q), OTHER_ARM.gravity(q), rtol=0, atol=1e-3)


def test_the_table_of_residuals_is_printed(place: Path) -> None:
    """Protects the reader: what masses and fit leave, joint by joint, and a line for robot.toml on standard error."""
    result, _ = calibrated(place)
    assert result.exit_code == 0, result.exception
    lines = result.stdout.splitlines()
    assert [line[:22].strip() for line in lines[:4]] == [
        "joint, N·m",
        "left by the masses",
        "left by the fit",
        "accepted",
    ]
    assert "gravity_mu_kg_m written" in lines[-1]
    assert "coulomb_Nm = [1.500, 1.500, 0.800, 0.800, 0.200, 0.100, 0.050]" in result.stderr


def test_without_a_hand_nothing_is_taken_off(place: Path) -> None:
    """Protects the bare arm: what hung on the flange is then counted as the arm's own."""
    result, _ = calibrated(place, "--without-hand", "--json")
    mu = np.array(json.loads(result.stdout)["gravity_mu_kg_m"])
    assert np.linalg.norm(mu[6] - OTHER_MU[6]) > 0.02


@pytest.mark.parametrize(
    ("trouble", "kind", "words"),
    [
        ("gripping", CommandError, "hand is gripping"),
        ("fault", CommandError, "collision|in the way"),
        ("gone", (DeviceError, CommandError), "sent no state|did not answer|No daemon listens"),
        ("blocked", InputError, "pose 3 from above: joint 1 had 0.05 rad away"),
        ("cable", InputError, "residual is left in joint 2"),
    ],
)
def test_trouble_writes_nothing(
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    trouble: str,
    kind: type[Exception] | tuple[type[Exception], ...],
    words: str,
) -> None:
    """Protects the arm's file from a measurement that was not one, and the operator from guessing what it was."""
    monkeypatch.setattr(controller.service.calibrate, "LONGEST_SILENCE_S", 0.3)
    own = place / "arm.toml"
    result, commands = calibrated(place, trouble=trouble)
    assert isinstance(result.exception, kind)
    assert re.search(words, str(result.exception))
    assert own.read_text() == OWN
    assert not (place / "arm.toml.bak").exists()
    if trouble == "gripping":
        assert commands == ["status"]
    if trouble == "fault":
        assert commands[-1] == "arm.hold"


def test_a_dry_run_needs_neither_daemon_nor_file() -> None:
    """Protects a first look: the plan is printed, with what was changed for this arm's limits, and nothing moves."""
    result = RUN.invoke(app, ["gravity", "--dry-run", "--json"])
    assert result.exit_code == 0, result.exception
    told = json.loads(result.stdout)
    assert len(told["poses_rad"]) == 9
    assert told["notes"] == []
    text = RUN.invoke(app, ["gravity", "--dry-run"]).stdout
    assert text.splitlines()[4].split()[2:] == ["-0.7854", "1.5708", "1.5708", "1.5708", "0.0000", "1.5000", "0.0000"]


def test_limits_of_the_installation_move_or_refuse_poses(place: Path) -> None:
    """Protects narrow stops: joint 6 at ±1.5 rad moves two poses, which is told; half the range is refused."""
    upper = "[2.6, 2.0, 2.8, 3.1, 1.24, {}, 3.0]"
    config = place / "narrow.toml"
    for limit in (1.5, 0.8):
        config.write_text(
            f"[arm.limits]\nlower_rad = [-2.6, -2, -2.8, -0.9, -4.76, -1.5, -3]\nupper_rad = {upper.format(limit)}\n"
        )
        result = RUN.invoke(app, ["gravity", "--dry-run", "--config", str(config)])
        if limit == 1.5:
            assert "pose 4: joint 6 at 1.440 instead of 1.500 rad" in result.stderr
        else:
            assert isinstance(result.exception, InputError)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--yes"], "not said where"),
        (["-o", "{}/arm.toml"], "nobody pressed Enter"),
        (["-o", "{}/robot.toml", "--yes"], "robot.toml: "),
        (["-o", "{}/robot.toml/arm.toml", "--yes"], "cannot be written there"),
        (["-o", "{}/arm.toml", "--yes", "--config", "{}/robot.toml"], "No daemon listens"),
    ],
)
def test_what_is_missing_is_said(place: Path, arguments: list[str], words: str) -> None:
    """Protects a hasty user: no file, a wrong one, no operator, no daemon: each has its answer, and nothing moves."""
    result = RUN.invoke(app, ["gravity", *(argument.format(place) for argument in arguments)])
    assert words in str(result.exception)
    assert (place / "arm.toml").read_text() == OWN
    assert len(list(place.iterdir())) == 2
