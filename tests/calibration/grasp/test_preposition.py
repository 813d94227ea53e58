"""First contact against the figures of the reference and sampled outlines, and the grasps that cannot be."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.preposition import FirstContact, first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import finger_models
from calibration.hand.parameters import Hand, load_hand
from calibration.objects import Curve, Disc, GraspObject, Polygon, Rectangle, Shape, load_object
from drivers.errors import MechanicsError

HANDS = ("t42pp", "t42pf", "t42ff")
PAD_M = 0.02
HEXAGON = Polygon(
    tuple((0.028 * math.cos(math.pi / 3 * (k + 0.5)), 0.028 * math.sin(math.pi / 3 * (k + 0.5))) for k in range(6))
)


def nominal(name: str, radius_m: float, pad_length_m: float = 0.0) -> Hand:
    """A hand at nominal stiffness with another fingertip, as in hand-mechanics reference 10."""
    hand = load_hand(name, "nominal")
    finger = replace(hand.right, tip=replace(hand.right.tip, radius_m=radius_m, pad_length_m=pad_length_m))
    return replace(hand, right=finger, left=finger)


def leaning(distal_rest_deg: float, pad_length_m: float) -> Hand:
    """T42PP whose distal links are bent outwards at rest."""
    hand = nominal("t42pp", 0.006, pad_length_m)
    finger = replace(hand.right, rest_angle_deg=(15.0, distal_rest_deg))
    return replace(hand, right=finger, left=finger)


def thing(shape: Shape) -> GraspObject:
    """An object of that shape."""
    return GraspObject("thing", shape, 0.1)


@pytest.mark.parametrize(
    ("hand", "diameter_mm", "onset_N", "height_m"),
    [
        ("t42pp", 30, 4.07, 0.0964),
        ("t42pp", 40, 3.91, 0.0971),
        ("t42pp", 45, 3.83, 0.0973),
        ("t42pf", 30, 4.08, 0.0979),
        ("t42pf", 40, 3.92, 0.0985),
        ("t42pf", 45, 3.84, 0.0987),
        ("t42ff", 30, 4.58, 0.0948),
        ("t42ff", 40, 4.41, 0.0962),
        ("t42ff", 45, 4.32, 0.0968),
    ],
)
def test_onset_figures_of_the_reference(hand: str, diameter_mm: int, onset_N: float, height_m: float) -> None:
    """Onset tension and contact height of the symmetric grasp (hand-mechanics reference 10)."""
    start = first_contact(nominal(hand, 0.006), load_object(f"cylinder{diameter_mm}"), GraspSpec())
    assert start.tendon_load_N == pytest.approx([onset_N, onset_N], abs=0.009)
    assert start.object_pose == pytest.approx([0.0, height_m, 0.0], abs=6e-5)
    assert start.tendon_excursion_m == pytest.approx(start.tendon_load_N / start.free_closing_stiffness_N_per_m)


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize(
    "name", ["strawberry", "mustard", "rubiks_cube", "pear", "sphere10", "sphere50", "rectangle60"]
)
def test_symmetric_grasps_are_symmetric(hand: str, name: str) -> None:
    """Placed centrally every object of the paper stands on the hand's axis, upright, its centroid between the
    contacts."""
    start = first_contact(load_hand(hand), load_object(name), GraspSpec())
    assert start.object_pose[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-14)
    assert [start.outline_angle_rad, start.contact_line_angle_rad] == pytest.approx([0.0, 0.0], abs=1e-13)
    assert start.quality_m < 1e-14
    assert start.tendon_load_N[0] == start.tendon_load_N[1]
    assert abs(start.contact_points_m[0] + start.contact_points_m[1].conjugate()) < 1e-14
    width_m = load_object(name).shape.extent_m(0.0)  # the pear is widest below its centroid
    apart_m = abs(start.contact_points_m[0] - start.contact_points_m[1])
    assert apart_m == pytest.approx(width_m, abs=1e-12 if name != "pear" else 3e-4)


@pytest.mark.parametrize("hand", HANDS)
def test_only_the_width_between_the_fingers_counts(hand: str) -> None:
    """A disc, a square and a polygon as wide are touched at the same load and place, however deep they are."""
    shapes: list[Shape] = [Disc(0.04), Rectangle(0.04, 0.04), Rectangle(0.04, 0.06), Curve((0.02,))]
    starts = [first_contact(load_hand(hand), thing(shape), GraspSpec()) for shape in shapes]
    for start in starts[1:]:
        assert start.tendon_load_N == pytest.approx(starts[0].tendon_load_N, rel=1e-12)
        assert start.object_pose == pytest.approx(starts[0].object_pose, abs=1e-14)


# -- any placement, against sampled outlines -------------------------------------------------------------------------


def fingertip_distance(points: np.ndarray, hand: Hand, start: FirstContact, side: int) -> np.ndarray:
    """Distance of points (K,) from a fingertip's pad and arc, by plain geometry."""
    finger, q = finger_models(hand)[side], start.finger_joint_rad[side]
    angle = finger.angle_rad + q @ finger.angle_row
    local = (points - finger.tip.at(q[None]).value[0]) * np.exp(-1j * angle)
    length = 0.0 if finger.pad is None else finger.pad.length_m
    inward = local.imag * (1 if side == 0 else -1)
    on_pad = (local.real < 0) & (local.real > -length) & (inward > 0)
    return np.asarray(np.where(on_pad, inward, np.abs(local)) - finger.tip_radius_m)


