"""Start-up's talk with single pucks: one question or order at a time, repeated when it is lost, with time-outs.

Not for the cycle: it waits, and drops what others say meanwhile. Adapters lose a frame now and then without a word, and
pucks answer no orders, so a question is asked three times and an order is followed by a question. Source: WAM reference
2.1 to 2.3 and 7.
"""

from __future__ import annotations

from drivers.clock import Clock, nanoseconds
from drivers.errors import NoReplyError
from drivers.wam.bus import CanBus, ask_property
from drivers.wam.frames import set_property
from drivers.wam.properties import property_id

REPLY_TIMEOUT_S = 0.05
ATTEMPTS = 3
STATUS_ID = property_id("STAT", 0, "monitor")
"""The same number in the boot monitor and in every firmware."""


class Dialogue:
    """Questions and orders to pucks by node and property number."""

    def __init__(self, bus: CanBus, clock: Clock) -> None:
        self.bus = bus
        self.clock = clock

    def ask(self, node: int, number: int, name: str, *, attempts: int = ATTEMPTS) -> int:
        """Value of property `number`, called `name`; NoReplyError if all attempts stay without answer for 50 ms."""
        value = self.ask_or_none(node, number, attempts=attempts)
        if value is None:
            asked = f", asked {attempts} times" if attempts > 1 else ""
            raise NoReplyError(
                f"puck {node}",
                f"no reply to {name} within {REPLY_TIMEOUT_S * 1e3:.0f} ms{asked}.",
                help="Check the arm's power and cables.",
            )
        return value

    def ask_or_none(self, node: int, number: int, *, attempts: int = ATTEMPTS) -> int | None:
        """Value of property `number`, None if all attempts stay without answer."""
        for _ in range(attempts):
            deadline_ns = self.clock.now_ns() + nanoseconds(REPLY_TIMEOUT_S)
            value = ask_property(self.bus, node, number, deadline_ns)
            if value is not None:
                return value
        return None

    def tell(self, destination: int, number: int, value: int, *, quiet_s: float = 0.0) -> None:
        """Write a property of a node, or of 0x400 | group, and keep quiet for `quiet_s`. Nobody acknowledges it."""
        self.bus.send(set_property(destination, number, value))
        self.pause(quiet_s)

    def pause(self, duration_s: float) -> None:
        """Let time pass without a word from here."""
        if duration_s > 0.0:
            self.clock.sleep_until_ns(self.clock.now_ns() + nanoseconds(duration_s))
