"""A bridge in memory on virtual time, with a force that a test sets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from drivers.clock import VirtualClock, nanoseconds
from drivers.simulated.takktile import SimulatedTakktile
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge, BridgeFrame
from drivers.takktile.calibration import PadCalibration, nominal
from drivers.takktile.pads import Pads, PadSample, PadSettings


class Strip:
    """Two fingers' pads: simulated cells, bridge and what is made of them."""

    def __init__(
        self,
        pads: tuple[PadCalibration, PadCalibration] | None = None,
        period_s: float = 0.008,
        **device: Any,
    ) -> None:
        self.force_N = [0.0, 0.0]
        self.clock = VirtualClock()
        self.device = SimulatedTakktile(lambda: self.force_N, **device)
        self.bridge = Bridge(MemoryTransport(self.device, self.clock), self.clock)
        fingers = ([c.cell for c in self.device.cells if c.finger == i] for i in (0, 1))
        right, left = (nominal(cells) for cells in fingers)
        self.pads = Pads(pads or (right, left), self.bridge.cells, self.bridge.coefficients, PadSettings())
        self.bridge.start(period_s)

    def frame(self) -> BridgeFrame:
        """The next frame."""
        frame = self.bridge.read(self.clock.now_ns() + nanoseconds(0.5))
        assert frame is not None
        return frame

    def run(self, duration_s: float, *, free: bool = False) -> list[PadSample]:
        """Frames for a time; the samples that came of them."""
        end_ns = self.clock.now_ns() + nanoseconds(duration_s)
        samples = []
        while self.clock.now_ns() < end_ns:
            sample = self.pads.take(self.frame(), free=free)
            if sample is not None:
                samples.append(sample)
        return samples

    def tared(self) -> Strip:
        """With a zero."""
        self.pads.tare()
        while self.pads.taring:
            self.pads.take(self.frame(), free=True)
        assert self.pads.tared
        return self


@pytest.fixture
def make_strip() -> Callable[..., Strip]:
    """Builds strips."""
    return Strip
