"""What a table was built from, made again from its header: hand, object and grasp. Source: design 4."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Hand
from calibration.motion_table import MotionTable
from calibration.objects import GraspObject
from calibration.table_file import REBUILD
from drivers.errors import MechanicsError, TableError

T = TypeVar("T", bound=msgspec.Struct)


def table_inputs(table: MotionTable) -> tuple[Hand, GraspObject, GraspSpec]:
    """Hand, object and grasp as they were given to the build. Errors: TableError when this version cannot take them."""
    header = table.header
    return (
        _restored(header.hand, Hand, "hand", table.source),
        _restored(header.object, GraspObject, "object", table.source),
        _restored(header.grasp, GraspSpec, "grasp", table.source),
    )


def _restored(content: dict[str, Any], type_: type[T], what: str, source: str) -> T:
    try:
        return msgspec.convert(content, type_, strict=False)  # the header writes infinity as the text "inf"
    except (msgspec.ValidationError, MechanicsError) as error:
        raise TableError(source, f"is for a {what} that this version cannot take: {error}.", help=REBUILD) from error
