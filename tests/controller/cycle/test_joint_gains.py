"""Gains and torque limits: the vendor's numbers, rows that replace them, and what is refused."""

from __future__ import annotations

from math import inf, nan

import pytest

from controller.cycle.joint_gains import LIBBARRETT_GAINS, STIFF_GAINS, JointGains, TorqueLimits, preset_gains
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

ONES = (1.0,) * 7


def test_the_vendor_preset_is_the_vendors() -> None:
    """Protects the starting preset: the table of WAM reference 5.4, row by row."""
    gains = preset_gains("libbarrett")
    assert gains.kp == (900, 2500, 600, 500, 50, 50, 8)
    assert gains.ki == (2.5, 5, 2, 0.5, 0.5, 0.5, 0.1)
    assert gains.kd == (10, 20, 5, 2, 0.5, 0.5, 0.05)
    assert gains.feedback_limit_Nm == (25, 20, 15, 15, 5, 5, 5)
    assert not gains.scaled_by_inertia


def test_rows_replace_those_of_a_preset_of_their_kind() -> None:
    """Protects configured gains from being taken for accelerations."""
    rows = (10.0,) * 7
    assert preset_gains("libbarrett", kp_Nm_per_rad=rows).kd == LIBBARRETT_GAINS.kd
    assert not preset_gains("stiff", kp_Nm_per_rad=rows, ki_Nm_per_rad_s=rows, kd_Nms_per_rad=rows).scaled_by_inertia
    assert preset_gains("stiff") is STIFF_GAINS
    with pytest.raises(InputError, match="accelerations"):
        preset_gains("stiff", kp_Nm_per_rad=rows)
    with pytest.raises(InputError, match="libbarrett"):
        preset_gains("soft")


def test_torque_limits_can_be_lowered_but_not_raised() -> None:
    """Protects the motors from a configuration that asks for more than they give."""
    parameters = load_wam_parameters()
    own = TorqueLimits.from_parameters(parameters)
    assert own.torque_Nm == (60.0, 60.0, 45.0, 28.8, 10.0, 10.0, 1.36)
    assert own.rate_Nm_per_s[0] == pytest.approx(3000.0)
    wanted = TorqueLimits.from_parameters(parameters, torque_Nm=(20.0,) * 7, rate_Nm_per_s=(50.0,) * 7)
    assert wanted.torque_Nm == (20.0, 20.0, 20.0, 20.0, 10.0, 10.0, 1.36)
    assert wanted.rate_Nm_per_s == (50.0,) * 7


@pytest.mark.parametrize("row", [(1.0,) * 6, (nan,) * 7, (-1.0,) * 7, (inf,) * 7])
def test_rows_that_are_none_are_refused(row: tuple[float, ...]) -> None:
    """Protects the control from gains of another length, and from what is no number."""
    with pytest.raises(InputError, match="kp"):
        JointGains(row, ONES, ONES, ONES, scaled_by_inertia=False)
    with pytest.raises(InputError, match="torque_Nm"):
        TorqueLimits(row, ONES)
    with pytest.raises(InputError, match="rate_Nm_per_s"):
        TorqueLimits.from_parameters(load_wam_parameters(), rate_Nm_per_s=row)
    with pytest.raises(InputError, match="rate_Nm_per_s"):
        TorqueLimits(ONES, (0.0,) * 7)
