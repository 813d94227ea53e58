"""Friction of the table: the reference's tables, its laws, and a minimisation by another method."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import NonlinearConstraint, minimize

from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2, OnTable, Sliding, sliding
from calibration.grasp.path import Path, trace
from calibration.hand.finger import Reals
from calibration.objects import load_object
from drivers.errors import MechanicsError

Grasping = Callable[..., GraspSystem]
STEP_M = 2e-4


def dragged(system: GraspSystem, mass_kg: float, load_N: float, step_m: float = STEP_M) -> Path:
    return trace(
        system,
        step_m=step_m,
        past_stops=False,
        load_cap_N=load_N,
        rule=OnTable(system, sliding(system.object, mass_kg)),
    )


@pytest.mark.parametrize(
    ("stiffness", "load_N", "rows"),
    [
        ("fitted", 78.0, {0.0: 16.58, 0.05: 16.39, 0.1: 16.21, 0.3: 15.48, 0.6: 14.45}),
        ("nominal", 13.0, {0.05: 15.48, 0.1: 14.45, 0.2: 12.58, 0.4: 9.49, 0.6: 7.04}),
    ],
)
def test_rows_of_the_reference(stiffness: str, load_N: float, rows: dict[float, float], grasping: Grasping) -> None:
    """T42PF, 45 mm disc, motion towards the palm at fixed final tension (hand-mechanics reference 8), to 0.02 mm; the
    heavier the object, the less it moves: the trend of the paper's Fig. 16."""
    system = grasping("t42pf", stiffness, "cylinder45", radius_m=0.006)
    found = {mass: -dragged(system, mass, load_N).motion[-1, 1] * 1e3 for mass in rows}
    assert found == pytest.approx(rows, abs=0.02)
    assert sorted(found.values(), reverse=True) == list(found.values())


@pytest.mark.parametrize(("mass", "x_mm", "y_mm", "angle_deg"), [(0.1, 4.50, -9.54, -5.26), (0.3, 3.87, -9.18, -4.49)])
def test_nonsymmetric_rows_of_the_reference(
    mass: float, x_mm: float, y_mm: float, angle_deg: float, grasping: Grasping
) -> None:
    """T42PP, 40 mm disc, 20 % split, cap 60 N: friction resists translation and rotation together (reference 8)."""
    path = dragged(grasping("t42pp", "fitted", "cylinder40", onset_split=0.2), mass, 60.0)
    x, y, angle = path.motion[-1]
    assert (x * 1e3, y * 1e3, math.degrees(angle)) == pytest.approx((x_mm, y_mm, angle_deg), abs=0.02)


def test_motion_depends_on_load_and_weight_over_stiffness(grasping: Grasping) -> None:
    """The scaling law: s = 1 with 100 g at 13 N moves as s = 6 with 600 g at 78 N, to rounding (reference 8: 14.45)."""
    soft = dragged(grasping("t42pf", "nominal", "cylinder45", radius_m=0.006), 0.1, 13.0)
    stiff = dragged(grasping("t42pf", "fitted", "cylinder45", radius_m=0.006), 0.6, 78.0)
    assert soft.motion[-1] == pytest.approx(stiff.motion[-1], abs=1e-9)
    assert -soft.motion[-1, 1] * 1e3 == pytest.approx(14.45, abs=0.005)
    assert stiff.contact_force_N[-1] == pytest.approx(6 * soft.contact_force_N[-1], rel=1e-6)


def test_without_weight_there_is_no_friction(grasping: Grasping) -> None:
    """Weight 0 is the frictionless path itself."""
    system = grasping("t42pf", "fitted", "cylinder45")
    assert dragged(system, 0.0, 60.0).w[-1] == pytest.approx(
        trace(system, step_m=STEP_M, past_stops=False, load_cap_N=60.0).w[-1], abs=1e-9
    )


def test_smaller_steps_change_nothing_that_matters(grasping: Grasping) -> None:
    """A path that turns slowly: a quarter of the step moves the end by a few micrometres."""
    system = grasping("t42pp", "fitted", "cylinder40", onset_split=0.2)
    coarse, fine = (dragged(system, 0.3, 60.0, step).motion[-1] for step in (2e-4, 5e-5))
    assert coarse[:2] == pytest.approx(fine[:2], abs=1.5e-5)


def test_friction_works_against_the_motion_on_the_limit_surface(grasping: Grasping) -> None:
    """While it slides, the wrench lies on the ellipsoid (f_x² + f_y²)/F² + τ²/M² = 1, normal to it points along the
    motion, and the contacts carry what the table takes."""
    system = grasping("t42pp", "fitted", "cylinder40", onset_split=0.2)
    path = dragged(system, 0.3, 60.0)
    rule = path.rule
    assert isinstance(rule, OnTable)
    F, M = rule.limits.force_N, rule.limits.moment_Nm
    for before, after in zip(path.w[2:-1:4], path.w[3::4], strict=False):
        wrench = rule.wrench(before, after)
        moved = (after - before)[system.joints : system.unknowns]
        assert wrench[:2] @ wrench[:2] / F**2 + wrench[2] ** 2 / M**2 == pytest.approx(1, abs=1e-5)
        normal = -wrench / np.array([F**2, F**2, M**2])
        assert normal / np.linalg.norm(normal) == pytest.approx(moved / np.linalg.norm(moved), abs=1e-9)
        slopes = [
            contact.at(after[None, part], after[None, system.joints : system.unknowns]).gradient[0, :, -3:]
            for contact, part in zip(system.contacts, system.parts, strict=True)
        ]
        carried = np.vstack(slopes).T @ (system.contact_rows() @ after)
        assert carried == pytest.approx(-wrench, abs=2e-8)


