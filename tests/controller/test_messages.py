"""Payloads between the processes: whole, in order, and nothing else."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.messages import (
    COMMAND_VALUES,
    CYCLE_RECORD,
    EVENT_VALUES,
    CommandKind,
    CycleCommand,
    CycleEvent,
    EventKind,
    HandFault,
    HandMode,
    HandSetPoint,
    HandState,
    Reason,
)
from drivers.errors import ProtocolError

numbers = st.floats(allow_nan=False)
pairs = st.tuples(numbers, numbers)
integers = st.integers(-(2**63), 2**63 - 1)
faults = st.integers(0, 1023).map(HandFault)


@given(pairs, pairs, pairs, pairs, st.sampled_from(HandMode), faults, st.tuples(pairs, pairs, pairs, pairs, numbers))
def test_hand_state_arrives_as_sent(
    excursion: tuple[float, float],
    rate: tuple[float, float],
    tension: tuple[float, float],
    effort: tuple[float, float],
    mode: HandMode,
    fault: HandFault,
    motors: tuple[tuple[float, float], tuple[float, float], tuple[float, float], tuple[float, float], float],
) -> None:
    """No number changes its place on the way: right is right, and the fault bits combine."""
    state = HandState(excursion, rate, tension, effort, mode, fault, *motors)
    assert HandState.unpack(state.pack()) == state


@given(pairs, pairs, st.sampled_from(HandMode))
def test_hand_set_point_arrives_as_sent(
    excursion: tuple[float, float], cap: tuple[float, float], mode: HandMode
) -> None:
    """As above, the other way."""
    set_point = HandSetPoint(excursion, cap, mode)
    assert HandSetPoint.unpack(set_point.pack()) == set_point


@given(st.sampled_from(CommandKind), integers, st.lists(numbers, max_size=COMMAND_VALUES), integers)
def test_command_arrives_as_sent(kind: CommandKind, token: int, values: list[float], effective_cycle: int) -> None:
    """A command keeps its number of values: an optional one that was not given is not a zero."""
    command = CycleCommand(kind, token, tuple(values), effective_cycle)
    assert CycleCommand.unpack(command.pack()) == command


@given(
    st.sampled_from(EventKind), integers, integers, st.sampled_from(Reason), st.lists(numbers, max_size=EVENT_VALUES)
)
def test_event_arrives_as_sent(kind: EventKind, token: int, cycle: int, reason: Reason, values: list[float]) -> None:
    """As above, the other way."""
    event = CycleEvent(kind, token, cycle, reason, tuple(values))
    assert CycleEvent.unpack(event.pack()) == event


def test_layout_is_little_endian_without_gaps() -> None:
    """Two processes of different builds, or a replay on another machine, read the same bytes."""
    command = CycleCommand(CommandKind.CLOSE, 7, (0.01,), 42)
    expected = struct.pack("<IIqq9d", 8, 1, 7, 42, 0.01, *[0.0] * 8)
    assert command.pack() == expected
    set_point = HandSetPoint((1.0, 2.0), (3.0, 4.0), HandMode.OPEN)
    assert set_point.pack() == struct.pack("<4dI", 1.0, 2.0, 3.0, 4.0, 2)


@pytest.mark.parametrize(
    ("unpack", "good"),
    [
        (HandState.unpack, HandState((0, 0), (0, 0), (0, 0), (0, 0)).pack()),
        (HandSetPoint.unpack, HandSetPoint((0, 0), (0, 0)).pack()),
        (CycleCommand.unpack, CycleCommand(CommandKind.STOP, 1).pack()),
        (CycleEvent.unpack, CycleEvent(EventKind.FAULT, 0, 1).pack()),
        (CYCLE_RECORD.read, np.zeros(CYCLE_RECORD.length).tobytes()),
    ],
)
def test_a_wrong_length_is_refused(unpack: Callable[[bytes], object], good: bytes) -> None:
    """A cut or padded message is never read as numbers."""
    unpack(good)
    for bad in (b"", good[:-1], good + b"\0"):
        with pytest.raises(ProtocolError, match="expected"):
            unpack(bad)


def test_record_names_tile_the_record() -> None:
    """Every number of the record has exactly one name, and is read under it."""
    record = np.zeros(CYCLE_RECORD.length)
    record[:] = np.arange(CYCLE_RECORD.length)
    read = CYCLE_RECORD.read(record.tobytes())
    flat = [n for value in read.values() for n in (value if isinstance(value, list) else [value])]
    assert flat == list(range(CYCLE_RECORD.length))
    for name, where in CYCLE_RECORD.slices.items():
        value = read[name]
        assert (value if isinstance(value, list) else [value]) == record[where].tolist()
