"""A newcomer's load calibration: two processes, one keyboard each, weights hung when they are asked for."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.config import load_config
from controller.service.assembly import tendon_motors

COMMAND = [sys.executable, "-P", "-c", "from controller.cli import main; main()"]
MOST_PROMPTS = 15


@pytest.fixture
def directory() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="sg-") as path:
        yield Path(path)


def start(directory: Path, *words: str) -> subprocess.Popen[str]:
    environment = {"PATH": "/usr/bin:/bin", "XDG_RUNTIME_DIR": str(directory), "MPLCONFIGDIR": str(directory)}
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*COMMAND, *words], stdin=pipe, stdout=pipe, stderr=pipe, env=environment, text=True, bufsize=1
    )


@pytest.mark.slow
def test_weights_hung_when_asked_for_end_in_the_motors_file(directory: Path) -> None:
    """Prompts, strokes, file: what `simulate dynamixel --hanging-kg` was made of comes out, and the motor still holds.

    Wide tolerances: a busy machine's pauses are the motor's too.
    """
    simulation = start(directory, "simulate", "dynamixel", "--hanging-kg", "0", "0", "--json")
    with simulation:
        assert simulation.stdin is not None
        assert simulation.stdout is not None
        try:
            port = json.loads(simulation.stdout.readline())["port"]
            config = directory / "robot.toml"
            config.write_text(f'[tendons]\nport = "{port}"\nown_file = "{directory}/motors.toml"\n')
            (directory / "motors.toml").write_text("right_zero_ticks = 0\n")
            words = ("--motor", "right", "--up-only", "--stroke-mm", "8", "--speed-mm-s", "6", "--json")
            weights = ("--weight", "0.5", "--weight", "2", "--weight", "5")
            with start(directory, "calibrate", "motor-load", "--config", str(config), *words, *weights) as calibration:
                assert calibration.stdin is not None
                assert calibration.stderr is not None
                assert calibration.stdout is not None
                asked: list[str] = []
                for line in calibration.stderr:
                    if "press Enter" not in line or len(asked) > MOST_PROMPTS:
                        continue
                    asked.append(line)
                    if ": hang " in line:
                        mass_kg = line.split(": hang ")[1].split()[0]
                        simulation.stdin.write(f"hang right {mass_kg}\n")
                        assert simulation.stderr is not None
                        assert mass_kg in simulation.stderr.readline()
                    calibration.stdin.write("\n")
                told = json.loads(calibration.stdout.read())
            assert calibration.returncode == 0
        finally:
            simulation.send_signal(signal.SIGINT)
    assert "the right motor will turn between 0.0 and 8.0 mm" in asked[0]
    assert "take the weight off" in asked[-1]
    assert told["accepted"]
    assert told["right"]["torque_constant_Nm_per_A"] == pytest.approx(1.79, rel=0.1)
    assert told["right"]["friction_current_A"] == pytest.approx(0.13, rel=0.3)
    right, _ = tendon_motors(load_config(config))
    assert right.calibrated is not None
    assert (right.calibrated.model, right.calibrated.firmware) == ("XM430-W350", 45)
