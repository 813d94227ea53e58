"""Fig. 15: the path of a 30 mm cylinder in the T42PF, and what small asymmetries of the grasp would make of it."""

from __future__ import annotations

from calibration.figures.drawing import GHOST, MM, as_picture, draw_forces, draw_path, draw_state
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.squeezing import squeezed, up_to_load
from calibration.figures.style import BLUE, GREY, ORANGE, PURPLE, RED, SKY, as_curves, new_figure
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.path import Path
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

MEAN_LOAD_N = 74.0
"""Load at which the fitted hand has moved the cylinder by the paper's 16 mm (hand-mechanics reference 12)."""
PRINTED_MM = -16.0
SPLITS = (-0.04, -0.02, 0.02, 0.04)
COLOURS = (ORANGE, SKY, PURPLE, BLUE)


def figure_15() -> PaperFigure:
    """T42PF, fitted, on the 30 mm cylinder."""
    path = _up_to_load(GraspSpec())
    x, y, angle = path.motion[-1]
    figure, (picture, plane) = new_figure(8.4, 4.0, 1, 2, widths=(1.15, 1))
    draw_state(picture, path.system, path.w[0], GHOST)
    draw_state(picture, path.system, path.w[-1])
    draw_path(picture, path.pose)
    draw_forces(picture, path.system, path.w[-1], 4.0)
    as_picture(picture, "First contact and end")
    sideways = {}
    for split, colour in zip(SPLITS, COLOURS, strict=True):
        other = _up_to_load(GraspSpec(onset_split=split))
        plane.plot(
            other.motion[:, 0] * MM, other.motion[:, 1] * MM, color=colour, lw=1.1, label=f"{100 * split:+.0f} %"
        )
        sideways[f"{split:+.2f}"] = other.motion[-1].tolist()
    plane.plot(path.motion[:, 0] * MM, path.motion[:, 1] * MM, color=RED, lw=3.2, label="symmetric", zorder=5)
    plane.axhline(PRINTED_MM, color=GREY, ls="--", lw=1)
    plane.annotate(
        "about 16 mm, as printed in the paper", (0.02, PRINTED_MM), (0, -4), xycoords=("axes fraction", "data"),
        textcoords="offset points", color=GREY, va="top", fontsize=8,
    )  # fmt: skip
    plane.set_ylim(-17.4, 0.8)
    plane.legend(loc="upper right", title="onset split", title_fontsize=8)
    as_curves(plane, "x  mm", "y  mm (towards the palm: down)", "Path of the object")
    return PaperFigure(
        15,
        "path of the object",
        f"A T42PF squeezes a cylinder of 30 mm to {MEAN_LOAD_N:.0f} N a tendon: it moves on a straight line, "
        f"{-y * MM:.1f} mm towards the palm. Thin lines: the same with fingers that touch a few percent apart in load. "
        "The paper prints about 16 mm, and 0.4 mm RMS error over its five trials.",
        "that the path of a symmetric grasp is a straight line along y; how asymmetries bend it.",
        "preset fitted; the load at which the path ends, 74 N, is chosen so that its length is the paper's.",
        {
            "motion_m_m_rad": [float(x), float(y), float(angle)],
            "load_N": path.load_N[-1].tolist(),
            "motion_by_onset_split_m_m_rad": sideways,
        },
        figure,
    )


def _up_to_load(grasp: GraspSpec) -> Path:
    system = grasp_system(load_hand("t42pf"), load_object("cylinder30"), grasp)
    return up_to_load(squeezed(system), MEAN_LOAD_N)
