"""Which joint encoders are used: fitted, wanted and indexed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.simulated.arm_faults import SetProperty
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.simple_arm import SimpleArm
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm
from drivers.wam.parameters import load_wam_parameters

PARAMETERS = load_wam_parameters()
JOINT_RAD = np.array([0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4])


@pytest.mark.parametrize("wanted", [False, True])
def test_joint_encoders_are_used_when_wanted(wanted: bool) -> None:
    """Protects the default, motors' encoders (reference 5.1), and the resolution of those that have better ones."""
    clock = VirtualClock()
    parameters = replace(PARAMETERS, use_joint_encoders=wanted)
    wam = SimulatedWam(SimpleArm(PARAMETERS, JOINT_RAD), PARAMETERS, zeroed=True, joint_encoders=True)
    hub = MemoryCanHub([wam])
    wam.begin_fault(SetProperty(node=2, name="ECMIN", value=0), 0)
    wam.begin_fault(SetProperty(node=2, name="ECMAX", value=0), 0)
    arm = Arm(MemoryCanBus(hub, clock), clock, parameters)
    notes = arm.start().notes
    assert any("joint 2 has not passed its index" in note for note in notes) == wanted
    clock.advance_to_ns(clock.now_ns() + 2_000_000)
    arm.request_positions()
    sample = arm.collect_positions(clock.now_ns() + 1_500_000)
    assert sample.complete
    error_rad = np.abs(sample.joint_rad - JOINT_RAD)
    assert np.all(error_rad < 2e-4)
    # Half a count of the joint encoders is 2, 5 and 10 µrad (reference 5.1), of the motors ten times that (5.4).
    fine = error_rad[[0, 2, 3]] <= np.array([2e-6, 5e-6, 1e-5])
    assert bool(np.all(fine)) == wanted
