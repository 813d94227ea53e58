"""CAN payloads as pucks see them: what they hear, and the frames with which they answer.

Written for the puck's side from the WAM reference 1.1, 2.1 to 2.5, apart from the driver's own packing, so that the two
can disagree. Counts and torques are puck units; positions and torques are big-endian, all else little-endian.
"""

from __future__ import annotations

from drivers.simulated.can_wire import Frame

HOST = 0
GROUP = 0x400
GROUP_POSITION = 3
GROUP_PROPERTY = 6
GROUP_JOINT_ENCODER = 7
TORQUE_BYTES = 8


def sending_node(identifier: int) -> int:
    """Node that sent a frame; 0 is the host."""
    return identifier >> 5 & 0x1F


def request(data: bytes) -> tuple[int, int | None] | None:
    """Property number asked for, or number and value to be set; None for bytes that are neither."""
    if len(data) == 1 and data[0] < 0x80:
        return data[0], None
    if len(data) in (4, 6) and data[0] >= 0x80 and data[1] == 0:
        return data[0] & 0x7F, int.from_bytes(data[2:], "little", signed=True)
    return None


def torques(data: bytes) -> tuple[int, tuple[int, int, int, int]] | None:
    """Property number and four 14-bit values of a packed torque frame; None for bytes that are none."""
    if len(data) != TORQUE_BYTES or data[0] < 0x80:
        return None
    bits = int.from_bytes(data, "big")
    values = (bits >> 42 & 0x3FFF, bits >> 28 & 0x3FFF, bits >> 14 & 0x3FFF, bits & 0x3FFF)
    first, second, third, fourth = (value - 0x4000 if value & 0x2000 else value for value in values)
    return data[0] & 0x7F, (first, second, third, fourth)


def position(node: int, motor_counts: int, joint_counts: int | None = None) -> Frame:
    """The answer to a position request: 22 bits of the count, and of the joint encoder's where there is one."""
    data = (motor_counts & 0x3FFFFF).to_bytes(3, "big")
    if joint_counts is not None:
        data += (joint_counts & 0x3FFFFF).to_bytes(3, "big")
    return Frame(GROUP | node << 5 | GROUP_POSITION, data)


def joint_encoder(node: int, joint_counts: int) -> Frame:
    """The answer to a request of JP: 22 bits of the joint encoder's count."""
    return Frame(GROUP | node << 5 | GROUP_JOINT_ENCODER, (joint_counts & 0x3FFFFF).to_bytes(3, "big"))


def property_value(node: int, number: int, value: int, width: int) -> Frame:
    """The answer to a request of any other property, with a value of `width` bytes (2 or 4)."""
    data = bytes((0x80 | number, 0)) + (value & ((1 << 8 * width) - 1)).to_bytes(width, "little")
    return Frame(GROUP | node << 5 | GROUP_PROPERTY, data)


def motor_mode_order(safety_node: int, mode_number: int, mode: int) -> Frame:
    """The safety puck's own frame to the motor pucks [assumed]: SET MODE in the short form, to group 0."""
    return Frame(GROUP | safety_node << 5, bytes((0x80 | mode_number, 0)) + mode.to_bytes(2, "little"))


def counts_between(later: int, earlier: int) -> int:
    """How far a 22-bit counter has gone from `earlier` to `later`, the short way round."""
    return ((later - earlier + 0x200000) & 0x3FFFFF) - 0x200000


def reported_counts(data: bytes) -> int | None:
    """Motor count of a position frame, as the safety puck hears it; None for bytes that are none."""
    if len(data) not in (3, 6):
        return None
    counts = int.from_bytes(data[:3], "big") & 0x3FFFFF
    return counts - 0x400000 if counts & 0x200000 else counts
