"""Every counterpart of a figure of the paper: drawn, written, and its numbers held against what is known of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from calibration.figures.atlas import DRAWN_BY, draw, write
from calibration.figures.compensation import hand_offset
from calibration.figures.paper_figure import PaperFigure
from drivers.errors import InputError

drawn: Callable[[int], PaperFigure] = cache(draw)


LONG = (6, 15, 16, 17)
"""Figures of many paths."""


@pytest.mark.parametrize(
    "number", [pytest.param(number, marks=pytest.mark.slow if number in LONG else ()) for number in DRAWN_BY]
)
def test_every_figure_is_drawn_with_caption_and_numbers(number: int, tmp_path: Path) -> None:
    """A picture that is not empty, of README size; a caption that says what is predicted and fitted; finite numbers."""
    figure = drawn(number)
    picture, caption, numbers = figure.save(tmp_path)
    pixels = matplotlib.image.imread(picture)
    height, width = pixels.shape[:2]
    assert 1000 <= width <= 1700
    assert 400 <= height <= 1100
    assert pixels[:, :, :3].std() > 0.05
    assert picture.stat().st_size < 300_000
    assert f"Fig. {number}" in caption.read_text()
    assert "Predicted:" in figure.caption
    assert "Fitted or assumed:" in figure.caption
    assert "not available" in figure.caption
    assert json.loads(numbers.read_text())["values"] == json.loads(json.dumps(dict(figure.values)))


def test_prepositioning_has_the_object_midway() -> None:
    """Fig. 2: Q_DC is zero in a symmetric grasp."""
    values = drawn(2).values
    assert values["quality_Q_DC_m"] == pytest.approx(0, abs=1e-12)
    assert 0.08 < values["wrist_offset_m"] < 0.11


def test_symmetric_motion_is_pure_and_ends_at_the_stop() -> None:
    """Fig. 3: only towards the palm; Fig. 4: the collision comes near l_F / r, and a little more motion with it."""
    motion, collision = drawn(3).values, drawn(4).values
    assert abs(motion["motion_m"][0]) < 1e-9
    assert abs(motion["rotation_rad"]) < 1e-9
    assert motion["end"].endswith("distal stop")
    assert "phalanges collide" in collision["end"]
    assert collision["collision_angle_rad"] == pytest.approx(1.25, rel=0.02)
    assert collision["motion_m"][1] < motion["motion_m"][1]


def test_ratios_of_stiffness_change_the_motion() -> None:
    """Fig. 6: more with a stiffer distal joint; the size matters at a low ratio only (hand-mechanics reference 12)."""
    motion = {ratio: list(own.values()) for ratio, own in drawn(6).values["motion_m"].items()}
    low, middle, high = motion.values()
    assert all(a < b < c for a, b, c in zip(low, middle, high, strict=True))
    assert max(low) / min(low) > 3
    assert max(high) / min(high) < 1.15


def test_compensation_keeps_the_object_where_it_is() -> None:
    """Fig. 7: through the arm's own kinematics the object drifts by nothing, and the wrist goes as far as it came."""
    values = drawn(7).values
    assert values["largest_drift_of_the_object_m"] < 1e-9
    assert values["wrist_travel_m"] == pytest.approx(-values["object_in_hand_m"][1], abs=1e-9)
    assert sum(np.array(values["joint_change_rad"])[[1, 3, 5]]) == pytest.approx(0, abs=1e-9)


def test_hand_offset_is_that_of_the_reference() -> None:
    """Hand-mechanics reference 9: object at (0, 100) mm goes (+6, −17) mm, −0.1 rad: hand (+2.3, +16.8), +0.1."""
    offset = hand_offset(np.array([0.0, 0.100, 0.0]), np.array([0.006, 0.083, -0.1]))
    assert offset.angle_rad == pytest.approx(0.1)
    assert offset.shift_m * 1e3 == pytest.approx(2.3 + 16.8j, abs=0.05)


def test_contacts_of_a_two_force_body_press_equally() -> None:
    """Fig. 10 and 13: without the support's friction both normal forces are equal, symmetric or not."""
    symmetric, split = drawn(10).values, drawn(13).values
    assert abs(symmetric["motion_m_m_rad"][0]) < 1e-9
    assert symmetric["sum_of_contact_forces_N"] > 1
    assert abs(split["motion_m_m_rad"][0]) > 1e-3
    assert abs(split["motion_m_m_rad"][2]) > 0.05


def test_the_cylinder_goes_16_mm_straight() -> None:
    """Fig. 15: fitted to the paper's 16 mm by the load at its end; asymmetries of either sign bend it either way."""
    values = drawn(15).values
    assert values["motion_m_m_rad"][1] == pytest.approx(-0.016, abs=2e-4)
    bent = [motion[0] for motion in values["motion_by_onset_split_m_m_rad"].values()]
    assert bent == pytest.approx([-value for value in reversed(bent)], abs=1e-9)


def test_weight_lessens_the_motion() -> None:
    """Fig. 16: the rows of hand-mechanics reference 8, and the scaling law between them."""
    values = drawn(16).values
    stiff = np.array(values["motion_m"]) * 1e3
    soft = np.array(values["motion_when_softer_m"]) * 1e3
    assert stiff == pytest.approx([16.58, 16.21, 15.84, 15.48, 15.13, 14.78, 14.45], abs=0.02)
    assert soft == pytest.approx([16.58, 14.45, 12.58, 10.94, 9.49, 8.19, 7.04], abs=0.02)
    assert soft[1] == pytest.approx(stiff[6], abs=1e-6)


def test_minimal_effort_and_maximum_are_those_of_the_reference() -> None:
    """Fig. 17: what the fitted preset gives for the paper's figures (hand-mechanics reference 12)."""
    values = drawn(17).values
    found = {name: [round(1e3 * value, 1) for key, value in own.items() if key.endswith("motion_m")]
             for name, own in values.items()}  # fmt: skip
    assert found["strawberry"] == pytest.approx([0.7, 22.4, 22.5], abs=0.11)
    assert found["mustard"] == pytest.approx([28.0, 39.6, 44.2], abs=0.45)


def test_a_figure_that_is_not_here_is_refused_before_others_are_drawn(tmp_path: Path) -> None:
    """Its number and the ones there are; nothing is written."""
    with pytest.raises(InputError, match=r"figure 5 .*2, 3, 4"):
        write([3, 5], tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    """A file where the folder should be."""
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        drawn(2).save(tmp_path / "taken")
