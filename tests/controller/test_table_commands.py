"""`stillgrasp table …` as a user types it."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from calibration.motion_table import MotionTable
from calibration.table_file import read_file, write_file
from controller.table_commands import app

RUN = CliRunner()
CATALOGUE = """
[[grasp]]
name = "symmetric"
[[grasp]]
name = "lifted"
supported = false
[[tables]]
hands = ["t42pp"]
objects = ["cylinder40", "drum.toml"]
grasps = ["symmetric", "lifted"]
"""
ONE = ["build", "--hand"]
SPLIT = [*ONE, "t42pp", "--object", "cylinder40", "--onset-split", "0.1", "--lifted", "--nodes", "13"]
DRUM = 'name = "drum"\nmass_kg = 0.1\nshape = { kind = "disc", diameter_m = 0.5 }\n[support]\nfriction = 0.3\n'


@pytest.fixture(scope="module")
def table_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tables") / "split.npz"
    result = RUN.invoke(app, [*SPLIT, "-o", str(path)])
    assert result.exit_code == 0, result.stderr
    assert str(path) in result.stdout
    return path


@pytest.fixture
def catalogue(tmp_path: Path) -> Path:
    """A catalogue of three cases that can be built and three that the hand cannot reach."""
    (tmp_path / "drum.toml").write_text(DRUM)
    (tmp_path / "mine.toml").write_text(CATALOGUE)
    return tmp_path / "mine.toml"


def test_show_prints_the_path(table_file: Path) -> None:
    """Text for people, JSON for programs; both tell the same path, from contact to the domain's end."""
    shown = json.loads(RUN.invoke(app, ["show", str(table_file), "--json"]).stdout)
    path = shown["path"]
    assert {"excursion_m", "load_N", "pose", "contact_force_N", "required_friction", "stable"} <= path[0].keys()
    assert path[0]["pose"] == [0.0] * 6
    table, row = MotionTable.load(table_file), path[4]
    assert row["pose"] == table.at_excursion(row["excursion_m"], 0.0).motion.tolist()
    assert shown["header"]["hand"]["name"] == "T42PP"
    text = RUN.invoke(app, ["show", str(table_file)]).stdout
    assert f"{row['pose'][1] * 1e3:.2f}" in text


def test_show_tells_how_the_outline_is_turned(table_file: Path, tmp_path: Path) -> None:
    """What `run --simulate --outline-angle` takes: the mirrored grasp turns the outline the other way."""
    mirrored = tmp_path / "mirrored.npz"
    RUN.invoke(app, ["-0.1" if word == "0.1" else word for word in (*SPLIT, "-o", str(mirrored))])
    files = (table_file, mirrored)
    there, back = (json.loads(RUN.invoke(app, ["show", str(f), "--json"]).stdout)["outline_angle_rad"] for f in files)
    assert there != 0.0
    assert back == pytest.approx(-there, rel=1e-9)


def test_show_tells_the_grasping_forces(table_file: Path) -> None:
    """Lifted, each finger must press with m g / (2 μ), and a little more for the force along the contact."""
    shown = json.loads(RUN.invoke(app, ["show", str(table_file), "--json"]).stdout)
    assert 1.0 <= shown["f_min_N"] / (0.1 * 9.80665 / 0.3) < 1.1
    assert shown["f_min_N"] < shown["f_max_N"]
    assert shown["f_e_N"] is None or shown["f_e_N"] <= shown["f_max_N"]
    assert shown["statement"] in RUN.invoke(app, ["show", str(table_file)]).stdout


def test_a_table_of_a_hand_that_is_no_hand_here_is_refused(table_file: Path, tmp_path: Path) -> None:
    """A header that this version cannot turn back into parameters ends in one message, not in a traceback."""
    header, arrays = read_file(table_file)
    header["hand"]["right"]["tip"]["radius_m"] = -1.0
    write_file(tmp_path / "odd.npz", header, arrays)
    told = RUN.invoke(app, ["show", str(tmp_path / "odd.npz")])
    assert (told.exit_code, told.stdout) == (2, "")
    assert "radius_m" in told.stderr or ">= 0" in told.stderr


def test_check_tells_intact_from_altered(table_file: Path, tmp_path: Path) -> None:
    """An altered table ends with exit code 2 and one message on standard error."""
    good = RUN.invoke(app, ["check", str(table_file), "--json"])
    assert json.loads(good.stdout)["intact"]
    assert json.loads(good.stdout)["current"]
    content = bytearray(table_file.read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "bad.npz").write_bytes(content)
    bad = RUN.invoke(app, ["check", str(tmp_path / "bad.npz")])
    assert bad.exit_code == 2
    assert "was altered" in bad.stderr
    assert bad.stdout == ""


def test_list_names_damaged_tables_too(table_file: Path) -> None:
    """A folder's tables are listed even when one of them cannot be read."""
    (table_file.parent / "noise.npz").write_bytes(b"noise")
    rows = json.loads(RUN.invoke(app, ["list", str(table_file.parent), "--json"]).stdout)
    assert [row.get("error") for row in rows] == ["is not a motion table.", None]
    assert rows[1]["onset_split"] == 0.1


def test_a_current_table_is_left_as_it_is(table_file: Path) -> None:
    """Building again costs nothing."""
    before = table_file.stat().st_mtime_ns
    told = RUN.invoke(app, [*SPLIT, "-o", str(table_file)])
    assert (told.exit_code, "already current" in told.stdout) == (0, True)
    assert table_file.stat().st_mtime_ns == before


