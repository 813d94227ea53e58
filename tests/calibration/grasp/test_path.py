"""Paths of equilibria: against the reference's instabilities, laws of frozen geometry, and direct solves."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from calibration.grasp.equilibrium import Drive, GraspSystem, excursion_drive, load_drive
from calibration.grasp.path import first_crossing, required_friction, state_between, trace
from calibration.grasp.stability import load_stability
from drivers.errors import MechanicsError

Grasping = Callable[..., GraspSystem]


@pytest.mark.parametrize(
    ("hand", "name", "load_N", "motion_mm"),
    [("t42pp", "cylinder40", 11.3, 13.7), ("t42pf", "cylinder45", 12.5, 15.2), ("t42ff", "cylinder30", 8.3, 6.9)],
)
def test_equal_tensions_become_unstable_where_the_reference_says(
    hand: str, name: str, load_N: float, motion_mm: float, grasping: Grasping
) -> None:
    """Hand-mechanics reference 6 gives the first unstable point of paths in 0.2 mm steps; here it is the very place,
    where the equations of that drive become singular; and the path goes on, flagged."""
    system = grasping(hand, "nominal", name, radius_m=0.006)
    path = trace(system, "load", step_m=4e-4, past_stops=False)
    lost = int(np.flatnonzero(~path.stable)[0])
    assert 0 < lost < len(path.w) - 1

    def eigenvalue(share: float) -> float:
        return float(load_stability(system, state_between(path, lost - 1, share)[None], path.at_stop[:1])[0])

    share = brentq(eigenvalue, 0.0, 1.0)
    w = state_between(path, lost - 1, share)
    motion = (w[system.joints : system.unknowns] - path.pose[0])[1]
    assert load_N - 0.2 < system.load_rows()[0] @ w < load_N + 0.05
    assert motion_mm - 0.6 < -motion * 1e3 < motion_mm + 0.05
    drive = Drive(system.load_rows())
    before, after = (
        np.linalg.slogdet(system.matrix(near[None], system.terms(near[None]), drive))[0][0]
        for near in (state_between(path, lost - 1, share - 1e-3), state_between(path, lost - 1, share + 1e-3))
    )
    assert before == -after


def test_equal_excursions_are_stable_through_the_stop(grasping: Grasping) -> None:
    """The same grasp, wound in equally: stable throughout, purely towards the palm, and the load goes on to the cap."""
    path = trace(grasping("t42ff", "nominal", "cylinder30", radius_m=0.006), step_m=4e-4)
    assert path.stable.all()
    assert np.abs(path.motion[:, [0, 2]]).max() < 1e-10
    assert "load cap" in path.end
    assert path.load_N[-1] == pytest.approx([128.0, 128.0], abs=1e-6)
    assert (np.diff(path.load_N.mean(1)) > 0).all()


def test_geometry_freezes_when_both_pins_are_at_their_stops(grasping: Grasping) -> None:
    """Point tips: then N = (T r − k q)/h over the proximal joint (hand-mechanics reference 6), up to the cap."""
    path = trace(grasping("t42pp", "nominal", "cylinder40", radius_m=0.0), step_m=4e-4)
    first = path.first_stop
    assert first is not None
    assert path.at_stop[first].tolist() == [0, 1, 0, 1]
    frozen = path.w[first:]
    assert frozen[:, :7] == pytest.approx(np.broadcast_to(frozen[0, :7], (len(frozen), 7)), abs=1e-9)
    height, bent = frozen[:, 5], frozen[:, 0]
    expected = (path.load_N[first:, 0] * 0.008 - 0.0290 * bent) / height
    assert path.contact_force_N[first:, 0] == pytest.approx(expected, rel=1e-8)
    stopped = trace(path.system, step_m=4e-4, past_stops=False)
    assert stopped.end == "right distal stop"
    assert stopped.w[-1] == pytest.approx(path.w[first], abs=1e-8)


def test_flexures_stay_a_little_soft_at_their_stops(grasping: Grasping) -> None:
    """End angles stand at the stop while shapes still give: force rises, motion goes on by less than a millimetre, and
    no step is lost on the way (hand-mechanics reference 14.3)."""
    path = trace(grasping("t42pf", "fitted", "cylinder45"), step_m=4e-4)
    first = path.first_stop
    assert first is not None
    angles = path.w[first:] @ path.system.joint_angle_rows()[[1, 3]].T
    assert angles == pytest.approx(np.full_like(angles, math.radians(103.1324)), abs=1e-9)
    moved = np.abs(path.motion[first:, 1] - path.motion[first, 1])
    assert 1e-7 < moved.max() < 1e-3
    assert (np.diff(path.contact_force_N[first:, 0]) > 0).all()
    assert np.abs(np.diff(path.motion[:, 1])).max() < 4e-3


def test_a_load_that_falls_up_to_the_stop_rises_again_there(grasping: Grasping) -> None:
    """T42PP, fitted, 30 mm: winding in beyond 97.8 N takes less load, not more; the path neither turns back nor ends
    there, but goes on to both stops and then to the cap."""
    path = trace(grasping("t42pp", "fitted", "cylinder30"), step_m=3e-4)
    load, first = path.load_N.mean(1), path.first_stop
    assert first is not None
    assert load[first] < load[:first].max() - 0.1
    assert (np.diff(path.excursion_m[: first + 1].mean(1)) > 0).all()
    assert (np.diff(load[first:]) > 0).all()
    assert load[-1] == pytest.approx(128.0, abs=1e-6)


def test_stops_are_met_one_after_the_other_off_centre(grasping: Grasping) -> None:
    """An onset split brings the right finger to its stop first; the left one follows, then nothing moves any more."""
    path = trace(grasping("t42pp", "nominal", "cylinder40", radius_m=0.006, onset_split=0.1), step_m=4e-4)
    first = path.first_stop
    assert first is not None
    assert path.at_stop[first].tolist() == [0, 1, 0, 0]
    both = int(np.flatnonzero((path.at_stop[:, 1] == 1) & (path.at_stop[:, 3] == 1))[0])
    assert both > first
    assert np.abs(path.motion[both:] - path.motion[both]).max() < 1e-9
    wound = path.excursion_m[: both + 1]
    assert wound[:, 0] == pytest.approx(wound[:, 1], abs=1e-10)


def test_nonsymmetric_tension_drive_ends_at_its_largest_load(grasping: Grasping) -> None:
    """Equal tension increments drift the other way than equal windings: 3.5 N as in hand-mechanics reference 6, and
    the path ends, by name, where the load cannot rise any more."""
    path = trace(grasping("t42pp", "nominal", "cylinder40", radius_m=0.006, onset_split=0.1), "load", step_m=4e-4)
    start = path.load_N[0].mean()
    found = first_crossing(path, lambda w: (w @ path.system.load_rows().T).mean(1) - start - 3.5)
    assert found is not None
    x, y, angle = found[1][4:7] - path.pose[0]
    assert (x * 1e3, y * 1e3, math.degrees(angle)) == pytest.approx((-3.6, -6.1, -4.6), abs=0.06)
    assert path.end == "no equilibrium beyond it"
    assert path.stability[-1] < 1e-2


def test_points_do_not_depend_on_the_steps(grasping: Grasping) -> None:
    """States are equilibria of their own: coarse and fine paths meet, and equal a direct solve."""
    system = grasping("t42pf", "fitted", "cylinder40", onset_split=0.05)
    coarse, fine = (trace(system, step_m=step, past_stops=False) for step in (8e-4, 3e-4))
    assert coarse.w[-1] == pytest.approx(fine.w[-1], abs=1e-7)
    drive = excursion_drive(system)
    w = state_between(coarse, 2, 0.37)
    direct = system.solve(fine.w[5][None], drive, (drive.rows @ w)[None])
    assert direct.converged[0]
    assert direct.w[0] == pytest.approx(w, abs=1e-9)


def test_stretching_tendons_change_the_winding_and_not_the_states(grasping: Grasping) -> None:
    """A symmetric grasp passes the same states with a soft tendon; the spool winds T/k more."""
    stiff = trace(grasping("t42pp", "fitted", "cylinder40"), step_m=8e-4)
    soft = trace(grasping("t42pp", "fitted", "cylinder40", tendon_stiffness_N_per_m=4e4), "spool", step_m=8e-4)
    drive = load_drive(stiff.system)
    w = soft.w[len(soft.w) // 2]
    same = stiff.system.solve(w[None], drive, (drive.rows @ w)[None])
    assert same.w[0] == pytest.approx(w, abs=1e-9)
    spool = soft.w @ soft.system.spool_rows().T
    finger = soft.w @ soft.system.excursion_rows().T
    assert spool - finger == pytest.approx(soft.load_N / 4e4, abs=1e-12)


def test_required_friction_is_not_a_number_where_nothing_presses(grasping: Grasping) -> None:
    """At first contact the ratio does not exist (hand-mechanics reference 14.7)."""
    assert math.isnan(required_friction(np.zeros((1, 4)))[0])
    assert required_friction(np.array([[2.0, -1.0, 4.0, 1.0]])) == pytest.approx([0.5])
    path = trace(grasping("t42pp", "fitted", "cylinder40"), step_m=2e-3, past_stops=False)
    assert np.isnan(path.required_friction).tolist() == [True] + [False] * (len(path.w) - 1)


def test_bad_requests_are_named(grasping: Grasping) -> None:
    """A step or a cap that cannot lead anywhere is refused before anything is computed."""
    system = grasping("t42pp", "nominal", "cylinder40")
    for step_m in (0.0, -1e-4, 0.1, math.nan):
        with pytest.raises(MechanicsError, match="step_m"):
            trace(system, step_m=step_m)
    for load_cap_N in (1.0, math.nan):
        with pytest.raises(MechanicsError, match="load_cap_N"):
            trace(system, load_cap_N=load_cap_N)
