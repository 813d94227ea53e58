"""What cycle, front and tactile process say to each other where pads are fitted, beside `controller/messages.py`.

tactile → cycle, front   PadState   latest value        cycle → tactile   PadOrder   latest value
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.errors import ProtocolError

_STATE = struct.Struct("<4d2qIIII")
_ORDER = struct.Struct("<II")


@dataclass(frozen=True)
class PadState:
    """Both fingers' pads at one time. Order right, left; N; `onset_ns` monotonic time of first contact."""

    force_N: tuple[float, float]
    deviation_N: tuple[float, float]
    onset_ns: tuple[int, int]
    touching: tuple[bool, bool]
    valid_cells: tuple[int, int]
    """Cells that count in each finger's sum; with none of them, or before the first zero, nothing is known."""

    def pack(self) -> bytes:
        return _STATE.pack(*self.force_N, *self.deviation_N, *self.onset_ns, *self.touching, *self.valid_cells)

    @classmethod
    def unpack(cls, payload: bytes) -> PadState:
        if len(payload) != _STATE.size:
            raise ProtocolError("link", f"a PadState has {len(payload)} bytes; expected {_STATE.size}.")
        f0, f1, d0, d1, o0, o1, t0, t1, v0, v1 = _STATE.unpack(payload)
        return cls((f0, f1), (d0, d1), (o0, o1), (bool(t0), bool(t1)), (v0, v1))


@dataclass(frozen=True)
class PadOrder:
    """What the cycle knows: whether the fingers are free, and a number that rises with each zero to take."""

    free: bool
    tare: int

    def pack(self) -> bytes:
        return _ORDER.pack(self.free, self.tare)

    @classmethod
    def unpack(cls, payload: bytes) -> PadOrder:
        if len(payload) != _ORDER.size:
            raise ProtocolError("link", f"a PadOrder has {len(payload)} bytes; expected {_ORDER.size}.")
        free, tare = _ORDER.unpack(payload)
        return cls(bool(free), tare)
