"""The cycle's view of a motion table, number by number against the table itself."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable, Status, TableSample
from calibration.objects import load_object
from controller.cycle.planar_table import PlanarSample, PlanarTable, finger_excursion_m
from drivers.errors import TableError

TABLE = build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=0.1), nodes=9)
PLANAR = PlanarTable(TABLE)


def assert_same(planar: PlanarSample, sample: TableSample) -> None:
    assert planar.status is sample.status
    np.testing.assert_allclose(planar.pose, sample.object_pose[[0, 1, 5]], atol=1e-15)
    np.testing.assert_array_equal(planar.along_first, sample.jacobian[[0, 1, 5], 0])
    np.testing.assert_array_equal(planar.along_second, sample.jacobian[[0, 1, 5], 1])
    np.testing.assert_array_equal(planar.tension_N, sample.tension)
    assert planar.mean_tension_N == pytest.approx(float(sample.tension.mean()))
    assert planar.usable is (sample.status not in (Status.OUTSIDE, Status.INVALID))


@settings(max_examples=80)
@given(st.floats(-0.002, 0.012), st.floats(-0.003, 0.003))
def test_unpacks_what_the_table_says(mean_m: float, difference_m: float) -> None:
    """Inside, before, beyond and beside the domain: no column is taken for another, and only good ones are usable."""
    assert_same(PLANAR.at_excursion(mean_m, difference_m), TABLE.at_excursion(mean_m, difference_m))


def test_contact_is_the_tables() -> None:
    """Right is right: a split grasp has two different contact excursions."""
    right, left = PLANAR.contact_excursion_m
    assert (right, left) == tuple(TABLE.contact_excursion_m)
    assert right > left
    assert PLANAR.mean_contact_m == pytest.approx(0.5 * (right + left))
    np.testing.assert_array_equal(PLANAR.contact_pose, TABLE.contact_pose[[0, 1, 5]])
    np.testing.assert_array_equal(PLANAR.free_slope_N_per_m, TABLE.free_closing_stiffness_N_per_m)
    np.testing.assert_array_equal(PLANAR.contact_tension_N, TABLE.contact_tension_N)


@pytest.mark.parametrize(("stiffness", "compliance"), [(float("inf"), 0.0), (4e4, 2.5e-5)])
def test_tendon_stretch_comes_from_the_hand(stiffness: float, compliance: float) -> None:
    """An infinitely stiff tendon, written as text in the header, stretches not at all."""
    hand = {side: {**TABLE.header.hand[side]} for side in ("right", "left")}
    hand["left"]["tendon_stiffness_N_per_m"] = "inf" if stiffness == float("inf") else stiffness
    header = msgspec.structs.replace(TABLE.header, hand={**TABLE.header.hand, **hand})
    planar = PlanarTable(MotionTable(header, TABLE.arrays))
    assert planar.compliance_m_per_N[1] == compliance


def test_refuses_a_table_for_other_hands() -> None:
    """The cycle drives two tendons; it does not guess what a third would mean."""
    sample = TABLE.header
    header = msgspec.structs.replace(
        sample,
        tendons=["right", "left", "thumb"],
        channels=[*sample.channels, "a", "b", "c"],
        contact=msgspec.structs.replace(
            sample.contact,
            excursion_m=[*sample.contact.excursion_m, 0.0],
            tension_N=[*sample.contact.tension_N, 0.0],
            free_closing_stiffness_N_per_m=[*sample.contact.free_closing_stiffness_N_per_m, 1.0],
        ),
    )
    arrays = dict(TABLE.arrays)
    for name, array in arrays.items():
        if name.startswith(("excursion.", "load.", "frozen.")) and array.shape[-1] == 12:
            arrays[name] = np.concatenate([array, np.zeros((*array.shape[:-1], 3))], axis=-1)
    with pytest.raises(TableError, match="3 tendons"):
        PlanarTable(MotionTable(header, arrays))


@given(st.floats(-0.012, 0.006), st.floats(1e-6, 1e-3))
def test_fingers_wind_together_and_arrive_together(winding_m: float, further_m: float) -> None:
    """Each finger only winds in as the coordinate rises; open is zero for both, the zone is entered at once by both."""
    zone_m = 0.0012
    for finger in (0, 1):
        here, further = (finger_excursion_m(PLANAR, finger, w, zone_m) for w in (winding_m, winding_m + further_m))
        assert further > here
    right, left = (finger_excursion_m(PLANAR, finger, winding_m, zone_m) for finger in (0, 1))
    contact_right, contact_left = PLANAR.contact_excursion_m
    if winding_m >= -zone_m:
        assert (right - contact_right, left - contact_left) == pytest.approx((winding_m, winding_m), abs=1e-15)
    for finger in (0, 1):
        assert finger_excursion_m(PLANAR, finger, -PLANAR.mean_contact_m, zone_m) == pytest.approx(0.0, abs=1e-15)
