"""The port under dynamixel-sdk: its packet handler's view of a line, but it waits in the clock instead of spinning.

The SDK's own PortHandler polls in a busy loop, by wall time, and gives a silent motor 34 ms (dynamixel reference 5.4).
`WaitingPort` has the methods that the SDK's packet handlers call, keeps their names, and closes these traps:

* `readPort` blocks in `clock.wait_readable` until bytes or the packet's deadline; no processor time, no wall time;
* the deadline is the wire time of what was sent and is expected, plus a small margin;
* bytes that never stop cannot keep the SDK's receive loop alive: after the deadline one last read is granted;
* after a failed transaction (`distrust`) the line is left silent for one margin and flushed before the next
  request, so that a late reply is not taken for the next one's (reference 6.1).
"""

from __future__ import annotations

from drivers.clock import NANOSECONDS, Clock, nanoseconds
from drivers.dynamixel.byte_line import ByteLine
from drivers.errors import BusError, InputError

BITS_PER_BYTE = 10
"""8N1: start bit, eight bits, stop bit."""

MAXIMUM_READ_BYTES = 256
"""More than the answers of one request: all that has come is taken with one system call."""


class WaitingPort:
    """`line` at `baud` bit/s; a reply may come `reply_margin_s` later than the wire allows (USB, scheduler)."""

    def __init__(self, line: ByteLine, clock: Clock, *, baud: int = 1_000_000, reply_margin_s: float = 0.004) -> None:
        if baud <= 0 or not 0.0 < reply_margin_s < 1.0:
            raise InputError(
                f"baud = {baud}, reply_margin_s = {reply_margin_s}; expected a baud rate above 0 and a margin in 0…1 s."
            )
        self.is_using = False  # the SDK's own flag: a request is under way
        self._line = line
        self._clock = clock
        self._baud = baud
        self._byte_ns = BITS_PER_BYTE * NANOSECONDS / baud
        self._margin_ns = nanoseconds(reply_margin_s)
        self._sent_ns = 0
        self._deadline_ns = 0
        self._silent_until_ns = 0
        self._last_read_granted = False
        self._received = b""  # taken from the line, not yet asked for

    def distrust(self) -> None:
        """The last transaction failed: keep silent for one margin and flush before the next."""
        self._silent_until_ns = self._clock.now_ns() + self._margin_ns
        self.is_using = False

    def surplus(self) -> bytes:
        """After an answer: what else comes within one margin. Two motors with one id may answer one after the other."""
        self._clock.sleep_until_ns(self._clock.now_ns() + self._margin_ns)
        data, self._received = self._received, b""
        while self._clock.wait_readable(self._line, self._clock.now_ns()):
            more = self._line.read(MAXIMUM_READ_BYTES)
            data += more
            if not more or len(data) > MAXIMUM_READ_BYTES:
                break
        return data

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    # The names below are the SDK's.

    def getBaudRate(self) -> int:
        """Bits per second."""
        return self._baud

    def clearPort(self) -> None:
        """Discard what has arrived; after a failed transaction, first let what is late arrive."""
        self._clock.sleep_until_ns(self._silent_until_ns)
        self._line.discard_input()
        self._received = b""

    def writePort(self, packet: list[int]) -> int:
        """Send the packet; its number of bytes."""
        data = bytes(packet)
        self._line.write(data)
        # bytes that were sent just before are still on the wire: a reply cannot come before they have left
        self._sent_ns = max(self._clock.now_ns(), self._sent_ns) + round(len(data) * self._byte_ns)
        return len(data)

    def setPacketTimeout(self, packet_length: int) -> None:
        """Give the reply the wire time of `packet_length` bytes and the margin."""
        self._set_deadline(self._sent_ns + round(packet_length * self._byte_ns) + self._margin_ns)

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Give the reply `msec` milliseconds from now."""
        self._set_deadline(self._clock.now_ns() + nanoseconds(msec * 1e-3))

    def isPacketTimeout(self) -> bool:
        """Whether the reply's time is over."""
        return self._clock.now_ns() >= self._deadline_ns

    def readPort(self, length: int) -> bytes:
        """At least one and at most `length` bytes, or none at the deadline. BusError if the line is gone."""
        if length <= 0:  # the SDK asks for this after a packet whose length field is absurdly small
            return b""
        if not self._received:
            self._received = self._wait_for_bytes()
        data, self._received = self._received[:length], self._received[length:]
        return data

    def _wait_for_bytes(self) -> bytes:
        if self._clock.now_ns() >= self._deadline_ns:
            if self._last_read_granted:
                return b""
            # a process that woke late finds its reply already here; that one read is fair
            self._last_read_granted = True
        if not self._clock.wait_readable(self._line, self._deadline_ns):
            return b""
        data = self._line.read(MAXIMUM_READ_BYTES)
        if not data:  # readable, yet nothing there: the end of file of an unplugged adapter
            self._line.close()
            raise BusError("tendon motor bus", "the serial line has ended.", help="Check the adapter's plug and power.")
        return data

    def _set_deadline(self, deadline_ns: int) -> None:
        self._deadline_ns = deadline_ns
        self._last_read_granted = False
