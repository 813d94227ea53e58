"""Robot hand constraints: clearances against plain geometry, and a motion that a collision ends (paper, Fig. 4)."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from calibration.grasp.constraints import contact_margins, gaps, object_body, phalanx_hull, robot_hand_constraints
from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.hulls import separation_m
from calibration.grasp.path import trace
from calibration.hand.finger import finger_models
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from drivers.errors import MechanicsError

Grasping = Callable[..., GraspSystem]


@pytest.mark.parametrize(("hand", "preset"), [("t42pf", "nominal"), ("t42ff", "nominal"), ("t42pf", "fitted")])
def test_phalanges_meet_when_the_exposed_tendon_is_used_up(hand: str, preset: str) -> None:
    """A flexure bent to an arc brings the inner faces together at l_F / inner_m, in both fingers: l_F/r nominally."""
    found = load_hand(hand, preset)
    angle = 0.010 / found.right.outline.inner_m
    if preset == "nominal":
        assert angle == pytest.approx(0.010 / 0.008)
    for finger in finger_models(found):
        q = np.zeros((3, finger.angle_row.size))
        q[:, finger.joint_index[1]] = [angle - 1e-6, angle, angle + 1e-6]
        before, there, after = separation_m(phalanx_hull(finger, 0, q), phalanx_hull(finger, 1, q))
        assert before > 0 > after
        assert there == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(("hand", "preset"), [("t42pf", "nominal"), ("t42ff", "fitted")])
def test_a_collision_ends_the_motion(hand: str, preset: str, grasping: Grasping) -> None:
    """Without joint stops the phalanges end the path, near l_F / inner_m (contact forces bend a flexure off its arc);
    there the clearance is zero and nothing is violated."""
    system = grasping(hand, preset, "sphere30", stop_deg=140.0)
    path = trace(system, clearances=gaps(system), step_m=4e-4)
    assert path.end == "right phalanges collide"
    clearance = next(gap for gap in gaps(system) if gap.name == path.end)
    assert clearance.at(path.w[-1:]) == pytest.approx(0, abs=1e-9)
    assert (clearance.at(path.w[:-1]) > 0).all()
    distal = system.joint_angle_rows()[1] @ path.w[-1]
    assert distal == pytest.approx(0.010 / load_hand(hand, preset).right.outline.inner_m, rel=0.02)
    report = robot_hand_constraints(system, path.w[-1], 0.3)
    assert report.violated == []
    assert report.surface_error_m < 1e-12


@pytest.mark.parametrize("name", ["cylinder40", "rectangle40", "pear"])
def test_phalanx_points_and_the_object(name: str, grasping: Grasping) -> None:
    """Clearances agree with the nearest of many points on both outlines: along the whole of a path."""
    system = grasping("t42pf", "fitted", name)
    path = trace(system, step_m=1e-3, past_stops=False)
    outline = system.object.shape.outline_m(720) @ [1, 1j] * np.exp(1j * system.start.outline_angle_rad)
    for side, (finger, part) in enumerate(zip(system.fingers, system.parts, strict=True)):
        for phalanx in (0, 1):
            gap = gaps(system)[2 * side + phalanx]
            for w in path.w[:: max(1, len(path.w) // 3)]:
                pose = w[system.joints : system.unknowns]
                placed = complex(pose[0], pose[1]) + outline * np.exp(1j * pose[2])
                hull = phalanx_hull(finger, phalanx, w[None, part], without_tip=True)
                corners = hull.centres[0]
                steps = np.linspace(0, 1, 60, endpoint=False)
                rim = (corners + steps[:, None] * (np.roll(corners, -1) - corners)).ravel()
                nearest = np.abs(placed[:, None] - rim[None]).min()
                found = float(gap.at(w[None])[0])
                assert 0 < found <= nearest + 1e-9
                if name != "rectangle40":  # between two corners the clearance is a lower bound
                    assert found == pytest.approx(nearest, abs=4e-4)


def test_overlapping_is_negative_and_named(grasping: Grasping) -> None:
    """An object pushed into a phalanx, crossed fingers and a joint beyond its limit are all told apart."""
    system = grasping("t42ff", "fitted", "cylinder40")
    w = system.first_state()
    assert robot_hand_constraints(system, w, 0.3).violated == []
    w[system.joints] += 0.04
    names = robot_hand_constraints(system, w, 0.3).violated
    assert "right proximal phalanx meets the object" in names or "right distal phalanx meets the object" in names
    assert "a contact has left the object's surface" in names
    crossed = system.first_state()
    crossed[system.joint_columns[0]] = crossed[system.joint_columns[2]] = math.radians(100)
    assert any("collide" in name for name in robot_hand_constraints(system, crossed, 0.3).violated)
    beyond = system.first_state()
    beyond[system.joint_columns[3]] = 2.0
    assert "left distal joint beyond its limit" in robot_hand_constraints(system, beyond, 0.3).violated


def test_cones_are_judged_with_the_weight(grasping: Grasping) -> None:
    """At one state the cones hold without weight and not with it: μ N − sqrt(f_o² + f_t²), by hand."""
    system = grasping("t42pp", "fitted", "cylinder40")
    w = trace(system, step_m=5e-4, past_stops=False).w[2]
    normal, along = (system.contact_rows() @ w)[:2]
    report = robot_hand_constraints(system, w, 0.3, out_of_plane_N=1.0)
    assert report.cone_margin_N == pytest.approx([0.3 * normal - math.hypot(along, 1.0)] * 2, abs=1e-9)
    assert ("right contact outside its friction cone" in report.violated) == (report.cone_margin_N[0] < 0)


def test_contact_margins_are_those_of_the_contacts(grasping: Grasping) -> None:
    """A rectangle's side ends somewhere; a disc's outline does not."""
    assert contact_margins(grasping("t42pp", "fitted", "cylinder40")) == []
    system = grasping("t42pp", "fitted", "rectangle40")
    margins = contact_margins(system)
    assert {gap.name for gap in margins} == {"right contact at side end", "left contact at side end"}
    assert margins[0].at(system.first_state()[None]) == pytest.approx(0.020, abs=1e-9)


def test_a_clearance_closed_from_the_start_is_refused(grasping: Grasping) -> None:
    """A path that would begin in a collision says so instead of following it."""
    system = grasping("t42pp", "fitted", "cylinder40")
    gap = gaps(system)[0]
    shifted = type(gap)("a wall", lambda w: gap.at(w) - 1.0)
    with pytest.raises(MechanicsError, match="a wall"):
        trace(system, step_m=1e-3, past_stops=False, clearances=[shifted])


def test_every_shape_has_a_body() -> None:
    """The body's extent along x is the shape's, wherever it stands and however it is turned."""
    for name in ("sphere20", "rectangle60", "pear"):
        shape = load_object(name).shape
        body = object_body(shape, 0.4, np.array([[0.01, 0.09, 0.2]]))
        ends = body.reach_m(np.array([[1.0 + 0j, -1.0 + 0j]]))[0]
        assert ends.sum() == pytest.approx(shape.extent_m(-0.6), rel=1e-9)
