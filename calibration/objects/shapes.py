"""Planar outlines of objects, in the object's own axes (origin at its reference point, metres).

A shape is data; how fingertips touch it is `calibration/grasp/contact.py`. Further shapes (rectangle, convex polygon,
smooth curve) join the union `Shape` with a `kind` of their own.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta


class Disc(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="disc"):
    """A circle about the reference point: a cylinder that stands upright to the hand plane."""

    diameter_m: Annotated[float, Meta(gt=0, le=1)]

    @property
    def radius_m(self) -> float:
        """Half the diameter, m."""
        return self.diameter_m / 2

    @property
    def closing_width_m(self) -> float:
        """Extent along the contact line of a two-finger grasp, m."""
        return self.diameter_m


Shape = Disc
"""Every outline that a file may hold; a union once there is a second one."""
