"""Fig. 2: both fingers close freely until they touch the object, and where the wrist must stand for that."""

from __future__ import annotations

import numpy as np

from calibration.figures.drawing import GHOST, MM, as_picture, draw_hand, draw_object, object_pose
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.style import BLUE, GREY, RED, as_curves, new_figure
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.free_closing import closing_path
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

GHOSTS = (0.0, 0.35, 0.7)
"""Shares of the load at first contact at which the closing hand is shown."""


def figure_2() -> PaperFigure:
    """T42FF closing on the sphere of 30 mm radius."""
    hand, sphere = load_hand("t42ff", "nominal"), load_object("sphere30")
    system = grasp_system(hand, sphere, GraspSpec())
    start = system.start
    contact_N = float(start.tendon_load_N.mean())
    loads = np.linspace(0, 1.25 * contact_N, 120)
    closing = closing_path(hand, loads)
    gap_m = np.abs(closing.arc_centre_m[0] - closing.arc_centre_m[1]) - 2 * system.fingers[0].tip_radius_m
    pose = object_pose(system, system.first_state())
    offset_mm, width_mm = float(pose[1]) * MM, sphere.shape.extent_m(0.0) * MM
    figure, (left, right) = new_figure(9.6, 3.7, 1, 2, widths=(1.7, 1))
    for share in GHOSTS:
        near = int(np.argmin(np.abs(loads - share * contact_N)))
        draw_hand(left, system.fingers, (closing.joint_rad[0][near], closing.joint_rad[1][near]), GHOST)
    draw_object(left, sphere.shape, pose, start.outline_angle_rad)
    draw_hand(left, system.fingers, start.finger_joint_rad)
    for tip in closing.arc_centre_m:
        until = loads <= contact_N
        left.plot(tip[until].real * MM, tip[until].imag * MM, color=RED, lw=1.2, zorder=6)
    left.annotate("", (0, offset_mm), (0, 0), arrowprops={"arrowstyle": "<|-|>", "color": RED, "lw": 1.4}, zorder=9)
    left.text(4, 8, f"wrist offset\n{offset_mm:.1f} mm", color=RED, rotation=90, va="bottom", fontsize=7.5)
    as_picture(left, "Free closing to first contact")
    right.plot(loads, gap_m * MM, color=BLUE)
    right.axhline(width_mm, color=GREY, ls="--", lw=1)
    right.plot([contact_N], [width_mm], "o", color=RED, zorder=5)
    right.annotate(
        f"first contact\n{contact_N:.2f} N", (contact_N, width_mm), (8, 14), textcoords="offset points", color=RED
    )
    right.text(loads[0], width_mm - 2.5, f"the sphere's diameter, {width_mm:.0f} mm", color=GREY, va="top")
    as_curves(right, "load of each tendon  N", "gap between the fingertips  mm", "Fingertip gap while closing")
    return PaperFigure(
        2,
        "prepositioning",
        f"A T42FF closes freely on a sphere of 30 mm radius. Its fingertips (red) are one diameter apart at "
        f"{contact_N:.2f} N a tendon; the sphere's centre is then {offset_mm:.1f} mm in front of the line between the "
        "fingers' roots: this, and the hand's own mount, is how far the wrist must stand off the object.",
        "the closing path, the load and the offset, from Table I, the flexures' stiffness and the rest angles.",
        "nothing is fitted; preset nominal (E = 5 MPa assumed, so loads scale with it; the offset does not).",
        {
            "load_at_first_contact_N": contact_N,
            "wrist_offset_m": offset_mm / MM,
            "quality_Q_DC_m": start.quality_m,
        },
        figure,
    )