def test_a_heavy_object_stays_where_it_is(grasping: Grasping) -> None:
    """20 kg: the fingers bend, the wrench stays inside the limit surface, the object creeps by less than the smoothing
    length a step."""
    system = grasping("t42pf", "fitted", "cylinder45")
    path = dragged(system, 20.0, 60.0)
    assert np.abs(np.diff(path.pose[:, :2], axis=0)).max() < 1e-7
    rule = path.rule
    assert isinstance(rule, OnTable)
    assert np.linalg.norm(rule.wrench(path.w[-2], path.w[-1])[:2]) < rule.limits.force_N


@pytest.mark.parametrize(("mass", "index"), [(0.05, 1), (0.3, 2), (1.0, 3)])
def test_one_step_is_the_minimum_of_energy_and_dissipation(mass: float, index: int, grasping: Grasping) -> None:
    """SLSQP on V(z) + D(Δ) alone, under contacts and windings, finds the same configuration for one step."""
    system = grasping("t42pp", "fitted", "cylinder40", onset_split=0.2)
    path = trace(system, step_m=1e-3, past_stops=False)
    start, drive = path.w[index], path.segments[index]
    limits = sliding(system.object, mass)
    rule, n = OnTable(system, limits), system.unknowns
    target = drive.rows @ start + [1e-4, 0.0]
    found = rule.solve(start, start, drive, target)
    assert found.converged[0]
    scale = system.column_scale[:n]
    e = drive.rows @ system.excursion_rows().T  # the drive in terms of both excursions

    def energy(x: Reals) -> float:
        z = x * scale
        moved = (z - start[:n])[system.joints :] * [limits.force_N, limits.force_N, limits.moment_Nm]
        return float(0.5 * system.stiffness @ z**2 + math.hypot(*moved, limits.force_N * 1e-7)) * 1e3

    def constraints(x: Reals) -> Reals:
        z = x * scale
        pose = z[None, system.joints :]
        gaps = [c.at(z[None, p], pose).value[0] for c, p in zip(system.contacts, system.parts, strict=True)]
        wound = [f.tendon.at(z[None, p]).value.sum() for f, p in zip(system.fingers, system.parts, strict=True)]
        return np.concatenate([*gaps, (e @ wound - target)]) * 30

    best = minimize(
        energy,
        start[:n] / scale,
        method="SLSQP",
        constraints=NonlinearConstraint(constraints, 0.0, 0.0),
        options={"ftol": 1e-15, "maxiter": 400},
    )
    assert energy(found.w[0, :n] / scale) <= energy(best.x) + 1e-7
    assert found.w[0, system.joints : n] == pytest.approx((best.x * scale)[system.joints :], abs=3e-6)


def test_a_sphere_turns_freely(grasping: Grasping) -> None:
    """It stands on a point: no moment, whatever the rotation."""
    sphere = load_object("sphere30")
    assert sliding(sphere) == Sliding(0.3 * sphere.mass_kg * STANDARD_GRAVITY_M_PER_S2, 0.0)
    path = dragged(grasping("t42ff", "fitted", "sphere30", onset_split=0.1), 0.3, 60.0)
    rule = path.rule
    assert isinstance(rule, OnTable)
    assert rule.wrench(path.w[-2], path.w[-1])[2] == 0
    assert abs(path.motion[-1, 2]) > 1e-3


def test_limits_are_those_of_weight_and_patch() -> None:
    """F = μ_t m g, M = F × mean distance: 29.8 mm for a 58 × 95 mm rectangle (hand-mechanics reference 8)."""
    limits = sliding(load_object("mustard"))
    assert limits.force_N == pytest.approx(0.3 * 0.6 * 9.80665)
    assert limits.moment_Nm / limits.force_N == pytest.approx(0.0298, abs=5e-5)
    with pytest.raises(MechanicsError, match="mass_kg"):
        sliding(load_object("mustard"), math.nan)
    with pytest.raises(MechanicsError, match="support"):
        sliding(replace(load_object("mustard"), support=None))


@pytest.mark.parametrize(("preset", "split"), [("nominal", 0.1), ("fitted", 0.0)])
def test_a_dragged_path_too_goes_past_its_stops_to_the_cap(preset: str, split: float, grasping: Grasping) -> None:
    """Pins at their stops leave the winding nothing to move, on the table as in the air: the load goes on alone."""
    system = grasping("t42pp", preset, "cylinder40", onset_split=split)
    path = trace(system, step_m=4e-4, rule=OnTable(system, sliding(system.object)))
    assert path.load_N[-1].max() == pytest.approx(128.0, abs=1e-6)
    assert path.at_stop[-1].tolist() == [0, 1, 0, 1]
    assert np.abs(path.pose[-1] - path.pose[-2]).max() < 1e-8