PEAR = load_object("pear").shape
PLACEMENTS: dict[str, tuple[Shape, GraspSpec]] = {
    "disc off-centre": (Disc(0.04), GraspSpec(object_offset_m=0.006)),
    "disc off-centre and split": (Disc(0.04), GraspSpec(object_offset_m=-0.004, onset_split=0.1)),
    "rectangle turned": (Rectangle(0.05, 0.09), GraspSpec(object_angle_deg=12.0)),
    "rectangle shifted and split": (Rectangle(0.05, 0.09), GraspSpec(object_offset_m=0.01, onset_split=-0.08)),
    "hexagon turned": (HEXAGON, GraspSpec(object_angle_deg=-8.0, object_offset_m=0.003)),
    "pear turned": (PEAR, GraspSpec(object_angle_deg=35.0, object_offset_m=0.004)),
    "pear across": (PEAR, GraspSpec(object_angle_deg=90.0)),
}


@pytest.mark.parametrize("tip", ["arc", "point", "pad"])
@pytest.mark.parametrize("hand_name", HANDS)
@pytest.mark.parametrize("placement", PLACEMENTS)
def test_both_fingertips_touch_and_nothing_overlaps(placement: str, hand_name: str, tip: str) -> None:
    """The nearest point of the placed outline is at distance 0 of each fingertip, where the contact is said to be,
    and the object stands to the contact line as the grasp says."""
    shape, grasp = PLACEMENTS[placement]
    hand = nominal(hand_name, 0.0 if tip == "point" else 0.0105, PAD_M if tip == "pad" else 0.0)
    start = first_contact(hand, thing(shape), grasp)

    centre = complex(start.object_pose[0], start.object_pose[1])
    outline = centre + shape.outline_m(100_000) @ [1, 1j] * np.exp(1j * start.outline_angle_rad)
    for side, (point, normal) in enumerate(zip(start.contact_points_m, start.normals, strict=True)):
        distance = fingertip_distance(outline, hand, start, side)
        assert distance.min() == pytest.approx(0.0, abs=5e-9 if tip != "point" else 5e-6)
        assert abs(outline[np.argmin(distance)] - point) < 5e-5
        assert abs(normal) == pytest.approx(1.0, abs=1e-15)
        inner = point + 1e-4 * normal  # the normal leads from the fingertip into the object
        assert fingertip_distance(np.array([inner]), hand, start, side)[0] > 0.9e-4
    right, left = start.contact_points_m
    line = (right - left) / abs(right - left)
    assert start.contact_line_angle_rad == pytest.approx(np.angle(line), abs=1e-12)
    assert ((centre - left) / line).imag == pytest.approx(grasp.object_offset_m, abs=1e-13)
    assert start.outline_angle_rad - np.angle(line) == pytest.approx(math.radians(grasp.object_angle_deg), abs=1e-12)
    assert start.quality_m == pytest.approx(abs(centre - (right + left) / 2), abs=1e-15)
    shares = start.tendon_load_N / start.tendon_load_N.mean()
    assert shares == pytest.approx([1 + grasp.onset_split, 1 - grasp.onset_split])


@pytest.mark.parametrize(("distal_rest_deg", "offset_m"), [(-10.0, 0.004), (-20.0, 0.008), (-40.0, 0.016)])
def test_wide_objects_rest_on_the_pads(distal_rest_deg: float, offset_m: float) -> None:
    """Fingers that lean outwards touch a large disc with their pads: its normal is the pad's, and its centre stands
    off the contact line by R times the sine of the lean; that angle alone finds the load."""
    hand = leaning(distal_rest_deg, pad_length_m=0.03)
    start = first_contact(hand, thing(Disc(0.09)), GraspSpec(object_offset_m=offset_m))
    finger, q = finger_models(hand)[0], start.finger_joint_rad[0]
    angle = finger.angle_rad + q @ finger.angle_row
    assert start.normals[0] == pytest.approx(1j * np.exp(1j * angle), abs=1e-12)
    assert 0.045 * math.cos(angle) == pytest.approx(offset_m, abs=1e-12)


