"""Frames against the worked rows of the WAM reference 2.1 to 2.5, and the laws of packing."""

from __future__ import annotations

from math import floor

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError, ProtocolError
from drivers.simulated import puck_frames
from drivers.simulated.can_wire import Frame
from drivers.wam.frames import (
    get_property,
    parse_position,
    parse_property,
    position_request,
    property_and_value,
    set_property,
    torque_frame,
)


def _message(identifier: int, data: str) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=bytes.fromhex(data))


def _heard(frame: Frame) -> can.Message:
    return _message(frame.identifier, frame.data.hex())


def _is(message: can.Message, identifier: int, data: str) -> bool:
    return message.equals(_message(identifier, data), check_channel=False)


@pytest.mark.parametrize(
    ("destination", "number", "data"),
    [
        *[(0x001, 5, "05"), (0x003, 0, "00"), (0x007, 1, "01"), (0x00A, 8, "08"), (0x00A, 42, "2A"), (0x00A, 43, "2B")],
        *[(0x404, 48, "30"), (0x400, 48, "30"), (0x006, 66, "42"), (0x005, 86, "56"), (0x002, 68, "44")],
    ],
)
def test_get_property_gives_the_reference_rows(destination: int, number: int, data: str) -> None:
    """Protects the request's identifier and its one byte."""
    assert _is(get_property(destination, number), destination, data)


def test_position_request_is_p_of_group_4() -> None:
    """Protects the one frame that starts every cycle."""
    assert _is(position_request(), 0x404, "30")
    assert _is(position_request(0, 26), 0x400, "1A")


@pytest.mark.parametrize(
    ("destination", "number", "value", "data"),
    [
        (0x004, 5, 2, "850002000000"),
        (0x404, 8, 0, "880000000000"),
        (0x002, 48, -28550, "B0007A90FFFF"),
        (0x004, 48, 36725, "B000758F0000"),
        (0x00A, 46, 6144, "AE0000180000"),
        (0x00A, 45, 5529, "AD0099150000"),
        (0x00A, 48, 4700, "B0005C120000"),
        (0x00A, 47, 1800, "AF0008070000"),
        (0x00A, 55, 5, "B70005000000"),
        (0x00A, 42, 1, "AA0001000000"),
        (0x00A, 8, 1, "880001000000"),
        (0x00A, 32, 46, "A0002E000000"),
        (0x00A, 31, 46, "9F002E000000"),
        (0x004, 43, 4320, "AB00E0100000"),
        (0x003, 30, -1, "9E00FFFFFFFF"),
    ],
)
def test_set_property_gives_the_reference_rows(destination: int, number: int, value: int, data: str) -> None:
    """Protects the six-byte form, and that a puck, or who overhears it, reads what was meant."""
    message = set_property(destination, number, value)
    assert _is(message, destination, data)
    assert property_and_value(destination, message.data) == puck_frames.request(bytes(message.data)) == (number, value)


@pytest.mark.parametrize(("data", "number", "value"), [("AF007B12", 47, 4731), ("AE000010", 46, 4096)])
def test_short_set_form_is_understood(data: str, number: int, value: int) -> None:
    """Protects the four-byte form that other hosts send."""
    assert property_and_value(0x00A, bytes.fromhex(data)) == (number, value)


