"""A whole plan: it agrees with its parts, and refuses what cannot be planned."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.plan import GraspPlan, plan_grasp
from calibration.grasp.preposition import first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from drivers.errors import MechanicsError


@pytest.fixture(scope="module")
def mustard() -> GraspPlan:
    return plan_grasp(load_hand("t42pf"), load_object("mustard"), GraspSpec(supported=False), 0.6)


def test_the_plan_of_the_heavy_bottle(mustard: GraspPlan) -> None:
    """Fig. 17: 28 mm at minimal effort, N* on flat sides; closed in the plane, rank 5 in space; nothing violated."""
    assert mustard.minimal is not None
    assert mustard.minimal.motion[1] == pytest.approx(-0.028, abs=2e-4)
    assert mustard.minimal.normal_N == pytest.approx([0.6 * 9.80665 / 0.6] * 2, rel=1e-9)
    assert mustard.closure.holds
    assert mustard.closure.spatial_rank == 5
    assert mustard.constraints is not None
    assert mustard.constraints.violated == []
    assert mustard.unstable_from_m is None
    assert "load cap" in mustard.path.end


def test_preposition_is_first_contact(mustard: GraspPlan) -> None:
    """The object's place in the hand is that of first contact, as tables have it, and Q_DC is zero."""
    start = first_contact(mustard.hand, mustard.object, mustard.grasp)
    assert mustard.T_hand_object[:2, 3] == pytest.approx(start.object_pose[:2], abs=1e-12)
    assert mustard.T_hand_object[:3, :3] == pytest.approx(np.eye(3))
    assert mustard.start.quality_m == pytest.approx(0, abs=1e-12)


def test_off_centre_grasps_say_by_how_much() -> None:
    """An offset is Q_DC; a disc taken off its middle turns the normals out of the line, by the angle of the chord."""
    plan = plan_grasp(
        load_hand("t42pp"), load_object("cylinder40"), GraspSpec(object_offset_m=0.004, supported=False), 0.1
    )
    assert plan.start.quality_m == pytest.approx(0.004, abs=1e-9)
    lean = math.asin(0.004 / 0.020)
    assert plan.closure.cone_margin_rad == pytest.approx([math.atan(0.3) - lean] * 2, abs=1e-9)


def test_on_the_table_the_largest_friction_is_that_of_the_drag() -> None:
    """The table asks for more friction just after contact than lifting asks for anywhere."""
    hand, cylinder = load_hand("t42pf"), load_object("cylinder45")
    lifted, supported = (
        plan_grasp(hand, cylinder, GraspSpec(supported=on_table, load_cap_N=60.0), 0.1) for on_table in (False, True)
    )
    assert supported.largest_required_friction > 0.3 > lifted.largest_required_friction


def test_what_nothing_holds_has_no_minimal_effort() -> None:
    """Ten kilograms: no effort, no constraints to report, and the sentence says why."""
    plan = plan_grasp(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(supported=False), 10.0)
    assert plan.minimal is None
    assert plan.constraints is None
    assert "Nothing below the load cap holds" in plan.levels.statement


def test_impossible_plans_are_refused() -> None:
    """Mass out of range, and a table that the object does not have."""
    hand, cylinder = load_hand("t42pp"), load_object("cylinder40")
    for mass in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(MechanicsError, match="mass_kg"):
            plan_grasp(hand, cylinder, GraspSpec(), mass)
    with pytest.raises(MechanicsError, match="supported"):
        plan_grasp(hand, replace(cylinder, support=None), GraspSpec(supported=True))
