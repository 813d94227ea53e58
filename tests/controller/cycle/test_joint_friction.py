"""Friction's direction: kept at rest, turned over within its displacement, whatever the speed."""

from __future__ import annotations

from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.joint_friction import FrictionDirection

speeds = st.lists(st.floats(-3.0, 3.0), min_size=7, max_size=7)


@given(st.lists(speeds, max_size=30))
def test_direction_stays_between_minus_one_and_one(motion: list[list[float]]) -> None:
    """Protects the arm from more friction torque than it has friction."""
    direction = FrictionDirection(2e-4)
    for velocity in motion:
        assert all(-1.0 <= z <= 1.0 for z in direction.step(velocity, 0.002))


def test_direction_is_kept_at_rest() -> None:
    """Protects the integral from taking friction over whenever the arm stops."""
    direction = FrictionDirection(2e-4)
    moving = list(direction.step([0.5] * 7, 0.01))
    assert direction.step([0.0] * 7, 10.0) == moving
    assert moving[0] > 0.99


@pytest.mark.parametrize("steps", [1, 10, 100])
def test_reversal_depends_on_displacement_alone(steps: int) -> None:
    """Protects slow motions: Dahl's law solved exactly, z = −1 + 2 exp(−x/δ) after a reversal, however it is cut up."""
    direction = FrictionDirection(2e-4)
    direction.values = [1.0] * 7
    for _ in range(steps):
        direction.step([-0.1] * 7, 0.003 / steps)
    assert direction.values[0] == pytest.approx(-1.0 + 2.0 * exp(-3e-4 / 2e-4), rel=1e-9)
