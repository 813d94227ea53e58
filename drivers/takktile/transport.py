"""The seam between a TakkTile bridge and what carries it: USB (`usb.py`), or memory or a socket to a simulated one."""

from __future__ import annotations

from typing import Protocol


class BridgeTransport(Protocol):
    """Vendor requests and bulk frames of one bridge. All raise BusError once the bridge has gone."""

    def request(self, request: int, value: int, index: int, length: int) -> bytes:
        """A vendor request to the bridge: at most `length` bytes of answer.

        Raises ProtocolError if the bridge refuses it and NoReplyError if it keeps silent.
        """
        ...

    def read_frame(self, deadline_ns: int) -> bytes | None:
        """The next bulk transfer, or None if none has come by `deadline_ns`."""
        ...

    def close(self) -> None:
        """Let go of the bridge."""
        ...
