"""`stillgrasp table …` as a user types it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from calibration.motion_table import MotionTable
from controller.table_commands import app

RUN = CliRunner()


@pytest.fixture(scope="module")
def table_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tables") / "split.npz"
    arguments = ["--hand", "t42pp", "--object", "cylinder40", "--onset-split", "0.1", "--nodes", "13", "-o", str(path)]
    result = RUN.invoke(app, ["build", *arguments])
    assert result.exit_code == 0, result.stderr
    assert str(path) in result.stdout
    return path


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


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["build", "--hand", "t42xx", "--object", "cylinder40"], "t42pp"),
        (["build", "--hand", "t42pp", "--object", "nothing.toml"], "nothing.toml"),
        (["build", "--hand", "t42pp", "--object", "cylinder40", "--onset-split", "nan"], "onset_split"),
        (["build", "--hand", "t42pp", "--object", "cylinder40", "--preset", "soft"], "fitted"),
        (["build", "--hand", "t42pp", "--object", "cylinder40", "--nodes", "3"], "9 and 401"),
    ],
)
def test_bad_input_ends_with_one_message(arguments: list[str], said: str, tmp_path: Path) -> None:
    """What is wrong and what is accepted, exit code 2, and no file."""
    output = tmp_path / "table.npz"
    result = RUN.invoke(app, [*arguments, "-o", str(output)])
    assert result.exit_code == 2
    assert said in result.stderr
    assert not output.exists()


@pytest.mark.parametrize("command", ["build", "show", "check", "list"])
def test_every_command_shows_an_example(command: str) -> None:
    """--help answers how it is typed."""
    assert f"stillgrasp table {command}" in RUN.invoke(app, [command, "--help"]).stdout
