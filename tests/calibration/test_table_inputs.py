"""Hand, object and grasp, read back from a table's header."""

from calibration.build import inputs_sha256
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable
from calibration.objects import load_object
from calibration.table_inputs import table_inputs


def test_what_went_in_comes_out(split_table: MotionTable) -> None:
    """Infinite tendon stiffness included: the same structs, and so the same hash."""
    hand, taken, grasp = table_inputs(split_table)
    assert (hand, taken, grasp) == (load_hand("t42pp"), load_object("cylinder40"), GraspSpec(onset_split=0.1))
    assert hand.right.tendon_stiffness_N_per_m == float("inf")
    assert inputs_sha256(hand, taken, grasp) == split_table.inputs_sha256
