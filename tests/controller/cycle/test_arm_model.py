"""The arm model against the reference's printed rows and an arm written down again, in numpy, from its DH tables."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from controller.cycle.arm_model import ArmFriction, ArmModel, Payload
from drivers.errors import InputError

Array = npt.NDArray[np.float64]

# WAM reference 6.1: a, alpha, d.
DH = [(0, -1, 0), (0, 1, 0), (0.045, -1, 0.55), (-0.045, 1, 0), (0, -1, 0.3), (0, 1, 0), (0, 0, 0.0609)]
# 6.2: mass, centre of mass in the DH frame; 6.3: Lxx Lxy Lxz Lyy Lyz Lzz, products with the positive sign convention.
LINKS = [
    (10.7677, (-0.00443, 0.12189, -0.00066)),
    (3.8749, (-0.00237, 0.03106, 0.01542)),
    (1.8023, (-0.03826, 0.20751, 0.00003)),
    (2.17266212, (0.00553408, 0.00006822, 0.11927695)),
    (0.35655692, (0.00005483, 0.02886286, 0.00148493)),
    (0.40915886, (-0.00005923, -0.01686123, 0.02419052)),
    (0.07548270, (0.00014836, 0.00007252, -0.00335185)),
]
INERTIAS = [
    (0.13488033, -0.00213041, -0.00012485, 0.11328369, 0.00068555, 0.09046330),
    (0.02140958, 0.00027172, 0.00002461, 0.01377875, -0.00181920, 0.01558906),
    (0.05911077, -0.00249612, 0.00000738, 0.00324550, -0.00001767, 0.05927043),
    (0.01067491, 0.00004503, -0.00135557, 0.01058659, -0.00011002, 0.00282036),
    (0.00037112, -0.00000008, -0.00000003, 0.00019434, -0.00001613, 0.00038209),
    (0.00054889, 0.00000019, -0.00000010, 0.00023846, -0.00004430, 0.00045133),
    (0.00003911, 0.00000019, 0, 0.00003877, 0, 0.00007614),
]
ROTORS = np.array([0.201, 0.182, 0.067, 0.034, 0.0033224, 0.0033224, 0.000466939])

POSE_ROWS = [
    (
        [0, 0, 0, 0, 0, 0, 0],
        [
            [1, 0, 0, 0],
            [0, 1, 0, 0],
            [0, 0, 1, 0.9109],
        ],
    ),
    (
        [0, -2, 0, 3.13, 0, 0, 0],
        [
            [0.426659808, 0, 0.904412189, -0.211637525],
            [0, 1, 0, 0],
            [-0.904412189, 0, 0.426659808, 0.006717697],
        ],
    ),
    (
        [0, -1.5708, 0, 1.5708, 0, 0, 0],
        [
            [1, 0, 0, -0.595000165],
            [0, 1, 0, 0],
            [0, 0, 1, 0.40589798],
        ],
    ),
    (
        [0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4],
        [
            [0.356141827, 0.735013121, 0.576991084, -0.263069582],
            [-0.919053042, 0.163960811, 0.358410881, 0.18237537],
            [0.168832774, -0.657930517, 0.733909347, 0.73117711],
        ],
    ),
    (
        [-1.2, 1.1, -0.5, 2.4, 0.8, -1.1, 2],
        [
            [0.606868987, -0.16665185, -0.777133961, -0.016312797],
            [-0.78787081, -0.254983821, -0.560573668, -0.485460745],
            [-0.104735947, 0.952475938, -0.286041901, -0.074131214],
        ],
    ),
    (
        [2, 0.4, -2.2, -0.5, -3.3, 1.3, -2.7],
        [
            [-0.204273228, 0.476128242, -0.855321194, -0.313275946],
            [0.699930423, 0.681889892, 0.212423111, 0.314912305],
            [0.684375519, -0.555272971, -0.472548491, 0.668727386],
        ],
    ),
]
GRAVITY_ROWS = [
    ([0, 0, 0, 0, 0, 0, 0], [0, -0.147093, 0, 1.212452, 0, 0.000128, 0]),
    ([0, -2, 0, 3.13, 0, 0, 0], [0, 17.335291, 0.054964, -4.055989, -0.056463, -0.126301, 0.000049]),
    ([0, 1.5708, 0, 0, 0, 0, 0], [0, -27.959505, -0.060446, -5.056652, -0.062431, -0.139711, 0.000054]),
    (
        [0.3, -0.6, 0.9, 1.2, -1.5, 0.7, -0.4],
        [0, 11.731876, -2.476516, -2.431322, -0.035802, -0.013985, -0.000081],
    ),
    ([-1.2, 1.1, -0.5, 2.4, 0.8, -1.1, 2], [0, -20.108641, -2.554157, 0.263958, 0.053816, -0.115007, 0.000110]),
]
GRAVITY = np.array([0.0, 0.0, -9.81])
joint_vectors = arrays(np.float64, 7, elements=st.floats(-2.5, 2.5, allow_subnormal=False))


def dh_frames(q: Array, base: Array | None = None) -> list[Array]:
    """DH frames 0 to 7 in the world."""
    frames = [np.eye(4) if base is None else base]
    for angle, (a, quarter_turns, d) in zip(q, DH, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), [1, 0, 0][quarter_turns], quarter_turns
        step = np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
        frames.append(frames[-1] @ step)
    return frames


def point_jacobian(frames: list[Array], point: Array, joints: int) -> Array:
    """Linear over angular rows (6×7) of a point that moves with the first `joints` joints."""
    J = np.zeros((6, 7))
    for j in range(joints):
        axis = frames[j][:3, 2]
        J[:3, j] = np.cross(axis, point - frames[j][:3, 3])
        J[3:, j] = axis
    return J


def numpy_mass_matrix(q: Array) -> Array:
    frames = dh_frames(q)
    M = np.diag(ROTORS)
    for k, ((mass, com), (xx, xy, xz, yy, yz, zz)) in enumerate(zip(LINKS, INERTIAS, strict=True), start=1):
        J = point_jacobian(frames, frames[k][:3, :3] @ com + frames[k][:3, 3], k)
        tensor = np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])
        world_tensor = frames[k][:3, :3] @ tensor @ frames[k][:3, :3].T
        M = M + mass * J[:3].T @ J[:3] + J[3:].T @ world_tensor @ J[3:]
    return M


def numpy_gravity(q: Array, base: Array | None = None, carried: tuple[float, Array] | None = None) -> Array:
    """Torque that holds the arm, and a mass at a point of DH frame 7 (kg, m)."""
    frames = dh_frames(q, base)
    masses = [(mass, np.array(com), k) for k, (mass, com) in enumerate(LINKS, start=1)]
    if carried is not None:
        masses.append((*carried, 7))
    torque = np.zeros(7)
    for mass, com, k in masses:
        torque -= point_jacobian(frames, frames[k][:3, :3] @ com + frames[k][:3, 3], k)[:3].T @ (mass * GRAVITY)
    return torque


def transform(rotation_vector: list[float], xyz: list[float]) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    T[:3, 3] = xyz
    return T


@pytest.mark.parametrize(("q", "rows"), POSE_ROWS)
def test_wrist_pose_is_the_printed_one(q: list[float], rows: list[list[float]]) -> None:
    """Protects the kinematics against the reference's rows, to their last digit."""
    pose = ArmModel().wrist_pose(q)
    np.testing.assert_allclose(pose[:3], rows, rtol=0, atol=6e-10)
    np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])


