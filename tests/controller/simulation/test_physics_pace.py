"""The pace of the simulated physics against what an active arm may do between two torques, with physics that count."""

from __future__ import annotations

import hypothesis.strategies as st
import pytest
from hypothesis import given

from controller.simulation.physics_pace import LONGEST_STEP_NS, PATIENCE_NS, PhysicsPace

REACH_NS = 3_000_000


class Counting:
    """Physics without steps: what was lived through, and what was passed over."""

    def __init__(self) -> None:
        self.time_ns = self.lived_ns = 0

    def advance_to(self, now_ns: int) -> None:
        self.lived_ns += max(0, now_ns - self.time_ns)
        self.time_ns = max(self.time_ns, now_ns)

    def pass_over(self, duration_ns: int) -> None:
        assert duration_ns > 0
        self.time_ns += duration_ns


class Arm:
    """When its torques came."""

    def __init__(self, torque_ns: int | None = None) -> None:
        self.torque_ns = torque_ns


def paced(torque_ns: int | None = None) -> tuple[Counting, Arm, PhysicsPace]:
    physics, arm = Counting(), Arm(torque_ns)
    return physics, arm, PhysicsPace(physics, lambda: arm.torque_ns, REACH_NS)


@given(st.lists(st.tuples(st.integers(0, 40_000_000), st.booleans()), max_size=60))
def test_an_arm_never_moves_far_under_the_same_torques(turns: list[tuple[int, bool]]) -> None:
    """Whatever the machine does: the physics keeps to the clock, and lives through no more than its reach a torque."""
    physics, arm, pace = paced(0)
    now_ns = torques = 0
    since_ns = 0
    for passed_ns, commanded in turns:
        now_ns += passed_ns
        pace.advance_to(now_ns)
        assert physics.time_ns == now_ns
        assert arm.torque_ns is not None
        if now_ns - arm.torque_ns < PATIENCE_NS:
            assert physics.lived_ns - since_ns <= REACH_NS
        if commanded:
            arm.torque_ns, torques, since_ns = now_ns, torques + 1, physics.lived_ns


@given(st.lists(st.integers(1, REACH_NS), max_size=60))
def test_a_controller_in_time_sees_real_time(periods_ns: list[int]) -> None:
    """Nothing is passed over while torques come in time."""
    physics, arm, pace = paced(0)
    now_ns = 0
    for period_ns in periods_ns:
        now_ns += period_ns
        pace.advance_to(now_ns)
        arm.torque_ns = now_ns
    assert physics.lived_ns == now_ns


def test_a_dead_controller_is_not_waited_for_for_ever() -> None:
    """After the patience the arm does what a real one does without torques."""
    physics, _, pace = paced(0)
    for now_ns in range(0, 2 * PATIENCE_NS, 1_000_000):
        pace.advance_to(now_ns)
    assert physics.lived_ns == pytest.approx(REACH_NS + PATIENCE_NS, abs=2_000_000)


def test_an_idle_arm_waits_for_nobody_but_does_not_race() -> None:
    """Without torques real time counts; what a stall took is not caught up, while which devices would not answer."""
    physics, _, pace = paced()
    for now_ns in range(0, 50_000_000, 1_000_000):
        pace.advance_to(now_ns)
    assert physics.lived_ns == 49_000_000
    pace.advance_to(149_000_000)
    assert physics.lived_ns == 49_000_000 + LONGEST_STEP_NS
    assert physics.time_ns == 149_000_000
