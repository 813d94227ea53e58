"""The seam between motors and the two protocols: what can be asked on a bus, and what comes of it.

`Protocol1Bus` and `Protocol2Bus` keep the same promises: a request is answered or failed before the next one; a value
comes only out of a whole, intact, expected status packet; all else is a DeviceError, and nobody waits longer than
the reply's wire time and the port's margin.

Errors: NoReplyError (silence), ProtocolError (anything but the expected reply, or a refusal), BusError (line gone).
Source: dynamixel reference 4, 6.1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

from drivers.dynamixel.port import WaitingPort
from drivers.errors import BusError, DeviceError, NoReplyError, ProtocolError

BROADCAST = 0xFE
PING, READ, WRITE, REBOOT, SYNC_READ, SYNC_WRITE, FAST_SYNC_READ = 0x01, 0x02, 0x03, 0x08, 0x82, 0x83, 0x8A

ATTEMPTS = 3
T = TypeVar("T")

COMM_SUCCESS, COMM_RX_TIMEOUT = 0, -3001
"""Result codes of dynamixel-sdk."""


class Status(NamedTuple):
    """A good reply: from whom, what its error byte tells of the motor, and the parameters."""

    motor_id: int
    alert: bool
    """The motor has something to complain about: look at its hardware error."""
    parameters: bytes
    alarms: int = 0
    """Protocol 1.0: which alarms (0x01 voltage, 0x04 overheating, 0x20 overload); protocol 2.0 keeps them in register
    70 and leaves this 0."""


@dataclass(frozen=True, slots=True)
class PingAnswer:
    """Who answered."""

    model_number: int
    firmware: int
    alert: bool


class PackedRequests:
    """Requests as the SDK packed them: those that are sent again and again are not packed again."""

    MOST = 64

    def __init__(self) -> None:
        self._packed: dict[tuple[int, int, bytes], list[int]] = {}

    def get(self, motor_id: int, instruction: int, parameters: bytes) -> list[int] | None:
        """The packet, if it is known."""
        return self._packed.get((motor_id, instruction, parameters))

    def keep(self, motor_id: int, instruction: int, parameters: bytes, packet: list[int]) -> None:
        """Remember a request that reads, as long as there is room; a scan's thousands are not worth it."""
        if instruction in (READ, SYNC_READ, FAST_SYNC_READ) and len(self._packed) < self.MOST:
            self._packed[motor_id, instruction, parameters] = packet


class MotorBus(Protocol):
    """Requests on one bus."""

    protocol: int
    """1 or 2."""
    maximum_id: int

    def ping(self, motor_id: int) -> PingAnswer:
        """Who answers to this id."""
        ...

    def read(self, motor_id: int, address: int, length: int) -> Status:
        """`length` bytes from `address`."""
        ...

    def write(self, motor_id: int, address: int, data: bytes) -> Status:
        """Write `data` at `address` and wait for the acknowledgement."""
        ...

    def reboot(self, motor_id: int) -> Status:
        """Restart a motor; it lets go. DeviceError where the protocol has no such instruction."""
        ...

    def sync_write(self, address: int, data: Mapping[int, bytes]) -> None:
        """Write to several motors at once, the same length to each. No one acknowledges it."""
        ...

    def read_group(self, address: int, length: int, motor_ids: Sequence[int]) -> tuple[Status | DeviceError, ...]:
        """`length` bytes from `address` of each motor, in the order asked: a status or what went wrong, for each.

        Raises BusError only.
        """
        ...

    def try_fast_read(self, address: int, length: int, motor_ids: Sequence[int]) -> bool:
        """Whether group reads can be had in one answer; from now on they are, if so."""
        ...

    def surplus(self) -> bytes:
        """Wait one margin after an answer: what comes then is another motor's, with the same id."""
        ...


def persistently(act: Callable[[], T], attempts: int = ATTEMPTS) -> T:
    """Ask again, up to `attempts` times, where an answer was lost or damaged; only what may be asked twice. One
    bad answer is no reason to refuse a motor. The last failure is raised, and a BusError at once."""
    for _ in range(attempts - 1):
        try:
            return act()
        except (NoReplyError, ProtocolError):
            continue
    return act()


def motor_name(motor_id: int) -> str:
    """What a motor is called in errors."""
    return f"tendon motor {motor_id}"


class PacketSender(Protocol):
    """What sends with either protocol's packet handler of the SDK; a packet is a list of byte values."""

    def txPacket(self, port: WaitingPort, txpacket: list[int]) -> int:
        """Complete the packet (header, stuffing, CRC or checksum), send it; 0 or a negative SDK code."""
        ...


def transmit(handler: PacketSender, port: WaitingPort, packet: list[int], instruction: int) -> None:
    """Let the SDK complete a packet, in place, and send it. BusError: line gone, or the SDK refuses."""
    try:
        result = handler.txPacket(port, packet)
    finally:
        port.is_using = False  # the SDK leaves it set when the line throws
    if result != COMM_SUCCESS:
        raise BusError("tendon motor bus", f"request 0x{instruction:02X} was not sent (SDK code {result}).")


def failed_reply(motor_id: int, request: str, packet: Sequence[int], result: int, expected: str) -> DeviceError:
    """Why what came instead of a status is none: silence, damage, or a packet that is not the `expected` one."""
    if result == COMM_RX_TIMEOUT:
        return NoReplyError(
            motor_name(motor_id),
            f"no reply to {request}.",
            help="Check power, id, baud rate, and that the adapter's latency timer is 1 ms.",
        )
    heard = bytes(packet).hex(" ") or "nothing"
    if result != COMM_SUCCESS:
        return ProtocolError(motor_name(motor_id), f"damaged reply to {request}: {heard}.")
    return ProtocolError(motor_name(motor_id), f"reply to {request} was {heard}; expected {expected}.")


def sync_write_parameters(data: Mapping[int, bytes]) -> tuple[int, bytes]:
    """Length of each motor's content, and all motors' ids and contents one after the other."""
    length = len(next(iter(data.values())))
    parameters = bytearray()
    for motor_id, content in data.items():
        if len(content) != length:
            raise ValueError("a sync write has the same length for every motor")
        parameters.append(motor_id)
        parameters += content
    return length, bytes(parameters)
