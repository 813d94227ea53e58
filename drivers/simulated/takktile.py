"""A simulated TakkTile bridge with its strips: what is asked of it and what it sends, byte for byte.

Each cell feels a share of its finger's force; its raw words come from the inverse of the compensation, rounded and
noisy, as a barometer's would. Frames are made at the timer's pace and wait in two buffers; when nobody drains them,
sampling stands still. A fault script makes things go wrong. `request` and `take_frame` are behind a transport of
`takktile_lines.py`. Source: TakkTile reference 2 to 4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.clock import nanoseconds, seconds
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.takktile_fault_actions import Repeat, TakktileAction
from drivers.simulated.takktile_faults import TakktileFaults, struck_frame
from drivers.takktile.bridge import CELL_READ_S
from drivers.takktile.compensation import (
    COUNTS_PER_KELVIN,
    KPA_PER_COUNT,
    LOWEST_KPA,
    Coefficients,
    raw_pressure,
    unpack_coefficients,
)
from drivers.takktile.frames import (
    ROWS,
    TIMER_TICK_S,
    Cell,
    Firmware,
    RawCell,
    Request,
    pack_frame,
    pack_scan,
    requested_cell,
)

TYPICAL_COEFFICIENTS = bytes.fromhex("42A8B5C0BB603A10")
COUNTS_PER_N = 100.0
"""Of a force right above a cell, an order of magnitude (TakkTile reference 5)."""
CELLS_PER_FINGER = 8
_BUFFERS = 2
_TEMPERATURE_AT_25 = 498.0


class RequestStalled(Exception):  # noqa: N818 - the bus' own word for a refusal
    """The bridge refuses a request."""


@dataclass(frozen=True)
class SimulatedCell:
    """A barometer under rubber: `counts_per_N` of a force right above it; it bears `share` of its finger's (0 right, 1
    left)."""

    cell: Cell
    finger: int
    counts_per_N: float = COUNTS_PER_N
    share: float = 1.0 / CELLS_PER_FINGER
    coefficients: bytes = TYPICAL_COEFFICIENTS
    counts_per_K: float = 0.0
    """Of trapped gas and rubber: what the chip's own compensation does not explain."""


def two_fingers() -> tuple[SimulatedCell, ...]:
    """Eight cells a finger, as two strips of five and three: rows 0 and 1 right, 2 and 3 left."""
    places = [(row, column) for row, columns in enumerate((5, 3)) for column in range(columns)]
    return tuple(SimulatedCell(Cell(2 * finger + row, column), finger) for finger in (0, 1) for row, column in places)


def uneven(cells: Sequence[SimulatedCell], seed: int) -> tuple[SimulatedCell, ...]:
    """The same cells as they come out of the mould: each its own sensitivity, ±20 %, and its own coefficients."""
    random = np.random.default_rng(seed)
    made = []
    for cell in cells:
        words = np.frombuffer(cell.coefficients, dtype=">i2") * (1.0 + 0.02 * random.uniform(-1.0, 1.0, 4))
        made.append(
            replace(
                cell,
                counts_per_N=cell.counts_per_N * (1.0 + 0.2 * random.uniform(-1.0, 1.0)),
                coefficients=np.round(words).astype(">i2").tobytes(),
            )
        )
    return tuple(made)


