"""Fault scripts in time: when faults begin and end, whom they strike, and the same twice."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.simulated.faults import Fault, FaultScript, Schedule

MS = 1_000_000


class Strike:
    """Acts on frames."""


class Moment:
    """Has no duration."""


class State:
    """Lasts."""


def _schedule(*faults: Fault[Any], seed: int = 0, start_ns: int = 0) -> Schedule[Any]:
    return Schedule(FaultScript(seed=seed, faults=faults), (Strike,), (Moment,), ("active",), start_ns)


def _due(schedule: Schedule[Any], now_ns: int) -> list[tuple[int, str, str]]:
    return [(at_ns, edge, type(running.action).__name__) for at_ns, edge, running in schedule.due(now_ns)]


def test_times_are_after_the_start_or_an_event() -> None:
    """Protects a script's clock: seconds after the start or the first such event, in order, ends before beginnings."""
    schedule = _schedule(
        Fault(action=State(), at_s=0.002, for_s=0.003),
        Fault(action=Moment(), at_s=0.005),
        Fault(action=State(), on="active", at_s=0.001),
        start_ns=100 * MS,
    )
    assert schedule.next_ns() == 102 * MS
    assert _due(schedule, 101 * MS) == []
    assert _due(schedule, 105 * MS) == [
        (102 * MS, "begin", "State"),
        (105 * MS, "end", "State"),
        (105 * MS, "begin", "Moment"),
    ]
    schedule.notice("active", 107 * MS)
    schedule.notice("active", 300 * MS)
    assert _due(schedule, 400 * MS) == [(108 * MS, "begin", "State")]
    assert schedule.next_ns() is None


@pytest.mark.parametrize(
    ("options", "struck"),
    [
        ({}, [0]),
        ({"for_frames": 3}, [0, 1, 2]),
        ({"at_frame": 4}, [3]),
        ({"at_frame": 4, "for_frames": 2}, [3, 4]),
        ({"at_s": 0.0025}, [3]),
        ({"at_s": 0.0025, "for_s": 0.003}, [3, 4, 5]),
        ({"at_s": 0.002, "for_s": 0.003}, [2, 3, 4]),
        ({"at_s": 0.0025, "at_frame": 2, "for_s": 0.002}, [4, 5]),
        ({"for_s": float("inf")}, list(range(10))),
        ({"on": "active", "for_s": 1.0}, [6, 7, 8, 9]),
    ],
)
def test_frames_that_a_fault_strikes(options: dict[str, Any], struck: list[int]) -> None:
    """Protects counting: one frame unless told otherwise; of ten a millisecond apart, the event before the 7th."""
    schedule = _schedule(Fault(action=Strike(), **options))
    hit = []
    for index in range(10):
        if index == 6:
            schedule.notice("active", 6 * MS)
        hit += [index for running in schedule.frame_faults if running.strikes(index * MS)]
    assert hit == struck


def test_a_state_can_begin_with_the_nth_frame() -> None:
    """Protects faults in the middle of a sequence: the third frame of all, whatever it is."""
    schedule = _schedule(Fault(action=State(), at_frame=3))
    for index in range(3):
        assert _due(schedule, index * MS) == []
        schedule.count_frame(index * MS)
    assert _due(schedule, 3 * MS) == [(2 * MS, "begin", "State")]


@given(seed=st.integers(0, 2**32), chance=st.floats(0.05, 1.0))
def test_chance_is_the_seeds_alone(seed: int, chance: float) -> None:
    """Law: the same seed strikes the same frames, and about as many as `chance` says."""
    runs = []
    for _ in range(2):
        (running,) = _schedule(Fault(action=Strike(), for_s=10.0, chance=chance), seed=seed).frame_faults
        runs.append([running.strikes(index) for index in range(400)])
    assert runs[0] == runs[1]
    assert abs(sum(runs[0]) - 400 * chance) <= 80


def test_combinations_without_meaning_are_refused() -> None:
    """Protects authors of scripts: each is named with its number and name."""
    with pytest.raises(InputError, match=r"fault 2 \(dip\): for_s = 1.0 means nothing"):
        _schedule(Fault(action=State()), Fault(action=Moment(), name="dip", for_s=1.0))
    with pytest.raises(InputError, match=r"fault 1: for_frames and chance belong to actions on frames"):
        _schedule(Fault(action=State(), chance=0.5))
    with pytest.raises(InputError, match=r"on = 'actve' is no event; expected one of start, active"):
        _schedule(Fault(action=Strike(), on="actve"))
