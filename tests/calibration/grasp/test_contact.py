"""Rolling contact: geometry against trigonometry and sampling, rolling against lengths travelled, what is refused."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from calibration.grasp.contact import RollingContact, rolling_contact
from calibration.hand.finger import FingerModel, Reals, finger_models
from calibration.hand.parameters import load_hand
from calibration.objects import Curve, Disc, Polygon, Rectangle, Shape, load_object
from calibration.objects.shapes import Flat
from drivers.errors import MechanicsError

RADIUS_M = 0.02
PAD_M = 0.02
PEAR = load_object("pear").shape


def fingers(radius_m: float, pad_length_m: float = 0.0) -> tuple[FingerModel, FingerModel]:
    """T42PP with another fingertip."""
    hand = load_hand("t42pp", "nominal")
    tip = replace(hand.right.tip, radius_m=radius_m, pad_length_m=pad_length_m)
    finger = replace(hand.right, tip=tip)
    return finger_models(replace(hand, right=finger, left=finger))


def touching(
    finger: FingerModel, shape: Shape, past_pad_rad: float, turn_rad: float = 0.0
) -> tuple[RollingContact, Reals, Reals]:
    """A contact of the arc, `past_pad_rad` beyond the pad's normal, with joints and pose.

    A round outline is turned by `turn_rad`; of a flat one the side with normal angle 0 faces the arc.
    """
    q = np.array([0.9, 0.5])
    angle = finger.angle_rad + q @ finger.angle_row
    direction = float(angle + finger.links[1].inner_side * (math.pi / 2 - past_pad_rad))
    facing = direction + math.pi
    if isinstance(shape, Flat):
        turn_rad, h, slope = facing, shape.extent_m(0.0) / 2, 0.0
    else:
        h, slope = (float(level[0]) for level in shape.support.derivatives(np.array([facing - turn_rad]), 1)[1:])
    centre = finger.tip.at(q[None]).value[0] - (h + finger.tip_radius_m + 1j * slope) * np.exp(1j * facing)
    pose = np.array([centre.real, centre.imag, 0.0])
    return rolling_contact(finger, shape, q, pose, turn_rad), q, pose


@pytest.mark.parametrize("side", [0, 1])
def test_gap_and_rolling_mean_what_they_say(side: int) -> None:
    """Rolling round a held tip by an angle turns the disc by (R + ρ)/R of it; a shift along the normal is a gap."""
    finger = fingers(0.0105)[side]
    contact, q, pose = touching(finger, Disc(2 * RADIUS_M), 0.3)
    distance, angle = RADIUS_M + finger.tip_radius_m, 0.8
    tip = complex(finger.tip.at(q[None]).value[0])
    assert contact.at(q[None], pose[None]).value == pytest.approx(np.zeros((1, 2)), abs=1e-10)
    rolled = tip + (complex(pose[0], pose[1]) - tip) * np.exp(1j * angle)
    turned = np.array([[rolled.real, rolled.imag, angle * distance / RADIUS_M]])
    assert contact.at(q[None], turned).value == pytest.approx(np.zeros((1, 2)), abs=1e-10)
    apart = tip + (rolled - tip) * 1.3
    gap = contact.at(q[None], np.array([[apart.real, apart.imag, turned[0, 2]]])).value[0, 0]
    assert gap == pytest.approx(0.3 * distance, rel=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_arc_rolls_along_a_flat_side(side: int) -> None:
    """Turning the finger by an angle about the arc's centre rolls the side on by ρ times it; more is slip."""
    finger = fingers(0.0105)[side]
    contact, q, pose = touching(finger, Rectangle(0.04, 0.06), 0.3)
    turn = 0.2
    curled = q + np.array([0.0, turn])
    moved = complex(finger.tip.at(curled[None]).value[0] - finger.tip.at(q[None]).value[0])
    normal = complex(contact.normal(q[None], pose[None])[0])
    rolled = complex(pose[0], pose[1]) + moved + 1j * normal * finger.tip_radius_m * float(turn * finger.angle_row[1])
    values = [
        contact.at(curled[None], np.array([[place.real, place.imag, 0.0]])).value[0]
        for place in (rolled, rolled + 1e-3j * normal, rolled + 1e-3 * normal)
    ]
    assert values == pytest.approx(np.array([[0.0, 0.0], [0.0, 1e-3], [1e-3, 0.0]]), abs=1e-15)


def test_disc_and_constant_curve_are_the_same_contact() -> None:
    """A disc written as a curve gives the same constraints, derivatives and contact point."""
    rng = np.random.default_rng(1)
    for finger in fingers(0.0105):
        disc, q, pose = touching(finger, Disc(2 * RADIUS_M), 0.3)
        # one more coefficient, of no size, so that the general search for the nearest point is what is compared
        curve = rolling_contact(finger, Curve((RADIUS_M, 0.0, 1e-300)), q, pose)
        some_q = q + rng.normal(size=(5, 2)) * 0.05
        some_pose = pose + rng.normal(size=(5, 3)) * [1e-3, 1e-3, 0.1]
        u, v = rng.normal(size=(2, 5, 5))
        both = (_everything(contact, some_q, some_pose, u, v) for contact in (disc, curve))
        for one, other in zip(*both, strict=True):
            assert one == pytest.approx(other, rel=1e-11, abs=1e-13)


