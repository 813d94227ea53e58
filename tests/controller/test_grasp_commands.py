"""`stillgrasp grasp …` as a user types it."""

import json

import pytest
from typer.testing import CliRunner

from controller.grasp_commands import app

RUN = CliRunner()
MUSTARD = ["plan", "--hand", "t42pf", "--object", "mustard", "--mass", "0.6"]


def test_the_plan_in_words_and_in_numbers_is_the_same() -> None:
    """Text for people, JSON for programs: one plan."""
    shown = RUN.invoke(app, [*MUSTARD, "--json"])
    assert shown.exit_code == 0, shown.stderr
    plan = json.loads(shown.stdout)
    text = RUN.invoke(app, MUSTARD).stdout
    assert plan["force_closure"]["holds"] is True
    assert plan["minimal_effort"]["contact_normal_N"] == pytest.approx([9.80665, 9.80665])
    assert plan["minimal_effort"]["motion"]["y_m"] == pytest.approx(-0.028, abs=2e-4)
    assert plan["f_min_N"] == pytest.approx(2 * 9.80665)
    assert plan["constraints_violated"] == []
    for said in (
        plan["statement"],
        plan["end"]["event"],
        f"{plan['minimal_effort']['motion']['y_m'] * 1e3:.2f}",
        f"{plan['minimal_effort']['load_N'][0]:.2f}",
        f"{plan['preposition']['object_in_hand_m'][1] * 1e3:.2f}",
        "Q_DC",
    ):
        assert said in text
    assert "-0.00" not in text


def test_what_does_not_hold_is_said_and_is_no_error() -> None:
    """A heavy object has no minimal effort; on the table the fingertips slip on the way: both are answers."""
    heavy = RUN.invoke(app, ["plan", "--hand", "t42pp", "--object", "cylinder40", "--mass", "5"])
    assert heavy.exit_code == 0
    assert "minimal effort none" in heavy.stdout
    dragged = RUN.invoke(app, ["plan", "--hand", "t42pp", "--object", "cylinder40", "--mass", "0.3", "--supported"])
    assert "the tips slip on the way" in dragged.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--hand", "t42xx", "--object", "mustard"], "t42pf"),
        (["--hand", "t42pf", "--object", "teapot"], "mustard"),
        (["--hand", "t42pf", "--object", "mustard", "--mass", "-1"], "mass_kg"),
        (["--hand", "t42pf", "--object", "mustard", "--mass", "nan"], "mass_kg"),
        (["--hand", "t42pf", "--object", "mustard", "--preset", "soft"], "fitted"),
        (["--hand", "t42pf", "--object", "mustard", "--onset-split", "1.5"], "onset_split"),
        (["--hand", "t42pf", "--object", "mustard", "--contact-friction", "0"], "contact_friction"),
        (["--hand", "t42pf", "--object", "mustard", "--object-angle-deg", "45"], "distal phalanx meets the object"),
    ],
)
def test_bad_input_ends_with_one_line(arguments: list[str], said: str) -> None:
    """What is wrong and what is accepted on one line of standard error, exit code 2, and nothing else."""
    result = RUN.invoke(app, ["plan", *arguments])
    assert result.exit_code == 2
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stdout == ""


def test_help_shows_an_example() -> None:
    """--help answers how it is typed."""
    assert "stillgrasp grasp plan --hand" in RUN.invoke(app, ["plan", "--help"]).stdout
    assert "stillgrasp grasp plan --hand" in RUN.invoke(app, ["--help"]).stdout
