"""How a hand takes an object: the parameters of one grasp, beside those of hand and object. SI units. Source: design
7."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.errors import MechanicsError


class GraspSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`onset_split` δ: the fingers touch at loads T(1 + δ) right, T(1 − δ) left (hand-mechanics reference 6); 0 is
    symmetric.

    `contact_friction`: coefficient at the fingertips, that required friction is compared with. `load_cap_N`: tendon
    load at which winding stops; None is the hand's. `supported`: the object stands on its support while it is
    gripped, so that it drags. `compensated`: the wrist gives way so that the object stands still in the room; it then
    does not drag, though it stands on its support. `object_offset_m`: how far the object's centre stands off the line
    between the fingertips, positive away from the palm. `object_angle_deg`: counter-clockwise turn of the outline from
    the placement in which its own x axis lies along that line. `branch`: while the tendons are wound in or let out
    again; they differ by the friction of the tendon routing.
    """

    onset_split: Annotated[float, Meta(gt=-1, lt=1)] = 0.0
    contact_friction: Annotated[float, Meta(gt=0, le=5)] = 0.3
    load_cap_N: Annotated[float, Meta(gt=0, le=2000)] | None = None
    supported: bool = True
    compensated: bool = False
    object_offset_m: Annotated[float, Meta(ge=-0.2, le=0.2)] = 0.0
    object_angle_deg: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    branch: Literal["winding", "unwinding"] = "winding"

    def __post_init__(self) -> None:
        if not -1 < self.onset_split < 1:
            raise MechanicsError("onset_split", f"{self.onset_split!r} is not between −1 and 1, both excluded.")
        if not 0 < self.contact_friction <= 5:
            raise MechanicsError("contact_friction", f"{self.contact_friction!r} is not > 0 and ≤ 5.")
        if self.load_cap_N is not None and not 0 < self.load_cap_N <= 2000:
            raise MechanicsError("load_cap_N", f"{self.load_cap_N!r} is not > 0 and ≤ 2000 N.")
        if not -0.2 <= self.object_offset_m <= 0.2:
            raise MechanicsError("object_offset_m", f"{self.object_offset_m!r} is not between −0.2 and 0.2 m.")
        if not -180 <= self.object_angle_deg <= 180:
            raise MechanicsError("object_angle_deg", f"{self.object_angle_deg!r} is not between −180 and 180°.")
        if self.branch not in ("winding", "unwinding"):
            raise MechanicsError("branch", f"{self.branch!r} is neither 'winding' nor 'unwinding'.")
