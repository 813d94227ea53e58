"""Minimal effort and the force levels: against the closed form, a general optimiser, and plain bookkeeping."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import NonlinearConstraint, minimize

from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.force import (
    contact_force_levels,
    force_levels,
    least_normal_force_N,
    minimal_effort,
    squeeze_path,
)
from calibration.grasp.force_optimisation import optimised_effort
from calibration.grasp.path import Path
from calibration.hand.finger import Reals
from drivers.errors import MechanicsError

Grasping = Callable[..., GraspSystem]
G = 9.80665


@pytest.fixture(scope="module")
def mustard(grasping: Grasping) -> Path:
    """T42PF, fitted, mustard bottle in the air."""
    return squeeze_path(grasping("t42pf", "fitted", "mustard"), 0.6, lifted=True, step_m=5e-4)


@pytest.fixture(scope="module")
def soft_mustard(grasping: Grasping) -> Path:
    """The same at nominal stiffness."""
    return squeeze_path(grasping("t42pf", "nominal", "mustard"), 0.6, lifted=True, step_m=5e-4)


@pytest.fixture(scope="module")
def split_disc(grasping: Grasping) -> Path:
    """T42PP, fitted, 40 mm cylinder, 10 % onset split, in the air."""
    return squeeze_path(grasping("t42pp", "fitted", "cylinder40", onset_split=0.1), 0.2, lifted=True, step_m=5e-4)


def test_flat_sides_need_half_the_weight_over_friction(mustard: Path) -> None:
    """Without tangential force N* = m g / (2 μ), F = √2 N*: 9.81 and 13.87 N for 600 g (hand-mechanics reference 7)."""
    found = minimal_effort(mustard, 0.6, 0.3, lifted=True)
    assert found is not None
    assert found.normal_N == pytest.approx((0.6 * G / 0.6, 0.6 * G / 0.6), abs=1e-9)
    assert found.norm_N == pytest.approx(13.87, abs=0.005)
    assert least_normal_force_N(0.018, 0.3) == pytest.approx(0.294, abs=5e-4)


def test_closed_form_equals_an_optimiser_over_the_six_components() -> None:
    """min sqrt(N_0² + N_1²) over both contacts' n, t, o components that carry 18 g and squeeze along x: N*."""
    weight = 0.018 * G

    def size(f: Reals) -> float:
        return math.hypot(f[0], f[3])

    def balance(f: Reals) -> Reals:
        return np.array([f[0] - f[3], f[1] - f[4], f[2] + f[5] - weight, f[2] - f[5]])

    def cones(f: Reals) -> Reals:
        return np.array([0.3 * f[k] - math.hypot(f[k + 1], f[k + 2]) for k in (0, 3)])

    best = minimize(
        size,
        np.array([1.0, 0.1, 0.1, 2.0, 0.0, 0.2]),
        method="SLSQP",
        constraints=(NonlinearConstraint(balance, 0.0, 0.0), NonlinearConstraint(cones, 0.0, np.inf)),
        options={"ftol": 1e-14},
    )
    assert best.x[[0, 3]] == pytest.approx([least_normal_force_N(0.018, 0.3)] * 2, rel=1e-6)


def test_cones_just_hold_at_minimal_effort_and_not_before(split_disc: Path) -> None:
    """Off-centre: μ N = sqrt((m g / 2)² + f_t²) at the worse contact; less squeeze is too little."""
    found = minimal_effort(split_disc, 0.2, 0.3, lifted=True)
    assert found is not None
    needed = [least_normal_force_N(0.2, 0.3, along) for along in found.along_N]
    assert min(np.array(found.normal_N) - needed) == pytest.approx(0, abs=1e-9)
    before = split_disc.contact_force_N[split_disc.load_N.mean(1) < np.mean(found.load_N) - 0.5]
    assert (before[:, 0] < needed[0]).all()


