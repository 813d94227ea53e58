"""Grasp matrix, force closure and the force decomposition, against virtual work, geometry and the multipliers."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.path import Path, trace
from calibration.grasp.stability import (
    contact_frames,
    finger_deflection,
    force_closure,
    force_decomposition,
    grasp_matrix,
    hand_jacobian,
    internal_force,
    spatial_grasp_matrix,
    structure_stiffness,
    weighted_right_inverse,
)
from calibration.hand.finger import Complexes, Reals
from drivers.errors import MechanicsError

Grasping = Callable[..., GraspSystem]
Pinch = tuple[Complexes, Complexes]


@pytest.fixture(scope="module", params=[("t42pp", "cylinder40"), ("t42pf", "rectangle40"), ("t42ff", "pear")])
def squeezed(request: pytest.FixtureRequest, grasping: Grasping) -> Path:
    """Nonsymmetric grasps of three hands, up to the first stop."""
    hand, name = request.param
    return trace(grasping(hand, "fitted", name, onset_split=0.05), step_m=1e-3, past_stops=False)


def pinch(width: float = 0.04, tilt_right: float = 0.0, tilt_left: float = 0.0) -> Pinch:
    """Contacts on the x axis; normals towards each other, turned by the tilts."""
    points = np.array([width / 2 + 0j, -width / 2 + 0j])
    return points, np.array([-np.exp(1j * tilt_right), np.exp(1j * tilt_left)])


def test_grasp_matrix_is_the_transpose_of_the_constraints_slope(squeezed: Path) -> None:
    """Virtual work: G f balances what the contacts' gradients in the pose say, for round, flat and curved outlines."""
    system = squeezed.system
    for w in squeezed.w[1::3]:
        pose = w[system.joints : system.unknowns]
        G = grasp_matrix(*contact_frames(system, w), complex(pose[0], pose[1]))
        slopes = [
            contact.at(w[None, part], pose[None]).gradient[0, :, -3:].T
            for contact, part in zip(system.contacts, system.parts, strict=True)
        ]
        assert pytest.approx(np.hstack(slopes), abs=1e-9) == G
        assert G @ (system.contact_rows() @ w) == pytest.approx(np.zeros(3), abs=1e-10)


def test_equilibrium_forces_are_internal(squeezed: Path) -> None:
    """Without an outer wrench both forces are equal and opposite along the line between the contacts."""
    system = squeezed.system
    w = squeezed.w[-1]
    forces = system.contact_rows() @ w
    direction = internal_force(*contact_frames(system, w))
    assert forces == pytest.approx(direction * (forces @ direction) / (direction @ direction), abs=1e-9)


@given(
    width=st.floats(0.005, 0.1),
    right=st.floats(-0.6, 0.6),
    left=st.floats(-0.6, 0.6),
    stiffnesses=st.tuples(*[st.floats(10, 1e5)] * 4),
)
def test_right_inverse_laws(width: float, right: float, left: float, stiffnesses: tuple[float, ...]) -> None:
    """G G⁺ = I and G (I − G⁺ G) = 0 for any stiffness; the internal force is in the null space; least energy."""
    points, normals = pinch(width, right, left)
    G = grasp_matrix(points, normals, 0.01 + 0.005j)
    K = np.diag(stiffnesses)
    inverse = weighted_right_inverse(G, K)
    scale = np.array([1.0, 1.0, 1 / width])[:, None]
    assert scale * (G @ inverse) / scale.T == pytest.approx(np.eye(3), abs=1e-7)
    assert scale * (G - G @ inverse @ G) == pytest.approx(np.zeros((3, 4)), abs=1e-7)
    hidden = internal_force(points, normals)
    assert scale[:, 0] * (G @ hidden) == pytest.approx(np.zeros(3), abs=1e-9)
    wrench = np.array([1.0, -2.0, 0.01])
    least = inverse @ wrench
    for change in (0.3, -0.2):
        other = least + change * hidden
        assert other @ np.linalg.solve(K, other) >= least @ np.linalg.solve(K, least) * (1 - 1e-9)


@pytest.mark.parametrize(("width", "tilts"), [(0.04, (0.0, 0.0)), (0.1, (0.2, -0.3)), (0.005, (0.1, 0.1))])
def test_rank_is_three_in_the_plane_and_five_in_space(width: float, tilts: tuple[float, float]) -> None:
    """Two hard fingers resist every planar wrench, and in space all but rotation about their line."""
    points, normals = pinch(width, *tilts)
    found = force_closure(points, normals, 0.5)
    assert (found.rank, found.spatial_rank) == (3, 5)
    spatial = spatial_grasp_matrix(points, normals, 0j)
    assert (np.array([0, 0, 0, 1, 0, 0]) @ spatial) == pytest.approx(np.zeros(6), abs=1e-15)


