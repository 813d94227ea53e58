"""The object of the simulated world, what it stands on, and how it touches: fingertips and support.

Object frame: z along the axis of an upright prism, origin at the outline's reference point, at half the height; the
outline is turned in it by a given angle. Outlines: hand-mechanics reference 5; friction is what is stated here.

A fingertip arc is a sphere, so that the contact has one point. On a cylinder or box MuJoCo computes it in closed form;
a polygon is a convex mesh, and so is any other curve, as a prism of `OUTLINE_POINTS` flat sides. Torsion about the
contact normal has the friction of a line as long as the finger is wide; without it two point contacts would let the
object swing about the line between them. A ball is an upright cylinder here: between fingers that are lines across the
hand plane it rolls as its section does, and between two points it would roll out of the plane.

An object stands on small balls, most of them along its rim, some around the middle, so that its drag against turning
is that of an evenly pressed patch (hand-mechanics reference 8). MuJoCo's own contact of cylinder and plane takes the
rim's lowest point from the tilt, and makes of a tilt of round-off size a penetration of millimetres, which throws the
object.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.hand.parameters import SIDES
from calibration.objects.parameters import GraspObject
from calibration.objects.shapes import Disc, Polygon, Rectangle, Shape, Sphere
from controller.simulation.world_arm import text
from controller.simulation.world_finger import FINGER_WIDTH_M
from drivers.errors import InputError

TIP_FRICTION = 1.0
DEFAULT_HEIGHT_M = 0.12
RIM_FEET = 8
FOOT_RADIUS_M = 5e-4
SUPPORT_HALF_WIDTH_M = 0.15  # drawn size only: the plane carries the object wherever it goes
OUTLINE_POINTS = 720
"""A round outline that is no circle is a prism of so many sides; its corners are half a degree."""


@dataclass(frozen=True)
class ObjectSetting:
    """The object, how its outline is turned in its frame, whether it floats, and friction at the right and left tip."""

    grasped: GraspObject
    outline_angle_rad: float
    weightless: bool
    tip_friction: tuple[float, float]
    padded: bool
    """Whether a fingertip has a flat pad."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.outline_angle_rad):
            raise InputError(f"outline_angle_rad = {self.outline_angle_rad} is not accepted; expected a finite angle.")
        if len(self.tip_friction) != 2 or not all(0.0 < friction <= 5.0 for friction in self.tip_friction):
            raise InputError(f"tip_friction = {self.tip_friction} is not accepted; expected two of > 0 and ≤ 5.")

    @property
    def outline_m(self) -> NDArray[np.float64]:
        """Points around the outline, counter-clockwise, in the object frame, (points, 2)."""
        cos, sin = np.cos(self.outline_angle_rad), np.sin(self.outline_angle_rad)
        turned: NDArray[np.float64] = _outline_m(self.grasped.shape) @ np.array([[cos, sin], [-sin, cos]])
        return turned


def add_object(
    worldbody: ElementTree.Element,
    asset: ElementTree.Element,
    contact: ElementTree.Element,
    setting: ObjectSetting,
    T_world_object: NDArray[np.float64],
    place: tuple[str, str],
    touch: dict[str, str],
) -> None:
    """Append the object at T_world_object (`place` as MJCF writes it), its mesh, its support and all contact pairs.

    Names: body, joint, mesh and geom `object`, geoms `foot_0` …, `support`. `touch`: constraint attributes of contacts.
    Raises InputError for an object that leans on its support.
    """
    grasped = setting.grasped
    height_m = grasped.height_m or DEFAULT_HEIGHT_M
    outline_m = setting.outline_m
    body = ElementTree.SubElement(worldbody, "body", name="object", pos=place[0], quat=place[1])
    if setting.weightless:
        body.set("gravcomp", "1")
    ElementTree.SubElement(body, "freejoint", name="object")
    xx, yy, xy = grasped.mass_kg * mean_squares_m2(outline_m)
    upright = grasped.mass_kg * height_m**2 / 12
    ElementTree.SubElement(
        body,
        "inertial",
        pos="0 0 0",
        mass=repr(grasped.mass_kg),
        fullinertia=text((yy + upright, xx + upright, xx + yy, -xy, 0.0, 0.0)),
    )
    half = setting.outline_angle_rad / 2
    turned = text((np.cos(half), 0.0, 0.0, np.sin(half)))
    ElementTree.SubElement(
        body, "geom", _geometry(grasped, height_m, setting.padded, asset), name="object", quat=turned
    )
    for side, tip_friction in zip(SIDES, setting.tip_friction, strict=True):
        torsion_m = tip_friction * FINGER_WIDTH_M / 4
        friction = text((tip_friction, tip_friction, torsion_m, 1e-6, 1e-6))
        ElementTree.SubElement(
            contact, "pair", touch, geom1=f"tip_{side}", geom2="object", condim="4", friction=friction
        )
    if grasped.support is not None:
        feet = feet_m(outline_m, grasped.shape.mean_pressure_distance_m)
        _add_support(worldbody, body, contact, grasped.support.friction, T_world_object, height_m, feet, touch)