@pytest.mark.parametrize(("q", "torque"), GRAVITY_ROWS)
def test_gravity_is_the_printed_one(q: list[float], torque: list[float]) -> None:
    """Protects masses and centres of mass against the reference's rows, to their last digit."""
    np.testing.assert_allclose(ArmModel().gravity(q), torque, rtol=0, atol=6e-7)


@settings(max_examples=40, deadline=None)
@given(q=joint_vectors, a=joint_vectors)
def test_dynamics_are_those_of_the_tables(q: Array, a: Array) -> None:
    """Protects every number of the URDF: inertias with their signs, rotors, and M·a as inverse dynamics at rest."""
    model, M = ArmModel(), numpy_mass_matrix(q)
    np.testing.assert_allclose(model.mass_matrix(q), M, rtol=0, atol=2e-7)
    torque = model.inverse_dynamics(q, np.zeros(7), a)
    np.testing.assert_allclose(torque, M @ a + numpy_gravity(q), rtol=0, atol=3e-6)


@settings(max_examples=30, deadline=None)
@given(q=joint_vectors, v=joint_vectors, a=joint_vectors)
def test_power_of_the_torques_becomes_energy(q: Array, v: Array, a: Array) -> None:
    """Protects the Coriolis terms: the torques' power is the rate of kinetic and potential energy."""
    h = 1e-5
    rate_of_M = (numpy_mass_matrix(q + h * v) - numpy_mass_matrix(q - h * v)) / (2 * h)
    power = v @ numpy_mass_matrix(q) @ a + 0.5 * v @ rate_of_M @ v + v @ numpy_gravity(q)
    assert v @ ArmModel().inverse_dynamics(q, v, a) == pytest.approx(power, abs=1e-4)


