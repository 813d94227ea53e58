"""Equilibria against the reference's figures, two independent solvers, and the laws they must obey."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.optimize import NonlinearConstraint, brentq, minimize

from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import GraspSystem, excursion_drive, grasp_system, load_drive
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import Hand, PinJoint, load_hand
from calibration.objects import load_object

R, B = 0.020, 0.030
PROXIMAL, DISTAL, ARM = 0.062, 0.047, 0.008


def hand(radius_m: float = 0.006, preset: str = "nominal", stiffer: float = 1.0) -> Hand:
    """T42PP with another fingertip and all joints stiffer by a factor."""
    found = load_hand("t42pp", preset)
    tip = replace(found.right.tip, radius_m=radius_m)
    proximal, distal = (joint for joint in found.right.joints if isinstance(joint, PinJoint))
    finger = replace(
        found.right,
        tip=tip,
        proximal_joint=replace(proximal, stiffness_Nm_per_rad=proximal.stiffness_Nm_per_rad * stiffer),
        distal_joint=replace(distal, stiffness_Nm_per_rad=distal.stiffness_Nm_per_rad * stiffer),
    )
    return replace(found, right=finger, left=finger)


def system(split: float = 0.0, radius_m: float = 0.006, preset: str = "nominal", stiffer: float = 1.0) -> GraspSystem:
    return grasp_system(hand(radius_m, preset, stiffer), load_object("cylinder40"), GraspSpec(onset_split=split))


def wound(grasp: GraspSystem, mean_m: float, difference_m: float = 0.0, steps: int = 8) -> Reals:
    """State (1, size) after winding in from first contact."""
    drive, w = excursion_drive(grasp), grasp.first_state()[None]
    targets = drive.rows @ w[0] + np.linspace(0, 1, steps + 1)[:, None] * [mean_m, difference_m]
    for start, end in pairwise(targets):
        w = advance(grasp, w, drive, start[None], end[None])
    assert np.isfinite(w).all()
    return w


def moved(grasp: GraspSystem, w: Reals) -> Reals:
    """Object motion since first contact (x, y, θ)."""
    motion: Reals = w[0, 4:7] - grasp.start.object_pose
    return motion


def test_symmetric_row_of_the_reference() -> None:
    """T42PP, 40 mm disc, 1.4 mm of winding (hand-mechanics reference 10); and a symmetric pinch moves along y only."""
    grasp = system()
    w = wound(grasp, 0.0014)
    assert w[0, -2:] == pytest.approx([8.04, 8.04], abs=0.005)
    normal, tangential = (grasp.contact_rows() @ w[0])[:2]
    assert normal == pytest.approx(0.394, abs=5e-4)
    assert abs(tangential) / normal == pytest.approx(0.040, abs=5e-4)
    motion = moved(grasp, w)
    assert motion[1] * 1e3 == pytest.approx(-6.56, abs=0.006)
    assert abs(motion[[0, 2]]).max() < 1e-12


@pytest.mark.parametrize(
    ("split", "x_mm", "y_mm", "angle_deg"), [(0.1, 3.0, -12.5, -3.5), (0.2, 5.8, -11.5, -7.0), (0.3, 8.3, -9.7, -10.8)]
)
def test_split_rows_of_the_reference(split: float, x_mm: float, y_mm: float, angle_deg: float) -> None:
    """Onset splits couple translation and rotation as in hand-mechanics reference 12: within half a printed digit, and
    what half a digit of the printed winding of 2.54 mm brings (5 µm at about 5 mm/mm and 5°/mm)."""
    grasp = system(split)
    x, y, angle = moved(grasp, wound(grasp, 0.00254))
    assert (x * 1e3, y * 1e3, math.degrees(angle)) == pytest.approx((x_mm, y_mm, angle_deg), abs=0.05 + 0.025)


@pytest.mark.parametrize("radius_m", [0.0, 0.006, 0.0105])
@pytest.mark.parametrize("mean_m", [0.0005, 0.002, 0.004])
def test_equals_a_hand_written_half_model(radius_m: float, mean_m: float) -> None:
    """The symmetric grasp with one unknown, from trigonometry and torque balance alone: same loads, force, motion."""
    grasp = system(radius_m=radius_m)
    w = wound(grasp, mean_m)
    k = np.array([0.0290, 0.0726])
    reach, distance = DISTAL - radius_m, R + radius_m
    q0 = grasp.start.finger_joint_rad[0]

    def geometry(q: Reals) -> tuple[float, float, float]:
        first = math.radians(15) + q[0]
        second = first + math.radians(15) + q[1]
        x = B + PROXIMAL * math.cos(first) + reach * math.cos(second)
        return x, PROXIMAL * math.sin(first) + reach * math.sin(second), second

    bent = float(q0.sum()) + mean_m / ARM
    turned = geometry(q0)[2]

    def off_axis(proximal: float) -> float:
        x, _, second = geometry(np.array([proximal, bent - proximal]))
        tilt = radius_m * (second - turned) / distance  # the tip's arc rolls on the disc, which cannot turn
        return x - distance * math.cos(tilt)

    proximal = brentq(off_axis, q0[0] - 0.8, q0[0] + 0.4, xtol=1e-15)
    q = np.array([proximal, bent - proximal])
    _, y, second = geometry(q)
    tilt = radius_m * (second - turned) / distance
    contact = np.array([distance * math.cos(tilt), y]) + radius_m * np.array([-math.cos(tilt), -math.sin(tilt)])
    joint = np.array([B + PROXIMAL * math.cos(math.radians(15) + q[0]), PROXIMAL * math.sin(math.radians(15) + q[0])])
    # the disc holds still along y only if each finger's force is horizontal: F on the finger points in +x
    heights = np.array([contact[1], contact[1] - joint[1]])
    load, force = np.linalg.solve(np.column_stack([[ARM, ARM], -heights]), k * q)
    centre = y - distance * math.sin(tilt)
    assert w[0, :2] == pytest.approx(q, abs=1e-9)
    assert w[0, 5] == pytest.approx(centre, abs=1e-10)
    assert w[0, -2:] == pytest.approx([load, load], rel=1e-8)
    assert np.hypot(*(grasp.contact_rows() @ w[0])[:2]) == pytest.approx(force, rel=1e-7)


def test_equals_a_general_optimiser_off_centre() -> None:
    """Energy minimised by SLSQP under constraints written with trigonometry: the same asymmetric equilibrium."""
    grasp, rho = system(0.1), 0.006
    w = wound(grasp, 0.002, 0.0006)
    start = grasp.first_state()[:7]
    k = np.array([0.0290, 0.0726, 0.0290, 0.0726])

    def arc(z: Reals, side: int) -> tuple[Reals, float]:
        sign = 1 if side == 0 else -1
        first = math.radians(15) + z[2 * side]
        second = first + math.radians(15) + z[2 * side + 1]
        tip = np.array([B + PROXIMAL * math.cos(first) + 0.041 * math.cos(second), 0.0])
        tip[1] = PROXIMAL * math.sin(first) + 0.041 * math.sin(second)
        angle = second if side == 0 else math.pi - second
        return z[4:6] - tip * [sign, 1], angle

    def constraints(scaled: Reals) -> Reals:
        z = scaled * scale
        found = [(z[0] + z[1] - start[0] - start[1]) * ARM - 0.0023, (z[2] + z[3] - start[2] - start[3]) * ARM - 0.0017]
        for side in (0, 1):
            (now, angle), (then, angle0) = arc(z, side), arc(start, side)
            turned = math.atan2(then[0] * now[1] - then[1] * now[0], float(then @ now))
            found += [np.hypot(*now) - R - rho, (R + rho) * turned - rho * (angle - angle0) - R * z[6]]
        return np.array(found) / 0.03

    def energy(scaled: Reals) -> float:
        return float(50 * (k * (scaled * scale)[:4] ** 2).sum())

    scale = np.array([1, 1, 1, 1, 0.03, 0.03, 1])
    best = minimize(
        energy,
        start / scale,
        method="SLSQP",
        constraints=NonlinearConstraint(constraints, 0.0, 0.0),
        options={"ftol": 1e-14, "maxiter": 300},
    )
    assert best.success
    assert best.x * scale == pytest.approx(w[0, :7], abs=2e-6)


@settings(max_examples=25, deadline=None)
@given(
    split=st.sampled_from([0.0, 0.1, -0.2]),
    mean_m=st.floats(0.0002, 0.006),
    difference_m=st.floats(-0.0015, 0.0015),
)
def test_laws_of_every_equilibrium(split: float, mean_m: float, difference_m: float) -> None:
    """Forces balance on the object, energy rises by load × excursion, and loads and forces scale with stiffness."""
    soft, stiff = system(split), system(split, stiffer=6)
    w = wound(soft, mean_m, difference_m)
    normal_r, along_r, normal_l, along_l = soft.contact_rows() @ w[0]
    force, moment = 0j, 0.0
    for finger, q, normal, along in (
        (soft.fingers[0], w[:, :2], normal_r, along_r),
        (soft.fingers[1], w[:, 2:4], normal_l, along_l),
    ):
        zeta = complex(w[0, 4], w[0, 5]) - complex(finger.tip.at(q).value[0])
        direction = zeta / abs(zeta)
        force += direction * complex(normal, along)
        moment += -R * along  # at −R·n from the centre
    assert abs(force) < 1e-11
    assert abs(moment) < 1e-12
    drive = excursion_drive(soft)
    tangent = soft.tangent(w, drive)[0]
    right, left = w[0, -2:]
    slope = (soft.stiffness * w[0, :7]) @ tangent[:7]
    assert slope == pytest.approx([right + left, (right - left) / 2], rel=1e-9, abs=1e-9)
    harder = wound(stiff, mean_m, difference_m)
    assert harder[0, :7] == pytest.approx(w[0, :7], abs=1e-10)
    forces = np.r_[7:11, 13:15]
    assert harder[0, forces] == pytest.approx(6 * w[0, forces], rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("index", ["excursion", "load"])
def test_slopes_are_those_of_the_solutions(index: str) -> None:
    """First and mixed second derivatives along both drives, against central differences of solutions."""
    grasp = system(0.1, preset="fitted")
    drive = excursion_drive(grasp) if index == "excursion" else load_drive(grasp)
    w = wound(grasp, 0.003, 0.0005)
    here = (drive.rows @ w[0])[None]
    steps = np.array([1e-5, 1e-5]) if index == "excursion" else np.array([0.05, 1e-5])
    tangent = grasp.tangent(w, drive)
    mixed = grasp.mixed_derivative(w, drive, tangent)
    for axis in (0, 1):
        shift = np.eye(2)[axis] * steps
        ahead, behind = (advance(grasp, w, drive, here, here + sign * shift) for sign in (1, -1))
        change = (ahead - behind)[0] / (2 * steps[axis])
        assert change == pytest.approx(tangent[0, :, axis], rel=2e-5, abs=1e-5 * np.abs(tangent[0, :, axis]).max())
        if axis == 1:
            turn = (grasp.tangent(ahead, drive) - grasp.tangent(behind, drive))[0, :, 0] / (2 * steps[1])
            assert turn == pytest.approx(mixed[0], rel=2e-5, abs=1e-5 * np.abs(mixed[0]).max())


def test_beyond_both_stops_geometry_is_frozen_and_force_follows_the_load() -> None:
    """With both distal stops met, N = (T r − k q)/h over the proximal joint (hand-mechanics reference 6, point tip)."""
    grasp = system(radius_m=0.0)
    drive, w = load_drive(grasp), wound(grasp, 0.004, steps=20)
    poses = []
    for load in (16.0, 20.0, 24.0):
        target = np.array([[load, float(drive.rows[1] @ w[0])]])
        states = grasp.solve(w, drive, target, stops=True)
        assert states.converged.all()
        assert states.at_stop[0].tolist() == [0, 1, 0, 1]
        assert (states.stop_torque_Nm[0, [1, 3]] > 0).all()
        poses.append(states.w[0, :7])
        height = states.w[0, 5]
        expected = (load * ARM - 0.0290 * states.w[0, 0]) / height
        assert (grasp.contact_rows() @ states.w[0])[0] == pytest.approx(expected, rel=1e-9)
    assert poses[2] == pytest.approx(poses[0], abs=1e-9)


def test_excursions_beyond_all_stops_are_refused_quietly() -> None:
    """Prescribed excursions contradict two stops: the state says it has no solution, and nothing raises."""
    grasp = system()
    drive, w = excursion_drive(grasp), wound(grasp, 0.004, steps=20)
    states = grasp.solve(w, drive, (drive.rows @ w[0] + [0.002, 0])[None], stops=True)
    assert not states.converged.any()


def test_stability_is_positive_on_the_path_and_counts_what_is_left() -> None:
    """Prescribed excursions leave one motion, stable on the whole symmetric path (hand-mechanics reference 6)."""
    grasp = system()
    w = np.concatenate([wound(grasp, mean) for mean in (0.0005, 0.002, 0.004)])
    assert (grasp.stability(w) > 0).all()
    held = np.tile([0.0, 1.0, 0.0, 0.0], (3, 1))
    assert np.isinf(grasp.stability(w, held)).all()
