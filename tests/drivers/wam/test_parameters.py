"""The arm's parameter file and the refusal of a bad one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigurationError
from drivers.wam import parameters
from drivers.wam.own_file import write_own_file
from drivers.wam.parameters import load_wam_parameters

_BUILT_IN = Path(parameters.__file__).with_name("wam7.toml")


def test_packaged_file_holds_the_reference_numbers() -> None:
    """Protects home, and that no joint is promised more torque than its motor gives at its limit alone (5.3)."""
    arm = load_wam_parameters()
    assert arm.home_rad.tolist() == [0, -2, 0, 3.13, 0, 0, 0]
    assert np.all(arm.joint_effort_limit_Nm <= [75.60, 101.70, 60.54, 28.80, 11.64, 11.64, 1.37])
    # Reference 6.5 gives the rotors themselves: rotor inertia seen from the joint over the squared ratio.
    assert arm.rotor_inertia_kgm2[0] / 42.0**2 == pytest.approx(1.14e-4, rel=0.01)
    with pytest.raises(ValueError, match="read-only"):
        arm.home_rad[0] = 1.0


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("home_rad = [0.0,", "home_rad = [nan,", "home_rad"),
        ("home_rad = [0.0,", "home_rad = [", "home_rad"),
        ("counts_per_turn = [4096", "counts_per_turn = [0", "counts_per_turn"),
        ("counts_per_turn = [4096", "counts_per_turn = [true", "counts_per_turn"),
        ("joint_lower_rad = [-2.6", "joint_lower_rad = [2.7", "joint_lower_rad"),
        ("units_per_Nm", "units_per_nm", "units_per_"),
        ('name = "wam7"', "name = 7", "name"),
        ('name = "wam7"', "name = ", "file"),
    ],
)
def test_bad_value_is_named(tmp_path: Path, old: str, new: str, key: str) -> None:
    """Protects the user of a wrong file: the error names file and key."""
    text = _BUILT_IN.read_text()
    assert old in text
    file = tmp_path / "arm.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(ConfigurationError, match=key) as caught:
        load_wam_parameters(file)
    assert caught.value.file == str(file)


def test_gravity_vectors_of_the_own_file_are_laid_over(tmp_path: Path) -> None:
    """Protects the calibration: what was identified on this arm is used, and without it nothing is assumed."""
    assert load_wam_parameters().gravity_mu_kg_m is None
    own = tmp_path / "arm.toml"
    rows = [[0.1 * joint, -0.2, 1e-3] for joint in range(7)]
    write_own_file(own, {"gravity_mu_kg_m": rows})
    mu = load_wam_parameters(own=own).gravity_mu_kg_m
    assert mu is not None
    np.testing.assert_array_equal(mu, rows)


@pytest.mark.parametrize(
    "rows",
    ["3.0", "[[0.0, 0.0, 0.0]]", "[[0.0], [0.0], [0.0], [0.0], [0.0], [0.0], [0.0]]"]
    + [f"[{', '.join(['[0.0, 0.0, ' + bad + ']'] * 7)}]" for bad in ("nan", "inf", "21.0", "true", "'x'")],
)
def test_gravity_vectors_that_are_none_are_refused(tmp_path: Path, rows: str) -> None:
    """Protects the arm from gravity of a damaged file."""
    own = tmp_path / "arm.toml"
    own.write_text(f"gravity_mu_kg_m = {rows}\n")
    with pytest.raises(ConfigurationError, match="seven rows of three numbers"):
        load_wam_parameters(own=own)
