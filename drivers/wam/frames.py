"""CAN frames of the WAM, on the host's side: identifiers and payloads, packed and parsed by pure functions on
`can.Message` or, for the cycle, on bare bytes.

All frames are standard 11-bit data frames. The identifier is a group bit, the sender's node (host 0, pucks 1 to 7,
safety puck 10) and a destination node or group. Positions are encoder counts, torques puck units; positions and torques
are big-endian, all else little-endian. Source: WAM reference 1.1 to 1.4 and 2.1 to 2.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, isfinite

import can

from drivers.errors import InputError, ProtocolError

GROUP_BIT = 0x400
"""Set in a destination: the frame goes to a group, whose number is in the low five bits."""
GROUP_ALL_MOTORS = 0
GROUP_LOWER_TORQUE = 1
GROUP_UPPER_TORQUE = 2
GROUP_POSITION = 3
GROUP_ARM = 4
GROUP_PROPERTY = 6
SAFETY_NODE = 10
UNASKED_SAFETY_ID = 0x540
"""The safety puck's own frames to the motor pucks."""

RawFrame = tuple[int, bytes]
"""Identifier and data of a frame."""
ERROR_FRAME = 0x20000000
"""Flag in the identifier of an error frame, which the adapter tells its host (linux/can/error.h)."""

_SENDER_MASK = 0x3E0
_TO_MASK = 0x41F
_POSITION_TO = GROUP_BIT | GROUP_POSITION
_PROPERTY_TO = GROUP_BIT | GROUP_PROPERTY

POSITION_MOTORS = {_POSITION_TO | node << 5: node - 1 for node in range(1, 8)}
"""Index of the motor, 0 to 6, by the identifier of its position reply."""


@dataclass(frozen=True, slots=True)
class Position:
    """A puck's position reply."""

    node: int
    motor_counts: int
    joint_counts: int | None
    """Count of the joint encoder; None for a puck without one."""


@dataclass(frozen=True, slots=True)
class PropertyReply:
    """A puck's property reply."""

    node: int
    property_id: int
    value: int


# --- what the host sends


def get_property(destination: int, property_id: int) -> can.Message:
    """Ask `destination` (a node, or 0x400 | group) for a property, 0 to 127. InputError if out of range."""
    _check_address(destination, property_id)
    return _frame(destination, bytes((property_id,)))


def set_property(destination: int, property_id: int, value: int) -> can.Message:
    """Write a property of `destination`, a signed or unsigned 32-bit value; nobody acknowledges it.

    InputError if out of range.
    """
    _check_address(destination, property_id)
    if not -0x80000000 <= value <= 0xFFFFFFFF:
        raise InputError(f"property value {value} does not fit; expected a 32-bit integer.")
    return _frame(destination, bytes((0x80 | property_id, 0)) + (value & 0xFFFFFFFF).to_bytes(4, "little"))


def position_request(group: int = GROUP_ARM, property_id: int = 48) -> can.Message:
    """Ask every puck of `group` for its position; 48 is P of all supported firmware."""
    return get_property(GROUP_BIT | group, property_id)


def torque_frame(group: int, values: Sequence[float], property_id: int = 42) -> can.Message:
    """Pack one to four torques, puck units, for the pucks with PIDX 1 to 4 of `group`; missing ones are zero.

    Each value is clipped to ±8191 and then floored towards minus infinity, as all host software of this arm does.
    InputError for more than four or non-finite values.
    """
    if not 1 <= len(values) <= 4:
        raise InputError(f"{len(values)} torques do not fit into a frame; expected one to four.")
    _check_address(GROUP_BIT | group, property_id)
    for value in values:
        if not isfinite(value):
            raise InputError(f"torque {value} is not finite; expected puck units between -8191 and 8191.")
    first, second, third, fourth = (*values, 0.0, 0.0, 0.0)[:4]
    return _frame(GROUP_BIT | group, torque_data(first, second, third, fourth, property_id))


