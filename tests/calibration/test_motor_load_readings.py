"""Files of readings: what is written is read back, and a slip is named by its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibration.motor_load_readings import MotorReadings, read_readings, write_readings
from drivers.dynamixel.control_tables import MX_28
from drivers.dynamixel.load_law import SpoolMotion, published_law
from drivers.errors import InputError
from tests.calibration.test_motor_load import readings_of

HEAD = "side,model,firmware,motion,mass_kg,speed_mm_s,effort,voltage_V,temperature_C"
GOOD = "right,XM430-W350,45,winding,2.0,3.0,0.245,12.0,31"


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    """A run can be fitted again from its file, with the same outcome: to the digits that a motor can tell."""
    own = tuple(readings_of(published_law(MX_28, 0.0105), noise=0.003))
    motors = [MotorReadings("right", "MX-28", 40, own), MotorReadings("left", "MX-28", 41, own[:3])]
    write_readings(tmp_path / "new" / "kept.csv", motors)
    back = read_readings(tmp_path / "new" / "kept.csv")
    assert [(one.side, one.model, one.firmware, len(one.readings)) for one in back] == [
        ("right", "MX-28", 40, 20),
        ("left", "MX-28", 41, 3),
    ]
    for before, after in zip(own, back[0].readings, strict=True):
        assert after.motion is before.motion
        assert after.tension_N == pytest.approx(before.tension_N, abs=1e-4)
        assert after.effort == pytest.approx(before.effort, abs=1e-6)
        assert after.rate_m_s == pytest.approx(before.rate_m_s, abs=1e-7)
        assert (after.voltage_V, after.temperature_C) == (before.voltage_V, before.temperature_C)
    assert back[0].readings[0].place == "line 2"


def test_toml_and_csv_say_the_same(tmp_path: Path) -> None:
    """Kilograms as well as newtons, comments, spaces; a row a reading in both."""
    csv, toml = tmp_path / "a.csv", tmp_path / "a.toml"
    csv.write_text(f"# hung on Tuesday\n{HEAD}\n\n right , XM430-W350,45,unwinding,1,3.0,-0.07,12.0,31\n")
    toml.write_text(
        '[[reading]]\nside = "right"\nmodel = "XM430-W350"\nfirmware = 45\nmotion = "unwinding"\n'
        "tension_N = 9.80665\nspeed_mm_s = 3\neffort = -0.07\nvoltage_V = 12.0\ntemperature_C = 31\n"
    )
    (from_csv,), (from_toml,) = read_readings(csv), read_readings(toml)
    first, second = from_csv.readings[0], from_toml.readings[0]
    assert first.motion is second.motion is SpoolMotion.UNWINDING
    assert first.tension_N == pytest.approx(second.tension_N)
    assert first.rate_m_s == second.rate_m_s == -0.003
    assert (first.place, second.place) == ("line 4", "reading 1")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (GOOD.replace("winding", "holding"), "line 3, motion = 'holding' is not accepted; expected one of"),
        (GOOD.replace("0.245", "nan"), "line 3, effort = nan"),
        (GOOD.replace("0.245", "high"), "line 3, effort = 'high' is not accepted; expected a finite number"),
        (GOOD.replace("3.0", "0"), "line 3, speed_mm_s = 0.0 is not accepted; expected a finite number > 0"),
        (GOOD.replace(",2.0,", ",,"), "line 3, mass_kg"),
        (GOOD.replace("XM430-W350", "AX-12"), "line 3, model = 'AX-12' is not accepted; expected one of RX-28"),
        (GOOD.replace("right", "middle"), "line 3, side = 'middle' is not accepted"),
        (GOOD.replace("45", "4x"), "line 3, firmware = '4x'"),
        (GOOD + ",9", "line 3 = "),
        (GOOD.replace("45", "44"), "line 3 is of a XM430-W350, firmware 44; the right motor's first of"),
    ],
)
def test_a_slip_is_named_by_its_line(tmp_path: Path, line: str, told: str) -> None:
    """File, line, key, value and what is accepted; nothing of the rest is used."""
    file = tmp_path / "kept.csv"
    file.write_text(f"{HEAD}\n{GOOD}\n{line}\n")
    with pytest.raises(InputError) as refused:
        read_readings(file)
    assert told in str(refused.value)
    assert "kept.csv" in str(refused.value)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("kept.csv", "", "no readings"),
        ("kept.csv", HEAD, "no readings"),
        ("kept.csv", f"{HEAD},colour\n{GOOD},red\n", "line 2, colour"),
        ("kept.csv", "side\nright\n", "(missing)"),
        ("kept.toml", "reading = 3", "reading = 3 is not accepted"),
        ("kept.toml", "reading = [3]", "reading 1 = 3 is not accepted"),
        ("kept.toml", "[[reading]\n", "valid TOML"),
    ],
)
def test_a_file_that_is_none_is_told(tmp_path: Path, name: str, text: str, told: str) -> None:
    """Empty files, other columns, other TOML."""
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as refused:
        read_readings(tmp_path / name)
    assert told in str(refused.value)


def test_a_missing_file_and_a_place_that_takes_none(tmp_path: Path) -> None:
    """Both name the file."""
    with pytest.raises(InputError, match=r"no\.csv.*readable CSV"):
        read_readings(tmp_path / "no.csv")
    with pytest.raises(InputError, match=r"readings cannot be written"):
        write_readings(Path("/dev/null/kept.csv"), [])