@pytest.mark.parametrize("case", ["mustard", "split_disc"])
def test_a_general_optimiser_confirms_it(case: str, request: pytest.FixtureRequest) -> None:
    """SLSQP over joints, pose, forces, windings and loads, from a far state, ends in the same state: the path of equal
    winding holds the least effort under equal winding."""
    path: Path = request.getfixturevalue(case)
    mass = {"mustard": 0.6, "split_disc": 0.2}[case]
    found = minimal_effort(path, mass, 0.3, lifted=True)
    assert found is not None
    far = path.w[len(path.w) * 2 // 3]
    best = optimised_effort(path.system, far, mass, 0.3)
    n = path.system.unknowns
    assert best[:n] == pytest.approx(found.w[:n], abs=1e-7)
    assert best[n:] == pytest.approx(found.w[n:], rel=1e-6, abs=1e-6)


def test_free_tendon_loads_spare_next_to_nothing(split_disc: Path) -> None:
    """With both tendon loads free, (7) in full, an off-centre grasp gets by with no less than 0.1 % of the force."""
    found = minimal_effort(split_disc, 0.2, 0.3, lifted=True)
    assert found is not None
    best = optimised_effort(split_disc.system, found.w, 0.2, 0.3, equal_winding=False)
    norm = float(np.linalg.norm((split_disc.system.contact_rows() @ best)[[0, 2]]))
    assert 0.999 * found.norm_N < norm <= found.norm_N * (1 + 1e-9)


def test_an_optimiser_confirms_it_beyond_the_stops(soft_mustard: Path) -> None:
    """At nominal stiffness 600 g is held only with the distal joints at their stops; there too both agree."""
    found = minimal_effort(soft_mustard, 0.6, 0.3, lifted=True)
    assert found is not None
    held = soft_mustard.at_stop[-1]
    best = optimised_effort(soft_mustard.system, soft_mustard.w[-1], 0.6, 0.3, at_stop=held)
    assert (soft_mustard.system.contact_rows() @ best)[[0, 2]] == pytest.approx(found.normal_N, rel=1e-7)


def test_levels_and_what_they_mean(mustard: Path, soft_mustard: Path) -> None:
    """f_min ≤ f_e ≤ f_max is common and not guaranteed (hand-mechanics reference 13); both are said in a sentence."""
    levels = force_levels(mustard, 0.6, 0.3, lifted=True)
    assert levels.f_min_N is not None
    assert levels.f_e_N is not None
    assert levels.f_min_N < levels.f_e_N < levels.f_max_N
    assert "before the reconfiguration stops" in levels.statement
    soft = force_levels(soft_mustard, 0.6, 0.3, lifted=True)
    assert soft.f_min_N is not None
    assert soft.f_e_N is not None
    assert soft.f_min_N > soft.f_e_N
    assert "only after the reconfiguration has stopped" in soft.statement
    heavy = force_levels(soft_mustard, 1.2, 0.3, lifted=True)
    assert heavy.f_min_N is None
    assert "Nothing below the load cap holds" in heavy.statement
    assert f"{1.2 * G / 0.3:.2f} N" in heavy.statement
    unknown = force_levels(mustard, None, 0.3, lifted=True)
    assert unknown.f_min_N is None
    assert "Without a mass" in unknown.statement


def test_where_the_hand_never_stops_it_says_so(grasping: Grasping) -> None:
    """A large sphere: the load cap comes before any stop, so there is no f_e."""
    levels = contact_force_levels(grasping("t42ff", "fitted", "sphere50"), 0.1, 0.3, True)
    assert levels.f_e_N is None
    assert "does not stop" in levels.statement
    assert sum(levels.largest.load_N) == pytest.approx(256.0, abs=1e-6)


def test_force_levels_scale_with_stiffness(grasping: Grasping) -> None:
    """The exact law T/s, N/s (hand-mechanics reference 2): stiffness × 6 in the fitted hand, with the nominal stop and
    tip, is six times the force and the same motion at the stop."""
    nominal = contact_force_levels(grasping("t42pf", "nominal", "cylinder45", radius_m=0.006), None, 0.3, True)
    stiff = contact_force_levels(
        grasping("t42pf", "fitted", "cylinder45", radius_m=0.006, stop_deg=71.6), None, 0.3, True
    )
    assert nominal.stopped is not None
    assert stiff.stopped is not None
    assert stiff.f_e_N == pytest.approx(6 * nominal.stopped.sum_N, rel=1e-7)
    assert stiff.stopped.motion == pytest.approx(nominal.stopped.motion, abs=1e-9)


def test_on_the_table_the_drag_asks_for_the_effort(grasping: Grasping) -> None:
    """A symmetric grasp on flat sides drags the object: each contact passes μ_t m g / 2, so f_min = μ_t m g / μ."""
    levels = contact_force_levels(grasping("t42pf", "fitted", "mustard"), 0.6, 0.4, False)
    assert levels.minimal is not None
    assert np.abs(levels.minimal.along_N) == pytest.approx([0.3 * 0.6 * G / 2] * 2, rel=1e-6)
    assert levels.f_min_N == pytest.approx(0.3 * 0.6 * G / 0.4, rel=1e-6)
    assert "on the table" in levels.statement


@pytest.mark.parametrize(
    ("mass", "friction", "named"), [(-1.0, 0.3, "mass_kg"), (math.nan, 0.3, "mass_kg"), (0.1, 0.0, "contact_friction")]
)
def test_impossible_numbers_are_named(mass: float, friction: float, named: str, mustard: Path) -> None:
    """Mass and friction are checked before anything is looked for."""
    with pytest.raises(MechanicsError, match=named):
        minimal_effort(mustard, mass, friction, lifted=True)
    with pytest.raises(MechanicsError, match=named):
        optimised_effort(mustard.system, mustard.w[3], mass, friction)


def test_an_optimiser_that_finds_nothing_says_so(mustard: Path) -> None:
    """20 kg with friction 0.3 is beyond the load cap."""
    with pytest.raises(MechanicsError, match="mass_kg"):
        optimised_effort(mustard.system, mustard.w[-1], 20.0, 0.3)