def torque_data(first: float, second: float, third: float, fourth: float, property_id: int = 42) -> bytes:
    """The eight bytes of four finite torques, puck units: clipped to ±8191, then floored."""
    bits = (0x80 | property_id) << 14 | floor(max(-8191.0, min(8191.0, first))) & 0x3FFF
    bits = bits << 14 | floor(max(-8191.0, min(8191.0, second))) & 0x3FFF
    bits = bits << 14 | floor(max(-8191.0, min(8191.0, third))) & 0x3FFF
    return (bits << 14 | floor(max(-8191.0, min(8191.0, fourth))) & 0x3FFF).to_bytes(8, "big")


# --- what pucks send


def parse_position(message: can.Message) -> Position:
    """Read a position reply of 3 or 6 bytes; anything else raises ProtocolError."""
    node = _reply_sender(message, _POSITION_TO, "position reply")
    counts = position_counts(message.data)
    if counts is None:
        raise _malformed(message, "position reply of 3 or 6 bytes")
    return Position(node, *counts)


def position_counts(data: bytes | bytearray) -> tuple[int, int | None] | None:
    """Motor count and joint encoder's count (None without one) in a position reply; None if it is malformed."""
    length = len(data)
    if length == 3:
        return ((int.from_bytes(data, "big") & 0x3FFFFF) ^ 0x200000) - 0x200000, None
    if length != 6:
        return None
    both = int.from_bytes(data, "big")
    return ((both >> 24 & 0x3FFFFF) ^ 0x200000) - 0x200000, ((both & 0x3FFFFF) ^ 0x200000) - 0x200000


def parse_property(message: can.Message) -> PropertyReply:
    """Read a property reply with two or four value bytes, signed; anything else raises ProtocolError."""
    node = _reply_sender(message, _PROPERTY_TO, "property reply")
    property_id, value = property_and_value(message.arbitration_id, _plain_data(message))
    return PropertyReply(node, property_id, value)


def sender(message: can.Message) -> int:
    """Node that sent the frame; 0 is the host."""
    return (message.arbitration_id & _SENDER_MASK) >> 5


def is_position(message: can.Message) -> bool:
    """Whether the identifier is that of a position reply; the rest may still be malformed."""
    return message.arbitration_id & _TO_MASK == _POSITION_TO


def property_and_value(identifier: int, data: bytes | bytearray) -> tuple[int, int]:
    """Read property number and value, signed, in a reply or set-property frame; anything else raises ProtocolError."""
    if len(data) not in (4, 6) or not data[0] & 0x80 or data[1]:
        raise _malformed_data(identifier, data, "property and value in 4 or 6 bytes")
    return data[0] & 0x7F, int.from_bytes(data[2:], "little", signed=True)


def _reply_sender(message: can.Message, to: int, what: str) -> int:
    identifier = message.arbitration_id
    node = (identifier & _SENDER_MASK) >> 5
    if identifier & _TO_MASK != to or not node or identifier > 0x7FF:
        raise _malformed(message, what)
    _plain_data(message)
    return node


def _plain_data(message: can.Message) -> bytearray:
    if message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd:
        raise _malformed(message, "standard data frame")
    return message.data


def _check_address(destination: int, property_id: int) -> None:
    if destination & ~(GROUP_BIT | 0x1F):
        raise InputError(f"destination {destination:#x} is not a node (0 to 31) or 0x400 | group (0 to 31).")
    if not 0 <= property_id <= 127:
        raise InputError(f"property number {property_id} is out of range; expected 0 to 127.")


def _frame(identifier: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytearray(data))


def _malformed(message: can.Message, expected: str) -> ProtocolError:
    return _malformed_data(message.arbitration_id, message.data, expected)


def _malformed_data(identifier: int, data: bytes | bytearray, expected: str) -> ProtocolError:
    return ProtocolError(
        "WAM bus",
        f"frame {identifier:#05x} with data {bytes(data).hex() or 'none'} is malformed; expected a {expected}.",
        help="Look for another device or a wrong bit rate on the bus.",
    )
