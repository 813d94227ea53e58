"""Fig. 3 and 4: how the hand moves the object while it squeezes, and phalanges that end it when they meet."""

from __future__ import annotations

import msgspec
import numpy as np
from matplotlib.axes import Axes

from calibration.figures.drawing import (
    GHOST,
    MM,
    as_picture,
    draw_forces,
    draw_path,
    draw_state,
    fingertips,
    object_pose,
)
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.squeezing import squeezed
from calibration.figures.style import BLACK, BLUE, GREY, RED, as_curves, new_figure
from calibration.grasp.constraints import gaps
from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.specification import GraspSpec
from calibration.hand.bundle import Reals
from calibration.hand.parameters import Finger, FlexureJoint, Hand, load_hand
from calibration.objects import load_object

FORCE_MM_PER_N = 18.0
FREE_LIMIT_DEG = 120.0
"""For Fig. 4: past the angle at which the phalanges meet, so that only their meeting ends the motion."""


def figure_3() -> PaperFigure:
    """T42FF on the sphere of 30 mm radius, first contact and end superposed."""
    system = grasp_system(load_hand("t42ff", "nominal"), load_object("sphere30"), GraspSpec())
    path = squeezed(system)
    motion_mm = path.motion[-1] * MM
    load_N = float(path.load_N[-1].mean())
    figure, (picture, curves) = new_figure(8.4, 3.7, 1, 2, widths=(1.1, 1))
    _superposed(picture, system, path.w[0], path.w[-1])
    draw_path(picture, path.pose)
    as_picture(picture, "First contact (dashed) and end")
    curves.plot(path.excursion_m.mean(1) * MM, -path.motion[:, 1] * MM, color=BLUE, label="towards the palm")
    curves.plot(path.excursion_m.mean(1) * MM, path.motion[:, 0] * MM, color=GREY, ls="--", label="sideways")
    curves.legend(loc="upper left")
    as_curves(curves, "both tendons wound in since contact  mm", "motion of the sphere  mm", "Parasitic motion")
    return PaperFigure(
        3,
        "parasitic motion",
        f"A T42FF squeezes a sphere of 30 mm radius, both tendons wound in equally, up to the stop of the distal "
        f"joints: it pulls the sphere {-motion_mm[1]:.1f} mm towards the palm at {load_N:.1f} N a tendon. Circles mark "
        "the centres of fingertips and object, solid at first contact, dotted at the end; arrows: contact forces.",
        "all of the motion, from Table I, the ratio of the flexures' stiffnesses (2.5, from their thickness) and the "
        "stop at l_F/r; symmetric, so sideways motion and rotation are zero.",
        "nothing is fitted; preset nominal (E = 5 MPa assumed: loads and forces scale with it, the motion does not).",
        {
            "motion_m": path.motion[-1, :2].tolist(),
            "rotation_rad": float(path.motion[-1, 2]),
            "load_N": load_N,
            "contact_force_N": path.contact_force_N[-1, ::2].tolist(),
            "end": path.end,
        },
        figure,
    )


def figure_4() -> PaperFigure:
    """T42FF whose distal stops are lifted: the phalanges meet."""
    system = grasp_system(_without_stop(load_hand("t42ff", "nominal")), load_object("sphere30"), GraspSpec())
    path = squeezed(system)
    meeting = [gap for gap in gaps(system) if gap.name.endswith("phalanges collide")]
    angle_rad = float(path.w[-1, system.fingers[0].joint_index[1]])
    figure, (picture, curves) = new_figure(8.4, 3.7, 1, 2, widths=(1.1, 1))
    _superposed(picture, system, path.w[0], path.w[-1])
    for finger, part in zip(system.fingers, system.parts, strict=True):
        link = finger.links[0]
        place = complex(link.point(*link.inner_corners_m[1]).at(path.w[-1:, part]).value[0]) * MM
        picture.plot([place.real], [place.imag], "o", ms=13, mfc="none", mec=RED, mew=2, zorder=9)
    as_picture(picture, "Ended by phalanges that meet (red circles)")
    for gap, style, side in zip(meeting, ("-", (0, (5, 5))), ("right", "left"), strict=True):
        curves.plot(path.excursion_m.mean(1) * MM, gap.at(path.w) * MM, ls=style, color=(BLUE, BLACK)[side == "left"],
                    label=f"{side} finger")  # fmt: skip
    curves.axhline(0, color=RED, lw=1)
    curves.legend(loc="upper right")
    as_curves(
        curves,
        "both tendons wound in since contact  mm",
        "clearance of the phalanges  mm",
        "Distal from proximal phalanx",
    )
    return PaperFigure(
        4,
        "motion ended by a collision",
        f"The hand of Fig. 3 without the stop of its distal joints: the motion goes on until, on each finger, the "
        f"inner faces of proximal and distal phalanx meet (constraint (12)), at a joint angle of "
        f"{np.degrees(angle_rad):.1f}°, after {-path.motion[-1, 1] * MM:.1f} mm.",
        "where the convex hulls meet. A flexure bent to a circle has them meet at l_F/r = 71.6°, where the exposed "
        "tendon is used up as well; under contact forces it is no circle.",
        "nothing is fitted; the phalanges' thickness on the inner side is assumed to be the tendon's offset, 8 mm.",
        {
            "collision_angle_rad": angle_rad,
            "motion_m": path.motion[-1, :2].tolist(),
            "load_N": float(path.load_N[-1].mean()),
            "end": path.end,
        },
        figure,
    )


def _superposed(axes: Axes, system: GraspSystem, first: Reals, last: Reals) -> None:
    draw_state(axes, system, first, GHOST)
    draw_state(axes, system, last)
    for w, style in ((first, "-"), (last, ":")):
        q = w[system.parts[0]], w[system.parts[1]]
        pose = object_pose(system, w)
        for centre in (*fingertips(system.fingers, q), complex(pose[0], pose[1])):
            turn = np.linspace(0, 2 * np.pi, 40)
            axes.plot(centre.real * MM + 3 * np.cos(turn), centre.imag * MM + 3 * np.sin(turn), ls=style, color=BLACK,
                      lw=1.4, zorder=9)  # fmt: skip
    draw_forces(axes, system, last, FORCE_MM_PER_N)


def _without_stop(hand: Hand) -> Hand:
    return msgspec.structs.replace(hand, right=_freed(hand.right), left=_freed(hand.left))


def _freed(finger: Finger) -> Finger:
    joint = finger.distal_joint
    assert isinstance(joint, FlexureJoint)
    limits = (joint.flexion_limit_deg[0], FREE_LIMIT_DEG)
    return msgspec.structs.replace(finger, distal_joint=msgspec.structs.replace(joint, flexion_limit_deg=limits))
