"""`stillgrasp figures` as a user types it."""

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from controller.figure_commands import figures

RUN = CliRunner()
APP = typer.Typer()
APP.command()(figures)


def test_chosen_figures_are_written_and_described(tmp_path: Path) -> None:
    """--only takes numbers as they come; JSON gives files, captions and numbers."""
    told = RUN.invoke(APP, ["--only", "2", "2", "-o", str(tmp_path), "--json"])
    assert told.exit_code == 0, told.stderr
    rows = json.loads(told.stdout)
    assert [row["figure"] for row in rows] == [2]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["figure-02.json", "figure-02.md", "figure-02.png"]
    assert rows[0]["values"]["wrist_offset_m"] > 0.05
    text = RUN.invoke(APP, ["--only", "2", "-o", str(tmp_path)]).stdout
    assert rows[0]["caption"] in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--only", "5"], "2, 3, 4"),
        (["--only"], "--only 3 6"),
        (["3"], "--only"),
        (["--only", "3", "-o", "/dev/null"], "written"),
    ],
)
def test_bad_input_ends_with_one_message(arguments: list[str], said: str) -> None:
    """What is wrong in one line, exit code 2."""
    told = RUN.invoke(APP, arguments)
    assert told.exit_code == 2
    assert said in told.stderr
    assert len(told.stderr.splitlines()) == 1
