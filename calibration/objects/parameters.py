"""Object files: TOML to a frozen struct. SI units; shape in the object's axes; support as a friction coefficient.

Source: design 7; the paper's objects are the files beside this module.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from calibration.hand.parameters import packaged_or_path
from calibration.objects.shapes import Shape
from calibration.toml_files import read_toml

DIRECTORY = Path(__file__).parent


class Support(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The table that the object stands on."""

    friction: Annotated[float, Meta(ge=0, le=5)]


class GraspObject(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An object to grasp; `support` None means that nothing carries it but the hand."""

    name: Annotated[str, Meta(min_length=1, max_length=80)]
    shape: Shape
    mass_kg: Annotated[float, Meta(gt=0, le=20)]
    height_m: Annotated[float, Meta(gt=0, le=2)] | None = None
    support: Support | None = None


def load_object(name_or_path: str | Path) -> GraspObject:
    """Object from a packaged file (by name) or from a TOML path. Errors: ConfigurationError."""
    return read_toml(packaged_or_path(name_or_path, DIRECTORY, "object"), GraspObject)
