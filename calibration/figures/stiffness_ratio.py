"""Fig. 6: hands with other ratios of distal to proximal stiffness move spheres differently."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
from matplotlib.figure import Figure

from calibration.figures.drawing import GHOST, MM, as_picture, draw_path, draw_state
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.squeezing import squeezed
from calibration.figures.style import CYCLE, DPI, as_curves
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.path import Path
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Finger, FlexureJoint, Hand, load_hand
from calibration.objects import load_object

RATIOS = (1.0, 2.5, 4.0)
RADII_MM = (10, 20, 30, 40, 50)
DRAWN_MM = (10, 30, 50)
STEP_M = 2e-4
MARKERS = ("o", "s", "^")


@dataclass(frozen=True)
class Squeezed:
    """One hand on one sphere, up to the distal stop."""

    ratio: float
    radius_mm: int
    path: Path

    @property
    def motion_mm(self) -> float:
        """Towards the palm, positive."""
        return -float(self.path.motion[-1, 1]) * MM


def figure_6() -> PaperFigure:
    """T42FF with three stiffness ratios on spheres of five radii."""
    hand = load_hand("t42ff", "nominal")
    runs = [_squeezed(hand, ratio, radius) for ratio in RATIOS for radius in RADII_MM]
    figure = Figure(figsize=(9.6, 5.6), dpi=DPI, layout="constrained")
    pictures, diagram = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.7, 1))[0]
    grid = pictures.subplots(len(RATIOS), len(DRAWN_MM), sharex=True, sharey=True, squeeze=False)
    shown = [run for run in runs if run.radius_mm in DRAWN_MM]
    for axes, run in zip(grid.ravel(), shown, strict=True):
        system, path = run.path.system, run.path
        draw_state(axes, system, path.w[0], GHOST)
        draw_state(axes, system, path.w[-1])
        draw_path(axes, path.pose)
        as_picture(axes, f"{run.motion_mm:.1f} mm", frame_labels=False)
        axes.label_outer()
    for axes, ratio in zip(grid[:, 0], RATIOS, strict=True):
        axes.set_ylabel(f"$R_S$ = {ratio:g}\ny  mm")
    for axes, radius in zip(grid[-1], DRAWN_MM, strict=True):
        axes.set_xlabel(f"x  mm\nsphere of radius {radius} mm")
    curves = diagram.subplots()
    for ratio, marker, colour in zip(RATIOS, MARKERS, CYCLE, strict=False):
        own = [run for run in runs if run.ratio == ratio]
        curves.plot([run.radius_mm for run in own], [run.motion_mm for run in own], marker=marker, color=colour,
                    label=f"$R_S$ = {ratio:g}")  # fmt: skip
    curves.set_ylim(bottom=0)
    curves.legend(loc="lower right")
    as_curves(
        curves, "radius of the sphere  mm", "motion towards the palm at the stop  mm", "Motion at the distal stop"
    )
    return PaperFigure(
        6,
        "stiffness ratios",
        "T42FF hands with three ratios R_S of distal to proximal stiffness squeeze spheres until the distal joints "
        "meet their stop; first contact dashed, end filled, the motion of the sphere above each picture.",
        "that another ratio reconfigures the fingers differently and moves the object by another amount, and that "
        "the object's size matters at a low ratio only.",
        "nothing is fitted; preset nominal, the distal flexure made stiffer or softer; the ratios are ours (2.5 "
        "follows from the flexures' thickness), the paper does not print its own.",
        {
            "motion_m": {
                f"R_S {ratio:g}": {f"r {run.radius_mm} mm": run.motion_mm / MM for run in runs if run.ratio == ratio}
                for ratio in RATIOS
            }
        },
        figure,
    )


def with_ratio(hand: Hand, ratio: float) -> Hand:
    """The hand with distal flexures `ratio` times as stiff as the proximal ones."""
    return msgspec.structs.replace(hand, right=_stiffer(hand.right, ratio), left=_stiffer(hand.left, ratio))


def _stiffer(finger: Finger, ratio: float) -> Finger:
    proximal, distal = finger.joints
    assert isinstance(proximal, FlexureJoint)
    assert isinstance(distal, FlexureJoint)
    stiffness = ratio * proximal.bending_stiffness_Nm2 * distal.length_m / proximal.length_m
    return msgspec.structs.replace(
        finger, distal_joint=msgspec.structs.replace(distal, bending_stiffness_Nm2=stiffness)
    )


def _squeezed(hand: Hand, ratio: float, radius_mm: int) -> Squeezed:
    system = grasp_system(with_ratio(hand, ratio), load_object(f"sphere{radius_mm}"), GraspSpec())
    return Squeezed(ratio, radius_mm, squeezed(system, step_m=STEP_M))
