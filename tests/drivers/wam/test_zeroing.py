"""Zeroing on paper: the worked check of the WAM reference 4.4 and the laws behind it."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.errors import InputError
from drivers.wam.zeroing import has_absolute_encoder, plan_zeroing, wrapped, zero_angles

HOME = np.array([0.0, -2.0, 0.0, 3.13, 0.0, 0.0, 0.0])
TURNS = (4096,) * 7
NO_ANGLES = np.full(7, -1.0)
FIELD_ZERO = np.array([4.85505, 5.05293, 4.67251, 5.80305, 2.09388, 1.04924, 4.90260])
FIELD_HOME = np.array([-0.00102, -1.86447, -0.03521, 3.08424, -0.03819, 0.14122, -0.00688])
"""A real arm's calibration, reference 4.4."""


def motor_angles(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reference 5.2's formulas, written out: motor angles of joint angles, rad."""
    j1, j2, j3, j4, j5, j6, j7 = q
    second, third = 28.25 * j2, 16.8155 * j3
    return np.array(
        [-42 * j1, second - third, -second - third, -18 * j4, 9.7 * (j5 - j6), 9.7 * (j5 + j6), -14.93 * j7]
    )


def encoders(q: NDArray[np.float64], zero: NDArray[np.float64], turns: tuple[int, ...] = TURNS) -> list[int]:
    """What absolute encoders show at `q`: whole counts within a turn."""
    return [
        int(np.floor(angle * turn / (2 * pi))) % turn for angle, turn in zip(motor_angles(q) + zero, turns, strict=True)
    ]


def test_plain_zeroing_gives_the_reference_counts() -> None:
    """Protects home itself: the floored counts of reference 5.2, joint 4 beyond its limit of 3.1 included."""
    plan = plan_zeroing(HOME, TURNS, NO_ANGLES, (None,) * 7)
    assert plan.motor_counts == (0, -36833, 36832, -36728, 0, 0, 0)
    assert plan.corrected == ()
    np.testing.assert_array_equal(plan.joint_rad, HOME)


def test_worked_check_of_the_reference() -> None:
    """Protects sign and wrap: zero angles 0 and MECH_2 = 100 make e_2 = −0.104730, and joints 2 and 3 share it."""
    mechanical: list[int | None] = [None, 100, None, None, None, None, None]
    plan = plan_zeroing(HOME, TURNS, np.zeros(7), mechanical)
    assert plan.motor_error_rad[1] == pytest.approx(-0.104730, abs=5e-7)
    assert plan.corrected == (2,)
    # By hand: J2 = (M2 − M3) / (2 · 28.25), J3 = −(M2 + M3) · 1.68 / (2 · 28.25), both for M2 alone.
    assert plan.joint_rad[1] == pytest.approx(-2.0 + 0.104730 / 56.5, abs=1e-7)
    assert plan.joint_rad[2] == pytest.approx(-0.104730 * 1.68 / 56.5, abs=1e-7)
    assert plan.motor_counts[1] == 100 - 9 * 4096  # the encoder's count, nine turns back


@given(
    offsets=st.lists(st.floats(-0.035, 0.035), min_size=7, max_size=7),
    turn=st.sampled_from([4096, 40960]),
    home=st.sampled_from([tuple(HOME), tuple(FIELD_HOME)]),
    zero=st.lists(st.floats(0, 2 * pi, exclude_max=True), min_size=7, max_size=7),
)
def test_a_hand_placed_arm_is_found_where_it_is(
    offsets: list[float], turn: int, home: tuple[float, ...], zero: list[float]
) -> None:
    """Law: within 2° of home at every joint, the absolute encoders tell the true pose to a count or two."""
    true_rad, turns = np.array(home) + offsets, (turn,) * 7
    plan = plan_zeroing(np.array(home), turns, np.array(zero), encoders(true_rad, np.array(zero), turns))
    count = 2 * pi / turn
    np.testing.assert_allclose(motor_angles(plan.joint_rad), motor_angles(true_rad), atol=1.01 * count)
    np.testing.assert_allclose(np.array(plan.motor_counts) * count, motor_angles(true_rad), atol=2.01 * count)
    assert np.all(np.abs(plan.motor_error_rad) <= pi + 1e-12)


@pytest.mark.parametrize("angle", [-1.0, -0.001, 2 * pi + 0.001, 100.0])
def test_zero_angle_out_of_its_turn_means_plain(angle: float) -> None:
    """Protects arms whose calibration leaves a motor out: it is zeroed by home, its neighbours by their encoders."""
    zero = FIELD_ZERO.copy()
    zero[3] = angle
    true_rad = FIELD_HOME + 0.02
    plan = plan_zeroing(FIELD_HOME, TURNS, zero, encoders(true_rad, FIELD_ZERO))
    assert plan.corrected == (1, 2, 3, 5, 6, 7)
    assert plan.joint_rad[3] == FIELD_HOME[3]
    np.testing.assert_allclose(np.delete(plan.joint_rad, 3), np.delete(true_rad, 3), atol=3e-4)


@pytest.mark.parametrize(
    ("firmware", "role", "absolute"),
    [(118, 0x0100, True), (200, 0x01C0, True), (117, 0x01C0, False), (200, 0x00C0, False), (60, 0x0100, False)],
)
def test_who_has_an_absolute_encoder(firmware: int, role: int, absolute: bool) -> None:
    """Protects the rule of reference 4.4: version 118 and ROLE bit 0x0100."""
    assert has_absolute_encoder(firmware, role) is absolute


@given(st.lists(st.floats(0, 6.28), min_size=7, max_size=7), st.lists(st.floats(-3, 3), min_size=7, max_size=7))
def test_calibration_finds_the_angles_that_zeroing_uses(zero: list[float], pose: list[float]) -> None:
    """Law: zero angles read in any known pose make zeroing in that pose correct by nothing but rounding."""
    mechanical = encoders(np.array(pose), np.array(zero))
    found = zero_angles(np.array(pose), TURNS, mechanical)
    assert np.all((found >= 0) & (found < 2 * pi))
    assert np.all(np.abs(wrapped(found - zero)) <= 2 * pi / 4096 + 1e-9)
    plan = plan_zeroing(np.array(pose), TURNS, found, mechanical)
    assert np.all(np.abs(plan.motor_error_rad) < 1e-9)


def test_motors_without_encoder_get_no_zero_angle() -> None:
    """Protects later start-ups: such a motor is marked as unused in the file."""
    assert zero_angles(HOME, TURNS, [None, 5.0, *[None] * 5])[[0, 2, 6]].tolist() == [-1.0] * 3


def test_home_beyond_the_counter_is_refused() -> None:
    """Protects the 22-bit counter from a home that is no home."""
    with pytest.raises(InputError, match="home_rad"):
        plan_zeroing(np.full(7, 90.0), (40960,) * 7, NO_ANGLES, (None,) * 7)
