"""The tendon motors' serial line for a calibration: opened, locked, and closed again whatever happens."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from controller.calibration_options import say
from drivers.clock import Clock
from drivers.dynamixel import discovery
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.port import WaitingPort

PATIENT_REPLY_MARGIN_S = 0.05
"""Nothing is in a hurry here, and a simulated motor on a shared machine may answer late."""


@contextlib.contextmanager
def opened_port(path: str, baud: int, clock: Clock) -> Iterator[WaitingPort]:
    """The port; what its adapter should be set to is told. Raises BusError."""
    line = SerialLine(path, baud)
    try:
        if line.advice:
            say(line.advice)
        margin_s = max(PATIENT_REPLY_MARGIN_S, discovery.reply_margin_s(line.latency_timer_ms))
        yield WaitingPort(line, clock, baud=baud, reply_margin_s=margin_s)
    finally:
        line.close()
