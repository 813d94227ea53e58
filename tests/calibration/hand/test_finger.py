"""Fingers of all hands against plain trigonometry, a finely integrated curve, and their own outlines."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.hand.bundle import Reals
from calibration.hand.finger import FingerModel, finger_model, finger_models
from calibration.hand.parameters import Finger, FlexureJoint, Outline, PinJoint, Tip, load_hand

HANDS = ("t42pp", "t42pf", "t42ff", "t42pf_tactile")
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def walked(finger: Finger, root_m: float, q: Reals) -> tuple[list[complex], list[float]]:
    """Ends of the two links of a right finger and their angles, by walking from the root: half of the rest angle,
    the joint, the other half, the link."""
    place, angle, ends, angles, rest_of = complex(root_m), 0.0, [], [], list(q)
    lengths = (finger.proximal_link_m, finger.distal_link_m)
    for joint, rest, length_m in zip(finger.joints, finger.rest_angle_rad, lengths, strict=True):
        angle += rest / 2
        if isinstance(joint, FlexureJoint):
            a, rest_of = rest_of[: joint.coordinates], rest_of[joint.coordinates :]
            bent = angle + np.polynomial.legendre.Legendre(a).integ(lbnd=-1)(NODES) / 2
            place += joint.length_m * complex((WEIGHTS * np.exp(1j * bent)).sum() / 2)
            angle += a[0]
        else:
            angle += rest_of.pop(0)
        angle += rest / 2
        place += length_m * complex(np.exp(1j * angle))
        ends.append(place)
        angles.append(angle)
    return ends, angles


def configuration(model: FingerModel, seed: int) -> Reals:
    return np.random.default_rng(seed).uniform(-0.5, 1.3, model.stiffness_Nm_per_rad.size)


@pytest.mark.parametrize("name", HANDS)
@given(seed=st.integers(0, 10**6))
def test_links_and_tip_are_where_walking_leads(name: str, seed: int) -> None:
    """Rest angles, lengths, flexures, the tip's arc, and the left finger as mirror image."""
    hand = load_hand(name)
    right, left = finger_models(hand)
    q = configuration(right, seed)
    ends, angles = walked(hand.right, hand.root_half_distance_m, q)
    tip = ends[1] - hand.right.tip.radius_m * complex(np.exp(1j * angles[1]))
    for model, side in ((right, 1), (left, -1)):
        for link, end, angle in zip(model.links, ends, angles, strict=True):
            along = complex(link.point(link.length_m, 0.0).at(q[None]).value[0])
            assert along == pytest.approx(complex(side * end.real, end.imag), abs=1e-11)
            inner = complex(link.point(link.length_m, 0.01).at(q[None]).value[0]) - along
            across = 0.01j * complex(np.exp(1j * angle))
            assert inner == pytest.approx(complex(side * across.real, across.imag), abs=1e-11)
        assert complex(model.tip.at(q[None]).value[0]) == pytest.approx(complex(side * tip.real, tip.imag), abs=1e-11)
        found = model.angle_rad + model.angle_row @ q
        assert found == pytest.approx(angles[1] if side == 1 else math.pi - angles[1])


def test_coordinates_come_joint_by_joint() -> None:
    """PP has 2, PF 1 + 3, FF 3 + 3; the distal angle counts both joint angles and no change of shape."""
    for name, joints, size in (("t42pp", (0, 1), 2), ("t42pf", (0, 1), 4), ("t42ff", (0, 3), 6)):
        right, left = finger_models(load_hand(name))
        row = np.zeros(size)
        row[list(joints)] = 1
        assert right.joint_index == joints
        assert right.angle_row == pytest.approx(row)
        assert left.angle_row == pytest.approx(-row)
        assert np.isinf(np.delete(right.upper_rad, joints)).all()
        assert right.tendon.linear
        assert right.tendon.at(row[None]).gradient[0].sum(0) == pytest.approx(0.008 * row)


