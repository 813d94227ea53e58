"""Gravity vectors in the arm model: the vendor's table, the masses' own vectors, and what mu must leave alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from controller.cycle.arm_model import GRAVITY_M_S2, ArmModel, Payload
from drivers.errors import InputError
from drivers.wam.parameters import load_wam_parameters

Array = npt.NDArray[np.float64]

# WAM reference 6.6, the vendor's default mu with its g, and the torques its own C code gives with them.
VENDOR_G = 9.805
VENDOR_MU = np.array(
    [
        [-0.4619813284, -8.777142616e-19, -0.0001650712715],
        [0.09324682625, -0.1429915845, 2.3827622],
        [0.09102604107, 0.1774000857, 0.1094180014],
        [-0.1263857613, -0.05701896802, 0.5415280943],
        [0.002226522425, 0.01362529161, -0.00101195702],
        [-0.0008998072939, -0.00499246526, 0.02592270061],
        [-3.960032732e-05, -7.543236065e-05, 1.303052607e-05],
    ]
)
VENDOR_ROWS = [
    ([0, 0, 0, 0, 0, 0, 0], [0, -0.580203, 0, 1.226592, 0, 0.009211, 0]),
    ([0, -2, 0, 3.13, 0, 0, 0], [0, 16.026183, -0.412966, -4.387970, -0.053915, -0.226062, -0.000669]),
    ([0, 1.5708, 0, 0, 0, 0, 0], [0, -27.053960, 0.454160, -5.430391, -0.059613, -0.254300, -0.000740]),
    (
        [0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4],
        [0, 10.656346, -2.521550, -2.646968, -0.096337, -0.018660, 0.000380],
    ),
    ([-1.2, 1.1, -0.5, 2.4, 0.8, -1.1, 2], [0, -19.261440, -2.076496, 0.270564, 0.095502, -0.211446, -0.000447]),
]
# 6.6, mu worked out from the masses.
MU_OF_MASSES = [
    [-0.0477009, 1.3124750, -0.0071067],
    [-0.0091835, 0.1203544, 0.0597510],
    [0.1477712, -2.2748931, 0.0000541],
    [-0.1236000, 0.0001482, 0.2591485],
    [0.0000196, -0.2420683, 0.0005295],
    [-0.0000242, -0.0068989, 0.0098978],
    [0.0000112, 0.0000055, 0.0043439],
]
ALPHA = np.array([-1, 1, -1, 1, -1, 1, 0]) * np.pi / 2
angles = arrays(np.float64, 7, elements=st.floats(-2.5, 2.5, allow_subnormal=False))
vectors = arrays(np.float64, (7, 3), elements=st.floats(-3.0, 3.0, allow_subnormal=False))


def with_mu(mu: npt.ArrayLike, **more: Any) -> ArmModel:
    return ArmModel(parameters=replace(load_wam_parameters(), gravity_mu_kg_m=np.asarray(mu)), **more)


def law(mu: Array, q: Array, g_base: Array) -> Array:
    """The recursion of the reference as it stands, in numpy: t_j = g_j × mu_j + R t_{j+1}; τ_j is z in frame j − 1."""
    turns = [Rotation.from_euler("z", angle) * Rotation.from_euler("x", a) for angle, a in zip(q, ALPHA, strict=True)]
    g, gravity = g_base, []
    for turn in turns:
        g = turn.inv().apply(g)
        gravity.append(g)
    torque, t = np.zeros(7), np.zeros(3)
    for j in range(6, -1, -1):
        t = turns[j].apply(np.cross(gravity[j], mu[j]) + t)
        torque[j] = t[2]
    return torque


@pytest.mark.parametrize(("q", "torque"), VENDOR_ROWS)
def test_the_vendors_vectors_give_the_vendors_torques(q: list[float], torque: list[float]) -> None:
    """Protects frames, sign and order of mu against the reference's rows, to their last digit."""
    model = with_mu(VENDOR_MU * (VENDOR_G / GRAVITY_M_S2))
    np.testing.assert_allclose(model.gravity(q), torque, rtol=0, atol=6e-7)


