"""Fig. 7: the wrist moves against the object's motion in the hand, so that in the room the object stays.

The hand's pose that keeps the object is T_H(0) · D, D = T_HO(0) · T_HO(t)⁻¹ in hand axes; joint velocities follow
from the arm's pseudo-inverse, (17) and (18), with the remaining pose error fed back so that nothing drifts. The arm's
base has z up, the closing plane is horizontal. Source: paper II-F; hand-mechanics reference 9, WAM reference 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import pinocchio
from matplotlib.axes import Axes

from calibration.figures.drawing import GHOST, MM, NOW, PlanarPose, as_picture, draw_state
from calibration.figures.paper_figure import PaperFigure
from calibration.figures.squeezing import squeezed
from calibration.figures.style import BLUE, CYCLE, GREY, RED, as_curves, new_figure
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.path import Path
from calibration.grasp.specification import GraspSpec
from calibration.hand.bundle import Reals
from calibration.hand.parameters import load_hand
from calibration.objects import load_object

START_RAD = (0.0, 0.60, 0.0, 1.90, 0.0, np.pi / 2 - 2.50, 0.0)
"""Tool axis level: shoulder, elbow and wrist pitch add up to a right angle."""
HAND_HEIGHT_M = 0.08
"""Hand frame before the tool plate, y along the tool axis (OpenHand reference)."""
CORRECTIONS = 3


@dataclass(frozen=True)
class ArmMotion:
    """K arm states: joints (K, 7) rad, and joint origins, tool, hand and object centre in the base frame."""

    joint_rad: Reals
    skeleton_m: tuple[Reals, Reals]
    """first and last: (points, 3)"""
    object_m: Reals
    """(K, 3) where the object's centre ends up in the room"""


def figure_7() -> PaperFigure:
    """T42FF on the WAM, sphere of 20 mm radius."""
    system = grasp_system(load_hand("t42ff", "nominal"), load_object("sphere20"), GraspSpec())
    path = squeezed(system)
    offsets = [hand_offset(path.pose[0], pose) for pose in path.pose]
    arm = _arm_motion(path, offsets)
    drift_m = float(np.linalg.norm(arm.object_m - arm.object_m[0], axis=1).max())
    figure, (side, above, joints) = new_figure(10.6, 3.7, 1, 3, widths=(1, 1, 1.1))
    _draw_arm(side, arm)
    draw_state(above, system, path.w[0], GHOST)
    draw_state(above, system, path.w[-1], NOW, offsets[-1])
    as_picture(above, "From above, in the room")
    above.set_xlabel("across  mm")
    above.set_ylabel("forwards from the first hand pose  mm")
    wound = path.excursion_m.mean(1) * MM
    change = np.degrees(arm.joint_rad - arm.joint_rad[0])
    for joint in range(change.shape[1]):
        moved = np.abs(change[:, joint]).max() > 1e-3
        joints.plot(wound, change[:, joint], color=CYCLE[joint % len(CYCLE)], ls="-" if moved else ":",
                    label=f"joint {joint + 1}")  # fmt: skip
    joints.legend(loc="upper left", ncols=2)
    as_curves(joints, "both tendons wound in since contact  mm", "change of the joint angle  deg", "Joints of the arm")
    moved_mm = abs(offsets[-1].shift_m) * MM
    return PaperFigure(
        7,
        "compensation by the arm",
        "A Barrett WAM with a T42FF squeezes a sphere of 20 mm radius. The hand pulls the sphere "
        f"{-path.motion[-1, 1] * MM:.1f} mm towards the palm; the wrist goes {moved_mm:.1f} mm forwards, and so the "
        "sphere stays where it is. Dashed: first contact.",
        "the motion of hand, wrist and joints, from the models of hand and arm; perfect tracking, no dynamics (the "
        "simulated robot of `stillgrasp demo` has both).",
        "nothing is fitted; preset nominal, the arm's first posture and the hand's mount are assumed.",
        {
            "object_in_hand_m": path.motion[-1].tolist(),
            "wrist_travel_m": moved_mm / MM,
            "joint_change_rad": (arm.joint_rad[-1] - arm.joint_rad[0]).tolist(),
            "largest_drift_of_the_object_m": drift_m,
        },
        figure,
    )


