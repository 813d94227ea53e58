"""The motors' own file: load laws stay with the motors that they were measured on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from calibration.load_calibration import LoadCalibration
from calibration.motor_file import MeasuredLaw, read_motor_file, write_load_laws, write_motor_setup
from calibration.motor_setup import MotorSetup
from controller.config import load_config
from controller.service.assembly import tendon_motors
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel
from drivers.dynamixel.load_law import LoadLaw, published_law
from drivers.dynamixel.settings import Calibration
from drivers.errors import ConfigurationError

SETUP = MotorSetup(5, 1, 2000, (-0.005, 0.04), 0.0)
LAW = replace(LoadLaw(), torque_per_effort_Nm=1.91, friction_effort=0.151)


def measured(motor_id: int, model: MotorModel = XM430_W350, law: LoadLaw = LAW) -> MeasuredLaw:
    calibrated = LoadCalibration(
        model=model.name,
        firmware=45,
        voltage_V=11.9,
        temperature_C=33.0,
        scatter_N=0.7,
        slope_uncertainty=0.03,
        friction_uncertainty_N=1.2,
        date="2026-01-31",
    )
    return MeasuredLaw(motor_id, law, calibrated)


def installation(tmp_path: Path, file: Path) -> Path:
    robot = tmp_path / "robot.toml"
    robot.write_text(f'[tendons]\nown_file = "{file}"\n[tendons.right]\nid = 5\n[tendons.left]\nid = 4\n')
    return robot


def test_a_measured_law_reaches_the_driver(tmp_path: Path) -> None:
    """Slope, friction, all uncertainties and where they are from: as measured, on the side that was measured alone."""
    file = tmp_path / "motors.toml"
    write_load_laws(file, {"right": measured(5)})
    right, left = tendon_motors(load_config(installation(tmp_path, file)))
    assert right.calibrated == Calibration("XM430-W350", 45, 11.9, 33.0, 0.7, "2026-01-31")
    law = right.load_law
    assert (law.torque_per_effort_Nm, law.friction_effort) == (1.91, 0.151)
    assert (law.slope_uncertainty, law.scatter_N, law.temperature_C) == (0.03, 0.7, 33.0)
    assert law.friction_uncertainty * 1.91 / 0.0105 == pytest.approx(1.2)
    assert left.calibrated is None
    assert left.load_law == published_law(XM430_W350, 0.0105)


def test_a_law_by_load_has_its_own_keys(tmp_path: Path) -> None:
    """Measured anew with a model that tells its load, no key of the current's law stays behind."""
    file = tmp_path / "motors.toml"
    write_load_laws(file, {"right": measured(5), "left": measured(4)})
    by_load = replace(published_law(MX_28, 0.0105), back_emf_effort_s_per_m=14.2)
    write_load_laws(file, {"right": measured(5, MX_28, by_load)})
    right, left = tendon_motors(load_config(installation(tmp_path, file)))
    assert right.load_law.back_emf_effort_s_per_m == 14.2
    assert right.load_law.voltage_V == 12.0
    assert read_motor_file(file).right_torque_constant_Nm_per_A is None
    assert left.calibrated is None  # of a motor that is no longer there: both are of one model


def test_a_law_goes_with_its_motor_to_the_other_side(tmp_path: Path) -> None:
    """Ids 5 and 4 are found on other sides: each law follows the id it was measured on."""
    file = tmp_path / "motors.toml"
    write_load_laws(file, {"right": measured(5), "left": measured(4, law=replace(LAW, torque_per_effort_Nm=1.7))})
    assert write_motor_setup(file, replace(SETUP, motor_id=4), SETUP, "XM430-W350") == ()
    own = read_motor_file(file)
    assert (own.right_id, own.right_torque_constant_Nm_per_A) == (4, 1.7)
    assert (own.left_id, own.left_torque_constant_Nm_per_A) == (5, 1.91)
    assert own.left_calibrated == measured(5).calibrated


@pytest.mark.parametrize(("motor_id", "model"), [(9, "XM430-W350"), (5, "XM430-W210")])
def test_another_motor_or_model_has_no_law(tmp_path: Path, motor_id: int, model: str) -> None:
    """A law of a motor that was taken off would be believed of the new one."""
    file = tmp_path / "motors.toml"
    write_load_laws(file, {"right": measured(5)})
    lost = write_motor_setup(file, replace(SETUP, motor_id=motor_id), replace(SETUP, motor_id=4), model)
    assert lost == ("right",)
    own = read_motor_file(file)
    assert own.right_calibrated is None
    assert own.right_torque_constant_Nm_per_A is None


def test_a_law_that_no_start_would_take_is_not_written(tmp_path: Path) -> None:
    """The file that every later command reads must stay one that can be read."""
    file = tmp_path / "motors.toml"
    write_load_laws(file, {"right": measured(5)})
    before = file.read_bytes()
    with pytest.raises(ConfigurationError, match=r"left_friction_current_A = 2\.5"):
        write_load_laws(file, {"left": measured(4, law=replace(LAW, friction_effort=2.5))})
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("right_friction_load = 0.9", "right_friction_load = 0.9"),
        ("right_calibrated = { model = 'XM430-W350' }", "right_calibrated.firmware"),
        ("right_calibrated = 3", "right_calibrated = 3"),
    ],
)
def test_a_slip_is_named(tmp_path: Path, line: str, told: str) -> None:
    """By the key that is in the file."""
    file = tmp_path / "motors.toml"
    file.write_text(f'model = "XM430-W350"\n{line}\n')
    with pytest.raises(ConfigurationError) as refused:
        read_motor_file(file)
    assert told in str(refused.value)


def test_a_calibration_of_another_model_is_refused(tmp_path: Path) -> None:
    """robot.toml may say it by hand: an XM430's law is not an MX-28's."""
    file = tmp_path / "motors.toml"
    write_load_laws(file, {"right": measured(5)})
    file.write_text(file.read_text().replace('model = "XM430-W350"\nright_id', 'model = "MX-28"\nright_id'))
    with pytest.raises(ConfigurationError, match=r"right_calibrated.model = 'XM430-W350'.*expected MX-28"):
        load_config(installation(tmp_path, file))