def test_options_reach_the_table(tmp_path: Path) -> None:
    """Every option of the grasp is in the header of what was built, the preset in the hand's."""
    output = tmp_path / "t.npz"
    options = ["--lifted", "--preset", "nominal", "--contact-friction", "0.5", "--load-cap-N", "9", "--nodes", "9"]
    options += ["--compensated"]
    arguments = ["build", "--hand", "t42pp", "--object", "cylinder40", *options, "-o", str(output), "--json"]
    told = json.loads(RUN.invoke(app, arguments).stdout)
    header = MotionTable.load(output).header
    assert (told["result"], told["inputs_sha256"]) == ("built", header.inputs_sha256)
    assert header.hand["preset"] == "nominal"
    asked = {"supported": False, "compensated": True, "contact_friction": 0.5, "load_cap_N": 9.0, "branch": "winding"}
    assert {key: header.grasp[key] for key in asked} == asked


def test_a_catalogue_is_built_with_a_report(catalogue: Path) -> None:
    """One line a case on standard error as it comes; the sum, and the reasons, on standard output; then it is
    current."""
    arguments = ["build", "--all", str(catalogue), "--directory", str(catalogue.parent), "--nodes", "9"]
    first = RUN.invoke(app, [*arguments, "--workers", "1"])
    assert first.exit_code == 0, first.stderr
    assert "2 built, 0 current, 2 unreachable, 0 failed" in first.stdout
    assert "unreachable t42pp-fitted-drum-lifted: " in first.stdout
    assert first.stderr.count("built ") == 2
    again = json.loads(RUN.invoke(app, [*arguments, "--workers", "1", "--json"]).stdout)
    assert (again["current"], again["unreachable"], again["built"]) == (2, 2, 0)
    assert MotionTable.load(again["cases"][0]["file"]).header.object["name"] == "cylinder 40 mm"


def test_a_failed_case_ends_with_exit_code_1_and_its_name(catalogue: Path) -> None:
    """Scripts notice; the others are built."""
    (catalogue.parent / "t42pp-fitted-cylinder40-lifted.npz").mkdir()
    arguments = ["build", "--all", str(catalogue), "--directory", str(catalogue.parent), "--nodes", "9"]
    told = RUN.invoke(app, [*arguments, "--cluster", "local", "--workers", "1"])
    assert told.exit_code == 1
    assert "1 built, 0 current, 2 unreachable, 1 failed" in told.stdout
    assert "1 of 4 cases failed: t42pp-fitted-cylinder40-lifted" in told.stderr


def test_ctrl_c_leaves_whole_tables_and_no_workers(catalogue: Path) -> None:
    """It ends at once with what was finished, and nothing half-written; the next run goes on from there."""
    directory = catalogue.parent / "tables"
    catalogue.write_text(CATALOGUE.replace('"drum.toml"', '"cylinder30", "cylinder45", "strawberry"'))
    program = "from controller.cli import main; main()"
    arguments = ["table", "build", "--all", str(catalogue), "--directory", str(directory), "--workers", "1"]
    arguments += ["--nodes", "9"]
    with subprocess.Popen([sys.executable, "-c", program, *arguments], stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        first = running.stderr.readline()
        running.send_signal(signal.SIGINT)
        rest = running.stderr.read()
        assert running.wait(60) == 130
    assert "Traceback" not in rest
    assert first.split() == ["built", "t42pp-fitted-cylinder40-symmetric"]
    files = list(directory.iterdir())
    assert "t42pp-fitted-cylinder40-symmetric.npz" in {file.name for file in files}
    assert len(files) < 8
    assert all(MotionTable.load(file).inputs_sha256 for file in files)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([*ONE, "t42xx", "--object", "cylinder40"], "t42pp"),
        ([*ONE, "t42pp", "--object", "nothing.toml"], "nothing.toml"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--onset-split", "nan"], "onset_split"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--object-offset-m", "inf"], "object_offset_m"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--object-angle-deg", "1e9"], "object_angle_deg"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--contact-friction", "0"], "contact_friction"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--load-cap-N", "-1"], "load_cap_N"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--branch", "sideways"], "unwinding"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--preset", "soft"], "fitted"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--nodes", "3"], "9 and 401"),
        ([*ONE, "t42pp", "--object", "cylinder40", "--workers", "2"], "--workers: only with --all"),
        ([*ONE, "t42pp"], "--object: missing"),
        (["build", "--all"], "--directory: missing"),
        (["build", "--all", "--directory", ".", "--nodes", "3"], "9 and 401"),
        (["build", "--all", "--directory", ".", "--onset-split", "0"], "--onset-split: only for one table"),
        (["build", "--all", "nothing.toml", "--directory", "."], "nothing.toml"),
        (["build", "--all", "--directory", ".", "--workers", "0"], "1024"),
        (["build", "--all", "--directory", ".", "--cluster", "nonsense://x"], "nonsense"),
    ],
    ids=lambda value: " ".join(value[-2:]) if isinstance(value, list) else None,
)
def test_bad_input_ends_with_one_message(arguments: list[str], said: str, tmp_path: Path) -> None:
    """What is wrong and what is accepted in one line, exit code 2, and no file."""
    output = tmp_path / "table.npz"
    result = RUN.invoke(app, arguments if "--all" in arguments else [*arguments, "-o", str(output)])
    assert result.exit_code == 2
    assert said in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert result.stdout == ""
    assert not output.exists()


@pytest.mark.parametrize("command", ["build", "show", "check", "list"])
def test_every_command_shows_an_example(command: str) -> None:
    """--help answers how it is typed."""
    assert f"stillgrasp table {command}" in RUN.invoke(app, [command, "--help"]).stdout