def test_the_vectors_of_the_masses_are_the_printed_ones() -> None:
    """Protects mu from masses against the reference's table, to its last digit."""
    np.testing.assert_allclose(ArmModel().gravity_mu_kg_m, MU_OF_MASSES, rtol=0, atol=6e-8)


@settings(max_examples=40, deadline=None)
@given(angles, vectors, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_torques_follow_the_law_on_any_base(q: Array, mu: Array, roll: float, pitch: float) -> None:
    """Protects the use of 1 kg on a joint of no length: it is the recursion of the reference, on a tilted base too."""
    base = np.eye(4)
    base[:3, :3] = Rotation.from_euler("xy", [roll, pitch]).as_matrix()
    base[:3, 3] = 0.4, -0.3, 0.8
    g_base = base[:3, :3].T @ [0.0, 0.0, -GRAVITY_M_S2]
    model = with_mu(mu, T_world_base=base)
    np.testing.assert_allclose(model.gravity(q), law(mu, q, g_base), rtol=0, atol=1e-11)


@settings(max_examples=40, deadline=None)
@given(angles, angles, angles)
def test_vectors_of_the_masses_change_nothing(q: Array, v: Array, a: Array) -> None:
    """Protects the replacement: mu from masses gives the gravity of the masses to 1e-12."""
    by_masses = ArmModel()
    by_mu = with_mu(by_masses.gravity_mu_kg_m)
    np.testing.assert_allclose(by_mu.gravity(q), by_masses.gravity(q), rtol=0, atol=1e-12)
    expected = by_masses.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(by_mu.inverse_dynamics(q, v, a), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        law(np.array(by_mu.gravity_mu_kg_m), q, np.array([0, 0, -9.81])), by_mu.gravity(q), atol=1e-11
    )


@settings(max_examples=25, deadline=None)
@given(angles, angles, angles, vectors)
def test_only_gravity_is_replaced(q: Array, v: Array, a: Array, mu: Array) -> None:
    """Protects inertia and Coriolis terms: they stay those of the masses, in the feed-forward too."""
    model, by_masses = with_mu(mu), ArmModel()
    np.testing.assert_array_equal(model.mass_matrix(q), by_masses.mass_matrix(q))
    motion = by_masses.inverse_dynamics(q, v, a) - by_masses.gravity(q)
    np.testing.assert_allclose(model.inverse_dynamics(q, v, a) - model.gravity(q), motion, rtol=0, atol=1e-9)
    nothing = [0.0] * 7
    np.testing.assert_array_equal(
        model.feed_forward(q, v, a, nothing), model.inverse_dynamics(q, v, a) + model.friction(v, nothing)
    )


@settings(max_examples=25, deadline=None)
@given(angles, vectors, st.floats(0.0, 1.0))
def test_hand_and_object_are_added_from_their_masses(q: Array, mu: Array, fraction: float) -> None:
    """Protects what is on the flange: hand and object weigh on an identified arm what they weigh on a nominal one."""
    mount = np.eye(4)
    mount[:3, 3] = 0.01, 0.0, 0.08
    hand, thing = Payload(0.6, (0.0, -0.04, 0.0)), Payload(0.5, (0.0, 0.09, 0.0))
    weights = []
    for model_of in (lambda **more: with_mu(mu, **more), ArmModel):
        loaded = model_of(hand=hand, payload=thing, T_wrist_hand=mount)
        loaded.set_payload_fraction(fraction)
        weights.append(loaded.gravity(q) - model_of().gravity(q))
    np.testing.assert_allclose(weights[0], weights[1], rtol=0, atol=1e-11)


@pytest.mark.parametrize("mu", [np.zeros((6, 3)), np.full((7, 3), np.nan), np.zeros(21)])
def test_vectors_that_are_none_are_refused(mu: Array) -> None:
    """Protects the arm from torques of NaN."""
    with pytest.raises(InputError, match="gravity vectors"):
        with_mu(mu)
