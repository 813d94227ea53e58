"""The pacer on a virtual clock."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.pacer import Pacer
from drivers.clock import VirtualClock

PERIOD_NS = 2_000_000


@given(st.lists(st.integers(0, 7 * PERIOD_NS), max_size=40))
def test_skips_and_never_bursts(work_ns: list[int]) -> None:
    """However long a cycle takes, deadlines stay on the grid, each is used once, and the skipped ones are counted."""
    clock = VirtualClock(12_345)
    pacer = Pacer(clock, PERIOD_NS)
    woken: list[int] = []
    for work in [*work_ns, 0]:
        pacer.wait()
        woken.append((pacer.begin() - 12_345) // PERIOD_NS)
        assert pacer.late_ns >= 0
        assert pacer.deadline_ns > clock.now_ns()
        assert (pacer.deadline_ns - 12_345) % PERIOD_NS == 0
        clock.advance_to_ns(clock.now_ns() + work)
    assert woken == sorted(set(woken))
    assert pacer.missed == woken[-1] - len(woken)


def test_an_early_wake_is_no_missed_period() -> None:
    """A process that is stepped before its deadline still has one deadline a period."""
    clock = VirtualClock()
    pacer = Pacer(clock, PERIOD_NS)
    clock.advance_to_ns(PERIOD_NS - 300)
    pacer.begin()
    assert (pacer.missed, pacer.late_ns, pacer.deadline_ns) == (0, -300, 2 * PERIOD_NS)


def test_restart_forgives_what_took_long() -> None:
    """Start-up of a device is no missed period."""
    clock = VirtualClock()
    pacer = Pacer(clock, PERIOD_NS)
    clock.advance_to_ns(50 * PERIOD_NS + 1)
    pacer.restart()
    pacer.wait()
    assert pacer.begin() == 51 * PERIOD_NS + 1
    assert pacer.missed == 0


def test_refuses_a_period_of_nothing() -> None:
    """A period of zero would spin for ever."""
    with pytest.raises(ValueError, match="more than 0"):
        Pacer(VirtualClock(), 0)
