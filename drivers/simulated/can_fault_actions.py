"""What can go wrong on a CAN bus between the host's adapter and the wire: the actions of its fault scripts.

Frame actions select frames by sender, node, identifier and mask. What happens to a host's frame happens before the wire
carries it; what happens to a device's frame happens behind the wire, on its way to the hosts, so that other devices
still hear it, or with `on_wire` before the wire. The rest concerns the host's adapter: floods, error frames, bus-off, a
full transmit queue, the unplugged adapter. Source: WAM reference 7; error classes of linux/can/error.h.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from drivers.simulated.can_wire import Frame

_Identifier = Annotated[int, Meta(ge=0, le=0x7FF)]
_Node = Annotated[int, Meta(ge=0, le=31)]
_Seconds = Annotated[float, Meta(ge=0, le=10)]
_Bytes = Annotated[str, Meta(pattern="^([0-9A-Fa-f]{2}){0,8}$")]


class _Action(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"):
    """An action; its kind is its name in the script."""


class FrameAction(_Action, frozen=True, kw_only=True):
    """What befalls single frames; without a selection, all frames of the devices."""

    sender: Literal["host", "device"] = "device"
    node: _Node | None = None
    """Node that sends; of the host's frames, node to which they are directed."""
    id: _Identifier = 0
    mask: _Identifier = 0
    on_wire: bool = False
    """Before the wire, so that no other device hears the frame either."""

    def concerns(self, frame: Frame, from_host: bool) -> bool:
        """Whether the frame is among those selected."""
        identifier = frame.identifier
        if from_host != (self.sender == "host") or (identifier ^ self.id) & self.mask:
            return False
        if self.node is None:
            return True
        return self.node == (identifier & 0x1F if from_host else identifier >> 5 & 0x1F)


class Drop(FrameAction, frozen=True, kw_only=True, tag="drop"):
    """The frame is lost."""


class Delay(FrameAction, frozen=True, kw_only=True, tag="delay"):
    """The frame comes later."""

    by_s: Annotated[float, Meta(gt=0, le=10)]


class Duplicate(FrameAction, frozen=True, kw_only=True, tag="duplicate"):
    """The frame comes again."""

    times: Annotated[int, Meta(ge=1, le=100)] = 1
    after_s: _Seconds = 0.0002


class Corrupt(FrameAction, frozen=True, kw_only=True, tag="corrupt"):
    """The frame has other content: `data`, or its own with some bits turned over."""

    bits: Annotated[int, Meta(ge=1, le=64)] = 1
    data: _Bytes | None = None


class Truncate(FrameAction, frozen=True, kw_only=True, tag="truncate"):
    """The frame loses its last bytes."""

    length: Annotated[int, Meta(ge=0, le=7)]


class Reorder(FrameAction, frozen=True, kw_only=True, tag="reorder"):
    """The frame waits, anything up to `within_s`, so that others overtake it."""

    within_s: Annotated[float, Meta(gt=0, le=10)] = 0.001


class Flood(_Action, frozen=True, kw_only=True, tag="flood"):
    """Somebody fills the wire; without `period_s` at full rate."""

    id: _Identifier
    data: _Bytes = "0000000000000000"
    period_s: _Seconds = 0.0


class ErrorFrame(_Action, frozen=True, kw_only=True, tag="error_frame"):
    """The adapter reports an error: a class of linux/can/error.h (0x08 protocol, 0x20 no acknowledgement, 0x80 bus)."""

    error: Annotated[int, Meta(ge=1, le=0x1FFFFFFF)] = 0x80
    data: _Bytes = "0000000000000000"


class BusOff(_Action, frozen=True, kw_only=True, tag="bus_off"):
    """The adapter has left the bus: nothing is heard, what is sent is lost, or refused if `refuse`."""

    refuse: bool = False


class QueueFull(_Action, frozen=True, kw_only=True, tag="enobufs"):
    """The transmit queue is full: sending fails with ENOBUFS."""


class Unplug(_Action, frozen=True, kw_only=True, tag="unplug"):
    """The adapter is gone: sending and receiving fail."""


CanAction = Drop | Delay | Duplicate | Corrupt | Truncate | Reorder | Flood | ErrorFrame | BusOff | QueueFull | Unplug
