"""The simulation's time against the machine's, which is played on virtual time."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from controller.simulation.stepped_clock import SteppedClock
from drivers.clock import VirtualClock

LONGEST_NS = 50_000_000


@given(st.lists(st.integers(0, 200_000_000), max_size=20))
def test_it_follows_but_never_bursts(pauses_ns: list[int]) -> None:
    """Each step is the machine's, up to 50 ms; all that is more is dropped, and nothing else is."""
    machine = VirtualClock(7)
    clock = SteppedClock(machine)
    for pause_ns in pauses_ns:
        before_ns = clock.now_ns()
        machine.advance_to_ns(machine.now_ns() + pause_ns)
        assert clock.now_ns() == before_ns
        assert clock.step() - before_ns == min(pause_ns, LONGEST_NS)
    assert clock.dropped_ns == sum(max(0, pause_ns - LONGEST_NS) for pause_ns in pauses_ns)
    assert clock.drops == sum(pause_ns > LONGEST_NS for pause_ns in pauses_ns)
    assert clock.now_ns() == machine.now_ns() - clock.dropped_ns


def test_a_resumed_clock_has_lost_nothing() -> None:
    """What it took to build the world is not simulated time, and no fault of the machine."""
    machine = VirtualClock()
    clock = SteppedClock(machine)
    machine.advance_to_ns(3_000_000_000)
    clock.resume()
    assert (clock.step(), clock.drops) == (0, 0)
    assert clock.until_ns(1_000) == 1_000