def _everything(contact: RollingContact, q: Reals, pose: Reals, u: Reals, v: Reals) -> list[Reals]:
    jet, point = contact.at(q, pose), contact.contact_point(q, pose)
    return [jet.value, jet.gradient, jet.hessian, contact.third(q, pose, u, v), point.real, point.imag]


def test_polygon_with_many_sides_is_nearly_the_disc() -> None:
    """On a regular polygon about the circle gap and rolling gradient approach the disc's as the sides get shorter."""
    finger = fingers(0.0105)[0]
    disc, q, pose = touching(finger, Disc(2 * RADIUS_M), 0.3)
    smooth = disc.at(q[None], pose[None])
    for sides in (16, 60):
        corners = RADIUS_M / math.cos(math.pi / sides) * np.exp(2j * np.pi * (np.arange(sides) + 0.5) / sides)
        polygon = Polygon(tuple((corner.real, corner.imag) for corner in corners))
        facing = float(np.angle(-disc.normal(q[None], pose[None])[0]))
        flat = rolling_contact(finger, polygon, q, pose, facing).at(q[None], pose[None])
        assert flat.value == pytest.approx(smooth.value, abs=1e-10)
        assert flat.gradient == pytest.approx(smooth.gradient, abs=1e-9)


# -- rolling, against the lengths that the contact point travels ----------------------------------------------------


def fingertip_distance(points: np.ndarray, finger: FingerModel, q: Reals) -> Reals:
    """Distance of points (K,) from the fingertip's outline, outside of it: pad segment and arc, by plain geometry."""
    angle = finger.angle_rad + q @ finger.angle_row
    local = (points - finger.tip.at(q[None]).value[0]) * np.exp(-1j * angle)
    inward = finger.links[1].inner_side * local.imag
    length = 0.0 if finger.pad is None else finger.pad.length_m
    beside_pad = (local.real < 0) & (local.real > -length) & (inward > 0)
    distance: Reals = np.where(beside_pad, inward, np.abs(local)) - finger.tip_radius_m
    return distance


CASES = {
    "arc on disc": (0.0105, 0.0, Disc(0.04), 0.4, 0.0),
    "arc on curve": (0.0105, 0.0, PEAR, 0.4, 0.5),
    "point on curve": (0.0, 0.0, PEAR, 0.4, 0.5),
    "pad to arc on disc": (0.0105, PAD_M, Disc(0.04), 0.02, 0.0),
    "pad to arc on curve": (0.006, PAD_M, PEAR, 0.03, 0.5),
    "arc on side": (0.0105, 0.0, Rectangle(0.04, 0.08), 0.3, 0.0),
}


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("case", CASES)
def test_bodies_touch_and_travel_equally_along_their_path(case: str, side: int) -> None:
    """On g = 0 the bodies touch, and their contact point runs over equal lengths of both outlines.

    The point is found by sampling the object's outline, the lengths by its path in the axes of each body.
    """
    radius_m, pad_m, shape, past_pad_rad, turn_rad = CASES[case]
    finger = fingers(radius_m, pad_m)[side]
    contact, q_start, pose_start = touching(finger, shape, past_pad_rad, turn_rad)
    if isinstance(shape, Flat):
        turn_rad = float(np.angle(-contact.normal(q_start[None], pose_start[None])[0]))
    outline = shape.outline_m(50_000) @ [1, 1j] * np.exp(1j * turn_rad)

    guess, on_finger, on_object = pose_start[:2], [], []
    for share in np.linspace(-1, 1, 41):
        q = q_start + share * np.array([0.10, -0.25])
        theta = 0.2 * share * finger.links[1].inner_side
        pose = np.append(_rolled(contact, q, theta, guess), theta)
        guess = pose[:2]
        placed = complex(pose[0], pose[1]) + outline * np.exp(1j * theta)
        distance = fingertip_distance(placed, finger, q)
        assert distance.min() == pytest.approx(0.0, abs=4e-9 if radius_m > 0 else 5e-6)
        point = complex(contact.contact_point(q[None], pose[None])[0])
        assert abs(placed[np.argmin(distance)] - point) < 4e-5
        angle = finger.angle_rad + q @ finger.angle_row
        on_finger.append((point - finger.tip.at(q[None]).value[0]) * np.exp(-1j * angle))
        on_object.append((point - complex(pose[0], pose[1])) * np.exp(-1j * theta))
    travelled = [np.abs(np.diff(path)) for path in (on_finger, on_object)]
    assert travelled[0] == pytest.approx(travelled[1], rel=2e-3, abs=1e-8)
    assert travelled[1].sum() > 2e-3 or finger.tip_radius_m == 0


