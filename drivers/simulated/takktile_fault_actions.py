"""What can go wrong with tactile pads and their bridge: the actions of fault scripts.

Frame actions strike single bulk transfers. The rest lasts: of the bridge, or of cells, named as [row, column]; without
a selection all cells. Source: TakkTile reference 2 to 5, 7.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

_Row = Annotated[int, Meta(ge=0, le=7)]
_Column = Annotated[int, Meta(ge=0, le=5)]
Places = Annotated[tuple[tuple[_Row, _Column], ...], Meta(min_length=1)]


class _Action(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """An action; its kind is its name in the script."""


class Lose(_Action, frozen=True, kw_only=True, tag="lose"):
    """The frame is lost."""


class Truncate(_Action, frozen=True, kw_only=True, tag="truncate"):
    """Only the first bytes of the frame come."""

    length: Annotated[int, Meta(ge=0, le=319)]


class MoreCells(_Action, frozen=True, kw_only=True, tag="more_cells"):
    """The frame has more cells than the scan named, as of a strip that was plugged in since."""

    cells: Annotated[int, Meta(ge=1, le=32)] = 1


class Garbage(_Action, frozen=True, kw_only=True, tag="garbage"):
    """The frame has its length, and any bytes."""


class Repeat(_Action, frozen=True, kw_only=True, tag="repeat"):
    """The frame gives the conversion before, as of a bridge that does not wait for its cells."""


class Unplug(_Action, frozen=True, kw_only=True, tag="unplug"):
    """The bridge is off USB; when it is back it samples nothing, and who had it open has it no more."""


class Silence(_Action, frozen=True, kw_only=True, tag="silence"):
    """The bridge answers requests, but gives no frame."""


class CellAction(_Action, frozen=True, kw_only=True):
    """What befalls cells; without a selection, all."""

    cells: Places | None = None


class Dead(CellAction, frozen=True, kw_only=True, tag="dead"):
    """They answer nothing: in no scan, and zeros in frames that were under way."""


class Stuck(CellAction, frozen=True, kw_only=True, tag="stuck"):
    """They give the words that they gave last."""


class Noise(CellAction, frozen=True, kw_only=True, tag="noise"):
    """Their pressure words have more noise."""

    counts: Annotated[float, Meta(gt=0, le=500)]


class Warmth(CellAction, frozen=True, kw_only=True, tag="warmth"):
    """They tell a temperature that is off, all at once."""

    kelvin: Annotated[float, Meta(ge=-150, le=150)]


class Press(CellAction, frozen=True, kw_only=True, tag="press"):
    """Something presses each of them with this force."""

    newtons: Annotated[float, Meta(ge=0, le=200)]


FrameAction = Lose | Truncate | MoreCells | Garbage | Repeat
TakktileAction = FrameAction | Unplug | Silence | Dead | Stuck | Noise | Warmth | Press
EVENTS = ("sampling",)
"""What faults can wait for: the first time that the bridge begins to sample."""
