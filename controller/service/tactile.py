"""The tactile part: frames of the bridge in, force and contact of both fingers out. It alone talks to the pads.

It takes a zero when the cycle says that the fingers are free and a grasp is about to begin, and follows drift as long
as they stay free. A zero that is not accepted is told, and the old one holds. A bridge that is unplugged or falls
silent is opened again from time to time; until then contact is found by the motors' load. Pads that come back keep
their zeros.
"""

from __future__ import annotations

from collections.abc import Callable

from controller.pad_messages import NOTHING_KNOWN, PadOrder, PadReport, PadState
from controller.service.links import LatestReader, LatestSender
from controller.service.tactile_cells import CellFaults, cell_states
from drivers.clock import Clock, nanoseconds
from drivers.errors import DeviceError, InputError, NoReplyError, StillgraspError
from drivers.takktile.bridge import Bridge, BridgeFrame
from drivers.takktile.calibration import PadCalibration, check_cells
from drivers.takktile.frames import DEVICE, Cell
from drivers.takktile.pads import Pads, PadSample
from drivers.takktile.touch import PadTouch, TouchSettings
from drivers.takktile.transport import BridgeTransport

LONGEST_SILENCE_S = 0.5
RETRY_S = 0.5


class TactilePart:
    """Reads one frame a step and tells cycle and front; `say` is for the operator."""

    def __init__(
        self,
        clock: Clock,
        open_transport: Callable[[], BridgeTransport],
        pads: tuple[PadCalibration, PadCalibration],
        orders: LatestReader,
        cycle: LatestSender,
        front: LatestSender,
        *,
        period_s: float,
        touch: TouchSettings,
        say: Callable[[str], None] = lambda _: None,
        longest_silence_s: float = LONGEST_SILENCE_S,
    ) -> None:
        self._clock, self._open_transport, self._say = clock, open_transport, say
        self._orders, self._cycle, self._front = orders, cycle, front
        self._calibrations = pads
        self._period_s = period_s
        self._silence_ns = nanoseconds(longest_silence_s)
        self._touch_settings = touch
        self._touches = (PadTouch(touch), PadTouch(touch))
        self._faults = CellFaults(say)
        self._order = PadOrder(False, 0)
        self._bridge: Bridge | None = None
        self._pads: Pads | None = None
        self._chips: dict[Cell, bytes] = {}
        self._said_lost = ""
        self.retry_ns = 0
        """When a bridge that is away is looked for again."""

    @property
    def present(self) -> bool:
        """Whether the bridge is there."""
        return self._bridge is not None

    def start(self) -> None:
        """Open the bridge and begin to sample. Raises DeviceError, and InputError if the cells are not those mapped."""
        self._open()
        if not all(pad.calibrated for pad in self._calibrations):
            self._say("the tactile pads are not calibrated; their newtons are rough. Run: stillgrasp calibrate tactile")

    def step(self) -> None:
        """The next frame, as soon as it is there; without a bridge, wait and look for it."""
        if self._bridge is None or self._pads is None:
            self._clock.sleep_until_ns(self.retry_ns)
            self._look_for_it()
            return
        try:
            frame = self._read(self._bridge)
        except DeviceError as error:
            self._lose(error)
            return
        self._take(self._bridge, self._pads, frame)

    def stop(self) -> None:
        """The end: the bridge stops sampling."""
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None

    def _open(self) -> None:
        """A bridge that samples, and its pads, with the zeros that they had before."""
        transport = self._open_transport()
        try:
            bridge = Bridge(transport, self._clock)
        except StillgraspError:
            transport.close()  # who looks for it again and again must not keep what was half opened
            raise
        try:
            dead = check_cells(self._calibrations, bridge.cells, bridge.coefficient_bytes)
            pads = Pads(self._calibrations, bridge.cells, bridge.coefficients)
            if self._pads is not None:
                known = self._pads.cells
                same = [c for c in pads.cells if c in known and bridge.coefficient_bytes[c] == self._chips[c]]
                pads.adopt_zeros(self._pads, same)
            bridge.start(self._period_s)
        except StillgraspError:
            bridge.close()
            raise
        if dead:
            self._say(f"tactile cells {', '.join(f'{cell.row}:{cell.column}' for cell in dead)} are dead: not counted")
        self._bridge, self._pads, self._chips = bridge, pads, bridge.coefficient_bytes
        if self._order.free and self._order.tare:
            pads.tare()

    def _look_for_it(self) -> None:
        try:
            self._open()
        except StillgraspError as error:
            self._lose(error)
            return
        self._said_lost = ""
        self._say("the tactile bridge is back")

    def _lose(self, error: StillgraspError) -> None:
        """Say so, once for each reason, and try again later."""
        self.stop()
        now_ns = self._clock.now_ns()
        self.retry_ns = now_ns + nanoseconds(RETRY_S)
        for touch in self._touches:
            touch.forget_rise()
        if not self._said_lost:
            self._say(f"the tactile pads are lost; the motors' load finds contact until they are back. {error}")
        elif isinstance(error, InputError) and self._said_lost != str(error):
            self._say(f"the tactile pads are back, but not accepted: {error}")
        self._said_lost = str(error)
        self._cycle.send(NOTHING_KNOWN.pack(), now_ns)
        self._front.send(PadReport(False, NOTHING_KNOWN).pack(), now_ns)

    def _read(self, bridge: Bridge) -> BridgeFrame:
        bad = bridge.bad_frames
        frame = bridge.read(self._clock.now_ns() + self._silence_ns)
        if frame is None:
            broken = bridge.bad_frames - bad
            kind = f"but {broken} of another length than {len(bridge.cells)} cells have" if broken else "at all"
            raise NoReplyError(
                DEVICE, f"gave no whole frame within {self._silence_ns * 1e-9:g} s, {kind}.", help="Check its plug."
            )
        return frame

    def _take(self, bridge: Bridge, pads: Pads, frame: BridgeFrame) -> None:
        self._listen(pads)
        try:
            sample = pads.take(frame, free=self._order.free)
        except InputError as error:
            self._say(str(error))
            return
        state = self._state(sample)
        cells = cell_states(self._calibrations, pads.cells, pads.readings(), bridge.coefficient_bytes)
        self._faults.take(cells, sample.sample_ns)
        self._cycle.send(state.pack(), sample.sample_ns)
        self._front.send(PadReport(True, state, cells).pack(), sample.sample_ns)

    def _listen(self, pads: Pads) -> None:
        newest = self._orders.newest()
        if newest is None:
            return
        order = PadOrder.unpack(newest[0])
        if order.free and order.tare != self._order.tare:
            pads.tare()
            self._touches = (PadTouch(self._touch_settings), PadTouch(self._touch_settings))  # nothing is touched now
        elif not order.free:
            pads.stop_taring()
        self._order = order

    def _state(self, sample: PadSample) -> PadState:
        for finger, touch in enumerate(self._touches):
            # A saturated cell drops out of the sum: that is more force, not less.
            pressed = sample.saturated[finger] and touch.touching and not self._order.free
            if sample.valid_cells[finger] and not pressed:
                touch.take(sample.sample_ns, sample.force_N[finger], sample.deviation_N[finger])
        right, left = self._touches
        return PadState(
            sample.force_N,
            sample.deviation_N,
            (right.onset_ns, left.onset_ns),
            (right.touching, left.touching),
            sample.valid_cells,
        )
