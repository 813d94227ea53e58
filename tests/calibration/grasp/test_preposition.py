"""First contact against the figures of the reference, and the grasps that cannot be."""

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.preposition import first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import finger_models
from calibration.hand.parameters import Hand, load_hand
from calibration.objects import Disc, GraspObject, load_object
from drivers.errors import MechanicsError


def nominal_with_tip(radius_m: float) -> Hand:
    """T42PP at nominal stiffness with another fingertip, as in hand-mechanics reference 10."""
    hand = load_hand("t42pp", "nominal")
    finger = replace(hand.right, tip=replace(hand.right.tip, radius_m=radius_m))
    return replace(hand, right=finger, left=finger)


@pytest.mark.parametrize(
    ("name", "onset_N", "height_m"),
    [("cylinder30", 4.07, 0.0964), ("cylinder40", 3.91, 0.0971), ("cylinder45", 3.83, 0.0973)],
)
def test_onset_figures_of_the_reference(name: str, onset_N: float, height_m: float) -> None:
    """Onset tension and contact height of the symmetric grasp (hand-mechanics reference 10)."""
    start = first_contact(nominal_with_tip(0.006), load_object(name), GraspSpec())
    assert start.tendon_load_N == pytest.approx([onset_N, onset_N], abs=0.006)
    assert start.object_pose == pytest.approx([0.0, height_m, 0.0], abs=6e-5)
    assert start.tendon_excursion_m == pytest.approx(start.tendon_load_N / start.free_closing_stiffness_N_per_m)


def test_onset_split_shares_the_load_and_mirrors() -> None:
    """A split δ means loads T(1 ± δ), and −δ is the mirror image."""
    hand, thing = load_hand("t42pp"), load_object("cylinder40")
    plus, minus = (first_contact(hand, thing, GraspSpec(onset_split=split)) for split in (0.1, -0.1))
    assert plus.tendon_load_N[0] / plus.tendon_load_N[1] == pytest.approx(1.1 / 0.9)
    assert minus.tendon_load_N == pytest.approx(plus.tendon_load_N[::-1])
    assert minus.object_pose == pytest.approx(plus.object_pose * [-1, 1, 1])


@pytest.mark.parametrize(
    ("diameter_m", "split", "said"),
    [
        (0.3, 0.0, "does not fit between the open fingers"),
        (0.04, 0.9, "without touching"),
        (0.0005, 0.5, "without touching"),
    ],
)
def test_impossible_grasps_say_why(diameter_m: float, split: float, said: str) -> None:
    """An object too wide, or fingers too far apart in load, are refused with the reason."""
    thing = GraspObject("thing", Disc(diameter_m), 0.1)
    with pytest.raises(MechanicsError, match=said):
        first_contact(load_hand("t42pp"), thing, GraspSpec(onset_split=split))


@pytest.mark.parametrize("split", [float("nan"), 1.0, -2.0])
def test_split_must_be_a_share(split: float) -> None:
    """NaN and loads that would push are refused where they enter."""
    with pytest.raises(MechanicsError, match="onset_split"):
        GraspSpec(onset_split=split)


def test_centre_lies_on_the_tip_line() -> None:
    """With different fingertips the disc still touches both: centre at R + ρ of each tip's arc."""
    hand = load_hand("t42pp")
    hand = replace(hand, left=replace(hand.left, tip=replace(hand.left.tip, radius_m=0.010)))
    start = first_contact(hand, load_object("cylinder40"), GraspSpec(onset_split=0.05))
    for finger, q in zip(finger_models(hand), start.finger_joint_rad, strict=True):
        tip = complex(finger.tip.at(q[None]).value[0])
        assert np.hypot(start.object_pose[0] - tip.real, start.object_pose[1] - tip.imag) == pytest.approx(
            0.020 + finger.tip_radius_m
        )
