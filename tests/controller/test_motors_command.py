"""`stillgrasp calibrate motors` as a user types it, on real bytes against simulated motors behind a pty."""

from __future__ import annotations

import io
import json
import sys
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from calibration.motor_setup import STEPS
from controller.cli import main
from controller.config import load_config
from controller.service.assembly import motor_drives, tendon_motors
from drivers.clock import MonotonicClock
from drivers.dynamixel import discovery
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel
from drivers.dynamixel.load_law import LoadLaw, nominal_law
from drivers.errors import ConfigurationError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.serial_lines import PtyServer


class HandTurnedSpools:
    """Spools that stand where the operator put them."""

    def __init__(self) -> None:
        self.angle_rad = [0.0, 0.0]

    def shaft_angle_rad(self, motor: int) -> float:
        return self.angle_rad[motor]

    def shaft_velocity_rad_s(self, motor: int) -> float:
        return 0.0

    def set_shaft_torque_Nm(self, motor: int, torque: float) -> None:
        pass


class ServedMotors:
    """Motor 5 winds the right finger clockwise, motor 4 the left one the other way; zeros at 3600 and 400 ticks."""

    def __init__(self, model: MotorModel = XM430_W350) -> None:
        self.spools = HandTurnedSpools()
        mounted = (SimulatedMotorSettings(5, 3600, -1, model), SimulatedMotorSettings(4, 400, 1, model))
        self.device = SimulatedMotors(self.spools, mounted)
        self._clock = MonotonicClock()
        self._server = PtyServer(self.device, self._clock)
        self.port = self._server.port
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def torque(self) -> list[int]:
        return [motor.value("torque_enable") for motor in self.device.motors]

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        while not self._ended.wait(0.0003):
            self.device.control(self._clock.now_ns(), 0.001)
            self._server.step()


class Operator:
    """Does what he is asked for on standard error, then presses Enter."""

    def __init__(self, motors: ServedMotors, capsys: pytest.CaptureFixture[str]) -> None:
        self._motors, self._capsys = motors, capsys
        self.asked: list[str] = []

    def readline(self) -> str:
        self.asked.append(self._capsys.readouterr().err.strip().splitlines()[-1])
        right, left = 0.0, 0.0
        if "close the right" in self.asked[-1]:
            right = 4.2
        elif "close the left" in self.asked[-1]:
            left = 4.5
        self._motors.spools.angle_rad = [right, left]
        _settled()
        return "\n"


def _settled() -> None:
    """The motors measure once a turn of their thread."""
    threading.Event().wait(0.02)


@pytest.fixture
def served() -> Iterator[ServedMotors]:
    motors = ServedMotors()
    yield motors
    motors.close()