def mean_squares_m2(outline_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of x², y² and xy over the area of the polygon with these vertices (n, 2) m, counter-clockwise."""
    x, y = outline_m.T
    x_next, y_next = np.roll(x, -1), np.roll(y, -1)
    cross = x * y_next - x_next * y
    moments = np.array(
        [
            ((x * x + x * x_next + x_next * x_next) * cross).sum() / 6,
            ((y * y + y * y_next + y_next * y_next) * cross).sum() / 6,
            ((x * y_next + 2 * x * y + 2 * x_next * y_next + x_next * y) * cross).sum() / 12,
        ]
    )
    means: NDArray[np.float64] = moments / cross.sum()
    return means


def _outline_m(shape: Shape) -> NDArray[np.float64]:
    if isinstance(shape, Rectangle | Polygon):
        return np.column_stack([shape.corners.real, shape.corners.imag])
    return shape.outline_m(OUTLINE_POINTS)


def _geometry(grasped: GraspObject, height_m: float, padded: bool, asset: ElementTree.Element) -> dict[str, str]:
    shape = grasped.shape
    if isinstance(shape, Disc | Sphere):
        # Next to a capsule the cylinder is one, too: a closed form. Its round ends touch nothing.
        kind = "capsule" if padded else "cylinder"
        return {"type": kind, "size": text((shape.radius_m, height_m / 2))}
    if isinstance(shape, Rectangle):
        return {"type": "box", "size": text((shape.width_m / 2, shape.depth_m / 2, height_m / 2))}
    prism = [text((x, y, z)) for z in (-height_m / 2, height_m / 2) for x, y in _outline_m(shape)]
    ElementTree.SubElement(asset, "mesh", name="object", vertex=" ".join(prism))
    return {"type": "mesh", "mesh": "object"}


def feet_m(outline_m: NDArray[np.float64], mean_distance_m: float) -> NDArray[np.float64]:
    """Where the feet of an outline (n, 2) stand, (feet, 2) m: the outermost points in `RIM_FEET` directions, a foot's
    radius inside, and so many around the middle that all are `mean_distance_m` from it on average."""
    directions = _around(RIM_FEET)
    rim = outline_m[np.unique(np.argmax(outline_m @ directions.T, axis=0))]
    distance_m = np.linalg.norm(rim, axis=1)
    rim = rim * (1.0 - FOOT_RADIUS_M / distance_m)[:, None]
    reach_m = float(np.mean(distance_m - FOOT_RADIUS_M))
    # A ball rests on a point, but has to stand: as a cylinder does.
    wanted_m = min(mean_distance_m or 2 * reach_m / 3, reach_m)
    inner = math.ceil(len(rim) * (reach_m / wanted_m - 1.0) - 1e-9)
    inner_m = ((len(rim) + inner) * wanted_m - len(rim) * reach_m) / max(inner, 1)
    feet: NDArray[np.float64] = np.concatenate([rim, inner_m * _around(inner)])
    return feet


def _around(count: int) -> NDArray[np.float64]:
    angles = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _add_support(
    worldbody: ElementTree.Element,
    body: ElementTree.Element,
    contact: ElementTree.Element,
    mu: float,
    T_world_object: NDArray[np.float64],
    height_m: float,
    feet: NDArray[np.float64],
    touch: dict[str, str],
) -> None:
    if abs(T_world_object[2, 2] - 1.0) > 1e-9:
        raise InputError(
            "T_world_object leans: an object on a support stands upright, z axes of object and world agree."
        )
    size = text((SUPPORT_HALF_WIDTH_M, SUPPORT_HALF_WIDTH_M, 0.01))
    below_m = T_world_object[:3, 3] - (0.0, 0.0, height_m / 2)
    ElementTree.SubElement(worldbody, "geom", name="support", type="plane", size=size, pos=text(below_m))
    # No friction is frictionless contact (condim 1): MuJoCo has no cone of zero width.
    friction = text((mu, mu, 1e-6, 1e-6, 1e-6)) if mu > 0.0 else text((1.0, 1.0, 1e-6, 1e-6, 1e-6))
    condim = "3" if mu > 0.0 else "1"
    for foot, (x_m, y_m) in enumerate(feet):
        position = text((x_m, y_m, FOOT_RADIUS_M - height_m / 2))
        name = f"foot_{foot}"
        ElementTree.SubElement(body, "geom", name=name, type="sphere", size=repr(FOOT_RADIUS_M), pos=position)
        ElementTree.SubElement(contact, "pair", touch, geom1=name, geom2="support", condim=condim, friction=friction)
