"""Fig. 10 and 13: contact forces and predicted motion over winding, of a symmetric and a nonsymmetric grasp."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from calibration.figures.drawing import GHOST, MM, as_picture, draw_forces, draw_path, draw_state
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.squeezing import squeezed
from calibration.figures.style import BLUE, GREEN, GREY, RED, as_curves, new_figure
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.path import Path
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

ONSET_SPLIT = 0.10
WOUND = "both tendons wound in since contact  mm"


def figure_10() -> PaperFigure:
    """T42PF with tactile sensors on the 45 mm cylinder, symmetric."""
    system = grasp_system(load_hand("t42pf_tactile"), load_object("cylinder45"), GraspSpec())
    path = squeezed(system)
    figure, (picture, forces, motion) = new_figure(10.2, 3.5, 1, 3)
    _picture(picture, path)
    _forces(forces, path)
    wound = _wound_mm(path)
    motion.plot(wound, path.motion[:, 1] * MM, color=BLUE, label="y")
    motion.plot(wound, path.motion[:, 0] * MM, color=RED, ls="--", label="x")
    motion.legend(loc="lower left")
    as_curves(motion, WOUND, "predicted motion  mm", "Motion of the cylinder")
    return PaperFigure(
        10,
        "forces and motion of a symmetric pinch",
        f"The T42PF with tactile sensors squeezes a cylinder of 45 mm (what ends it: {path.end}). Sum of the contact "
        f"forces up to {_sum_N(path)[-1]:.1f} N, motion {path.motion[-1, 1] * MM:.1f} mm along y (towards the palm), "
        "none along x. The paper reports 96.4 % agreement along y between its own prediction and its measurement.",
        "a pure translation along y, and its shape over the winding.",
        "preset fitted (all stiffness × 6, stop 1.8 rad, from the mustard bottle of Fig. 17); that the tactile hand "
        "is twice as stiff as the T42PF is assumed: the paper says only that it is stiffer. So the force axis is not "
        "the paper's.",
        _values(path),
        figure,
    )


def figure_13() -> PaperFigure:
    """T42PF on the mustard bottle, nonsymmetric."""
    system = grasp_system(load_hand("t42pf"), load_object("mustard"), GraspSpec(onset_split=ONSET_SPLIT))
    path = squeezed(system)
    figure, (picture, forces, motion) = new_figure(10.2, 3.5, 1, 3)
    _picture(picture, path)
    _forces(forces, path)
    wound = _wound_mm(path)
    motion.plot(wound, path.motion[:, 0] * MM, color=RED, ls="--", label="x  (mm)")
    motion.plot(wound, path.motion[:, 1] * MM, color=BLUE, label="y  (mm)")
    motion.plot(wound, np.degrees(path.motion[:, 2]), color=GREEN, ls="-.", label="θ  (deg)")
    motion.legend(loc="lower left")
    as_curves(motion, WOUND, "predicted motion  mm, deg", "Motion of the bottle")
    x, y, angle = path.motion[-1]
    return PaperFigure(
        13,
        "forces and motion of a nonsymmetric pinch",
        f"A T42PF squeezes the mustard bottle (58 × 95 mm); its fingers touched at loads {100 * ONSET_SPLIT:.0f} % off "
        f"their mean. The bottle moves by x {x * MM:.1f} mm, y {y * MM:.1f} mm and turns by {np.degrees(angle):.1f}° "
        f"(what ends it: {path.end}). The paper reports 89.34 % mean agreement of its own prediction and measurement.",
        "that translation and rotation are coupled, and their course over the winding.",
        f"preset fitted (stiffness × 6, stop 1.8 rad); the onset split of {100 * ONSET_SPLIT:.0f} % is assumed: the "
        "paper does not say how nonsymmetric its grasp was. Without friction of the support.",
        _values(path) | {"onset_split": ONSET_SPLIT},
        figure,
    )


def _picture(axes: Axes, path: Path) -> None:
    system = path.system
    draw_state(axes, system, path.w[0], GHOST)
    draw_state(axes, system, path.w[-1])
    draw_path(axes, path.pose)
    draw_forces(axes, system, path.w[-1], 22.0 / float(path.contact_force_N[-1, ::2].max()))
    as_picture(axes, "First contact and end")


def _forces(axes: Axes, path: Path) -> None:
    wound = _wound_mm(path)
    axes.plot(wound, _sum_N(path), color=BLUE, label="sum of the contact forces")
    axes.plot(wound, path.contact_force_N[:, 0], color=GREY, lw=1.1, label="right")
    axes.plot(wound, path.contact_force_N[:, 2], color=RED, lw=1.1, ls="--", label="left")
    axes.legend(loc="upper left")
    as_curves(axes, WOUND, "normal force  N", "Contact forces")


def _wound_mm(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    wound: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = path.excursion_m.mean(1) * MM
    return wound


def _sum_N(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    total: np.ndarray[tuple[int, ...], np.dtype[np.float64]] = path.contact_force_N[:, ::2].sum(1)
    return total


def _values(path: Path) -> dict[str, object]:
    return {
        "motion_m_m_rad": path.motion[-1].tolist(),
        "sum_of_contact_forces_N": float(_sum_N(path)[-1]),
        "load_N": path.load_N[-1].tolist(),
        "largest_required_friction": float(np.nanmax(path.required_friction)),
        "end": path.end,
    }
