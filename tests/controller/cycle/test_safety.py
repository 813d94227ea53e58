"""What ends a motion: each reason at its band, and none below it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.compensation import STILL, PlanarMotion
from controller.cycle.safety import SafetyLimits, SafetyMonitor, attention, governor
from controller.messages import HandFault, Reason

LIMITS = SafetyLimits()
PERIOD_S = 0.002


@pytest.fixture
def monitor() -> SafetyMonitor:
    return SafetyMonitor(LIMITS, PERIOD_S)


def at(x: float, y: float = 0.0, angle: float = 0.0) -> PlanarMotion:
    return PlanarMotion((x, y, angle), STILL.rate, STILL.acceleration)


def test_missing_replies_count_only_in_a_row(monitor: SafetyMonitor) -> None:
    """A lost frame now and then is no fault; an arm that stays silent is."""
    for _ in range(3):
        assert {monitor.replies(False) for _ in range(LIMITS.silent_cycles - 1)} == {Reason.NONE}
        assert monitor.replies(True) is Reason.NONE
    silent = [monitor.replies(False) for _ in range(LIMITS.silent_cycles)]
    assert silent == [Reason.NONE] * (LIMITS.silent_cycles - 1) + [Reason.ARM_SILENT]


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_each_joint_has_its_tracking_band(monitor: SafetyMonitor, joint: int, sign: float) -> None:
    """A blocked joint is seen, whichever it is and whichever way it lags."""
    command = np.linspace(-1.0, 1.0, 7)
    measured = command.copy()
    measured[joint] += sign * 0.999 * LIMITS.tracking_error_rad[joint]
    assert monitor.tracking(measured, command) is Reason.NONE
    measured[joint] = command[joint] + sign * 1.001 * LIMITS.tracking_error_rad[joint]
    assert monitor.tracking(measured, command) is Reason.TRACKING_ERROR


@pytest.mark.parametrize("joint", range(7))
def test_a_collision_is_a_residual_that_lasts(monitor: SafetyMonitor, joint: int) -> None:
    """20 ms above the band in one joint is a collision; shorter, or spread over joints, it is not."""
    cycles = round(LIMITS.residual_time_s / PERIOD_S)
    over, other = np.zeros(7), np.zeros(7)
    over[joint] = -1.01 * LIMITS.torque_residual_Nm[joint]
    other[(joint + 1) % 7] = 1.01 * LIMITS.torque_residual_Nm[(joint + 1) % 7]
    for residual in (over, other, np.zeros(7)):
        assert {monitor.residual(residual) for _ in range(cycles - 1)} == {Reason.NONE}
    assert [monitor.residual(over) for _ in range(cycles)][-2:] == [Reason.NONE, Reason.COLLISION]
    monitor.reset()
    assert monitor.residual(over) is Reason.NONE


@pytest.mark.parametrize(
    ("age_s", "fault", "reason"),
    [
        (0.0, HandFault.NONE, Reason.NONE),
        (LIMITS.hand_age_s, HandFault.NONE, Reason.NONE),
        (LIMITS.hand_age_s + 0.001, HandFault.NONE, Reason.HAND_SILENT),
        (None, HandFault.NONE, Reason.HAND_SILENT),
        (0.0, HandFault.NO_REPLY, Reason.HAND_SILENT),
        (0.0, HandFault.BUS_LOST, Reason.HAND_BUS_LOST),
        (0.0, HandFault.OTHER_MODE | HandFault.REFUSED, Reason.HAND_OTHER_MODE),
        (0.0, HandFault.HARDWARE | HandFault.VOLTAGE, Reason.HAND_VOLTAGE),
        (0.0, HandFault.TORQUE_LOST | HandFault.RESTARTED, Reason.HAND_RESTARTED),
        (0.0, HandFault.HARDWARE | HandFault.TORQUE_LOST | HandFault.OVERLOADED, Reason.HAND_OVERLOADED),
        (0.0, HandFault.HARDWARE | HandFault.TORQUE_LOST | HandFault.OVERHEATED, Reason.HAND_OVERHEATED),
        (0.0, HandFault.NO_REPLY | HandFault.ONE_SILENT, Reason.HAND_MOTOR_SILENT),
        (0.0, HandFault.NO_REPLY | HandFault.HARDWARE | HandFault.VOLTAGE, Reason.HAND_SILENT),
        (0.0, HandFault.REFUSED, Reason.HAND_REFUSED),
        (0.0, HandFault.HARDWARE, Reason.HAND_HARDWARE),
        (0.0, HandFault.HARDWARE | HandFault.TORQUE_LOST, Reason.HAND_TORQUE_LOST),
        (1.0, HandFault.TORQUE_LOST, Reason.HAND_TORQUE_LOST),
    ],
)
def test_the_worst_of_the_hand_is_named(
    monitor: SafetyMonitor, age_s: float | None, fault: HandFault, reason: Reason
) -> None:
    """The operator hears first what may have dropped the object, and of silence only when nothing is known."""
    assert monitor.hand(age_s, fault) is reason


@pytest.mark.parametrize(
    ("target", "offset", "reason"),
    [
        (at(0.0), at(0.0), Reason.NONE),
        (at(0.0, -0.999 * LIMITS.offset_m), at(0.0, -0.999 * LIMITS.offset_m), Reason.NONE),
        (at(0.8 * LIMITS.offset_m, 0.8 * LIMITS.offset_m), at(0.8 * LIMITS.offset_m, 0.8 * LIMITS.offset_m), None),
        (at(0.0, 0.0, -1.001 * LIMITS.offset_rad), at(0.0, 0.0, -1.001 * LIMITS.offset_rad), None),
        (at(0.01), at(0.01, 1.01 * LIMITS.offset_lag_m), Reason.OFFSET_LAG),
        (at(0.01), at(0.01, 0.99 * LIMITS.offset_lag_m), Reason.NONE),
    ],
)
def test_offset_has_a_size_and_a_lag(
    monitor: SafetyMonitor, target: PlanarMotion, offset: PlanarMotion, reason: Reason | None
) -> None:
    """A table that does not belong to the hand, or an arm that cannot follow, ends the squeeze."""
    assert monitor.offset(target, offset) is (reason if reason is not None else Reason.OFFSET_LIMIT)


lags = st.floats(0.0, 2e-3)
scales = st.floats(0.0, 1.0)
speeds = st.floats(0.0, 1.0)


@given(lags, lags, scales, scales, speeds, speeds)
def test_governor_never_gives_more_for_less(
    lag: float, more_lag: float, scale: float, more_scale: float, speed: float, more_speed: float
) -> None:
    """Winding never speeds up because the arm falls behind, saturates, or would have to go faster."""
    lag, more_lag = sorted((lag, more_lag))
    scale, more_scale = sorted((scale, more_scale))
    speed, more_speed = sorted((speed, more_speed))
    best = governor(lag, more_scale, speed, 0.06)
    worst = governor(more_lag, scale, more_speed, 0.06)
    assert 0.0 <= worst <= best <= 1.0
    assert worst * more_speed <= 0.06 + 1e-12


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_what_is_not_seen_is_not_moved_on(age_s: float, older_s: float) -> None:
    """Full pace on samples of 25 ms, none on samples of 50 ms, and never more on older ones."""
    age_s, older_s = sorted((age_s, older_s))
    assert 0.0 <= attention(older_s) <= attention(age_s) <= 1.0
    assert attention(0.0065) == attention(0.025) == 1.0
    assert attention(0.05) == attention(10.0) == 0.0


def test_governor_stops_winding_at_a_millimetre() -> None:
    """Free within 0.3 mm, stopped from 1 mm of offset error on (design 4)."""
    assert governor(3e-4, 1.0, 0.0, 0.06) == 1.0
    assert governor(6.5e-4, 1.0, 0.0, 0.06) == pytest.approx(0.5)
    assert governor(1e-3, 1.0, 0.0, 0.06) == 0.0
    assert governor(0.0, 1.0, 0.12, 0.06) == pytest.approx(0.5)
