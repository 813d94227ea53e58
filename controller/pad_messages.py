"""What cycle, front and tactile process say to each other where pads are fitted, beside `controller/messages.py`.

tactile → cycle   PadState    latest value        tactile → front   PadReport   latest value, all of them recorded
cycle → tactile   PadOrder    latest value
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

from drivers.errors import ProtocolError
from drivers.takktile.compensation import COEFFICIENT_BYTES

_STATE = struct.Struct("<4d2qIIII")
_ORDER = struct.Struct("<II")
_REPORT = struct.Struct("<BB")
_CELL = struct.Struct(f"<BBBBHH5f{COEFFICIENT_BYTES}s")


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


NOTHING_KNOWN = PadState((0.0, 0.0), (0.0, 0.0), (0, 0), (False, False), (0, 0))
"""Of pads whose bridge is away."""


class CellState(NamedTuple):
    """One cell of the map: all that its part in the force was made of, so that it can be made anew."""

    finger: int
    row: int
    column: int
    quality: int
    """A `drivers.takktile.quality.CellQuality`."""
    pressure: int
    temperature: int
    """Raw counts, both."""
    counts: float
    """Pcomp counts above zero; without a zero 0."""
    zero_counts: float
    zero_temperature: float
    smooth_temperature: float
    """Low-passed temperature counts, those that the signal is corrected with."""
    force_N: float
    coefficients: bytes


@dataclass(frozen=True)
class PadReport:
    """Both pads with all their cells, right before left; `present`: whether the bridge is there."""

    present: bool
    state: PadState
    cells: tuple[CellState, ...] = ()

    def pack(self) -> bytes:
        cells = b"".join(_CELL.pack(*cell) for cell in self.cells)
        return _REPORT.pack(self.present, len(self.cells)) + self.state.pack() + cells

    @classmethod
    def unpack(cls, payload: bytes) -> PadReport:
        start = _REPORT.size + _STATE.size
        if len(payload) < start or len(payload) != start + _CELL.size * payload[1]:
            raise ProtocolError("link", f"a PadReport of {len(payload)} bytes; its cells do not fill it.")
        cells = tuple(CellState(*values) for values in _CELL.iter_unpack(payload[start:]))
        return cls(bool(payload[0]), PadState.unpack(payload[_REPORT.size : start]), cells)


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
