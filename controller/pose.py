"""A pose as files and commands write it: position in metres and a unit quaternion, w first.

`xyz_m` is the origin of the posed frame in the reference frame, `quaternion_wxyz` its orientation; the key that holds
the pair says which frames (`T_world_base`: pose of base in world). Quaternion order is in the name because libraries
differ (real-time-python reference 6, pin).
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from calibration.toml_files import FieldError

Coordinate = Annotated[float, msgspec.Meta(ge=-10, le=10)]
Component = Annotated[float, msgspec.Meta(ge=-1.001, le=1.001)]

_NORM_TOLERANCE = 1e-3  # four printed decimals; anything further off is a mistake, not rounding


class Pose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Position (3), m, and quaternion (4), w x y z, of length 1 within 0.001."""

    xyz_m: tuple[Coordinate, Coordinate, Coordinate]
    quaternion_wxyz: tuple[Component, Component, Component, Component]

    def __post_init__(self) -> None:
        if not abs(math.hypot(*self.quaternion_wxyz) - 1.0) <= _NORM_TOLERANCE:
            raise FieldError("quaternion_wxyz", "four numbers w, x, y, z of length 1 (within 0.001)")

    def matrix(self) -> NDArray[np.float64]:
        """The pose as a homogeneous matrix, 4×4; the quaternion is normalised first."""
        length = math.hypot(*self.quaternion_wxyz)
        w, x, y, z = (component / length for component in self.quaternion_wxyz)
        px, py, pz = self.xyz_m
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), px],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), py],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), pz],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
