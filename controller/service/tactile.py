"""The tactile part: frames of the bridge in, force and contact of both fingers out. It alone talks to the pads.

It takes a zero when the cycle says that the fingers are free and a grasp is about to begin, and follows drift as long
as they stay free. A zero that is not accepted is told, and the old one holds. A bridge that falls silent ends the part:
contact is then found by the motors' load.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from controller.pad_messages import PadOrder, PadState
from controller.service.links import LatestReader, LatestSender
from drivers.clock import Clock, nanoseconds
from drivers.errors import InputError, NoReplyError
from drivers.takktile.bridge import Bridge
from drivers.takktile.calibration import PadCalibration, check_cells
from drivers.takktile.frames import DEVICE
from drivers.takktile.pads import Pads, PadSample
from drivers.takktile.touch import PadTouch, TouchSettings

LONGEST_SILENCE_S = 0.5


class TactilePart:
    """Reads one frame a step and tells `states`; `say` is for the operator."""

    def __init__(
        self,
        clock: Clock,
        bridge: Bridge,
        pads: tuple[PadCalibration, PadCalibration],
        orders: LatestReader,
        states: Sequence[LatestSender],
        *,
        period_s: float,
        touch: TouchSettings,
        say: Callable[[str], None] = lambda _: None,
        longest_silence_s: float = LONGEST_SILENCE_S,
    ) -> None:
        self._clock, self._bridge, self._say = clock, bridge, say
        self._orders, self._states = orders, states
        self._period_s = period_s
        self._silence_ns = nanoseconds(longest_silence_s)
        dead = check_cells(pads, bridge.cells, bridge.coefficient_bytes)
        if dead:
            say(f"tactile cells {', '.join(f'{cell.row}:{cell.column}' for cell in dead)} are dead and do not count")
        if not all(pad.calibrated for pad in pads):
            say("the tactile pads are not calibrated; their newtons are rough. Run: stillgrasp calibrate tactile")
        self._cells = tuple(sum(cell in bridge.cells for cell in pad.cells) for pad in pads)
        self._pads = Pads(pads, bridge.cells, bridge.coefficients)
        self._touches = (PadTouch(touch), PadTouch(touch))
        self._order = PadOrder(False, 0)

    def start(self) -> None:
        """Begin to sample. Raises DeviceError."""
        self._bridge.start(self._period_s)

    def step(self) -> None:
        """The next frame, as soon as it is there. Raises BusError, and NoReplyError if none comes."""
        frame = self._bridge.read(self._clock.now_ns() + self._silence_ns)
        if frame is None:
            raise NoReplyError(DEVICE, f"gave no frame within {self._silence_ns * 1e-9:g} s.", help="Check its plug.")
        self._listen()
        sample: PadSample | None = None
        try:
            sample = self._pads.take(frame, free=self._order.free)
        except InputError as error:
            self._say(str(error))
        if sample is not None:
            self._tell(sample)

    def stop(self) -> None:
        """The end: the bridge stops sampling."""
        self._bridge.close()

    def _listen(self) -> None:
        newest = self._orders.newest()
        if newest is None:
            return
        order = PadOrder.unpack(newest[0])
        if order.free and order.tare != self._order.tare:
            self._pads.tare()
        elif not order.free:
            self._pads.stop_taring()
        self._order = order

    def _tell(self, sample: PadSample) -> None:
        for finger, touch in enumerate(self._touches):
            # A saturated cell drops out of the sum: that is more force, not less.
            saturated = sample.valid_cells[finger] < self._cells[finger]
            if not (saturated and touch.touching):
                touch.take(sample.sample_ns, sample.force_N[finger], sample.deviation_N[finger])
        right, left = self._touches
        state = PadState(
            sample.force_N,
            sample.deviation_N,
            (right.onset_ns, left.onset_ns),
            (right.touching, left.touching),
            sample.valid_cells,
        )
        for sender in self._states:
            sender.send(state.pack(), sample.sample_ns)
