"""The gravity fit in front of another arm: Pinocchio's, with other masses, friction and noise."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration.gravity import ACCEPTED_RMS_NM, GravityFit, fit_gravity, gravity_torque
from calibration.gravity_plan import POSES_RAD, Balanced, GravityPlan, HeldPose, averaged, balanced
from drivers.errors import InputError

Array = npt.NDArray[np.float64]

G = 9.81
LEVEL = np.array([0.0, 0.0, -G])
COULOMB = np.array([1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05])
# Torque noise of one sample: 20 puck units of each motor at the joint (WAM reference 5.2, IPNM).
NOISE_NM = np.array([0.3, 0.4, 0.25, 0.13, 0.04, 0.04, 0.02])
LIMIT_NM = np.array([60.0, 60.0, 45.0, 28.8, 10.0, 10.0, 1.36])
NO_MU = np.zeros((7, 3))
RANDOM_POSES = np.random.default_rng(5).uniform(
    [-2.5, -1.9, -2.7, -0.8, -4.5, -1.5, -2.9], [2.5, 1.9, 2.7, 3.0, 1.2, 1.5, 2.9], (200, 7)
)


class OtherArm:
    """Gravity of the arm's URDF by Pinocchio, each mass off by up to a tenth and each centre of mass by up to 2 cm."""

    def __init__(self, seed: int, gravity: Array = LEVEL) -> None:
        random = np.random.default_rng(seed)
        self._model: Any = pinocchio.buildModelFromXML((files("drivers.wam") / "wam7.urdf").read_text(encoding="utf-8"))
        self._model.gravity.linear = gravity
        for joint in range(1, 8):
            inertia = self._model.inertias[joint]
            lever = inertia.lever + random.uniform(-0.02, 0.02, 3)
            self._model.inertias[joint] = pinocchio.Inertia(inertia.mass * random.uniform(0.9, 1.1), lever, np.eye(3))
        self._data = self._model.createData()

    def gravity(self, q: Array) -> Array:
        return np.array([pinocchio.computeGeneralizedGravity(self._model, self._data, angles) for angles in q])


def measured(arm: OtherArm, seed: int, plan: GravityPlan | None = None) -> list[HeldPose]:
    """What would be sampled: the arm's torques with friction of uneven size against each approach, and noise."""
    random = np.random.default_rng(seed)
    held = []
    for approach in (plan or GravityPlan()).approaches():
        q = np.array(approach.pose_rad) + random.normal(0.0, 2e-4, 7)
        friction = -approach.side * COULOMB * random.uniform(0.9, 1.1, 7)
        samples = arm.gravity(q[None])[0] + friction + random.normal(0.0, 1.0, (400, 7)) * NOISE_NM
        held.append(averaged(approach, [q.tolist()] * 400, samples.tolist()))
    return held


def fitted(arm: OtherArm, seed: int, gravity: Array = LEVEL) -> GravityFit:
    return fit_gravity(balanced(GravityPlan(), measured(arm, seed), LIMIT_NM), gravity, NO_MU)


@pytest.mark.parametrize("seed", range(4))
def test_an_exact_arm_is_found_to_the_ridge(seed: int) -> None:
    """Protects the fit itself: without friction and noise nine poses tell the torques of every pose."""
    arm = OtherArm(seed)
    q = np.array(POSES_RAD)
    fit = fit_gravity(Balanced(q, arm.gravity(q), np.zeros((9, 7))), LEVEL, NO_MU)
    np.testing.assert_allclose(gravity_torque(fit.mu_kg_m, RANDOM_POSES, LEVEL), arm.gravity(RANDOM_POSES), atol=2e-4)


