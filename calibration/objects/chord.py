"""Where a straight line crosses an outline: the two places at which a pinch grasp touches it.

In the line's own axes: x along the line, the object's reference point at the origin, the line at the height `level_m`
above it. Metres, complex numbers x + i y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from calibration.objects.shapes import Flat, Shape
from calibration.objects.support import SupportFunction
from drivers.errors import MechanicsError

CORNER_M = 1e-5
"""A crossing nearer than this to a corner has no normal to speak of."""


@dataclass(frozen=True)
class ChordEnd:
    """A crossing: place, m, and unit outward normal of the outline there, both in the line's axes."""

    point: complex
    normal: complex


def chord(shape: Shape, direction_rad: float, level_m: float) -> tuple[ChordEnd, ChordEnd]:
    """Front (larger x) and back end of the chord of `shape` along `direction_rad` in the outline's axes.

    Errors: MechanicsError when the line passes beside the object or through one of its corners.
    """
    if isinstance(shape, Flat):
        corners = shape.corners * np.exp(-1j * direction_rad)
        _refuse_beside(level_m, float(corners.imag.min()), float(corners.imag.max()))
        sides = list(zip(corners, np.roll(corners, -1), strict=True))
        front = next((one, two) for one, two in sides if one.imag < level_m <= two.imag)
        back = next((one, two) for one, two in sides if one.imag >= level_m > two.imag)
        return _on_side(*front, level_m), _on_side(*back, level_m)
    support = shape.support
    h = support.derivatives(direction_rad + np.array([-np.pi / 2, np.pi / 2]), 0)[1]
    _refuse_beside(level_m, -float(h[0]), float(h[1]))
    return _on_curve(support, direction_rad, level_m, 1.0), _on_curve(support, direction_rad, level_m, -1.0)


def _on_side(start: complex, end: complex, level_m: float) -> ChordEnd:
    share = (level_m - start.imag) / (end.imag - start.imag)
    if min(share, 1 - share) * abs(end - start) < CORNER_M:
        raise MechanicsError(
            "object_angle_deg",
            "the line between the fingertips passes through a corner of the object, where they would not stay.",
            help="Turn the object, or shift it by object_offset_m, so that both fingertips meet a flat side.",
        )
    along = end - start
    return ChordEnd(start.real + share * along.real + 1j * level_m, -1j * along / abs(along))


def _on_curve(support: SupportFunction, direction_rad: float, level_m: float, forward: float) -> ChordEnd:
    """The outline's height over the line's direction grows with the normal's elevation, from −90° to 90°."""

    def point(elevation_rad: float) -> complex:
        turned = elevation_rad if forward > 0 else math.pi - elevation_rad
        return complex(support.point(np.array([direction_rad + turned]))[0] * np.exp(-1j * direction_rad))

    if support.constant:
        elevation = math.asin(level_m / support.cos_m[0])
        reach = support.cos_m[0] * math.cos(elevation)
    else:
        quarter = math.pi / 2
        elevation = float(brentq(lambda angle: point(angle).imag - level_m, -quarter, quarter, xtol=1e-15, rtol=1e-15))
        reach = forward * point(elevation).real
    return ChordEnd(forward * reach + 1j * level_m, forward * math.cos(elevation) + 1j * math.sin(elevation))


def _refuse_beside(level_m: float, lower_m: float, upper_m: float) -> None:
    if not lower_m < level_m < upper_m:
        raise MechanicsError(
            "object_offset_m",
            f"the line between the fingertips passes {max(lower_m - level_m, level_m - upper_m) * 1e3:.1f} mm beside "
            "the object.",
            help=f"Take an offset between {-upper_m * 1e3:.1f} and {-lower_m * 1e3:.1f} mm.",
        )