@pytest.mark.parametrize("name", ["mustard", "pear"])
def test_the_grasp_starts_in_contact(name: str) -> None:
    """The equations that start here have no residual there, also where the contact line is tilted."""
    grasp = GraspSpec(onset_split=0.1, object_angle_deg=7.0)
    system = grasp_system(load_hand("t42pp"), load_object(name), grasp)
    w = system.first_state()
    pose = w[None, system.joints : system.unknowns]
    for contact, q in zip(system.contacts, system.start.finger_joint_rad, strict=True):
        assert contact.at(q[None], pose).value == pytest.approx(np.zeros((1, 2)), abs=1e-13)


def test_onset_split_shares_the_load_and_mirrors() -> None:
    """A split δ means loads T(1 ± δ), and −δ is the mirror image."""
    hand, cylinder = load_hand("t42pp"), load_object("cylinder40")
    plus, minus = (first_contact(hand, cylinder, GraspSpec(onset_split=split)) for split in (0.1, -0.1))
    assert plus.tendon_load_N[0] / plus.tendon_load_N[1] == pytest.approx(1.1 / 0.9)
    assert minus.tendon_load_N == pytest.approx(plus.tendon_load_N[::-1])
    assert minus.object_pose == pytest.approx(plus.object_pose * [-1, 1, 1])


def test_offset_and_turn_mirror_up_and_down() -> None:
    """An arc that meets a disc from above or below closes to the same load; the disc stands elsewhere."""
    hand, cylinder = load_hand("t42pp"), load_object("cylinder40")
    up, down = (first_contact(hand, cylinder, GraspSpec(object_offset_m=offset)) for offset in (0.005, -0.005))
    assert up.tendon_load_N == pytest.approx(down.tendon_load_N)
    assert up.normals == pytest.approx(down.normals.conj())


# -- what cannot be --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "grasp", "said", "parameter"),
    [
        (Disc(0.3), GraspSpec(), "does not fit between the open fingers", "object.shape"),
        (Disc(0.04), GraspSpec(onset_split=0.9), "without touching", "onset_split"),
        (Disc(0.0005), GraspSpec(onset_split=0.5), "close past each other", "onset_split"),
        (Disc(0.04), GraspSpec(load_cap_N=20.0), "close freely up to 20.0 N", "load_cap_N"),
        (Disc(0.04), GraspSpec(object_offset_m=0.021), "1.0 mm beside the object", "object_offset_m"),
        (Rectangle(0.04, 0.04), GraspSpec(object_angle_deg=45.0), "corner", "object_angle_deg"),
        (Rectangle(0.02, 0.25), GraspSpec(), "through the palm", "object.shape"),
        (Disc(0.04), GraspSpec(object_offset_m=0.0199), "moves away from the object", "object_offset_m"),
    ],
)
def test_impossible_grasps_say_why(shape: Shape, grasp: GraspSpec, said: str, parameter: str) -> None:
    """What the fingers cannot take is refused with the reason and the parameter to change."""
    with pytest.raises(MechanicsError, match=said) as caught:
        first_contact(load_hand("t42pp"), thing(shape), grasp)
    assert caught.value.parameter == parameter


def test_a_stop_that_is_met_first_is_named() -> None:
    """A distal stop before contact is refused."""
    hand = load_hand("t42pp")
    joint = replace(hand.right.distal_joint, flexion_limit_deg=(0.0, 5.0))
    right = replace(hand.right, distal_joint=joint)
    with pytest.raises(MechanicsError, match="the right finger meets a stop"):
        first_contact(replace(hand, right=right), load_object("cylinder40"), GraspSpec())


@pytest.mark.parametrize(("shape", "said"), [(Disc(0.09), "pads do not face"), (Rectangle(0.06, 0.06), "outwards")])
def test_pads_that_lean_the_wrong_way_are_refused(shape: Shape, said: str) -> None:
    """A pad that would have to touch with its far end, or not at all, is no contact."""
    with pytest.raises(MechanicsError, match=said):
        first_contact(leaning(-30.0, pad_length_m=0.03), thing(shape), GraspSpec())


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