@settings(max_examples=40, deadline=None)
@given(q=joint_vectors)
def test_jacobian_is_the_derivative_of_the_pose(q: Array) -> None:
    """Protects axes, reference point and row order of the Jacobian, on a tilted base."""
    base, h = transform([0.4, -0.2, 0.1], [0.5, 0.1, 0.8]), 1e-6
    model = ArmModel(T_world_base=base)
    numeric = np.zeros((6, 7))
    R = model.wrist_pose(q)[:3, :3]
    for j in range(7):
        step = h * np.eye(7)[j]
        change = (model.wrist_pose(q + step) - model.wrist_pose(q - step)) / (2 * h)
        spin = change[:3, :3] @ R.T
        numeric[:, j] = [*change[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(model.jacobian(q), numeric, rtol=0, atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(q=joint_vectors)
def test_tilted_base_turns_gravity(q: Array) -> None:
    """Protects the mounting: poses move with the base, gravity stays with the world."""
    base = transform([0.3, 1.2, -0.4], [0.2, -0.3, 1.1])
    model = ArmModel(T_world_base=base)
    np.testing.assert_allclose(model.wrist_pose(q), base @ ArmModel().wrist_pose(q), rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.gravity(q), numpy_gravity(q, base), rtol=0, atol=2e-6)


@settings(max_examples=30, deadline=None)
@given(q=joint_vectors, fraction=st.floats(0.0, 1.0))
def test_hand_always_weighs_and_payload_by_its_fraction(q: Array, fraction: float) -> None:
    """Protects where the hand's and the object's masses act, and the ramp of the object's."""
    mount = transform([2 * np.pi / (3 * np.sqrt(3))] * 3, [0.01, 0.0, 0.08])
    hand = Payload(0.4, (0.0, -0.04, 0.0), (4e-4, 4e-4, 4e-4, 0.0, 0.0, 0.0))
    model = ArmModel(hand=hand, T_wrist_hand=mount, payload=Payload(0.6, (0.01, 0.09, 0.02)))
    model.set_payload_fraction(fraction)
    mass = 0.4 + fraction * 0.6
    moment = 0.4 * np.array([0.0, -0.04, 0.0]) + fraction * 0.6 * np.array([0.01, 0.09, 0.02])
    at = mount[:3, :3] @ (moment / mass) + mount[:3, 3]
    np.testing.assert_allclose(model.gravity(q), numpy_gravity(q, carried=(mass, at)), rtol=0, atol=3e-6)
    assert model.payload_fraction == fraction


def test_new_payload_weighs_nothing_at_first() -> None:
    """Protects the arm from a torque step when another object is announced."""
    model, q = ArmModel(payload=Payload(1.0)), np.full(7, 0.5)
    model.set_payload_fraction(1.0)
    model.set_payload(Payload(2.0))
    np.testing.assert_allclose(model.gravity(q), ArmModel().gravity(q), rtol=0, atol=1e-12)


def test_update_serves_pose_and_jacobian_that_stay() -> None:
    """Protects those who keep the shared results from a later update writing into them."""
    model, q = ArmModel(), np.linspace(-0.5, 0.7, 7)
    model.update(q)
    pose, jacobian = model.pose, model.jacobian_now
    model.update(np.zeros(7))
    model.gravity(np.ones(7))
    np.testing.assert_array_equal(pose, ArmModel().wrist_pose(q))
    np.testing.assert_array_equal(jacobian, ArmModel().jacobian(q))


def test_friction_is_odd_and_zero_without_speed_or_direction() -> None:
    """Protects an arm at rest from friction torque, and a moving one from the wrong sign of it."""
    model = ArmModel(friction=ArmFriction((0.9,) * 7, (1.5, 1.5, 0.8, 0.8, 0.2, 0.1, 0.05)))
    v, forward, backward = np.full(7, 0.5), [1.0] * 7, [-1.0] * 7
    np.testing.assert_array_equal(model.friction(np.zeros(7), [0.0] * 7), np.zeros(7))
    np.testing.assert_allclose(model.friction(v, forward), [1.95, 1.95, 1.25, 1.25, 0.65, 0.55, 0.5], rtol=1e-12)
    np.testing.assert_array_equal(model.friction(-v, backward), -model.friction(v, forward))
    q, a = np.ones(7), np.full(7, 0.3)
    expected = model.inverse_dynamics(q, v, a) + model.friction(v, forward)
    np.testing.assert_allclose(model.feed_forward(q, v, a, forward), expected)


@pytest.mark.parametrize("q", [np.full(7, np.nan), np.array([0, 0, 0, np.inf, 0, 0, 0]), np.zeros(6), np.zeros((7, 1))])
def test_bad_joint_vectors_are_refused(q: Array) -> None:
    """Protects the solver behind from NaN, which it would pass through in silence."""
    model, good = ArmModel(), np.zeros(7)
    for call in (model.wrist_pose, model.gravity, model.jacobian, model.mass_matrix, model.update):
        with pytest.raises(InputError, match="expected 7 finite"):
            call(q)
    with pytest.raises(InputError, match="accelerations"):
        model.inverse_dynamics(good, good, q)


def test_bad_bodies_and_mounts_are_refused() -> None:
    """Protects the arm from torques of an impossible hand, payload, base or friction."""
    with pytest.raises(InputError, match="not positive"):
        ArmModel(hand=Payload(0.4, inertia_kgm2=(1e-4, 1e-4, 1e-4, 5e-4, 0.0, 0.0)))
    with pytest.raises(InputError, match="mass"):
        ArmModel(payload=Payload(float("nan")))
    with pytest.raises(InputError, match="T_world_base"):
        ArmModel(T_world_base=np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(InputError, match="T_wrist_hand"):
        ArmModel(T_wrist_hand=np.eye(3))
    with pytest.raises(InputError, match="coulomb_Nm"):
        ArmFriction(coulomb_Nm=(-1.0,) * 7)
    with pytest.raises(InputError, match="0 to 1"):
        ArmModel().set_payload_fraction(float("nan"))