@pytest.mark.parametrize("seed", range(4))
def test_friction_cancels_and_other_poses_are_met_as_well_as_the_measured(seed: int) -> None:
    """Protects the aim: with 1.5 N·m of friction the model is right to a tenth of it in poses it has never seen, and
    the residual it reports is of that size."""
    arm = OtherArm(seed)
    fit = fitted(arm, seed)
    errors = np.sqrt(
        np.mean((gravity_torque(fit.mu_kg_m, RANDOM_POSES, LEVEL) - arm.gravity(RANDOM_POSES)) ** 2, axis=0)
    )
    assert (errors < 0.15 * COULOMB + 0.01).all()
    assert (fit.rms_Nm < 0.15 * COULOMB).all()
    assert fit.refused_joints() == ()
    np.testing.assert_allclose(fit.friction_Nm, COULOMB, rtol=0.1)


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))
def test_the_base_may_be_tilted(roll: float, pitch: float) -> None:
    """Protects arms on a slanted base: gravity is turned, and joint 1, which then carries weight, is identified too."""
    gravity = np.asarray(Rotation.from_euler("xy", [roll, pitch]).apply(LEVEL), np.float64)
    arm, q = OtherArm(3, gravity), np.array(POSES_RAD)
    fit = fit_gravity(Balanced(q, arm.gravity(q), np.zeros((9, 7))), gravity, NO_MU)
    error = gravity_torque(fit.mu_kg_m, RANDOM_POSES, gravity) - arm.gravity(RANDOM_POSES)
    assert np.abs(error).max() < 2e-3


def test_what_hangs_on_the_flange_is_taken_off() -> None:
    """Protects the bare arm's vectors from the hand's weight, which the arm model adds by itself."""
    arm, q = OtherArm(1), np.array(POSES_RAD)
    carried = np.random.default_rng(0).normal(size=(9, 7))
    bare = fit_gravity(Balanced(q, arm.gravity(q), np.zeros((9, 7))), LEVEL, NO_MU)
    loaded = fit_gravity(Balanced(q, arm.gravity(q) + carried, np.zeros((9, 7))), LEVEL, NO_MU, carried)
    np.testing.assert_allclose(loaded.mu_kg_m, bare.mu_kg_m, rtol=0, atol=1e-9)


def test_what_is_not_told_stays_as_it_was_known() -> None:
    """Protects a known arm from being forgotten: data that it explains change nothing of it."""
    arm, q = OtherArm(1), np.array(POSES_RAD)
    known = fitted(arm, 0).mu_kg_m
    fit = fit_gravity(Balanced(q, gravity_torque(known, q, LEVEL), np.zeros((9, 7))), LEVEL, known)
    np.testing.assert_allclose(fit.mu_kg_m, known, rtol=0, atol=1e-9)


def test_an_arm_that_is_not_gravitys_alone_is_not_accepted() -> None:
    """Protects the arm's file from a run in which a cable pulled: the joint and its worst pose are named."""
    held = measured(OtherArm(0), 0)
    torque = held[8].torque_Nm.copy()
    torque[1] += 8.0
    held[8] = HeldPose(4, 1, held[8].joint_rad, torque, held[8].range_rad, 400)
    fit = fit_gravity(balanced(GravityPlan(), held, LIMIT_NM), LEVEL, NO_MU)
    assert 1 in fit.refused_joints()
    assert fit.worst_pose[1] == 4
    assert len(ACCEPTED_RMS_NM) == 7


def test_poses_that_are_all_alike_are_refused() -> None:
    """Protects from vectors that fit nine times the same torque and nothing else."""
    q = np.array(POSES_RAD)[[0] * 9]
    with pytest.raises(InputError, match="poses as different"):
        fit_gravity(Balanced(q, OtherArm(0).gravity(q), np.zeros((9, 7))), LEVEL, NO_MU)
    with pytest.raises(InputError, match="poses as different"):
        fit_gravity(Balanced(q[:1], OtherArm(0).gravity(q[:1]), np.zeros((1, 7))), LEVEL, NO_MU)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_none_are_refused(bad: float) -> None:
    """Protects the arm's file from NaN."""
    q, torque = np.array(POSES_RAD), np.zeros((9, 7))
    torque[3, 2] = bad
    with pytest.raises(InputError, match="not finite"):
        fit_gravity(Balanced(q, torque, np.zeros((9, 7))), LEVEL, NO_MU)
    with pytest.raises(InputError, match="expected poses and torques"):
        fit_gravity(Balanced(q, torque[:, :6], np.zeros((9, 7))), LEVEL, NO_MU)
