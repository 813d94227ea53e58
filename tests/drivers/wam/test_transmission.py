"""Transmission against the reference's formulas and worked rows (5.2), and power balance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wam.parameters import load_wam_parameters
from drivers.wam.transmission import joint_to_motor, joint_to_motor_torque, motor_to_joint, motor_to_joint_torque

_SEVEN = st.lists(st.floats(-100, 100), min_size=7, max_size=7).map(np.array)


@pytest.mark.parametrize(
    ("joint_rad", "counts"),
    [
        ([0, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0]),
        ([0, -2, 0, 3.13, 0, 0, 0], [0, -36833, 36832, -36728, 0, 0, 0]),
        ([0.5, 0, 0, 0, 0, 0, 0], [-13690, 0, 0, 0, 0, 0, 0]),
        ([0, 0.3, -0.4, 0, 0, 0, 0], [0, 9909, -1141, 0, 0, 0, 0]),
        ([0, 0, 0, 0, 0.7, -0.2, 0], [0, 0, 0, 0, 5691, 3161, 0]),
        ([-1.1, 0.9, 1.3, 2.2, -2.5, 0.6, -0.8], [30117, 2323, -30826, -25816, -19603, -12015, 7786]),
    ],
)
def test_angles_of_the_reference(joint_rad: list[float], counts: list[int]) -> None:
    """Protects signs, ratios and the two differentials."""
    motor_rad = joint_to_motor(np.array(joint_rad, dtype=float))
    assert np.floor(4096 / (2 * np.pi) * motor_rad).tolist() == counts


@pytest.mark.parametrize(
    ("torque_Nm", "units"),
    [
        ([1, 0, 0, 0, 0, 0, 0], [-65, 0, 0, 0, 0, 0, 0]),
        ([0, 10, 0, 0, 0, 0, 0], [0, 477, -478, 0, 0, 0, 0]),
        ([0, 0, 5, 0, 0, 0, 0], [0, -402, -402, 0, 0, 0, 0]),
        ([2, -3, 4, 5, 0.5, -0.6, 0.1], [-129, -465, -178, -750, 368, -34, -118]),
        ([0, 17.3353, 0.054964, -4.05599, -0.056463, -0.126301, 4.9e-05], [0, 823, -833, 608, 23, -62, -1]),
    ],
)
def test_torques_of_the_reference(torque_Nm: list[float], units: list[int]) -> None:
    """Protects that each motor gets its share of a joint's torque."""
    motor_Nm = joint_to_motor_torque(np.array(torque_Nm, dtype=float))
    assert np.floor(load_wam_parameters().units_per_Nm * motor_Nm).tolist() == units


@given(_SEVEN)
def test_torque_follows_the_published_formulas(tau: np.ndarray) -> None:
    """Protects the matrices with the older source's formulas, whose ratio N3/n3 differs in the seventh digit."""
    N1, N2, N3, N4, N5, N7, n3 = 42.0, 28.25, 28.25, 18.0, 9.7, 14.93, 1.68
    expected = [
        -tau[0] / N1,
        tau[1] / (2 * N2) - n3 * tau[2] / (2 * N3),
        -tau[1] / (2 * N2) - n3 * tau[2] / (2 * N3),
        -tau[3] / N4,
        (tau[4] - tau[5]) / (2 * N5),
        (tau[4] + tau[5]) / (2 * N5),
        -tau[6] / N7,
    ]
    np.testing.assert_allclose(joint_to_motor_torque(tau), expected, rtol=2e-6, atol=1e-5)


@given(_SEVEN, _SEVEN)
def test_inverses_and_power_balance(angle: np.ndarray, torque: np.ndarray) -> None:
    """Law: there and back is the identity, and the motors' power is the joints'."""
    np.testing.assert_allclose(motor_to_joint(joint_to_motor(angle)), angle, atol=1e-9)
    np.testing.assert_allclose(motor_to_joint_torque(joint_to_motor_torque(torque)), torque, atol=1e-9)
    power = joint_to_motor_torque(torque) @ joint_to_motor(angle)
    assert power == pytest.approx(torque @ angle, abs=1e-6)
