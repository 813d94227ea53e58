"""What is drawn is what the mechanics has: hulls, flexure curves, contacts, poses."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch

from calibration.figures.drawing import (
    HERE,
    PlanarPose,
    draw_forces,
    draw_state,
    fingertips,
    force_arrows,
    joint_curve,
    phalanx_outline,
)
from calibration.figures.style import new_figure
from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.specification import GraspSpec
from calibration.hand.finger import finger_models
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

HANDS = ("t42pp", "t42pf", "t42ff", "t42pf_tactile")


@pytest.mark.parametrize("name", HANDS)
@pytest.mark.parametrize("side", [0, 1])
def test_flexures_are_drawn_from_phalanx_to_phalanx(name: str, side: int) -> None:
    """A flexure's curve begins and ends at the phalanges' own ends, square to them, at any coordinates; a pin is one
    point there."""
    finger = finger_models(load_hand(name))[side]
    rng = np.random.default_rng(1)
    q = rng.uniform(0.1, 0.5, finger.stiffness_Nm_per_rad.size)
    proximal, distal = finger.links
    for joint, (link, before) in enumerate(((proximal, None), (distal, proximal))):
        curve = joint_curve(finger, joint, q)
        root = complex(link.root.at(q[None]).value[0])
        assert abs(curve[-1] - root) < 1e-12
        if before is not None:
            end = complex(before.point(before.length_m, 0.0).at(q[None]).value[0])
            assert abs(curve[0] - end) < 2e-5  # straight pieces instead of arcs
        if curve.size > 1:
            along = np.exp(1j * (link.angle_rad + link.angle_row @ q))
            rest = finger.links[joint].angle_rad - (finger.links[0].angle_rad if joint else (np.pi if side else 0.0))
            half_rest = np.exp(-1j * rest / 2)
            direction = (curve[-1] - curve[-2]) / abs(curve[-1] - curve[-2])
            assert abs(direction - along * half_rest) < 0.05


@pytest.mark.parametrize("name", HANDS)
def test_left_is_the_mirror_image_of_right(name: str) -> None:
    """Outlines and flexures of the two fingers at equal coordinates."""
    right, left = finger_models(load_hand(name))
    q = np.full(right.stiffness_Nm_per_rad.size, 0.3)
    for part in (0, 1):
        mirrored = -joint_curve(right, part, q).conj()
        assert joint_curve(left, part, q) == pytest.approx(mirrored, abs=1e-12)
        outlines = phalanx_outline(left, part, q), -phalanx_outline(right, part, q).conj()
        for turn in np.exp(1j * np.linspace(0, 2 * np.pi, 13)):
            reach = [(outline * turn.conjugate()).real.max() for outline in outlines]
            assert reach[0] == pytest.approx(reach[1], abs=1e-4)


def test_a_phalanx_ends_at_the_finger_s_end() -> None:
    """The distal outline reaches as far as the tip arc does, and holds the arc."""
    finger = finger_models(load_hand("t42pf"))[0]
    q = finger.free_closing(20.0)
    outline = phalanx_outline(finger, 1, q)
    centre = complex(finger.tip.at(q[None]).value[0])
    along = np.exp(1j * (finger.angle_rad + finger.angle_row @ q))
    assert ((outline - centre) / along).real.max() == pytest.approx(finger.tip_radius_m, abs=1e-5)


@pytest.fixture(scope="module")
def system() -> GraspSystem:
    return grasp_system(load_hand("t42pp"), load_object("cylinder40"), GraspSpec())


def test_forces_point_at_the_object(system: GraspSystem) -> None:
    """A fingertip that presses with 5 N: its arrow ends on the object's outline and points at its centre, wherever the
    hand is drawn."""
    w = system.first_state()
    w = w + np.linalg.pinv(system.contact_rows()[[0, 2]]) @ np.array([5.0, 5.0])
    for frame in (HERE, PlanarPose(0.02 + 0.05j, 0.7)):
        begins, ends = force_arrows(system, w, 2.0, frame)
        centre = complex(frame.of(np.array([complex(*w[system.joints : system.joints + 2])]))[0]) * 1e3
        assert abs(ends - centre) == pytest.approx([20.0, 20.0])
        assert abs(begins - centre) == pytest.approx([30.0, 30.0])
        _, (axes,) = new_figure(3, 3)
        draw_state(axes, system, w, frame=frame)
        draw_forces(axes, system, w, 2.0, frame=frame)
        assert len([patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]) == 2


def test_poses_move_points_rigidly() -> None:
    """A planar pose turns about the hand's origin, then shifts."""
    pose = PlanarPose(0.1 + 0.2j, np.pi / 2)
    assert pose.of(np.array([0j, 1 + 0j])) == pytest.approx([0.1 + 0.2j, 0.1 + 1.2j])


def test_fingertips_touch_the_object_at_first_contact(system: GraspSystem) -> None:
    """The tips' centres are one object and two radii apart."""
    right, left = fingertips(system.fingers, system.start.finger_joint_rad)
    assert abs(right - left) == pytest.approx(0.040 + 2 * 0.006, abs=1e-12)
