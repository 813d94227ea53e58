"""A hand and its object, drawn at a state: phalanges, flexures, outline, contact forces.

Hand frame, drawn in mm. `Placed` holds what is drawn where; a state of the mechanics gives one, and so does free
closing, before there is an object between the fingers. A planar pose may carry all of it elsewhere (into the room).
Source: hand-mechanics reference 1, 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Circle, FancyArrowPatch, Polygon

from calibration.figures.style import BLACK, BLUE, GREEN, GREY, RED, SKY
from calibration.grasp.constraints import phalanx_hull
from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.stability import contact_frames
from calibration.hand.bundle import Complexes, Reals
from calibration.hand.finger import FingerModel
from calibration.hand.joints import flexure_angles
from calibration.objects.shapes import Polygon as ConvexPolygon
from calibration.objects.shapes import Rectangle, Shape

MM = 1e3
OUTLINE_POINTS = 120
SAME_M = 1e-9
FLEXURE_POINTS = 24
ARROW: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 9, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
PALM = "#e6e6e6"
PALM_DEPTH_M = 0.022
PALM_MARGIN_M = 0.012


@dataclass(frozen=True)
class Look:
    """Colours of one state; the first of two superposed ones is a ghost."""

    phalanx: str
    edge: str
    flexure: str
    object_: str
    object_edge: str
    alpha: float = 1.0
    line: float = 1.0
    dashed: bool = False


NOW = Look("#f4f4f4", BLACK, BLUE, SKY, BLUE)
GHOST = Look("none", GREY, GREY, "none", GREY, alpha=0.9, line=0.9, dashed=True)


@dataclass(frozen=True)
class PlanarPose:
    """Where the hand frame is in the picture: a rotation, then a shift, m."""

    shift_m: complex = 0j
    angle_rad: float = 0.0

    def of(self, points: Complexes) -> Complexes:
        """Points of the hand frame in the picture."""
        moved: Complexes = self.shift_m + np.exp(1j * self.angle_rad) * points
        return moved


HERE = PlanarPose()


def draw_state(axes: Axes, system: GraspSystem, w: Reals, look: Look = NOW, frame: PlanarPose = HERE) -> None:
    """Hand and object at a state `w` (size,) of a grasp."""
    draw_object(axes, system.object.shape, object_pose(system, w), system.start.outline_angle_rad, look, frame)
    draw_hand(axes, system.fingers, (w[system.parts[0]], w[system.parts[1]]), look, frame)


def draw_hand(
    axes: Axes, fingers: tuple[FingerModel, FingerModel], q: tuple[Reals, Reals], look: Look = NOW,
    frame: PlanarPose = HERE,
) -> None:  # fmt: skip
    """Palm and both fingers at coordinates `q` (right, left)."""
    roots = [complex(finger.links[0].root.origin) for finger in fingers]
    _fill(axes, frame.of(_palm(roots[0].real, roots[1].real)), look, PALM if look.phalanx != "none" else "none")
    for finger, coordinates in zip(fingers, q, strict=True):
        for joint in (0, 1):
            curve = frame.of(joint_curve(finger, joint, coordinates))
            if curve.size > 1:
                axes.plot(
                    curve.real * MM, curve.imag * MM, color=look.flexure, lw=3.2 * look.line, alpha=look.alpha,
                    solid_capstyle="butt", zorder=3,
                )  # fmt: skip
        for phalanx in (0, 1):
            _fill(axes, frame.of(phalanx_outline(finger, phalanx, coordinates)), look, look.phalanx)
        for joint in (0, 1):
            curve = frame.of(joint_curve(finger, joint, coordinates))
            if curve.size == 1:
                place = (float(curve[0].real) * MM, float(curve[0].imag) * MM)
                axes.add_patch(Circle(place, 2.2, fc="white", ec=look.edge, lw=0.9 * look.line, zorder=4))


def draw_object(
    axes: Axes, shape: Shape, pose: Reals, outline_angle_rad: float = 0.0, look: Look = NOW, frame: PlanarPose = HERE
) -> None:
    """Outline of the object at `pose` (x m, y m, θ rad), with a mark that shows how it is turned."""
    outline = object_outline(shape) * np.exp(1j * (pose[2] + outline_angle_rad))
    centre = complex(pose[0], pose[1])
    _fill(axes, frame.of(centre + outline), look, look.object_, look.object_edge, 0.55)
    at = complex(frame.of(np.array([centre]))[0])
    reach = 0.45 * shape.extent_m(-outline_angle_rad) / 2
    mark = frame.of(centre + reach * np.exp(1j * pose[2]) * np.array([-1.0, 1.0]))
    axes.plot(mark.real * MM, mark.imag * MM, color=look.object_edge, lw=0.8 * look.line, alpha=0.8, zorder=5)
    axes.add_patch(
        Circle((at.real * MM, at.imag * MM), 1.3, fc=look.object_edge, ec="white", lw=0.4, zorder=6, alpha=look.alpha)
    )


def draw_forces(
    axes: Axes, system: GraspSystem, w: Reals, mm_per_N: float, colour: str = RED, frame: PlanarPose = HERE
) -> None:
    """Contact forces on the object as arrows that end at the contacts."""
    for begin, end in zip(*force_arrows(system, w, mm_per_N, frame), strict=True):
        arrow = FancyArrowPatch((begin.real, begin.imag), (end.real, end.imag), **ARROW, color=colour, zorder=8)
        axes.add_patch(arrow)


def force_arrows(
    system: GraspSystem, w: Reals, mm_per_N: float, frame: PlanarPose = HERE
) -> tuple[Complexes, Complexes]:
    """Where arrows of the contact forces begin and end in the picture, (2,) mm each, right and left."""
    components = system.contact_rows() @ w
    points, normals = contact_frames(system, w)
    forces = (components[::2] + 1j * components[1::2]) * normals * np.exp(1j * frame.angle_rad)
    ends: Complexes = frame.of(points) * MM
    begins: Complexes = ends - forces * mm_per_N
    return begins, ends


def draw_path(axes: Axes, poses: Reals, colour: str = GREEN, frame: PlanarPose = HERE) -> None:
    """Where the object's reference point went, `poses` (K, 3), with an arrow head at its end."""
    points = frame.of(poses[:, 0] + 1j * poses[:, 1])
    x, y = points.real * MM, points.imag * MM
    axes.plot(x, y, color=colour, lw=1.6, zorder=7)
    before = max(0, len(x) - max(2, len(x) // 8))
    axes.add_patch(FancyArrowPatch((x[before], y[before]), (x[-1], y[-1]), **ARROW, color=colour, zorder=7))


def as_picture(axes: Axes, title: str = "", *, frame_labels: bool = True) -> None:
    """Make axes those of a picture to scale, in mm of the hand frame."""
    axes.set_aspect("equal")
    axes.set_title(title)
    if frame_labels:
        axes.set_xlabel("x  mm")
        axes.set_ylabel("y  mm")
    axes.grid(True, lw=0.4)
    axes.set_axisbelow(True)


def object_pose(system: GraspSystem, w: Reals) -> Reals:
    """(3,) x m, y m, θ rad of the object at a state."""
    pose: Reals = w[system.joints : system.joints + 3]
    return pose


def fingertips(fingers: tuple[FingerModel, FingerModel], q: tuple[Reals, Reals]) -> Complexes:
    """(2,) centres of the fingertip arcs, right and left, hand frame, m."""
    return np.array([finger.tip.at(own[None]).value[0] for finger, own in zip(fingers, q, strict=True)])


def object_outline(shape: Shape) -> Complexes:
    """Outline in the object's own axes, x + i y m; a polygon's corners are points of it."""
    if isinstance(shape, Rectangle | ConvexPolygon):
        return shape.corners
    points = shape.outline_m(OUTLINE_POINTS)
    outline: Complexes = points[:, 0] + 1j * points[:, 1]
    return outline


def phalanx_outline(finger: FingerModel, phalanx: int, q: Reals) -> Complexes:
    """Outline of a phalanx, tip included, at coordinates `q` (n,): the hull of the mechanics, as a polygon."""
    hull = phalanx_hull(finger, phalanx, q[None])
    turns = np.exp(2j * np.pi * np.arange(OUTLINE_POINTS) / OUTLINE_POINTS)
    reach = (hull.centres[0] * turns.conj()[:, None]).real + hull.radii_m
    farthest = np.argmax(reach, axis=1)
    points: Complexes = hull.centres[0][farthest] + hull.radii_m[farthest] * turns
    outline: Complexes = points[np.abs(points - np.roll(points, 1)) > SAME_M]
    return outline


def joint_curve(finger: FingerModel, joint: int, q: Reals) -> Complexes:
    """Centre line of a joint at coordinates `q` (n,), hand frame, m: one point for a pin, many for a flexure."""
    link = finger.links[joint]
    model, sign = finger.joints[joint], link.inner_side
    end = complex(link.root.at(q[None]).value[0])
    length = float(model.bend.weights.sum())
    if length == 0:
        return np.array([end])
    first = finger.joint_index[joint]
    own = q[first : first + model.size]
    along = np.linspace(0, 1, FLEXURE_POINTS)
    angles = flexure_angles(along, model.size) @ own
    phase = float(link.root.phases[-1]) if sign > 0 else np.pi - float(link.root.phases[-1])
    row = (link.root.coordinates[-1] if sign > 0 else -link.root.coordinates[-1]).copy()
    row[first : first + model.size] = 0.0
    start_angle = phase + float(row @ q)
    steps = np.exp(1j * (start_angle + 0.5 * (angles[1:] + angles[:-1]))) * length / (FLEXURE_POINTS - 1)
    curve = np.concatenate([[0j], np.cumsum(steps)])
    if sign < 0:
        curve = -curve.conj()
    placed: Complexes = curve + (end - curve[-1])
    return placed


def _palm(right: float, left: float) -> Complexes:
    edge = PALM_MARGIN_M
    corners = [
        complex(right + edge, 0), complex(right + 0.4 * edge, -PALM_DEPTH_M),
        complex(left - 0.4 * edge, -PALM_DEPTH_M), complex(left - edge, 0),
    ]  # fmt: skip
    return np.array(corners)


def _fill(
    axes: Axes, points: Complexes, look: Look, face: str, edge: str | None = None, alpha: float | None = None
) -> None:
    corners = np.column_stack([points.real, points.imag]) * MM
    transparency = look.alpha if alpha is None else alpha
    axes.add_patch(
        Polygon(
            corners,
            closed=True,
            fc="none" if face == "none" else to_rgba(face, transparency),
            ec=to_rgba(edge or look.edge, look.alpha),
            lw=1.1 * look.line,
            ls=(0, (3, 2)) if look.dashed else "-",
            zorder=4 if look.dashed else 2,
        )
    )
