"""Robot hand constraints: no phalanx enters the object, no two phalanges enter one another, and a report of all five.

The gaps here, (11) and (12), are clearances in m along a path, 0 where bodies touch; friction cones (8), joint limits
(9) and contacts on the surface (10) are conditions of an equilibrium and are assessed with them in
`robot_hand_constraints`. Phalanges are taken whole (convex, exact), not as a sample of their points. The fingertip's
arc and pad touch the object by design and are left out of (11). Two phalanges that a pin joins overlap at the pin;
there the joint's own limits (9) stand for (12), as in the paper. Hand frame, SI. Source: paper (8)–(12).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.grasp.equilibrium import GraspSystem
from calibration.grasp.hulls import Body, Hull, SmoothBody, separation_m
from calibration.hand.finger import Complexes, FingerModel, LinkModel, Reals
from calibration.objects.shapes import Disc, Polygon, Rectangle, Shape, Sphere

SIDES = ("right", "left")
PHALANGES = ("proximal", "distal")
ROUNDING_M = 1e-12
CONE_N = 1e-6
"""A cone is left from here on; a place on a path where it just holds is found to this."""
ROUNDING_RAD = 1e-9
SURFACE_M = 1e-9
"""A contact or clearance is violated from here on."""


@dataclass(frozen=True)
class Gap:
    """A clearance: `at` states w (B, size) → (B,) m, ≥ 0 allowed."""

    name: str
    at: Callable[[Reals], Reals]


def gaps(system: GraspSystem) -> list[Gap]:
    """Clearances of a grasp: each phalanx from the object, phalanges of one finger and of both from one another."""
    found = []
    for side in (0, 1):
        for phalanx in (0, 1):
            name = f"{SIDES[side]} {PHALANGES[phalanx]} phalanx meets the object"
            found.append(Gap(name, _from_object(system, side, phalanx)))
    for side, finger in enumerate(system.fingers):
        if not pinned(finger):
            found.append(Gap(f"{SIDES[side]} phalanges collide", _between(system, (side, 0), (side, 1))))
    for first in (0, 1):
        for second in (0, 1):
            name = f"right {PHALANGES[first]} and left {PHALANGES[second]} phalanx collide"
            found.append(Gap(name, _between(system, (0, first), (1, second))))
    return found


def contact_margins(system: GraspSystem) -> list[Gap]:
    """Distances of both contacts from what ends their kind: the far end of a pad, the end of a side, …"""
    first = system.first_state()[None]
    return [
        Gap(f"{SIDES[side]} contact at {name}", _feature(system, side, name))
        for side, (contact, part) in enumerate(zip(system.contacts, system.parts, strict=True))
        for name in contact.features(first[:, part], first[:, system.joints : system.unknowns])
    ]


@dataclass(frozen=True)
class RobotHandConstraints:
    """All of (8)–(12) at one state, with numbers: margins are ≥ 0 where a constraint holds."""

    cone_margin_N: tuple[float, float]
    """(8): μ N − sqrt(f_o² + f_t²) at the right and the left contact"""
    joint_margin_rad: dict[str, float]
    """(9): distance from the nearer limit, by joint"""
    surface_error_m: float
    """(10): largest violation of contact and rolling"""
    clearance_m: dict[str, float]
    """(11) and (12): by what would meet"""

    @property
    def violated(self) -> list[str]:
        """What does not hold, in words; empty if all does."""
        found = [
            f"{side} contact outside its friction cone"
            for side, margin in zip(SIDES, self.cone_margin_N, strict=True)
            if margin < -CONE_N
        ]
        found += [
            f"{name} joint beyond its limit" for name, gap in self.joint_margin_rad.items() if gap < -ROUNDING_RAD
        ]
        found += ["a contact has left the object's surface"] if self.surface_error_m > SURFACE_M else []
        return found + [name for name, clearance_m in self.clearance_m.items() if clearance_m < -SURFACE_M]


def robot_hand_constraints(
    system: GraspSystem, w: Reals, contact_friction: float, out_of_plane_N: float = 0.0
) -> RobotHandConstraints:
    """Constraints (8)–(12) at a state `w` (size,); `out_of_plane_N` is f_o, the weight that each contact carries."""
    state = w[None]
    forces = system.contact_rows() @ w
    margins = contact_friction * forces[::2] - np.hypot(forces[1::2], out_of_plane_N)
    names = [f"{side} {phalanx}" for side in SIDES for phalanx in PHALANGES]
    limits = {
        name: float(min(w[column] - system.lower_rad[column], system.upper_rad[column] - w[column]))
        for name, column in zip(names, system.joint_columns, strict=True)
    }
    error_m = max(float(np.abs(jet.value).max()) for jet in system.terms(state).contacts)
    clearances = {gap.name: float(gap.at(state)[0]) for gap in gaps(system)}
    return RobotHandConstraints((float(margins[0]), float(margins[1])), limits, error_m, clearances)


def pinned(finger: FingerModel) -> bool:
    """Whether a pin joins the two phalanges, so that they overlap there by design."""
    proximal, distal = finger.links
    rest = np.zeros((1, finger.angle_row.size))
    end = proximal.point(proximal.length_m, 0.0).at(rest).value
    return bool(abs(end[0] - distal.root.at(rest).value[0]) < ROUNDING_M)


def phalanx_hull(finger: FingerModel, phalanx: int, q: Reals, *, without_tip: bool = False) -> Hull:
    """Outline of the proximal (0) or distal (1) phalanx at coordinates `q` (B, n), hand frame.

    Without the tip, the distal one ends behind the parts of the fingertip that may touch the object.
    """
    link, outer_m = finger.links[phalanx], finger.outer_m
    (start, inner_start_m), (end, inner_end_m) = link.inner_corners_m
    if phalanx == 0:
        corners = [(0.0, -outer_m), (link.length_m, -outer_m), (end, inner_end_m), (start, inner_start_m)]
        return _placed(link, q, corners, [0.0] * 4)
    radius_m = finger.tip_radius_m
    tip_m, pad_m = link.length_m - radius_m, finger.pad.length_m if finger.pad else 0.0
    if without_tip:
        outer_end_m = -min(radius_m, outer_m)
        corners = [(0.0, -outer_m), (tip_m, outer_end_m), (end - pad_m, inner_end_m), (start, inner_start_m)]
        return _placed(link, q, corners, [0.0] * 4)
    corners = [(0.0, -outer_m), (tip_m, 0.0), (start, inner_start_m)]
    return _placed(link, q, corners, [0.0, radius_m, 0.0])


def object_body(shape: Shape, outline_angle_rad: float, pose: Reals) -> Body:
    """Outline of the object at `pose` (B, 3), turned in its own frame by `outline_angle_rad`."""
    centre: Complexes = (pose[:, 0] + 1j * pose[:, 1])[:, None]
    if isinstance(shape, Disc | Sphere):
        return Hull(centre, np.array([shape.radius_m]))
    turn = pose[:, 2] + outline_angle_rad
    if isinstance(shape, Rectangle | Polygon):
        corners = shape.corners
        return Hull(centre + np.exp(1j * turn)[:, None] * corners, np.zeros(corners.size))
    return SmoothBody(shape.support, centre[:, 0], turn)


def _placed(link: LinkModel, q: Reals, corners_m: list[tuple[float, float]], radii_m: list[float]) -> Hull:
    """Discs given as (along, across) of a link, right finger counter-clockwise, where the finger's coordinates put
    them."""
    local = np.array([complex(along, link.inner_side * across) for along, across in corners_m])
    axis = np.exp(1j * (link.angle_rad + q @ link.angle_row))
    centres = link.root.at(q).value[:, None] + axis[:, None] * local
    order = slice(None) if link.inner_side > 0 else slice(None, None, -1)
    return Hull(centres[:, order], np.array(radii_m)[order])


def _feature(system: GraspSystem, side: int, name: str) -> Callable[[Reals], Reals]:
    contact, part = system.contacts[side], system.parts[side]

    def at(w: Reals) -> Reals:
        return contact.features(w[:, part], w[:, system.joints : system.unknowns])[name]

    return at


def _between(system: GraspSystem, first: tuple[int, int], second: tuple[int, int]) -> Callable[[Reals], Reals]:
    def at(w: Reals) -> Reals:
        hulls = [
            phalanx_hull(system.fingers[side], phalanx, w[:, system.parts[side]]) for side, phalanx in (first, second)
        ]
        return separation_m(*hulls)

    return at


def _from_object(system: GraspSystem, side: int, phalanx: int) -> Callable[[Reals], Reals]:
    finger, part = system.fingers[side], system.parts[side]

    def at(w: Reals) -> Reals:
        pose = w[:, system.joints : system.joints + 3]
        body = object_body(system.object.shape, system.start.outline_angle_rad, pose)
        return separation_m(body, phalanx_hull(finger, phalanx, w[:, part], without_tip=phalanx == 1))

    return at
