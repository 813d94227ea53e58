"""Discrete-event order of virtual time."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from controller.simulation.virtual_time import Part, VirtualTime
from drivers.clock import VirtualClock


class Periodic:
    """A part that notes when it is stepped, works for `work_ns` on its own clock, and wants its next turn."""

    def __init__(self, name: str, period_ns: int, log: list[tuple[int, str]], work_ns: int = 0) -> None:
        self.clock = VirtualClock()
        self._period_ns, self._work_ns, self._log, self._name = period_ns, work_ns, log, name
        self.part = Part(name, self.clock, self.step)

    def step(self) -> int:
        began_ns = self.clock.now_ns()
        self._log.append((began_ns, self._name))
        self.clock.sleep_until_ns(began_ns + self._work_ns)
        return began_ns + self._period_ns


parts = st.lists(st.tuples(st.integers(1, 9), st.integers(0, 15)), min_size=1, max_size=5)


@given(parts)
def test_parts_go_in_the_order_of_their_moments(periods_and_work: list[tuple[int, int]]) -> None:
    """Time never runs backwards for anyone, ties go by rank, and nobody is stepped before its own work is done."""
    log: list[tuple[int, str]] = []
    time = VirtualTime()
    for rank, (period_ns, work_ns) in enumerate(periods_and_work):
        time.add(Periodic(str(rank), period_ns, log, work_ns).part)
    assert not time.run_until(60)
    assert log == sorted(log, key=lambda entry: (entry[0], int(entry[1])))
    for rank, (period_ns, work_ns) in enumerate(periods_and_work):
        own = [moment for moment, name in log if name == str(rank)]
        assert own == list(range(0, 61, max(period_ns, work_ns)))
    assert time.now_ns == 60


def test_a_part_that_waited_goes_on_when_its_wait_is_over() -> None:
    """A bus transaction takes its time: others run meanwhile, and the part sees their work afterwards."""
    log: list[tuple[int, str]] = []
    slow, fast = Periodic("slow", 10, log, work_ns=25), Periodic("fast", 10, log)
    time = VirtualTime()
    time.add(slow.part)
    time.add(fast.part)
    time.run_until(30)
    assert log == [(0, "slow"), (0, "fast"), (10, "fast"), (20, "fast"), (25, "slow"), (30, "fast")]
    assert slow.clock.now_ns() == 50


def test_stops_as_soon_as_satisfied() -> None:
    """A client's wait ends with the step that answers it, not at the deadline."""
    log: list[tuple[int, str]] = []
    time = VirtualTime(start_ns=100)
    time.add(Periodic("a", 10, log).part, first_ns=105)
    assert time.run_until(1000, lambda: len(log) == 3)
    assert time.now_ns == 125
    assert time.run_until(1000, lambda: True)
    assert len(log) == 3


def test_a_part_that_is_done_is_not_stepped_again() -> None:
    """None ends a part; virtual time goes on without it."""
    steps: list[int] = []
    clock = VirtualClock()

    def step() -> int | None:
        steps.append(clock.now_ns())
        return None if len(steps) == 2 else 10

    time = VirtualTime()
    time.add(Part("short", clock, step))
    assert not time.run_until(500)
    assert (steps, time.now_ns) == ([0, 10], 500)


def test_a_part_that_never_waits_does_not_stop_the_others() -> None:
    """Whoever asks for a turn at once gets it a nanosecond later, so time still moves."""
    steps: list[int] = []
    clock = VirtualClock()

    def step() -> int:
        steps.append(clock.now_ns())
        return 0

    time = VirtualTime()
    time.add(Part("greedy", clock, step))
    time.run_until(5)
    assert steps == [0, 1, 2, 3, 4, 5]
