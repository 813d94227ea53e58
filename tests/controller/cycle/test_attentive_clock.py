"""A clock that cuts long waits at the cycle's deadlines."""

from __future__ import annotations

from controller.cycle.attentive_clock import AttentiveClock
from drivers.clock import VirtualClock


class Arrival:
    """Data that arrive at a time."""

    def __init__(self, time_ns: int | None) -> None:
        self.time_ns = time_ns

    def fileno(self) -> int:
        return -1

    def next_arrival_ns(self) -> int | None:
        return self.time_ns


class Beats:
    """What is called at deadlines, every ten."""

    def __init__(self, clock: AttentiveClock) -> None:
        self._clock = clock
        self.due_ns = 10
        self.times: list[int] = []

    def attend(self) -> None:
        self.times.append(self._clock.now_ns())
        self.due_ns += 10


def test_a_long_sleep_is_attended_at_every_deadline() -> None:
    """Protects the heartbeat to the front while pucks wake."""
    clock = AttentiveClock(VirtualClock())
    beats = Beats(clock)
    with clock.attended(beats.attend, lambda: beats.due_ns):
        clock.sleep_until_ns(35)
    clock.sleep_until_ns(100)
    assert beats.times == [10, 20, 30]
    assert clock.now_ns() == 100


def test_a_wait_ends_with_its_data() -> None:
    """Protects start-up: an answer is taken when it comes, late or soon, and the deadlines before it are kept."""
    clock = AttentiveClock(VirtualClock())
    beats = Beats(clock)
    with clock.attended(beats.attend, lambda: beats.due_ns):
        assert clock.wait_readable(Arrival(23), 50)
        assert (clock.now_ns(), beats.times) == (23, [10, 20])
        assert not clock.wait_readable(Arrival(None), 27)
        assert clock.now_ns() == 27


def test_answers_in_quick_succession_do_not_starve_the_cycle() -> None:
    """Protects the heartbeat while one question after another is answered at once."""
    inner = VirtualClock()
    clock = AttentiveClock(inner)
    beats = Beats(clock)
    with clock.attended(beats.attend, lambda: beats.due_ns):
        for time_ns in range(3, 60, 3):
            assert clock.wait_readable(Arrival(time_ns), time_ns + 100)
    assert len(beats.times) >= 5