def hand_offset(contact_pose: Reals, pose: Reals) -> PlanarPose:
    """D = T_HO(0) · T_HO(t)⁻¹ for planar poses (x m, y m, θ rad): where the hand must go in its first axes."""
    turn = float(contact_pose[2] - pose[2])
    shift = complex(*contact_pose[:2]) - np.exp(1j * turn) * complex(*pose[:2])
    return PlanarPose(complex(shift), turn)


def _arm_motion(path: Path, offsets: list[PlanarPose]) -> ArmMotion:
    urdf = files("drivers.wam").joinpath("wam7.urdf").read_text(encoding="utf-8")
    model: Any = pinocchio.buildModelFromXML(urdf)  # its classes have no types
    data: Any = model.createData()
    tool = model.getFrameId("tool")
    T_tool_hand = pinocchio.SE3(np.array([[0, 0, -1.0], [-1, 0, 0], [0, 1, 0]]), np.array([0, 0, HAND_HEIGHT_M]))
    q = np.array(START_RAD)
    pinocchio.framesForwardKinematics(model, data, q)
    T_base_tool = data.oMf[tool].copy()
    states, skeletons, objects = [], [], []
    for offset, pose in zip(offsets, path.pose, strict=True):
        wanted = T_base_tool * T_tool_hand * _spatial(offset) * T_tool_hand.inverse()
        for _ in range(CORRECTIONS):
            pinocchio.framesForwardKinematics(model, data, q)
            error = pinocchio.log6(data.oMf[tool].actInv(wanted)).vector
            J = pinocchio.computeFrameJacobian(model, data, q, tool, pinocchio.LOCAL)
            q = q + J.T @ np.linalg.solve(J @ J.T, error)
        pinocchio.framesForwardKinematics(model, data, q)
        hand = data.oMf[tool] * T_tool_hand
        objects.append(hand.act(np.array([pose[0], pose[1], 0.0])))
        skeletons.append(np.array([*(data.oMi[i].translation for i in range(1, 8)), data.oMf[tool].translation,
                                   hand.translation]))  # fmt: skip
        states.append(q)
    return ArmMotion(np.array(states), (skeletons[0], skeletons[-1]), np.array(objects))


def _spatial(pose: PlanarPose) -> Any:
    """Planar pose of the hand as a pinocchio.SE3."""
    turn = pinocchio.utils.rotate("z", pose.angle_rad)
    return pinocchio.SE3(turn, np.array([pose.shift_m.real, pose.shift_m.imag, 0.0]))


def _draw_arm(axes: Axes, arm: ArmMotion) -> None:
    for points, colour, style, width in zip(arm.skeleton_m, (GREY, BLUE), ("--", "-"), (1.4, 3.0), strict=True):
        axes.plot(points[:, 0] * MM, points[:, 2] * MM, color=colour, ls=style, lw=width, marker="o", ms=4,
                  zorder=3 if style == "-" else 4)  # fmt: skip
    centre = arm.object_m[-1] * MM
    axes.plot(arm.skeleton_m[1][-1:, 0] * MM, arm.skeleton_m[1][-1:, 2] * MM, "s", color=BLUE, ms=7, zorder=5)
    axes.plot([centre[0]], [centre[2]], "o", ms=8, color=RED, zorder=6)
    axes.annotate("sphere", (centre[0], centre[2]), (0, 9), textcoords="offset points", ha="center", color=RED)
    axes.annotate("shoulder", (0, 0), (10, 2), textcoords="offset points", color=GREY, fontsize=8)
    axes.margins(x=0.1)
    as_picture(axes, "The arm from the side")
    axes.set_xlabel("forwards from the shoulder  mm")
    axes.set_ylabel("up  mm")
