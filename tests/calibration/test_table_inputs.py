"""Hand, object and grasp, read back from a table's header."""

from calibration.build import build_table, inputs_sha256
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from calibration.table_inputs import table_inputs


def test_what_went_in_comes_out() -> None:
    """Infinite tendon stiffness included: the same structs, and so the same hash."""
    given = load_hand("t42pf"), load_object("pear"), GraspSpec(onset_split=0.05, load_cap_N=90.0)
    table = build_table(*given, nodes=9)
    hand, taken, grasp = table_inputs(table)
    assert (hand, taken, grasp) == given
    assert hand.right.tendon_stiffness_N_per_m == float("inf")
    assert inputs_sha256(hand, taken, grasp, nodes=9) == table.inputs_sha256
