"""The fault matrix of the tendon motors, like `test_motor_faults.py`: with motors of protocol 1.0, and
with motors of protocol 2.0 that tell their load."""

from __future__ import annotations

import pytest

from tests.system.motor_fault_cases import CASES
from tests.system.motor_fault_matrix import XM, Case
from tests.system.motor_fault_runs import RobotIn, entries, live_through

pytestmark = pytest.mark.slow
OTHERS = sorted({case.model for case in CASES} - {XM})


@pytest.mark.parametrize(("case", "phase"), entries(OTHERS, ("start-up", "squeezing", "holding")))
def test_fault(case: Case, phase: str, robot_in: RobotIn) -> None:
    """Protects the object, the fingers in the hand, and the operator who reads what happened."""
    live_through(case, phase, robot_in)
