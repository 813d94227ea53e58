"""Fingertip slip: Coulomb's law at every point, the reference's numbers, and ejection said aloud."""

from collections.abc import Callable

import numpy as np
import pytest

from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.friction import OnTable, sliding
from calibration.grasp.path import Path, first_crossing, required_friction, trace
from calibration.grasp.slip import SlippingTips, slip_m
from drivers.errors import MechanicsError

Grasping = Callable[..., GraspSystem]


@pytest.fixture(scope="module")
def mustard(grasping: Grasping) -> GraspSystem:
    return grasping("t42pf", "fitted", "mustard")


@pytest.fixture(scope="module")
def slipping(mustard: GraspSystem) -> Path:
    """600 g on the table, friction 0.3 at the fingertips."""
    rule = SlippingTips(mustard, 0.3, sliding(mustard.object, 0.6))
    return trace(mustard, step_m=1e-4, rule=rule)


def test_slip_takes_the_motion_that_the_reference_says(mustard: GraspSystem, slipping: Path) -> None:
    """Mustard, 600 g, to 128 N (hand-mechanics reference 8): 44 mm lifted, 39.6 on the table, 36.9 with tips of 0.6, 33
    with 0.3, whose tips slide 6.4 mm. The tips slide most in the very first steps, so figures depend on them."""
    assert -slipping.motion[-1, 1] * 1e3 == pytest.approx(33, abs=0.5)
    assert np.abs(slip_m(slipping)[-1]) * 1e3 == pytest.approx([6.4, 6.4], abs=0.35)
    rough = trace(mustard, step_m=1e-4, rule=SlippingTips(mustard, 0.6, sliding(mustard.object, 0.6)))
    assert -rough.motion[-1, 1] * 1e3 == pytest.approx(36.9, abs=0.35)


def test_coulombs_law_holds_at_every_point(slipping: Path) -> None:
    """|f_t| ≤ μ N; a tip that slides is at the edge of its cone; friction takes energy out; a tip inside its cone keeps
    its place."""
    forces, slips = slipping.contact_force_N[1:], np.diff(slip_m(slipping), axis=0)
    for side in (0, 1):
        normal, along, slid = forces[:, 2 * side], forces[:, 2 * side + 1], slips[:, side]
        assert (np.abs(along) <= 0.3 * normal + 1e-7).all()
        sliding_now = np.abs(slid) > 1e-8
        assert sliding_now.any()
        assert np.abs(along)[sliding_now] == pytest.approx(0.3 * normal[sliding_now], abs=1e-7)
        assert (along * slid <= 1e-10).all()
        assert (np.abs(along)[~sliding_now] <= 0.3 * normal[~sliding_now] + 1e-7).all()


def test_rough_tips_roll(grasping: Grasping) -> None:
    """With friction enough for the whole path the rule changes nothing."""
    system = grasping("t42pp", "fitted", "cylinder40", onset_split=0.1)
    limits = sliding(system.object, 0.1)
    rolling = trace(system, step_m=3e-4, load_cap_N=60.0, rule=OnTable(system, limits))
    rough = trace(system, step_m=3e-4, load_cap_N=60.0, rule=SlippingTips(system, 5.0, limits))
    assert rough.w[-1] == pytest.approx(rolling.w[-1], abs=1e-6)
    assert np.abs(slip_m(rough)).max() < 1e-9
    with pytest.raises(MechanicsError, match="SlippingTips"):
        slip_m(rolling)


def test_lifted_tips_roll_until_friction_is_used_up(grasping: Grasping) -> None:
    """In the air a 40 mm disc asks for |f_t|/N that grows along the path. Where there is no more, a tip slides further
    round the disc, which asks for more still: the disc is squeezed out, and the path ends there."""
    system = grasping("t42pp", "fitted", "cylinder40")
    rolling = trace(system, step_m=3e-4, past_stops=False)
    path = trace(system, step_m=3e-4, past_stops=False, rule=SlippingTips(system, 0.1))
    assert path.end == "the fingertips slip off: no quasi-static continuation"
    used_up = first_crossing(rolling, lambda w: required_friction(w @ system.contact_rows().T) - 0.1, start=1)
    assert used_up is not None
    assert path.w[-1] == pytest.approx(used_up[1], rel=2e-3, abs=2e-3)
    assert np.abs(slip_m(path)).max() < 1e-9


def test_heavy_round_objects_are_ejected_and_it_is_said(grasping: Grasping) -> None:
    """600 g at 0.3: the tips slide round the equator until nothing balances (hand-mechanics reference 8)."""
    system = grasping("t42pf", "fitted", "cylinder45")
    path = trace(system, step_m=4e-4, rule=SlippingTips(system, 0.3, sliding(system.object, 0.6)))
    assert path.end == "the fingertips slip off: no quasi-static continuation"
    assert np.abs(slip_m(path)[-1]).min() > 5e-3
    assert np.abs(path.motion[-1]).max() < 1e-3


def test_friction_that_is_none_is_refused(mustard: GraspSystem) -> None:
    """Slip needs a coefficient > 0."""
    with pytest.raises(MechanicsError, match="contact_friction"):
        SlippingTips(mustard, 0.0)