def calibrate(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["stillgrasp", "calibrate", "motors", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_prompts_lead_to_a_file_that_the_daemon_reads(
    served: ServedMotors, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the prompts alone: sides, signs, zeros and travels come out, other keys stay, robot.toml is overruled."""
    operator = Operator(served, capsys)
    monkeypatch.setattr(sys, "stdin", operator)
    file, robot = tmp_path / "motors.toml", tmp_path / "robot.toml"
    robot.write_text(f'[tendons]\nport = "{served.port}"\nown_file = "{file}"\n[tendons.right]\nposition_gain = 700\n')
    assert calibrate(monkeypatch, "--config", str(robot), "--ids", "4", "5", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["model"], told["right"]["motor_id"], told["left"]["motor_id"]) == ("XM430-W350", 5, 4)
    assert [step.rstrip(",") in asked for step, asked in zip(STEPS, operator.asked, strict=True)] == [True] * 4
    right, left = tendon_motors(load_config(robot))
    assert (right.motor_id, right.tightening_sign, right.zero_ticks, right.position_gain) == (5, -1, 3600, 700)
    assert (left.motor_id, left.tightening_sign, left.zero_ticks, left.model) == (4, 1, 400, "XM430-W350")
    assert right.travel_m == pytest.approx((-0.005, 4.2 * 0.0105), abs=1e-4)
    assert left.travel_m == pytest.approx((-0.005, 4.5 * 0.0105), abs=1e-4)
    assert tomllib.loads(file.read_text())["right_tightening_sign"] == -1
    assert served.torque() == [0, 0]


def test_motors_that_hold_are_let_go_only_after_asking(
    served: ServedMotors, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The operator may have an object in the hand: nobody at the keyboard means that it stays there."""
    for motor in served.device.motors:
        motor.put("torque_enable", 1)
    words = ["--port", served.port, "--ids", "5", "4", "-o", str(tmp_path / "motors.toml")]
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert calibrate(monkeypatch, *words) != 0
    error = capsys.readouterr().err
    assert "motor 5 and tendon motor 4 will let go: take what" in error
    assert "nobody pressed Enter" in error
    assert served.torque() == [1, 1]
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(sys, "stdin", Operator(served, capsys))
    assert calibrate(monkeypatch, *words, "--yes") == 0
    assert served.torque() == [0, 0]
    assert "motors.toml: written" in capsys.readouterr().out


def test_scan_lists_what_is_there(
    served: ServedMotors, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ids, model and firmware, by text and as JSON; nothing is written to a motor."""
    monkeypatch.setattr(discovery, "reply_margin_s", lambda latency_ms: 0.05)
    words = ["--scan", "--port", served.port, "--baud", "1000000", "--highest-id", "6"]
    assert calibrate(monkeypatch, *words, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert [(motor["motor_id"], motor["model_name"], motor["baud"]) for motor in told["motors"]] == [
        (4, "XM430-W350", 1_000_000),
        (5, "XM430-W350", 1_000_000),
    ]
    assert told["latency_timer_ms"] is None
    assert not [packet for packet in served.device.heard if packet[7] not in (0x01, 0x02)]


def test_an_empty_line_is_said_to_be_empty(
    served: ServedMotors, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Silence has causes that a user can look for."""
    words = ["--scan", "--port", served.port, "--baud", "57600", "--highest-id", "1"]
    assert calibrate(monkeypatch, *words) == 1
    assert "no motor answered. Check the supply" in capsys.readouterr().err


def test_reboot_clears_a_hardware_error(
    served: ServedMotors, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the daemon's fault advises must work as it is written there."""
    served.device.trip(0, 0x20)
    assert served.device.motors[0].value("hardware_error_status") == 0x20
    assert calibrate(monkeypatch, "--reboot", "5", "--port", served.port, "--yes") == 0
    assert "motor 5, a XM430-W350: no hardware error any more" in capsys.readouterr().out
    assert served.device.motors[0].value("hardware_error_status") == 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--scan", "--reboot", "3"], "--scan only looks"),
        ([], "it is not said where"),
        (["-o", "{}/bad.toml"], "bad.toml: zero = 3"),
        (["-o", "{}/signs.toml"], "right_tightening_sign = 2 is not accepted; expected one of"),
        (["-o", "{}/same.toml"], "left_id = 1 is not accepted; expected another id than right_id = 1"),
        (["-o", "{}/motors.toml", "--ids", "3", "3"], "are one motor"),
        (["-o", "{}/motors.toml", "--ids", "1", "2"], "tendon motors 1 and 2: no reply"),
        (["-o", "{}/motors.toml", "--port", "{}/nothing"], "no such device"),
    ],
)
def test_bad_input_is_one_clear_line(
    served: ServedMotors,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    told: str,
) -> None:
    """What is wrong is told before anything is asked of the operator, and nothing is written."""
    (tmp_path / "bad.toml").write_text("zero = 3\n")
    (tmp_path / "signs.toml").write_text("right_tightening_sign = 2\n")
    (tmp_path / "same.toml").write_text("right_id = 1\nleft_id = 1\n")
    before = sorted(tmp_path.iterdir())
    port = [] if "--port" in words else ["--port", served.port]
    assert calibrate(monkeypatch, *port, *(word.format(tmp_path) for word in words)) != 0
    error = capsys.readouterr().err
    assert told in error
    assert len(error.splitlines()) == 1
    assert sorted(tmp_path.iterdir()) == before


def test_a_hand_without_its_file_does_not_start(tmp_path: Path) -> None:
    """robot.toml names a file that was never measured: other commands go on, but no motor is wound on guesses."""
    robot = tmp_path / "robot.toml"
    robot.write_text(f'[tendons]\nown_file = "{tmp_path}/motors.toml"\n')
    config = load_config(robot)
    with pytest.raises(ConfigurationError, match=r"motors\.toml: file = 'No such file'"):
        tendon_motors(config)


def test_a_wrong_key_of_the_own_file_is_named(tmp_path: Path) -> None:
    """The file, the key, the value and what is accepted; not robot.toml, where the user would look in vain."""
    robot, file = tmp_path / "robot.toml", tmp_path / "motors.toml"
    robot.write_text(f'[tendons]\nown_file = "{file}"\n')
    file.write_text("right_travel_m = [0.04, 0.01]\n")
    with pytest.raises(ConfigurationError, match=r"motors.toml: right_travel_m = .* a lower and then an upper"):
        load_config(robot)
    file.write_text('model = "AX-12"\n')
    with pytest.raises(ConfigurationError, match=r"motors.toml: model = 'AX-12'.*expected one of RX-28"):
        load_config(robot)


def test_the_configured_model_decides_the_load_law(tmp_path: Path) -> None:
    """An MX-28 tells a part of its output: its law is in that unit, by its data sheet or by what robot.toml says."""
    robot = tmp_path / "robot.toml"
    robot.write_text('[tendons]\nmodel = "MX-28"\n[tendons.left]\nstall_torque_12V_Nm = 2.0\nfriction_load = 0.1\n')
    right, left = tendon_motors(load_config(robot))
    assert right.load_law == nominal_law(MX_28, 0.0105)
    assert left.load_law == nominal_law(MX_28, 0.0105, stall_torque_Nm=2.0, friction_load=0.1)
    assert motor_drives(load_config(robot))[0].friction_N == pytest.approx(right.load_law.friction_tension_N)
    right, _ = tendon_motors(load_config())
    assert right.load_law == LoadLaw(1.79, 0.13, 0.0105)