def _rolled(contact: RollingContact, q: Reals, theta: float, place: Reals) -> Reals:
    """The object's place (2,) that g = 0 asks for at joints and turn, by Newton's method."""
    for _ in range(30):
        jet = contact.at(q[None], np.append(place, theta)[None])
        place = place - np.linalg.solve(jet.gradient[0, :, -3:-1], jet.value[0])
    assert np.abs(contact.at(q[None], np.append(place, theta)[None]).value).max() < 1e-14
    return place


# -- pads, margins and refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize(("shape", "turn_rad"), [(Disc(0.04), 0.0), (PEAR, 0.5)], ids=["disc", "curve"])
@pytest.mark.parametrize("radius_m", [0.0, 0.006])
def test_pad_and_arc_change_smoothly(radius_m: float, shape: Shape, turn_rad: float, side: int) -> None:
    """At the junction the contact as pad and as arc has the same constraints and the same gradient."""
    finger = fingers(radius_m, PAD_M)[side]
    contact, q, pose = touching(finger, shape, 0.0, turn_rad)
    ahead, behind = (q + step * np.array([0.0, 1.0]) for step in (1e-9, -1e-9))
    down = [PAD_M - contact.features(one[None], pose[None])["pad end"][0] for one in (ahead, behind)]
    assert down[0] < 0 < down[1]  # curling rolls the contact off the pad on to the arc
    one, other = (contact.at(q_[None], pose[None]) for q_ in (ahead, behind))
    assert one.value == pytest.approx(other.value, abs=1e-9)
    assert one.gradient == pytest.approx(other.gradient, abs=2e-8)
    batch = contact.at(np.array([ahead, behind]), np.array([pose, pose]))
    assert batch.hessian == pytest.approx(np.concatenate([one.hessian, other.hessian]))


def test_pad_ends_where_it_ends() -> None:
    """The margin is the pad's length at the arc's foot and 0 where the contact reaches the pad's far end."""
    finger = fingers(0.006, PAD_M)[0]
    _, q, _ = touching(finger, Disc(0.04), 0.0)
    angle = finger.angle_rad + q @ finger.angle_row
    for down_m in (0.005, PAD_M, 0.025):
        along, inward = np.exp(1j * angle), 1j * np.exp(1j * angle)
        centre = finger.tip.at(q[None]).value[0] - down_m * along + (finger.tip_radius_m + 0.02) * inward
        pose = np.array([centre.real, centre.imag, 0.0])
        contact = rolling_contact(finger, Disc(0.04), q, pose)
        assert contact.features(q[None], pose[None])["pad end"] == pytest.approx([PAD_M - down_m], abs=1e-15)
        assert contact.normal(q[None], pose[None]) == pytest.approx(np.array([inward]))
        assert contact.at(q[None], pose[None]).value == pytest.approx(np.zeros((1, 2)), abs=1e-16)


def test_side_ends_at_its_corners() -> None:
    """The margin of a flat side is the way to the nearer corner, and the pad's that of its far end."""
    finger = fingers(0.0105, PAD_M)[0]
    contact, q, pose = touching(finger, Rectangle(0.04, 0.06), 0.3)
    normal = complex(contact.normal(q[None], pose[None])[0])
    for shift_m, left_m in ((0.0, 0.03), (0.02, 0.01), (-0.025, 0.005), (0.031, -0.001)):
        shifted = pose + shift_m * np.array([(1j * normal).real, (1j * normal).imag, 0.0])
        margins = {name: margin[0] for name, margin in contact.features(q[None], shifted[None]).items()}
        assert margins == pytest.approx({"side end": left_m, "pad lies flat": PAD_M * math.sin(0.3)})


def test_contacts_on_corners_and_surfaces_are_refused() -> None:
    """What two constraints cannot describe is an error that names the parameter to change."""
    finger = fingers(0.0105, PAD_M)[0]
    for past_pad_rad, said in ((0.0, "surface contact"), (-0.2, "leans 11.5° outwards")):
        with pytest.raises(MechanicsError, match=said) as caught:
            touching(finger, Rectangle(0.04, 0.06), past_pad_rad)
        assert caught.value.parameter == "finger.tip.pad_length_m"
    _, q, pose = touching(finger, Disc(0.04), 0.3)
    facing = math.pi + finger.angle_rad + float(q @ finger.angle_row) + math.pi / 2 - 0.3
    with pytest.raises(MechanicsError, match="corner"):
        rolling_contact(finger, Rectangle(0.02, 0.02), q, pose, facing + math.pi / 4)


def test_rolling_begins_in_contact_only() -> None:
    """A pose or a turn that is not that of first contact is refused with the gap that it leaves."""
    finger = fingers(0.0105)[0]
    _, q, pose = touching(finger, PEAR, 0.3, 0.5)
    with pytest.raises(MechanicsError, match="µm apart where rolling should begin"):
        rolling_contact(finger, PEAR, q, pose, 0.51)
