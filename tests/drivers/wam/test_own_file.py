"""The arm's own file: written whole or not at all, and laid over the packaged parameters."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import ConfigurationError, InputError
from drivers.wam.own_file import write_own_file
from drivers.wam.parameters import load_wam_parameters

ANGLES = [0.1, -2.0, 0.0, 3.13, 1e-9, -0.0, 2.5]


def test_other_keys_stay_and_the_old_file_is_kept(tmp_path: Path) -> None:
    """Protects what another calibration wrote, and the way back."""
    file = tmp_path / "sub" / "arm.toml"
    write_own_file(file, {"home_rad": ANGLES, "name": 'a "quoted" \\ näme'})
    assert not file.with_name("arm.toml.bak").exists()
    first = file.read_bytes()
    write_own_file(file, {"home_rad": [0.0] * 7, "zero_angle_rad": [[1.0, 2], [3.5]]})
    content = tomllib.loads(file.read_text())
    assert content == {"home_rad": [0.0] * 7, "name": 'a "quoted" \\ näme', "zero_angle_rad": [[1.0, 2], [3.5]]}
    assert file.with_name("arm.toml.bak").read_bytes() == first
    assert sorted(path.name for path in file.parent.iterdir()) == ["arm.toml", "arm.toml.bak"]


@settings(max_examples=40, deadline=None)  # each example waits for the disk
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=9), st.text(max_size=20))
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], text: str
) -> None:
    """Law: every finite number, to the last bit, and every text that TOML knows comes back as it was."""
    file = tmp_path_factory.mktemp("own") / "arm.toml"
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        return  # no TOML file can hold half a surrogate pair
    write_own_file(file, {"numbers": numbers, "text": text})
    assert tomllib.loads(file.read_bytes().decode()) == {"numbers": numbers, "text": text}


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), None, {"a": None}, [float("nan")]])
def test_values_that_do_not_belong_there_change_nothing(tmp_path: Path, bad: object) -> None:
    """Protects the file from a calibration that failed without noticing."""
    file = tmp_path / "arm.toml"
    write_own_file(file, {"home_rad": ANGLES})
    before = file.read_bytes()
    with pytest.raises(InputError, match="zero_angle_rad"):
        write_own_file(file, {"zero_angle_rad": bad})
    assert file.read_bytes() == before
    assert not file.with_name("arm.toml.bak").exists()


def test_tables_are_kept_and_keys_taken_out(tmp_path: Path) -> None:
    """What belongs to a part that is no longer there must not stay; a table among the others comes back as it was."""
    file = tmp_path / "motors.toml"
    write_own_file(file, {"law": {"model": "X", "at": [1, 2.5]}, "old": 1})
    write_own_file(file, {"new": 2}, without=("old", "never_there"))
    assert tomllib.loads(file.read_text()) == {"law": {"model": "X", "at": [1, 2.5]}, "new": 2}


def test_a_place_where_nothing_can_be_written_is_named(tmp_path: Path) -> None:
    """Protects the operator who has just measured: the error says which file and why, and the old one stands."""
    with pytest.raises(InputError, match=r"arm\.toml: this file cannot be written"):
        write_own_file(Path(os.devnull) / "arm.toml", {"home_rad": ANGLES})


def test_a_broken_file_is_not_replaced(tmp_path: Path) -> None:
    """Protects a file with a slip of the pen: it is named, and stays for its owner to mend."""
    file = tmp_path / "arm.toml"
    file.write_text("home_rad = [")
    with pytest.raises(ConfigurationError, match="readable TOML"):
        write_own_file(file, {"home_rad": ANGLES})
    assert file.read_text() == "home_rad = ["


def test_own_keys_lie_over_the_packaged_ones(tmp_path: Path) -> None:
    """Protects an arm's own home, beyond a joint limit too, and that all else stays as packaged."""
    file = tmp_path / "arm.toml"
    write_own_file(file, {"home_rad": ANGLES, "zero_angle_rad": [1.0] * 7})
    arm, packaged = load_wam_parameters(own=file), load_wam_parameters()
    assert arm.home_rad.tolist() == ANGLES
    assert arm.home_rad[3] > arm.joint_upper_rad[3]
    assert arm.zero_angle_rad.tolist() == [1.0] * 7
    assert packaged.zero_angle_rad.tolist() == [-1.0] * 7
    assert arm.joint_upper_rad.tolist() == packaged.joint_upper_rad.tolist()
    assert arm.name == packaged.name


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("home_rad = [1, 2]", "home_rad"),
        ("zero_angle = [1, 1, 1, 1, 1, 1, 1]", "zero_angle"),
        ("safety_velocity_m_s = 0", "safety_velocity_m_s"),
        ("safety_velocity_m_s = 8.0", "safety_velocity_m_s"),
        ("safety_motor_torque_Nm = 3.1", "safety_motor_torque_Nm"),
        ("safety_motor_torque_Nm = true", "safety_motor_torque_Nm"),
        ("joint_upper_rad = [-3, 1, 1, 1, 1, 1, 1]", "joint_"),
    ],
)
def test_a_bad_own_file_is_named(tmp_path: Path, text: str, key: str) -> None:
    """Protects against a wrong key or value in the arm's own file: that file is named, not the packaged one."""
    file = tmp_path / "arm.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=key):
        load_wam_parameters(own=file)


def test_a_missing_own_file_is_an_error(tmp_path: Path) -> None:
    """Protects a calibrated arm whose file was moved: it does not run on packaged numbers unnoticed."""
    with pytest.raises(ConfigurationError, match="nowhere"):
        load_wam_parameters(own=tmp_path / "nowhere.toml")
