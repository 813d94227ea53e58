"""The hysteresis loop of rubbing tendons: its band by hand, its branch by the equations of that branch."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.equilibrium import GraspSystem, excursion_drive, grasp_system
from calibration.grasp.path import trace
from calibration.grasp.specification import GraspSpec
from calibration.grasp.unwinding import RubbingTendons, unwind
from calibration.hand.parameters import StraightTendonAtPin, load_hand
from calibration.objects import load_object
from drivers.errors import MechanicsError


def rubbing(
    hand: str, loss: float, *, preset: str = "fitted", split: float = 0.0, unwinding: bool = False
) -> GraspSystem:
    found = load_hand(hand, preset)
    finger = replace(found.right, routing_friction=loss)
    return grasp_system(
        replace(found, right=finger, left=finger),
        load_object("cylinder40"),
        GraspSpec(onset_split=split),
        branch="unwinding" if unwinding else "winding",
    )


def test_the_load_falls_through_the_band_while_the_hand_holds_its_shape() -> None:
    """Two pins, symmetric, forces horizontal: T r − k_P q_P = N h_1 and T_D r − k_D q_D = N h_2 (hand-mechanics
    reference 6). With the shape held, T_D = T e^c gives the load at which the tendon runs again."""
    system = rubbing("t42pp", 0.2)
    path = trace(system, step_m=6e-4, load_cap_N=70.0)
    back = unwind(path, step_m=6e-4)
    w = path.w[-1]
    point = system.contacts[0].contact_point(w[None, :2], w[None, 4:7])[0]
    elbow = system.fingers[0].links[1].root.at(w[None, :2]).value[0]
    h_1, h_2 = point.imag, (point - elbow).imag
    spring_P, spring_D = system.stiffness[:2] * w[:2]
    runs_again_N = (spring_D - h_2 / h_1 * spring_P) / (0.008 * (math.exp(0.2) - h_2 / h_1))
    above = back.load_N[:, 0] > runs_again_N + 1e-6
    assert above.sum() > 3
    assert back.pose[above] == pytest.approx(np.broadcast_to(path.pose[-1], (above.sum(), 3)), abs=1e-10)
    assert np.abs(back.excursion_m[above]).max() < 1e-10
    assert np.abs(back.motion[~above][1:, 1]).min() > 1e-5
    rule = back.rule
    assert isinstance(rule, RubbingTendons)
    share = np.array([rule.distal_share(state)[0] for state in back.w])
    assert share[0] == pytest.approx(math.exp(-0.2), rel=1e-7)
    assert share[~above] == pytest.approx(np.full((~above).sum(), math.exp(0.2)), rel=1e-7)
    assert (np.diff(share[above]) > 0).all()


@pytest.mark.parametrize(("hand", "split"), [("t42pp", 0.1), ("t42pf", 0.0), ("t42ff", 0.05)])
def test_then_it_follows_the_unwinding_branch(hand: str, split: float) -> None:
    """Every later state solves the equations of the unwinding branch, and the loop is open: less load at the same
    winding, the object left nearer to the palm, until the contacts let go."""
    system, other = rubbing(hand, 0.15, split=split), rubbing(hand, 0.15, split=split, unwinding=True)
    path = trace(system, step_m=6e-4, load_cap_N=60.0)
    back = unwind(path, step_m=6e-4)
    drive = excursion_drive(system)
    states = other.solve(back.w[-4:], drive, back.w[-4:] @ drive.rows.T)
    assert states.converged.all()
    assert states.w == pytest.approx(back.w[-4:], abs=1e-6)
    assert "contact lost" in back.end
    assert back.load_N[-1].mean() < path.load_N[0].mean()
    assert back.pose[-1, 1] < path.pose[0, 1] - 1e-3


def test_without_friction_it_goes_back_the_way_it_came() -> None:
    """c = 0: the same states, back to first contact."""
    path = trace(rubbing("t42pf", 0.0), step_m=6e-4, load_cap_N=50.0)
    back = unwind(path, step_m=6e-4)
    assert back.pose[-1] == pytest.approx(path.pose[0], abs=1e-8)
    assert back.load_N[-1] == pytest.approx(path.load_N[0], abs=1e-4)


def test_joints_leave_their_stops_again() -> None:
    """From the load cap, both joints at their stops, down to contact: stops are released, in the order of the loads."""
    path = trace(rubbing("t42pp", 0.2, preset="nominal"), step_m=6e-4, load_cap_N=30.0)
    assert path.at_stop[-1].tolist() == [0, 1, 0, 1]
    back = unwind(path, step_m=6e-4)
    assert back.at_stop[-1].tolist() == [0, 0, 0, 0]
    assert (np.diff(back.load_N.mean(1)) < 0).all()
    assert (np.diff(back.pose[:, 1]) > -1e-9).all()


def test_straight_tendons_are_refused() -> None:
    """A law that the distal length alone does not fix says so."""
    found = load_hand("t42pp")
    joint = replace(found.right.distal_joint, tendon=StraightTendonAtPin(before_m=0.02, after_m=0.02))
    finger = replace(found.right, distal_joint=joint)
    system = grasp_system(replace(found, right=finger, left=finger), load_object("cylinder40"), GraspSpec())
    path = trace(system, step_m=1e-3, load_cap_N=40.0)
    with pytest.raises(MechanicsError, match="straight tendon"):
        unwind(path)
