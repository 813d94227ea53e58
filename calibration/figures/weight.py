"""Fig. 16: the heavier an object on a table, the less a hand moves it at the same contact forces."""

from __future__ import annotations

from msgspec.structs import replace

from calibration.figures.drawing import GHOST, MM, as_picture, draw_path, draw_state
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.style import BLUE, ORANGE, as_curves, new_figure
from calibration.grasp.equilibrium import GraspSystem, grasp_system
from calibration.grasp.friction import OnTable, sliding
from calibration.grasp.path import Path, trace
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Finger, Hand, PinJoint, load_hand
from calibration.objects import load_object

WEIGHTS_G = (0, 100, 200, 300, 400, 500, 600)
LOAD_N = 78.0
SOFTER = 6.0
"""The second curve: all joints as many times softer, and as many times less load (hand-mechanics reference 8)."""
STEP_M = 2e-4


def figure_16() -> PaperFigure:
    """T42PF on the 45 mm cylinder, weights of 0 to 600 g on a table."""
    fitted = load_hand("t42pf")
    paths = [_dragged(_system(fitted), weight, LOAD_N) for weight in WEIGHTS_G]
    soft = [_dragged(_system(softer(fitted, SOFTER)), weight, LOAD_N / SOFTER) for weight in WEIGHTS_G]
    motion_mm, soft_mm = ([-float(path.motion[-1, 1]) * MM for path in own] for own in (paths, soft))
    figure, (light, heavy, curves) = new_figure(9.6, 3.6, 1, 3, widths=(1, 1, 1.4))
    for picture, index in ((light, 0), (heavy, len(WEIGHTS_G) - 1)):
        path = paths[index]
        draw_state(picture, path.system, path.w[0], GHOST)
        draw_state(picture, path.system, path.w[-1])
        draw_path(picture, path.pose)
        as_picture(picture, f"{WEIGHTS_G[index]} g: {motion_mm[index]:.1f} mm")
    labels = f"fitted stiffness, {LOAD_N:g} N", f"{SOFTER:g} times softer, {LOAD_N / SOFTER:g} N"
    for own, marker, colour, label in zip((motion_mm, soft_mm), "os", (BLUE, ORANGE), labels, strict=True):
        curves.plot(WEIGHTS_G, own, marker=marker, color=colour, label=label)
        for index in (len(WEIGHTS_G) // 2, len(WEIGHTS_G) - 1):
            curves.annotate(
                f"{own[index]:.1f}",
                (WEIGHTS_G[index], own[index]),
                (0, 6),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
    curves.set_ylim(0, 19)
    curves.legend(loc="lower left")
    as_curves(curves, "weight of the cylinder  g", "motion towards the palm  mm", "At a fixed load of each tendon")
    return PaperFigure(
        16,
        "effect of kinetic friction",
        "A T42PF squeezes a cylinder of 45 mm that stands on a table (friction 0.3) to the same load of its tendons, "
        f"for weights of 0 to 600 g: the motion falls from {motion_mm[0]:.1f} to {motion_mm[-1]:.1f} mm. In a hand "
        f"{SOFTER:g} times softer, at as many times less load, it falls from {soft_mm[0]:.1f} to {soft_mm[-1]:.1f} mm.",
        "that weight lessens the motion at a fixed load; it counts per stiffness only, so 100 g in the soft hand do "
        f"what {SOFTER * 100:g} g do in the stiff one.",
        "preset fitted (stiffness × 6); the load is chosen and the friction of the table assumed. The paper's weights "
        "and magnitudes stand in its picture only: no digits are compared.",
        {
            "weight_kg": [weight / 1e3 for weight in WEIGHTS_G],
            "load_N": LOAD_N,
            "motion_m": [value / MM for value in motion_mm],
            "softer_by": SOFTER,
            "motion_when_softer_m": [value / MM for value in soft_mm],
        },
        figure,
    )


def softer(hand: Hand, factor: float) -> Hand:
    """The hand with all joints `factor` times less stiff."""
    return replace(hand, right=_softer(hand.right, factor), left=_softer(hand.left, factor))


def _softer(finger: Finger, factor: float) -> Finger:
    proximal, distal = (
        replace(joint, stiffness_Nm_per_rad=joint.stiffness_Nm_per_rad / factor)
        if isinstance(joint, PinJoint)
        else replace(joint, bending_stiffness_Nm2=joint.bending_stiffness_Nm2 / factor)
        for joint in finger.joints
    )
    return replace(finger, proximal_joint=proximal, distal_joint=distal)


def _system(hand: Hand) -> GraspSystem:
    return grasp_system(hand, load_object("cylinder45"), GraspSpec())


def _dragged(system: GraspSystem, weight_g: float, load_N: float) -> Path:
    """Squeezed on the table up to a load of both tendons; an object without weight does not drag."""
    rule = OnTable(system, sliding(system.object, weight_g / 1e3))
    return trace(system, step_m=STEP_M, past_stops=False, rule=rule, load_cap_N=load_N)