def test_asymmetric_hand() -> None:
    """Each finger has its own coordinates, lengths, tip and pad; the other is not touched."""
    hand = load_hand("t42ff")
    stub = FlexureJoint(length_m=0.012, bending_stiffness_Nm2=3e-3, coordinates=2, flexion_limit_deg=(0, 50))
    other = msgspec.structs.replace(
        hand.left, proximal_joint=stub, distal_link_m=0.05, tip=Tip(0.004, 0.02), outline=Outline(0.003, 0.004)
    )
    right, left = finger_models(msgspec.structs.replace(hand, left=other))
    assert (right.stiffness_Nm_per_rad.size, left.stiffness_Nm_per_rad.size) == (6, 5)
    assert right.pad is None
    assert left.pad is not None
    assert (left.pad.length_m, left.tip_radius_m, left.inner_m, left.outer_m) == (0.02, 0.004, 0.003, 0.004)
    q = configuration(left, 1)
    ends, angles = walked(other, hand.root_half_distance_m, q)
    tip = ends[1] - 0.004 * complex(np.exp(1j * angles[1]))
    assert complex(left.tip.at(q[None]).value[0]) == pytest.approx(complex(-tip.real, tip.imag), abs=1e-11)


def knuckle_gap_m(model: FingerModel, distal_rad: float) -> tuple[float, float]:
    """Distance of the inner corners that face each other across the distal joint; and how far the distal phalanx's
    corner stands on the open side of the proximal one's, along the line that both faces mirror in."""
    q = np.zeros(model.stiffness_Nm_per_rad.size)
    q[model.joint_index[0]], q[model.joint_index[1]] = 0.4, distal_rad
    proximal, distal = model.links
    first, last = (
        complex(link.point(*corner).at(q[None]).value[0])
        for link, corner in ((proximal, proximal.inner_corners_m[1]), (distal, distal.inner_corners_m[0]))
    )
    middle = 0.5 * (proximal.angle_rad + proximal.angle_row @ q + distal.angle_rad + distal.angle_row @ q)
    return abs(last - first), float(((last - first) * np.exp(-1j * middle)).real)


@pytest.mark.parametrize("name", ["t42pf", "t42ff"])
@pytest.mark.parametrize("preset", ["nominal", "fitted"])
@pytest.mark.parametrize("side", [0, 1])
def test_inner_faces_at_a_flexure_meet_at_its_length_over_their_height(name: str, preset: str, side: int) -> None:
    """l_F / inner_m, whatever the rest angle: at the stop of both presets, and not before."""
    model = finger_models(load_hand(name, preset))[side]
    meeting = 0.010 / model.inner_m
    assert knuckle_gap_m(model, meeting)[0] < 1e-15
    assert [knuckle_gap_m(model, share * meeting)[1] > 0 for share in (0.5, 0.99, 1.01)] == [True, True, False]
    stop = model.upper_rad[model.joint_index[1]]
    assert stop < meeting < stop + 0.001


def test_inner_faces_at_a_pin_meet_at_its_stop() -> None:
    """Cut so that they stand open by less than 20 µm there; at the tip they end below the arc's centre."""
    for preset in ("nominal", "fitted"):
        model = finger_models(load_hand("t42pp", preset))[0]
        distance, ahead = knuckle_gap_m(model, float(model.upper_rad[1]))
        assert 0 < ahead <= distance < 20e-6
        along, across = model.links[1].inner_corners_m[1]
        assert along == pytest.approx(0.047 - model.tip_radius_m)
        assert across <= model.tip_radius_m


@pytest.mark.parametrize(("rest_deg", "limit_deg"), [((15, 100), (0, 120)), ((0, -60), (0, 30)), ((0, 0), (0, 180))])
def test_faces_that_never_meet_are_cut_no_farther_than_the_links(
    rest_deg: tuple[float, float], limit_deg: tuple[float, float]
) -> None:
    """A pin that folds to 180° and beyond, or only stretches, still has an outline within its links."""
    pin = PinJoint(stiffness_Nm_per_rad=0.1, flexion_limit_deg=limit_deg)
    finger = msgspec.structs.replace(load_hand("t42pp").right, rest_angle_deg=rest_deg, distal_joint=pin)
    for link in finger_model(finger, 0.03, mirrored=False).links:
        (start, _), (end, _) = link.inner_corners_m
        assert 0 <= start <= end <= link.length_m