@pytest.mark.parametrize(
    ("identifier", "data", "node", "number", "value"),
    [
        (0x426, "85000000", 1, 5, 0),
        (0x426, "85000200", 1, 5, 2),
        (0x466, "8000C800", 3, 0, 200),
        (0x4E6, "8100C001", 7, 1, 0x01C0),
        (0x546, "81008200", 10, 1, 0x0082),
        (0x546, "88000100", 10, 8, 1),
        (0x546, "AA000000", 10, 42, 0),
        (0x446, "C40000100000", 2, 68, 4096),
        (0x4A6, "D6006419", 5, 86, 6500),
        (0x4C6, "C200B50A0000", 6, 66, 2741),
        (0x486, "BC0000FF", 4, 60, -256),
        (0x546, "AB0049123F0D", 10, 43, 0x0D3F1249),
    ],
)
def test_property_replies_of_the_reference(identifier: int, data: str, node: int, number: int, value: int) -> None:
    """Protects node, number, width and sign of a reply, both ways."""
    reply = parse_property(_message(identifier, data))
    assert (reply.node, reply.property_id, reply.value) == (node, number, value)
    assert puck_frames.property_value(node, number, value, len(data) // 2 - 2) == (identifier, bytes.fromhex(data))


@pytest.mark.parametrize(
    ("group", "values", "data"),
    [
        (1, [0, 0, 0, 0], "AA00000000000000"),
        (1, [1, -1, 8191, -8191], "AA0007FFF7FFE001"),
        (1, [2700, -2700, 1350, -1350], "AA2A33574151BABA"),
        (1, [100.7, -100.2, 0.5, -0.5], "AA0193F9B0003FFF"),
        (1, [9000, -9000, 12, -13], "AA7FFE0010033FF3"),
        (1, [4096, -4096, 2048, -2048], "AA40030002003800"),
        (2, [6500, -6500, 1747], "AA659269C1B4C000"),
        (2, [1, 2, -3], "AA0004002FFF4000"),
        (2, [-1, -1, -1], "AAFFFFFFFFFFC000"),
        (1, [-173.57, 842.01, -911.4, 33.333], "AAFD4834AF1C0021"),
    ],
)
def test_torque_frames_of_the_reference(group: int, values: list[float], data: str) -> None:
    """Protects bit order, sign, clip and floor of the torques that reach the motors."""
    assert _is(torque_frame(group, values), 0x400 | group, data)


@pytest.mark.parametrize(
    ("identifier", "data", "node", "motor", "joint"),
    [
        (0x423, "000000", 1, 0, None),
        (0x443, "000002", 2, 2, None),
        (0x463, "3FFFFF", 3, -1, None),
        (0x483, "3FFFFE", 4, -2, None),
        (0x4A3, "1FFFFF", 5, 2097151, None),
        (0x4C3, "200000", 6, -2097152, None),
        (0x4E3, "000FFF", 7, 4095, None),
        (0x423, "3F1F61", 1, -57503, None),
        (0x483, "008F75", 4, 36725, None),
        (0x423, "000000000000", 1, 0, 0),
        (0x443, "3F701F3CD11C", 2, -36833, -208612),
        (0x463, "008FE100000C", 3, 36833, 12),
        (0x483, "3F708B027D34", 4, -36725, 163124),
        (0x423, "0003E83FFC18", 1, 1000, -1000),
        (0x443, "1FFFFF200000", 2, 2097151, -2097152),
        (0x463, "3FFFFF000001", 3, -1, 1),
        (0x483, "01E2403E7E33", 4, 123456, -98765),
    ],
)
def test_positions_of_the_reference(identifier: int, data: str, node: int, motor: int, joint: int | None) -> None:
    """Protects sign and byte order of the counts that all control rests on, both ways."""
    position = parse_position(_message(identifier, data))
    assert (position.node, position.motor_counts, position.joint_counts) == (node, motor, joint)
    assert puck_frames.position(node, motor, joint) == (identifier, bytes.fromhex(data))


def test_position_masks_the_two_top_bits() -> None:
    """Protects against pucks that leave the two unused bits set, as every reader of this protocol does."""
    assert parse_position(_message(0x423, "C00002")).motor_counts == 2


@pytest.mark.parametrize(
    ("identifier", "data", "node", "counts"),
    [(0x427, "000000", 1, 0), (0x447, "3CD11C", 2, -208612), (0x487, "027D34", 4, 163124)],
)
def test_joint_encoder_replies_of_the_reference(identifier: int, data: str, node: int, counts: int) -> None:
    """Protects the joint encoder's own frame, as the simulated puck sends it."""
    assert puck_frames.joint_encoder(node, counts) == (identifier, bytes.fromhex(data))


_UNITS = st.lists(st.floats(-20000, 20000, allow_nan=False), min_size=1, max_size=4)


@given(group=st.integers(0, 31), values=_UNITS, number=st.integers(0, 127))
def test_torques_unpack_to_the_clipped_floor(group: int, values: list[float], number: int) -> None:
    """Law: what is unpacked is each value clipped to ±8191 and floored; missing ones are zero."""
    expected = [floor(min(max(value, -8191), 8191)) for value in values] + [0] * (4 - len(values))
    assert puck_frames.torques(bytes(torque_frame(group, values, number).data)) == (number, tuple(expected))


@given(node=st.integers(1, 31), counts=st.integers(-(2**21), 2**21 - 1), number=st.integers(0, 127), wide=st.booleans())
def test_what_a_puck_says_is_what_the_host_reads(node: int, counts: int, number: int, wide: bool) -> None:
    """Law: parse ∘ pack is the identity for positions and properties."""
    assert parse_position(_heard(puck_frames.position(node, counts))).motor_counts == counts
    value = counts if wide else counts >> 6
    reply = parse_property(_heard(puck_frames.property_value(node, number, value, 4 if wide else 2)))
    assert (reply.node, reply.property_id, reply.value) == (node, number, value)


@given(
    identifier=st.integers(0, 0x1FFFFFFF),
    data=st.binary(max_size=8),
    extended=st.booleans(),
    remote=st.booleans(),
    error=st.booleans(),
)
def test_noise_is_parsed_or_refused(identifier: int, data: bytes, extended: bool, remote: bool, error: bool) -> None:
    """Law: any frame is either understood or raises ProtocolError, never anything else."""
    message = can.Message(
        arbitration_id=identifier, is_extended_id=extended, is_remote_frame=remote, is_error_frame=error, data=data
    )
    for parse in (parse_position, parse_property):
        try:
            parse(message)
        except ProtocolError:
            continue


@pytest.mark.parametrize(
    ("identifier", "data"),
    [(0x403, "000000"), (0x423, "0000"), (0x423, "00000000"), (0x426, "000000"), (0x042, "000000")],
)
def test_malformed_positions_are_refused(identifier: int, data: str) -> None:
    """Protects against taking a frame of the host, another group or another length for a position."""
    with pytest.raises(ProtocolError, match="expected"):
        parse_position(_message(identifier, data))


@pytest.mark.parametrize("data", ["05000000", "85010000", "850000", "8500000000", ""])
def test_malformed_property_replies_are_refused(data: str) -> None:
    """Protects the three conditions that the reference sets for a reply."""
    with pytest.raises(ProtocolError, match="expected"):
        parse_property(_message(0x426, data))


@pytest.mark.parametrize("values", [[], [0.0] * 5, [float("nan")], [float("inf"), 0.0]])
def test_impossible_torques_are_refused(values: list[float]) -> None:
    """Protects the motors from values that are no torque."""
    with pytest.raises(InputError):
        torque_frame(1, values)


@pytest.mark.parametrize(
    ("destination", "number", "value"), [(0x420, 5, 0), (-1, 5, 0), (1, 128, 0), (1, -1, 0), (1, 5, 2**32)]
)
def test_impossible_requests_are_refused(destination: int, number: int, value: int) -> None:
    """Protects other nodes from a frame whose number ran over."""
    with pytest.raises(InputError):
        set_property(destination, number, value)
