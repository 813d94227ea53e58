"""The simple arm against a numerical integration, and the driver in front of it for five seconds, twice."""

from __future__ import annotations

import hashlib
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.bench_can import ArmRig
from drivers.errors import InputError
from drivers.simulated.can_fault_actions import Corrupt, Drop
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.simple_arm import BRAKING_NMS_PER_RAD, LINK_INERTIA_KGM2, SimpleArm
from drivers.wam.parameters import load_wam_parameters

PARAMETERS = load_wam_parameters()
MS = 1_000_000
Array = NDArray[np.float64]


def _turning(torque: Array, damping: Array, inertia: Array, _: float, state: Array) -> Array:
    """Time derivative of angles and speeds."""
    return np.concatenate([state[7:], (torque - damping * state[7:]) / inertia])


def test_motion_is_that_of_the_equation() -> None:
    """Protects the exact solution: torques that change, then braking, against scipy's Runge-Kutta of J v' = τ − b v."""
    arm = SimpleArm(PARAMETERS, np.zeros(7))
    first, second = np.linspace(-3, 3, 7), np.linspace(1, 0.1, 7)
    arm.set_joint_torque_Nm(first, False, 0)
    arm.set_joint_torque_Nm(second, False, 30 * MS)
    arm.set_joint_torque_Nm(np.zeros(7), True, 70 * MS)
    for now_ns in (1, 12 * MS, 31 * MS, 100 * MS):
        arm.advance_to(now_ns)
    inertia = np.array(LINK_INERTIA_KGM2) + PARAMETERS.rotor_inertia_kgm2
    viscous = PARAMETERS.viscous_friction_Nms_per_rad
    state = np.zeros(14)
    for torque, damping, duration_s in (
        (first, viscous, 0.03),
        (second, viscous, 0.04),
        (np.zeros(7), viscous + np.array(BRAKING_NMS_PER_RAD), 0.03),
    ):
        solution = solve_ivp(
            partial(_turning, torque, damping, inertia),
            (0, duration_s),
            state,
            method="LSODA",
            rtol=1e-10,
            atol=1e-13,
        )
        state = solution.y[:, -1]
    np.testing.assert_allclose(arm.joint_position_rad(), state[:7], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(arm.joint_rad_s, state[7:], rtol=1e-5, atol=1e-9)


def test_weight_is_held_by_its_own_torque() -> None:
    """Protects rigs with gravity: the torque that the model gives holds the arm, and without it joint 2 falls."""

    def gravity_Nm(joint_rad: Array) -> Array:
        weight: Array = -20.0 * np.sin(joint_rad[1]) * np.eye(7)[1]
        return weight

    start = 0.5 * np.eye(7)[1]
    held = SimpleArm(PARAMETERS, start, gravity_Nm=gravity_Nm)
    held.set_joint_torque_Nm(gravity_Nm(start), False, 0)
    falling = SimpleArm(PARAMETERS, start, gravity_Nm=gravity_Nm)
    falling.set_joint_torque_Nm(np.zeros(7), False, 0)
    for arm in (held, falling):
        arm.advance_to(200 * MS)
    np.testing.assert_allclose(held.joint_position_rad(), start, atol=1e-12)
    assert falling.joint_position_rad()[1] > 0.6
    with pytest.raises(InputError, match="seven finite"):
        SimpleArm(PARAMETERS, [0.0] * 6)


def _digest(script: FaultScript[Any], seconds: float) -> str:
    """All that the driver saw and the arm did, cycle by cycle."""
    rig, digest = ArmRig(script), hashlib.sha256()
    for sample in rig.run(seconds):
        digest.update(sample.joint_rad.tobytes() + bytes((sample.replies, sample.rejected)))
    digest.update(repr((rig.clock.now_ns(), sorted(rig.wam.heard.items()))).encode())
    return digest.hexdigest()


@pytest.mark.slow
def test_five_seconds_are_the_same_twice() -> None:
    """Protects system tests: driver and simulated arm at 500 Hz, with seeded loss, give the same to the bit."""
    faults: tuple[Fault[Any], ...] = (
        Fault(action=Drop(), on="active", for_s=10.0, chance=0.01),
        Fault(action=Corrupt(), on="active", for_s=10.0, chance=0.005),
    )
    script: FaultScript[Any] = FaultScript(seed=3, faults=faults)
    assert _digest(script, 5.0) == _digest(script, 5.0)
