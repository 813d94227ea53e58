"""`stillgrasp calibrate tactile` as a user types it, against a simulated bridge on its socket."""

from __future__ import annotations

import json
import re
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from calibration.tactile_file import read_tactile_file
from controller.cli import main
from controller.config import load_config
from controller.service.tactile_assembly import configured_pads
from drivers.clock import MonotonicClock
from drivers.errors import ConfigurationError, InputError
from drivers.simulated.takktile import SimulatedCell, SimulatedTakktile, two_fingers
from drivers.simulated.takktile_lines import TakktileServer
from drivers.takktile.frames import Cell

RIGHT = [[0, 0], [0, 1], [0, 2], [0, 3], [0, 4], [1, 0], [1, 1], [1, 2]]
LEFT = [[2, 0], [2, 1], [2, 2], [2, 3], [2, 4], [3, 0], [3, 1], [3, 2]]
TACTILE = f"""
[tactile]
interface = "socket"
channel = "{{channel}}"
right_cells = {RIGHT}
left_cells = {LEFT}
period_s = 0.0044
"""


class ServedPads:
    """A simulated bridge behind its socket, served by a thread; cells differ in sensitivity."""

    def __init__(self, directory: Path) -> None:
        cells = [
            SimulatedCell(cell.cell, cell.finger, counts_per_N=70.0 + 10.0 * index % 80)
            for index, cell in enumerate(two_fingers())
        ]
        self.device = SimulatedTakktile(lambda: (0.0, 0.0), cells)
        self.file = directory / "robot.toml"
        self.file.write_text(TACTILE.format(channel=directory / "pads"))
        self._server = TakktileServer(directory / "pads", self.device, MonotonicClock())
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        while not self._ended.wait(0.0005):
            self._server.step()


class Operator:
    """Does what it is asked for on standard error, then presses Enter."""

    def __init__(self, device: SimulatedTakktile, capsys: pytest.CaptureFixture[str], loss: float = 0.0) -> None:
        self._device, self._capsys, self._loss = device, capsys, loss
        self.asked: list[str] = []

    def readline(self) -> str:
        request = self._capsys.readouterr().err.strip().splitlines()[-1]
        self.asked.append(request)
        self._device.pressed_N.clear()
        if put := re.search(r"put ([\d.]+) g on", request):
            cells = [Cell(int(row), int(column)) for row, column in re.findall(r"(\d):(\d)", request)]
            load_N = float(put[1]) * 1e-3 * 9.80665 * (1.0 - self._loss * (Cell(0, 2) in cells))
            self._device.pressed_N.update({cell: load_N / len(cells) for cell in cells})
        return "\n"


@pytest.fixture
def pads() -> Iterator[ServedPads]:
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:
        served = ServedPads(Path(directory))
        yield served
        served.close()


def calibrate(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    monkeypatch.setattr(sys, "argv", ["stillgrasp", "calibrate", "tactile", *words])
    main()


@pytest.mark.slow  # 14 zeros of half a second
def test_weights_in_the_prompted_places_calibrate_the_pad(
    pads: ServedPads, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the prompts alone: the cells' true sensitivities come out, the file is written, and the daemon reads it."""
    operator = Operator(pads.device, capsys)
    monkeypatch.setattr(sys, "stdin", operator)
    file = pads.file.with_name("tactile.toml")
    with pytest.raises(SystemExit) as ended:
        calibrate(monkeypatch, "right", "--config", str(pads.file), "-o", str(file), "--seconds", "0.1", "--json")
    assert not ended.value.code
    told = json.loads(capsys.readouterr().out)
    assert told["accepted"]
    assert told["presses"] == 42
    true = [cell.counts_per_N for cell in pads.device.cells if cell.finger == 0]
    assert told["gain_N_per_count"] == pytest.approx([1.0 / value for value in true], rel=0.03)
    assert sum("take everything off" in request for request in operator.asked) == 14
    pad = read_tactile_file(file).pad("right")
    assert pad is not None
    assert pad.calibrated
    config = load_config(pads.file, {"tactile": {"own_file": str(file)}})
    assert config.tactile is not None
    right, left = configured_pads(config.tactile)
    assert (right.calibrated, left.calibrated) == (True, False)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["middle"], "'middle' is no side"),
        (["right"], "it is not said where"),
        (["right", "-o", "{directory}/x.toml", "--mass", "0.1"], "too few"),
        (["right", "-o", "{directory}/x.toml", "--config", "{directory}/none.toml"], "no tactile pads"),
        (["right", "-o", "{directory}/robot.toml/x.toml"], "cannot be written"),
        (["right", "-o", "{directory}/robot.toml"], "robot.toml: tactile"),
    ],
)
def test_bad_input_is_one_clear_line(
    pads: ServedPads, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    """What is wrong is told before a bridge is opened."""
    pads.file.with_name("none.toml").write_text("")
    given = [word.format(directory=pads.file.parent) for word in words]
    with pytest.raises(SystemExit) as ended:
        calibrate(monkeypatch, *([] if "--config" in given else ["--config", str(pads.file)]), *given)
    assert ended.value.code
    error = capsys.readouterr().err
    assert told in error
    assert len(error.splitlines()) == 1
    assert not pads.device.requests


def test_a_file_for_another_map_is_refused(tmp_path: Path) -> None:
    """Gains of other cells are nobody's newtons."""
    file = tmp_path / "tactile.toml"
    file.write_text(
        "right_cells = [[5, 0]]\nright_gain_N_per_count = [0.01]\nright_thermal_counts = [0.0]\n"
        'right_coefficients = ["42a8b5c0bb603a10"]\n'
    )
    robot = tmp_path / "robot.toml"
    robot.write_text(TACTILE.format(channel="x") + f'own_file = "{file}"\n')
    config = load_config(robot)
    assert config.tactile is not None
    with pytest.raises(InputError, match="not the cells of"):
        configured_pads(config.tactile)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("release_N = 0.2", "less than touch_N"),
        ("period_s = 0.001", "≥ 0.004"),
        ("touch_N = 0.0", "> 0"),
        ("left_cells = [[0, 0]]", "named once"),
        ("left_cells = [[8, 0]]", "left_cells"),
        ('channel = ""', "path of the simulated"),
    ],
)
def test_a_wrong_key_under_tactile_is_named(tmp_path: Path, line: str, told: str) -> None:
    """The file, the key, the value and what is accepted."""
    key = line.split(" = ")[0]
    kept = [text for text in TACTILE.format(channel="x").splitlines() if not text.startswith(f"{key} =")]
    robot = tmp_path / "robot.toml"
    robot.write_text("\n".join([*kept, line]))
    with pytest.raises(ConfigurationError, match=re.escape(told)):
        load_config(robot)


def test_without_the_table_there_are_no_pads() -> None:
    """The default installation has none."""
    assert load_config().tactile is None
