"""Equilibria of all hands against the reference's figures, a general optimiser, and the laws they must obey."""

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import NonlinearConstraint, minimize

from calibration.grasp.continuation import advance
from calibration.grasp.equilibrium import GraspSystem, excursion_drive, grasp_system
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import Reals
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

HANDS = ("t42pp", "t42pf", "t42ff")


def system(name: str, thing: str, *, split: float = 0.0, preset: str = "fitted", friction: float = 0.0) -> GraspSystem:
    """A grasp with fingertips of 6 mm, as in hand-mechanics reference 10."""
    hand = load_hand(name, preset)
    finger = replace(hand.right, tip=replace(hand.right.tip, radius_m=0.006), routing_friction=friction)
    return grasp_system(replace(hand, right=finger, left=finger), load_object(thing), GraspSpec(onset_split=split))


def wound(
    grasp: GraspSystem, mean_m: float, difference_m: float = 0.0, steps: int = 8, pull: Reals | None = None
) -> Reals:
    """State (1, size) after winding in from first contact, under an external wrench (3,) that grows on the way."""
    drive, w = excursion_drive(grasp), grasp.first_state()[None]
    shares = np.linspace(0, 1, steps + 1)[:, None]
    targets = drive.rows @ w[0] + shares * [mean_m, difference_m]
    pulls = shares * (np.zeros(3) if pull is None else pull)
    for (start, end), (before, after) in zip(pairwise(targets), pairwise(pulls), strict=True):
        w = advance(grasp, w, drive, start[None], end[None], wrench=(before[None], after[None]))
    assert np.isfinite(w).all()
    return w


@pytest.mark.parametrize(
    ("name", "tension_N", "normal_N", "y_mm"),
    [("t42pp", 8.04, 0.394, -6.56), ("t42pf", 8.03, 0.384, -6.14), ("t42ff", 8.10, 0.364, -6.48)],
)
def test_rows_of_the_reference(name: str, tension_N: float, normal_N: float, y_mm: float) -> None:
    """Nominal, 40 mm disc, 1.4 mm of winding (hand-mechanics reference 10)."""
    grasp = system(name, "cylinder40", preset="nominal")
    w = wound(grasp, 0.0014)[0]
    assert grasp.load_rows() @ w == pytest.approx([tension_N] * 2, abs=0.006)
    assert (grasp.contact_rows() @ w)[0] == pytest.approx(normal_N, abs=6e-4)
    motion = w[grasp.joints + 1] - grasp.start.object_pose[1]
    assert motion * 1e3 == pytest.approx(y_mm, abs=0.006)


@pytest.mark.parametrize("name", HANDS)
@pytest.mark.parametrize("thing", ["cylinder40", "rectangle40"])
def test_a_symmetric_pinch_moves_along_y_only(name: str, thing: str) -> None:
    """Equal windings on a symmetric grasp: no sideways motion and no turn, to 1e-12."""
    grasp = system(name, thing)
    w = wound(grasp, 0.004)[0]
    x, y, angle = w[grasp.joints : grasp.unknowns] - grasp.start.object_pose
    assert y < -0.01
    assert abs(x) < 1e-12
    assert abs(angle) < 1e-11


@pytest.mark.parametrize("name", HANDS)
def test_forces_balance_an_external_wrench(name: str) -> None:
    """Contact forces and the wrench that pulls at the object add up to nothing, about the object's own point."""
    grasp, pull = system(name, "cylinder40", split=0.1), np.array([0.4, -0.3, 0.006])
    w = wound(grasp, 0.003, 0.0004, pull=pull)
    forces = grasp.contact_rows() @ w[0]
    centre = complex(*w[0, grasp.joints : grasp.joints + 2])
    total, moment = complex(pull[0], pull[1]), float(pull[2])
    for finger, part, (normal, along) in zip(grasp.fingers, grasp.parts, (forces[:2], forces[2:]), strict=True):
        zeta = centre - complex(finger.tip.at(w[:, part]).value[0])
        direction = zeta / abs(zeta)
        force = direction * complex(normal, along)
        total += force
        moment += float((-0.020 * direction.conjugate() * force).imag)
    assert abs(total) < 1e-9
    assert abs(moment) < 1e-11


