"""A tactile part on virtual time, in front of a simulated bridge, with the other ends of its links."""

from __future__ import annotations

from collections.abc import Callable

from controller.pad_messages import PadOrder
from controller.service.links import LatestReader, LatestSender, VirtualLink
from controller.service.tactile import TactilePart
from drivers.clock import VirtualClock
from drivers.simulated.takktile import SimulatedTakktile, two_fingers
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.calibration import PadCalibration, nominal
from drivers.takktile.touch import TouchSettings
from drivers.takktile.transport import BridgeTransport

_WAITING = 1000


def nominal_pads() -> tuple[PadCalibration, PadCalibration]:
    """Both fingers of `two_fingers`, never calibrated."""
    right, left = (nominal([cell.cell for cell in two_fingers() if cell.finger == finger]) for finger in (0, 1))
    return right, left


class PartRig:
    """`device` may be exchanged for another while it is unplugged. `step` the `part`; what it says is in `said`."""

    def __init__(
        self, device: SimulatedTakktile, pads: tuple[PadCalibration, PadCalibration], period_s: float = 0.008
    ) -> None:
        self.device = device
        self.clock = VirtualClock()
        self.said: list[str] = []
        self.new_transport: Callable[[], BridgeTransport] = lambda: MemoryTransport(self.device, self.clock)
        orders, cycle, front = (VirtualLink(self.clock, self.clock, capacity=_WAITING) for _ in range(3))
        self.orders, self.states, self.reports = LatestSender(orders), LatestReader(cycle), LatestReader(front)
        self.part = TactilePart(
            self.clock,
            lambda: self.new_transport(),
            pads,
            LatestReader(orders),
            LatestSender(cycle),
            LatestSender(front),
            period_s=period_s,
            touch=TouchSettings(),
            say=self.said.append,
        )
        self.part.start()

    def order(self, free: bool, tare: int) -> None:
        """What the cycle says: whether the fingers are free, and the number of the zero to take."""
        self.orders.send(PadOrder(free, tare).pack(), self.clock.now_ns())
