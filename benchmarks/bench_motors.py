"""The hand process on virtual time, in front of motors of every model on springs: how old, how often, how dear.

    python -m benchmarks.bench_motors [--json] [--seconds N] [--poll-hz N]

Both tendons wind up and down slowly, at 1 Mbit/s with return delay 0. Age is that of the newest sample which a cycle
finds, whenever it looks; it holds wire time, the motors' answering time and waiting for the next exchange, and is the
same on every machine. So is the read rate. Processor time is this machine's: of `HandPart.step`
with its links, without the simulated motors and without system calls; for these see `bench_motor_bus`. Nothing here
passes or fails.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from controller.messages import HandMode, HandSetPoint, HandState
from controller.service.hand import HandPart, HandSettings
from controller.service.links import LatestReader, LatestSender, VirtualLink
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.dynamixel.control_tables import MODELS, MotorModel
from drivers.dynamixel.load_law import published_law
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings, taut_ticks
from drivers.simulated.dynamixel_answer import Answer
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.serial_faults import Adapter
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

LOOK_NS = nanoseconds(0.0001)
"""A cycle may look at any phase of the polling: looked at so densely."""
STEP_NS = nanoseconds(0.0005)
RADIUS_M = 0.0105
CAPS_N = (40.0, 40.0)


@dataclass
class TimedMotors:
    """The simulated motors as a line has them; adds up the processor time that they take to answer."""

    motors: SimulatedMotors
    used_ns: int = 0

    @property
    def adapter(self) -> Adapter:
        return self.motors.adapter

    def answers(self, data: bytes, now_ns: int, baud: int | None = None) -> list[Answer]:
        begin_ns = time.process_time_ns()
        answers = self.motors.answers(data, now_ns, baud)
        self.used_ns += time.process_time_ns() - begin_ns
        return answers


@dataclass
class HandBench:
    """A hand process with its links, and the motors and springs behind it."""

    model: MotorModel
    poll_s: float = 0.005
    used_ns: int = 0
    """Processor time of the hand's steps, without the motors'."""
    sent: list[tuple[int, int]] = field(default_factory=list)
    """When a state left the hand process, and the time of its sample."""

    def __post_init__(self) -> None:
        electrics, zero_ticks = electrics_of(self.model), taut_ticks(self.model)
        self.springs = SpringTendons(friction_Nm=electrics.gear_friction_Nm, inertia_kgm2=electrics.inertia_kgm2)
        mounted = [SimulatedMotorSettings(number, zero_ticks, model=self.model) for number in (1, 2)]
        self.motors = TimedMotors(SimulatedMotors(self.springs, mounted, noise_counts=1.0))
        self.clock = VirtualClock()
        law = published_law(self.model, RADIUS_M)
        right, left = (MotorSettings(n, 1, zero_ticks, RADIUS_M, law, self.model.name) for n in (1, 2))
        port = WaitingPort(MemoryLine(self.motors, self.clock), self.clock)
        self.pair = TendonPair(port, self.clock, (right, left))
        set_points, states = (VirtualLink(self.clock, self.clock, capacity=100) for _ in range(2))
        self._cycle, self._states = LatestSender(set_points), LatestReader(states)
        self.hand = HandPart(
            self.clock, self.pair, LatestReader(set_points), LatestSender(states), HandSettings(period_s=self.poll_s)
        )
        self.hand.start()
        self._plant_ns = self.clock.now_ns()

    def run(self, duration_s: float) -> HandState:
        """Let virtual time pass; the last state."""
        end_ns = self.clock.now_ns() + nanoseconds(duration_s)
        state = HandState((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
        while self.clock.now_ns() < end_ns:
            excursion_m = 0.003 - 0.003 * math.cos(seconds(self.clock.now_ns()))
            set_point = HandSetPoint((excursion_m, excursion_m), CAPS_N, HandMode.TRACK)
            self._cycle.send(set_point.pack(), self.clock.now_ns())
            motors_ns, begin_ns = self.motors.used_ns, time.process_time_ns()
            self.hand.step()
            self.used_ns += time.process_time_ns() - begin_ns - (self.motors.used_ns - motors_ns)
            newest = self._states.newest()
            assert newest is not None
            state = HandState.unpack(newest[0])
            self.sent.append((self.clock.now_ns(), newest[1]))
            self.clock.sleep_until_ns(self.hand.pacer.deadline_ns)
            while self._plant_ns < self.clock.now_ns():
                self.motors.motors.control(self._plant_ns, STEP_NS * 1e-9)
                self.springs.step(STEP_NS * 1e-9)
                self._plant_ns += STEP_NS
        return state


def ages_ms(sent: Sequence[tuple[int, int]]) -> list[float]:
    """Ages of the newest sample whenever a cycle looks, from (when it left, time of the sample), in order."""
    left_ns, sample_ns = np.array(sent, dtype=np.int64).T
    looks_ns = np.arange(left_ns[0], left_ns[-1], LOOK_NS)
    newest = np.searchsorted(left_ns, looks_ns, side="right") - 1
    ages: list[float] = ((looks_ns - sample_ns[newest]) * 1e-6).tolist()
    return ages


def measure(model: MotorModel, poll_hz: float, duration_s: float) -> dict[str, Any]:
    """All figures of one model."""
    bench = HandBench(model, 1.0 / poll_hz)
    bench.run(0.2)
    bench.sent.clear()
    bench.used_ns = 0
    state = bench.run(duration_s)
    middle_ms, high_ms = np.percentile(ages_ms(bench.sent), (50, 99))
    step_us = bench.used_ns * 1e-3 / len(bench.sent)
    return {
        "model": model.name,
        "poll_hz": poll_hz,
        "read_rate_hz": round(state.read_rate_hz, 1),
        "age_median_ms": round(float(middle_ms), 2),
        "age_p99_ms": round(float(high_ms), 2),
        "step_us": round(step_us, 1),
        "share_percent": round(1e-4 * step_us * poll_hz, 2),
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one line of JSON")
    parser.add_argument("--seconds", type=float, default=5.0, help="virtual time per model, s")
    parser.add_argument("--poll-hz", type=float, default=200.0, help="polling rate; 200 is the default installation's")
    arguments = parser.parse_args()
    if not 0.1 <= arguments.seconds <= 600.0:
        parser.error(f"--seconds {arguments.seconds}: expected 0.1 to 600")
    if not 10.0 <= arguments.poll_hz <= 1000.0:
        parser.error(f"--poll-hz {arguments.poll_hz}: expected 10 to 1000")
    figures = [measure(model, arguments.poll_hz, arguments.seconds) for model in MODELS.values()]
    if arguments.json:
        print(json.dumps(figures))
        return
    table = Table(title=f"hand process at {arguments.poll_hz:g} Hz, 1 Mbit/s, return delay 0")
    for heading in ("model", "samples/s", "age ms, median", "99 %", "processor µs a step", "share of a core"):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for one in figures:
        values = (f"{one['read_rate_hz']:.0f}", f"{one['age_median_ms']:.1f}", f"{one['age_p99_ms']:.1f}")
        table.add_row(one["model"], *values, f"{one['step_us']:.0f}", f"{one['share_percent']:.1f} %")
    Console().print(table)


if __name__ == "__main__":
    main()