@pytest.mark.parametrize("name", HANDS)
@pytest.mark.parametrize("friction", [0.0, 0.15])
def test_energy_rises_by_the_work_that_arrives_at_the_joints(name: str, friction: float) -> None:
    """dV = T dl without routing friction (hand-mechanics reference 10). With it only exp(−c) T arrives at the distal
    joint, as the capstan law says; and what is lost on the way is positive."""
    grasp = system(name, "cylinder40", split=0.1, friction=friction)
    w = wound(grasp, 0.003, 0.0004)
    tangent = grasp.tangent(w, excursion_drive(grasp))[0]
    arriving, wound_in = np.zeros(2), np.zeros(2)
    for part, load, tendon in zip(grasp.parts, w[0, -2:], (f.tendon for f in grasp.fingers), strict=True):
        moved = tendon.at(w[:, part]).gradient[0] @ tangent[part]
        arriving += load * (moved[0] + np.exp(-friction) * moved[1])
        wound_in += load * moved.sum(0)
    n = grasp.unknowns
    assert (grasp.stiffness * w[0, :n]) @ tangent[:n] == pytest.approx(arriving, rel=1e-9, abs=1e-9)
    assert (wound_in[0] - arriving[0] > 0.01 * wound_in[0]) == (friction > 0)


def test_less_load_arrives_behind_a_bend_that_rubs() -> None:
    """With routing friction the same loads close less (hand-mechanics reference 12): the same winding of a symmetric
    grasp needs more load on the winding branch, and less on the unwinding one."""
    loads = {}
    for friction, direction in ((0.0, 1.0), (0.1, 1.0), (0.1, -1.0)):
        hand = load_hand("t42pp")
        finger = replace(hand.right, routing_friction=friction)
        spec = GraspSpec(branch="winding" if direction > 0 else "unwinding")
        grasp = grasp_system(replace(hand, right=finger, left=finger), load_object("cylinder40"), spec)
        assert grasp.friction_direction == direction
        start = grasp_system(replace(hand, right=finger, left=finger), load_object("cylinder40"), GraspSpec())
        w = wound(start, 0.003)
        target = w @ excursion_drive(grasp).rows.T
        loads[friction * direction] = grasp.solve(w, excursion_drive(grasp), target).w[0, -2:].mean()
    assert loads[-0.1] < loads[0.0] < loads[0.1]


@pytest.mark.parametrize("name", ["t42pf", "t42ff"])
def test_equals_a_general_optimiser(name: str) -> None:
    """Energy minimised by SLSQP under contacts and excursions as constraints: the same asymmetric equilibrium."""
    grasp = system(name, "cylinder40", split=0.1, preset="nominal")
    w = wound(grasp, 0.002, 0.0006)
    n, scale = grasp.unknowns, grasp.column_scale[: grasp.unknowns]
    target = grasp.excursion_rows() @ w[0]

    def state(scaled: Reals) -> Reals:
        full: Reals = np.concatenate([scaled * scale, np.zeros(4), target, np.zeros(2)])[None]
        return full

    def constraints(scaled: Reals) -> Reals:
        terms = grasp.terms(state(scaled))
        contacts = [jet.value[0] / 0.03 for jet in terms.contacts]
        wound_in = [(jet.value[0].sum() - e) / 0.008 for jet, e in zip(terms.tendons, target, strict=True)]
        return np.concatenate([*contacts, wound_in])

    def slopes(scaled: Reals) -> Reals:
        terms, rows = grasp.terms(state(scaled)), np.zeros((6, n))
        for index, (jet, tendon, part) in enumerate(zip(terms.contacts, terms.tendons, grasp.parts, strict=True)):
            local = [*range(part.start, part.stop), *range(grasp.joints, n)]
            rows[2 * index : 2 * index + 2, local] = jet.gradient[0] / 0.03
            rows[4 + index, part] = tendon.gradient[0].sum(0) / 0.008
        scaled_rows: Reals = rows * scale
        return scaled_rows

    def energy(scaled: Reals) -> float:
        return float(50 * (grasp.stiffness * (scaled * scale) ** 2).sum())

    def torques(scaled: Reals) -> Reals:
        found: Reals = 100 * grasp.stiffness * scaled * scale**2
        return found

    best = minimize(
        energy,
        grasp.first_state()[:n] / scale,
        jac=torques,
        method="SLSQP",
        constraints=NonlinearConstraint(constraints, 0.0, 0.0, jac=slopes),
        options={"ftol": 1e-15, "maxiter": 300},
    )
    assert best.success
    assert best.x * scale == pytest.approx(w[0, :n], abs=2e-6)