class SimulatedTakktile:
    """The bridge. `force_N()` gives the fingers' normal forces now, `temperature_C(time_s)` their temperature."""

    def __init__(
        self,
        force_N: Callable[[], Sequence[float]],
        cells: Sequence[SimulatedCell] | None = None,
        *,
        firmware: Firmware = Firmware.TAKKTILE_USB,
        temperature_C: Callable[[float], float] = lambda _: 25.0,
        ambient_kPa: float = 101.3,
        noise_counts: float = 0.5,
        seed: int = 0,
        faults: FaultScript[TakktileAction] | None = None,
        start_ns: int = 0,
    ) -> None:
        self.cells = tuple(sorted(two_fingers() if cells is None else cells, key=lambda cell: cell.cell))
        self.firmware = firmware
        self.requests: list[tuple[int, int, int]] = []
        """Everything that was asked: request, wValue, wIndex."""
        self.plug = 0
        """Rises with each unplugging: who opened the bridge before has it no more."""
        self._unplugged = False
        self.pressed_N: dict[Cell, float] = {}
        """Forces right above single cells, beside those of the fingers: weights on a pad."""
        self._force_N = force_N
        self._temperature_C = temperature_C
        self._ambient_kPa = ambient_kPa
        self._noise_counts = noise_counts
        self._random = np.random.default_rng(seed)
        self._coefficients = [unpack_coefficients(cell.coefficients, cell.cell) for cell in self.cells]
        self._alive = list(self.cells)  # as of the newest scan: those are in frames
        self._frames: deque[bytes] = deque()
        self._period_ns = 0
        self._due_ns = 0
        self._start_ns: int | None = None
        self._last: list[RawCell] = []
        places = [cell.cell for cell in self.cells]
        self._faults = TakktileFaults(faults or FaultScript(), places, self._unplug, start_ns)

    def add_fault(self, fault: Fault[TakktileAction], now_ns: int) -> None:
        """Let something go wrong, timed from now. Raises InputError."""
        self._faults.add(fault, now_ns)

    @property
    def unplugged(self) -> bool:
        """Whether it is off USB, as of the last call that told the time; set, it goes or comes back."""
        return self._unplugged

    @unplugged.setter
    def unplugged(self, gone: bool) -> None:
        self._unplug(gone)

    def request(self, request: int, value: int, index: int, length: int, now_ns: int) -> bytes:
        """A vendor request's answer. Raises RequestStalled for what the firmware does not know."""
        self._faults.advance(now_ns)
        self.requests.append((request, value, index))
        return self._answer(request, value, index, now_ns)[:length]

    def _answer(self, request: int, value: int, index: int, now_ns: int) -> bytes:
        if request == Request.VERSION:
            return b"simulated hardware" if index == 0 else f"simulated {self.firmware.value}".encode()
        if request == Request.SCAN:
            self._alive = [cell for cell in self.cells if not self._faults.is_dead(cell.cell)]
            self._last = []
            return pack_scan(self.firmware, [cell.cell for cell in self._alive])
        if request == Request.CALIBRATION:
            wanted = requested_cell(self.firmware, value, index)
            for cell in self._alive:
                if cell.cell == wanted:
                    return cell.coefficients
            return bytes(len(TYPICAL_COEFFICIENTS))
        if request == Request.ACKNOWLEDGED:
            rows = {cell.cell.row for cell in self.cells}
            return bytes([(index >> 4) in rows and index >> 4 < ROWS])
        if request == Request.SAMPLING:
            self._period_ns = nanoseconds(value * TIMER_TICK_S + CELL_READ_S * len(self._alive)) if index else 0
            self._due_ns = now_ns + self._period_ns
            if index:
                self._faults.notice("sampling", now_ns)
            return bytes([index != 0])
        raise RequestStalled(f"request 0x{request:02X}")

    def next_frame_ns(self) -> int | None:
        """When a frame can be fetched, possibly past; None while nothing is sampled."""
        if self._frames:
            return self._due_ns - self._period_ns
        return self._due_ns if self._period_ns else None

    def advance_to(self, now_ns: int) -> None:
        """Sample what is due by `now_ns`; what the physics does not give for the past is sampled now."""
        self._faults.advance(now_ns)
        while self._period_ns and self._due_ns <= now_ns and len(self._frames) < _BUFFERS:
            frame = self._sample(self._due_ns)
            if frame is not None:
                self._frames.append(frame)
            self._due_ns += self._period_ns
        if len(self._frames) == _BUFFERS:  # it stands still until it is drained
            self._due_ns = max(self._due_ns, now_ns)

    def take_frame(self, now_ns: int) -> bytes | None:
        """The oldest frame that is ready."""
        self.advance_to(now_ns)
        return self._frames.popleft() if self._frames else None

    def _unplug(self, gone: bool) -> None:
        if gone and not self._unplugged:
            self.plug += 1
            self._period_ns = 0
            self._frames.clear()
        self._unplugged = gone

    def _sample(self, now_ns: int) -> bytes | None:
        self._start_ns = now_ns if self._start_ns is None else self._start_ns
        struck = self._faults.strikes(now_ns)
        repeats = any(isinstance(action, Repeat) for action, _ in struck)
        if not (repeats and self._last):
            self._last = self._readings(self._temperature_C(seconds(now_ns - self._start_ns)))
        if self._faults.silent:
            return None
        return struck_frame(pack_frame(self.firmware, [cell.cell for cell in self._alive], self._last), struck)

    def _readings(self, temperature_C: float) -> list[RawCell]:
        force_N = self._force_N()
        noise = self._noise_counts * self._random.standard_normal((len(self.cells), 2))
        before = dict(zip((cell.cell for cell in self._alive), self._last, strict=False))
        readings = []
        for cell, coefficients, noises in zip(self.cells, self._coefficients, noise.tolist(), strict=True):
            if cell in self._alive:
                stuck = self._faults.is_stuck(cell.cell) and cell.cell in before
                reading = self._reading(cell, coefficients, temperature_C, force_N, noises)
                readings.append(before[cell.cell] if stuck else reading)
        return readings

    def _reading(
        self,
        cell: SimulatedCell,
        coefficients: Coefficients,
        temperature_C: float,
        force_N: Sequence[float],
        noises: Sequence[float],
    ) -> RawCell:
        """One cell's words. What the converter of pressure sees does not know the temperature word's noise or fault."""
        faults, place = self._faults, cell.cell
        if faults.is_dead(place):
            return RawCell(0, 0)
        temperature = _TEMPERATURE_AT_25 + COUNTS_PER_KELVIN * (temperature_C - 25.0)
        counts = (self._ambient_kPa - LOWEST_KPA) / KPA_PER_COUNT
        load_N = cell.share * force_N[cell.finger] + self.pressed_N.get(place, 0.0) + faults.press_N(place)
        counts += cell.counts_per_N * load_N + cell.counts_per_K * (temperature_C - 25.0)
        extra = faults.noise_counts(place)
        more = extra * self._random.standard_normal() if extra else 0.0
        pressure = raw_pressure(coefficients, counts, temperature) + noises[0] + more
        return RawCell(_count(pressure), _count(temperature + noises[1] + COUNTS_PER_KELVIN * faults.warmth_K(place)))


def _count(value: float) -> int:
    return min(max(round(value), 0), 1023)
