"""When a motor counts as being at its load cap."""

from __future__ import annotations

import pytest

from controller.cycle.load_cap import LoadCap, LoadCapWatch

CAP = LoadCap(100.0, 2.0, 20_000_000)
MILLISECOND = 1_000_000


def first_ns(loads: list[tuple[float, float]], derating: tuple[float, float] = (1.0, 1.0)) -> int | None:
    """When it is reached, with a sample every 5 ms."""
    watch = LoadCapWatch(CAP)
    for number, tension_N in enumerate(loads):
        if watch.reached(tension_N, derating, number * 5 * MILLISECOND):
            return number * 5 * MILLISECOND
    return None


@pytest.mark.parametrize("finger", [0, 1])
def test_either_motor_that_stalls_at_its_cap_is_seen_within_20_ms(finger: int) -> None:
    """The other one would wind on; the ceiling's own count keeps the reading a little below the cap."""
    stalled = (98.5, 40.0) if finger == 0 else (40.0, 98.5)
    assert first_ns([(40.0, 40.0)] * 10 + [stalled] * 10) == 70 * MILLISECOND


def test_a_peak_is_not_the_cap() -> None:
    """One false reading, however high, does not end a squeeze."""
    assert first_ns(([(40.0, 40.0)] * 3 + [(900.0, 40.0)] * 3) * 10) is None


def test_heat_lowers_the_cap() -> None:
    """A hot motor stalls earlier, and there both stop."""
    loads = [(55.0, 55.0)] * 10
    assert first_ns(loads) is None
    assert first_ns(loads, (1.0, 0.5)) == 20 * MILLISECOND
