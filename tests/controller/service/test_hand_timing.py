"""How old motor data are when the cycle finds them, and what a dead motor costs the other one: virtual time."""

from __future__ import annotations

import statistics

import numpy as np
import pytest

from benchmarks.bench_motors import HandBench, ages_ms
from controller.messages import HandFault
from drivers.clock import nanoseconds, seconds
from drivers.dynamixel.control_tables import MODELS, MotorModel

EVERY = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
POLL_S = 0.005
TIME_OUT_S = 0.0045
"""Of one request: wire and the port's margin. After a failed one the line is left silent for another margin."""


@EVERY
def test_samples_reach_the_cycle_young(model: MotorModel) -> None:
    """At 1 Mbit/s with return delay 0, whenever the cycle looks: half of the samples are younger than 6 ms."""
    bench = HandBench(model, POLL_S)
    state = bench.run(0.6)
    ages = ages_ms(bench.sent)
    assert statistics.median(ages) <= 6.0
    assert np.percentile(ages, 99) <= 8.0
    assert state.fault is HandFault.NONE
    assert state.read_rate_hz == pytest.approx(1.0 / POLL_S, rel=0.02)


@EVERY
@pytest.mark.parametrize("dead", [0, 1], ids=["right", "left"])
def test_a_dead_motor_costs_the_other_no_more_than_a_time_out(model: MotorModel, dead: int) -> None:
    """Both in turn: the healthy one is read at the full rate, and now and then later by what asking the dead costs."""
    bench = HandBench(model, POLL_S)
    bench.motors.motors.motors[dead].mute = True
    due_ns = bench.clock.now_ns()
    intervals_s: list[float] = []
    last_ns = due_ns
    for _ in range(300):
        sample = bench.pair.exchange()
        intervals_s.append(seconds(sample.sample_ns[1 - dead] - last_ns))
        last_ns = sample.sample_ns[1 - dead]
        due_ns = max(due_ns + nanoseconds(POLL_S), bench.clock.now_ns())
        bench.clock.advance_to_ns(due_ns)
    assert sample.missed[dead] == 300
    assert sample.missed[1 - dead] == 0
    assert statistics.median(intervals_s) == pytest.approx(POLL_S, rel=0.05)
    assert max(intervals_s[3:]) <= POLL_S + 2 * TIME_OUT_S
    assert statistics.mean(intervals_s) < 1.05 * POLL_S
