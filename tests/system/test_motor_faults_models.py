"""The fault matrix of the tendon motors, like `test_motor_faults.py`: with motors of protocol 1.0, and
with motors of protocol 2.0 that tell their load."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.simulated.faults import Fault
from drivers.simulated.serial_fault_actions import Supply
from tests.system.forked import in_a_fork
from tests.system.motor_fault_cases import CASES
from tests.system.motor_fault_matrix import XM, Case
from tests.system.motor_fault_runs import RobotIn, entries, live_through

pytestmark = pytest.mark.slow
OTHERS = sorted({case.model for case in CASES} - {XM})


@pytest.mark.parametrize(("case", "phase"), entries(OTHERS, ("start-up", "squeezing", "holding")))
def test_fault(case: Case, phase: str, robot_in: RobotIn) -> None:
    """Protects the object, the fingers in the hand, and the operator who reads what happened."""
    live_through(case, phase, robot_in)


@pytest.mark.parametrize(("volts", "code"), [(12.0, None), (7.5, "wound_short")])
def test_a_squeeze_that_ends_short_says_so(robot_in: RobotIn, volts: float, code: str | None) -> None:
    """A supply that sags within its range is no fault, but what was wound is not what was asked for."""
    robot, _ = robot_in("XL430-W250", "squeezing")

    def squeezed() -> tuple[Any, float]:
        robot.virtual.add_motor_fault(Fault(action=Supply(volts=volts)))
        done = robot.squeeze.wait()
        applied, desired = (done[what]["mean_excursion_m"] for what in ("applied", "desired"))
        return done.get("reason", {}).get("code"), applied - desired

    told, beyond_m = in_a_fork(squeezed)
    assert told == code
    assert (beyond_m < -1e-4) == (code is not None)
