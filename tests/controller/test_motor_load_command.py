"""`stillgrasp calibrate motor-load` as a user types it: readings from a file, the plan, and bad input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from calibration.motor_file import read_motor_file
from calibration.motor_load_readings import MotorReadings, write_readings
from controller.calibrate_commands import app
from controller.config import load_config
from controller.service.assembly import tendon_motors
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel
from drivers.dynamixel.load_law import published_law
from drivers.errors import StillgraspError
from tests.calibration.test_motor_load import readings_of

RUN = CliRunner()


def kept(tmp_path: Path, model: MotorModel = XM430_W350, noise: float = 0.002, slip: bool = False) -> Path:
    """A file of readings of both motors; with a slip, the right one's line 7 is off by a factor."""
    lines = tmp_path / "kept.csv"
    own = readings_of(published_law(model, 0.0105), noise=noise)
    write_readings(
        lines, [MotorReadings("right", model.name, 45, tuple(own)), MotorReadings("left", model.name, 45, tuple(own))]
    )
    if slip:
        text = lines.read_text().splitlines()
        text[6] = text[6].replace("winding,9.8", "winding,39.8")
        lines.write_text("\n".join(text))
    return lines


def robot(tmp_path: Path, model: str = "XM430-W350") -> Path:
    file = tmp_path / "robot.toml"
    file.write_text(f'[tendons]\nmodel = "{model}"\nown_file = "{tmp_path}/motors.toml"\n')
    (tmp_path / "motors.toml").write_text(f'model = "{model}"\nright_zero_ticks = 7\n')
    return file


@pytest.mark.parametrize("model", [XM430_W350, MX_28], ids=lambda model: model.name)
def test_readings_become_the_drivers_law(tmp_path: Path, model: MotorModel) -> None:
    """From a file to what the hand starts with; other keys stay, the plot is there, the table tells both motors."""
    config = robot(tmp_path, model.name)
    told = RUN.invoke(app, ["motor-load", "--config", str(config), "--readings", str(kept(tmp_path, model)), "--json"])
    assert told.exit_code == 0, told.output
    result = json.loads(told.stdout)
    assert result["accepted"]
    assert result["right"]["rms_N"] == pytest.approx(0.3, abs=0.3)
    assert Path(result["plot"]).read_bytes().startswith(b"\x89PNG")
    right, left = tendon_motors(load_config(config))
    for motor in (right, left):
        assert motor.calibrated is not None
        assert motor.calibrated.model == model.name
        true = published_law(model, 0.0105)
        assert motor.load_law.torque_per_effort_Nm == pytest.approx(true.torque_per_effort_Nm, rel=0.02)
        assert motor.load_law.friction_effort == pytest.approx(true.friction_effort, rel=0.05)
        assert motor.load_law.slope_uncertainty < 0.03
    assert right.zero_ticks == 7


def test_a_slip_writes_nothing_and_ends_with_1(tmp_path: Path) -> None:
    """The line is named; the motors' own file stands as it was; the plot is kept to look at."""
    config = robot(tmp_path)
    before = (tmp_path / "motors.toml").read_bytes()
    told = RUN.invoke(
        app, ["motor-load", "--config", str(config), "--readings", str(kept(tmp_path, slip=True)), "--motor", "right"]
    )
    assert told.exit_code == 1
    assert "line 7 is off by -30" in told.stderr
    assert "not accepted: nothing was written" in told.stdout
    assert (tmp_path / "motors.toml").read_bytes() == before
    assert (tmp_path / "motors.load.png").exists()


def test_what_is_accepted_can_be_said(tmp_path: Path) -> None:
    """The same readings, another threshold: 1, then 0; --motor left leaves the right one alone."""
    config = robot(tmp_path)
    words = ["motor-load", "--config", str(config), "--readings", str(kept(tmp_path, noise=0.01)), "--motor", "left"]
    assert RUN.invoke(app, [*words, "--accept-rms", "0.005"]).exit_code == 1
    assert RUN.invoke(app, [*words, "--accept-rms", "0.2", "--accept-max", "0.5"]).exit_code == 0
    own = read_motor_file(tmp_path / "motors.toml")
    assert own.left_calibrated is not None
    assert own.right_calibrated is None


def test_the_plan_is_told_without_a_motor() -> None:
    """--dry-run opens nothing: weights, way, speed and cap, for the configured model."""
    told = RUN.invoke(app, ["motor-load", "--dry-run", "--weight", "1", "--weight", "2", "--weight", "4", "--up-only"])
    assert told.exit_code == 0
    assert "right motor, a XM430-W350: on the cord 1 kg, 2 kg, 4 kg" in told.stdout
    told = RUN.invoke(app, ["motor-load", "--dry-run", "--motor", "left", "--json"])
    assert json.loads(told.stdout)["left"]["steps_N"][0] == pytest.approx(4.903)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "it is not said where the calibration shall be written"),
        (["-o", "/dev/null/motors.toml"], "cannot be written there"),
        (["-o", "{}/bad.toml"], "bad.toml: colour = 3"),
        (["-o", "{}/new.toml", "--readings", "{}/none.csv"], "a readable CSV file"),
        (["-o", "{}/new.toml", "--readings", "{}/kept.csv"], "are of a MX-28; expected a XM430-W350"),
        (["-o", "{}/new.toml", "--readings", "{}/right.csv", "--motor", "left"], "no readings of the left motor"),
        (["-o", "{}/new.toml", "--readings", "{}/few.csv"], "right motor: 1 different tensions while winding"),
        (["-o", "{}/new.toml", "--port", "{}/nothing"], "no such device"),
        (["--dry-run", "--weight", "90"], "is not to be loaded with"),
        (["--dry-run", "--stroke-mm", "80"], "a stroke of 80.0 mm"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, words: list[str], told: str) -> None:
    """Told with value and cure, before anything is asked of the operator, and no file is made."""
    (tmp_path / "bad.toml").write_text("colour = 3\n")
    kept(tmp_path, MX_28)
    head, *lines = (tmp_path / "kept.csv").read_text().splitlines()
    own = [line.replace("MX-28", "XM430-W350") for line in lines if line.startswith("right")]
    (tmp_path / "right.csv").write_text("\n".join([head, *own]))
    (tmp_path / "few.csv").write_text("\n".join([head, *own[:4]]))
    config = tmp_path / "robot.toml"
    config.write_text('[tendons]\nmodel = "XM430-W350"\n')
    before = sorted(tmp_path.iterdir())
    result = RUN.invoke(app, ["motor-load", "--config", str(config), *(word.format(tmp_path) for word in words)])
    assert isinstance(result.exception, StillgraspError)
    assert told in str(result.exception)
    assert sorted(tmp_path.iterdir()) == before