@given(right=st.floats(-1.2, 1.2), left=st.floats(-1.2, 1.2), friction=st.floats(0.05, 1.5))
def test_cone_test_is_that_of_nguyen(right: float, left: float, friction: float) -> None:
    """Planar force closure of two contacts: the line inside both cones, margins as angles by hand; and then, and only
    then, a squeeze along the line needs less friction than there is."""
    points, normals = pinch(0.04, right, left)
    found = force_closure(points, normals, friction)
    cone = math.atan(friction)
    assert found.cone_margin_rad == pytest.approx((cone - abs(right), cone - abs(left)), abs=1e-12)
    forces = internal_force(points, normals)
    needed = max(abs(forces[1] / forces[0]), abs(forces[3] / forces[2]))
    if abs(needed - friction) > 1e-9:
        assert found.holds == (needed < friction)


def test_sideways_normals_do_not_hold() -> None:
    """Contacts that push the same way, past each other or with no friction at all give no closure."""
    points, normals = pinch()
    assert not force_closure(points, np.array([1.0 + 0j, 1.0 + 0j]), 1.0).holds
    assert not force_closure(points, 1j * normals, 0.5).holds
    assert not force_closure(points, normals, 0.0).holds
    with pytest.raises(MechanicsError, match="contact_friction"):
        force_closure(points, normals, math.nan)


def compliance(system: GraspSystem) -> Reals:
    found: Reals = 1 / system.stiffness[: system.joints]
    return found


def test_decomposition_returns_the_multipliers(squeezed: Path) -> None:
    """(3) with K_s from J_h and the joints' compliance, Δp = J_h (free − loaded joints): the contact forces of the
    equilibrium, also under an outer wrench."""
    system, rows = squeezed.system, squeezed.system.contact_rows()
    w = squeezed.w[len(squeezed.w) // 2]
    wrench = np.array([0.3, -0.2, 0.004])
    drive = squeezed.segments[0]
    pushed = system.solve(w[None], drive, (drive.rows @ w)[None], wrench=wrench[None])
    assert pushed.converged[0]
    for state, outer in ((w, np.zeros(3)), (pushed.w[0], wrench)):
        pose = state[system.joints : system.unknowns]
        G = grasp_matrix(*contact_frames(system, state), complex(pose[0], pose[1]))
        K = structure_stiffness(hand_jacobian(system, state), compliance(system))
        found = force_decomposition(G, K, outer, finger_deflection(system, state))
        assert found.total_N == pytest.approx(rows @ state, abs=1e-9)
        assert G @ found.internal_N == pytest.approx(np.zeros(3), abs=1e-9)
        assert G @ found.particular_N == pytest.approx(-outer, abs=1e-9)


def test_decomposition_with_real_fingertip_displacements_is_of_first_order(grasping: Grasping) -> None:
    """Δp from forward kinematics of free and loaded fingers, not linearised: the error falls with the deflection."""
    system = grasping("t42pp", "fitted", "cylinder40")
    path = trace(system, step_m=1e-5, past_stops=False, load_cap_N=24.2)
    errors = []
    for index in (1, 2, 4):
        w = path.w[index]
        pose = w[system.joints : system.unknowns]
        _, normals = contact_frames(system, w)
        moved = []
        for side, (finger, part) in enumerate(zip(system.fingers, system.parts, strict=True)):
            free = finger.free_closing(float(system.load_rows()[side] @ w))
            away = complex(finger.tip.at(free[None]).value[0] - finger.tip.at(w[None, part]).value[0])
            turned = float(finger.angle_row @ (free - w[part])) * finger.tip_radius_m
            local = away / complex(normals[side])
            moved += [local.real, local.imag + turned]  # the contact point is ρ n from the arc's centre
        G = grasp_matrix(*contact_frames(system, w), complex(pose[0], pose[1]))
        K = structure_stiffness(hand_jacobian(system, w), compliance(system))
        found = force_decomposition(G, K, np.zeros(3), np.array(moved)).total_N
        forces = system.contact_rows() @ w
        errors.append(float(np.abs(found - forces).max() / np.abs(forces).max()))
    assert errors[0] < 0.02
    assert errors[1] / errors[0] == pytest.approx(2, rel=0.15)
    assert errors[2] / errors[1] == pytest.approx(2, rel=0.15)


def test_pads_soften_the_hand_and_deformation_counts_as_force() -> None:
    """C_s adds to the compliance in series; K_c δp of (3) is a force too; a hand that cannot yield is refused."""
    points, normals = pinch()
    J, C_q = np.array([[0.05, 0.0], [0.01, 0.03], [0.0, 0.04], [0.02, -0.01]]), np.array([5.0, 2.0])
    with pytest.raises(MechanicsError, match="pad_compliance"):
        structure_stiffness(J, C_q)
    K = structure_stiffness(J, C_q, 1e-4)
    assert np.linalg.inv(K) == pytest.approx(1e-4 * np.eye(4) + J @ np.diag(C_q) @ J.T, abs=1e-12)
    G, none = grasp_matrix(points, normals, 0j), np.zeros(4)
    deformed, force = np.array([1e-4, 0.0, 1e-4, 0.0]), 1e4 * np.array([1e-4, 0.0, 1e-4, 0.0])
    found = force_decomposition(G, K, np.zeros(3), none, 1e4 * np.eye(4), deformed)
    assert found.internal_N == pytest.approx(force - weighted_right_inverse(G, K) @ (G @ force))
