"""Noise at full bus rate against the driver's receive path: nothing crashes, nothing wrong is believed.

A bus of plain lists stands in for the adapter, so that ten seconds of a full bus take seconds of processor time. The
frames are those that a filterless adapter could pass on: any identifier, any length, error frames.
"""

from __future__ import annotations

import random
from collections import deque

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import VirtualClock
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.simple_arm import SimpleArm
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm
from drivers.wam.fault_table import ArmFault
from drivers.wam.frames import RawFrame
from drivers.wam.parameters import load_wam_parameters
from drivers.wam.watch import ArmWatch

PARAMETERS = load_wam_parameters()
PERIOD_NS = 2_000_000
CYCLES = 5000
FRAMES_A_CYCLE = 24
"""A full bus carries some 34 frames in 2 ms; ten of them are the cycle's own."""


class NoisyBus:
    """Hands out what the test puts into it; while the arm is started, a simulated arm answers."""

    def __init__(self, clock: VirtualClock) -> None:
        wam = SimulatedWam(SimpleArm(PARAMETERS, np.zeros(7)), PARAMETERS, zeroed=True)
        self._starting: MemoryCanBus | None = MemoryCanBus(MemoryCanHub([wam]), clock)
        self.frames: deque[RawFrame] = deque()
        self.replies: list[RawFrame] = []

    def begin(self) -> None:
        self._starting = None

    def send(self, message: can.Message) -> None:
        assert self._starting is not None
        self._starting.send(message)

    def receive(self, deadline_ns: int) -> can.Message | None:
        assert self._starting is not None
        return self._starting.receive(deadline_ns)

    def send_frame(self, identifier: int, data: bytes) -> None:
        if identifier == 0x404:
            self.frames.extend(self.replies)
            self.replies = []

    def receive_frame(self, deadline_ns: int) -> RawFrame | None:
        return self.frames.popleft() if self.frames else None

    def close(self) -> None: ...


def true_replies(counts: int) -> list[RawFrame]:
    return [(0x403 | node << 5, (counts % 2**22).to_bytes(3, "big")) for node in range(1, 8)]


def noise(chance: random.Random, identifiers: list[int] | None) -> RawFrame:
    identifier = chance.choice(identifiers) if identifiers else chance.randrange(0x800)
    if not identifiers and chance.random() < 0.05:
        identifier = 0x20000000 | 1 << chance.randrange(9)
    return identifier, chance.randbytes(chance.randrange(9))


@pytest.mark.parametrize(
    ("identifiers", "told"),
    [
        (None, {ArmFault.BUS_OFF}),
        ([0x403 | node << 5 for node in range(1, 8)], {ArmFault.MALFORMED_FLOOD, ArmFault.POSITION_JUMP}),
        ([0x406 | node << 5 for node in (*range(1, 8), 10)], {ArmFault.MALFORMED_FLOOD}),
        ([0x540, 0x401, 0x402, 0x400], {ArmFault.FOREIGN_TORQUE, ArmFault.MALFORMED_FLOOD, ArmFault.MODE_RAISED}),
    ],
    ids=["any", "positions", "properties", "orders"],
)
def test_ten_seconds_of_noise(identifiers: list[int] | None, told: set[ArmFault]) -> None:
    """Protects the arm: what is read is true to a few counts or not called complete, and the noise has a name."""
    clock = VirtualClock()
    bus = NoisyBus(clock)
    arm = Arm(bus, clock, PARAMETERS)
    arm.start()
    bus.begin()
    chance = random.Random(7)
    complete, faults = 0, set()
    unit = np.abs(np.array([1 / 42, 1 / 28.25, 1.68 / 28.25, 1 / 18, 1 / 9.7, 1 / 9.7, 1 / 14.93])) * 2 * np.pi / 4096
    clock.advance_to_ns(clock.now_ns() // PERIOD_NS * PERIOD_NS)
    for cycle in range(CYCLES):
        clock.advance_to_ns(clock.now_ns() // PERIOD_NS * PERIOD_NS + PERIOD_NS)
        counts = cycle % 200  # a slow motion
        frames = [noise(chance, identifiers) for _ in range(FRAMES_A_CYCLE)]
        bus.frames.extend(frames[:4])
        truth = true_replies(counts)
        bus.replies = sorted([*frames[4:], *truth], key=lambda frame: chance.random() if frame in truth else 0.9)
        arm.request_positions()
        now_ns = clock.now_ns()
        sample = arm.collect_positions(now_ns + 1_400_000)
        assert np.isfinite(sample.joint_rad).all()
        if sample.complete and cycle % 200 > 5:
            complete += 1
            # A frame that happens to hold a plausible count is a position; within a quarter turn nothing tells.
            assert np.all(np.abs(sample.joint_rad) <= unit * (1024 + 200))
        fault = arm.fault(sample)
        if fault is not None:
            faults.add(fault.code)
    assert complete > 0
    assert faults & told


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 0x3FFFFFFF), st.binary(max_size=8)), max_size=30))
def test_nothing_that_is_heard_raises(frames: list[RawFrame]) -> None:
    """Law: the watch takes any identifier and any bytes, and counts what it cannot read."""
    watch = ArmWatch()
    for identifier, data in frames:
        watch.notice(identifier, data)
    assert watch.malformed + watch.unknown + watch.error_frames <= len(frames)


@settings(max_examples=200, deadline=None)
@given(st.sampled_from([0x546, 0x426, 0x4E6, 0x540]), st.integers(0, 127), st.integers(-(2**31), 2**31 - 1))
def test_any_property_value_is_borne(identifier: int, number: int, value: int) -> None:
    """Law: a property of any number and value changes what is known or is counted as malformed; MODE 3 is no mode."""
    watch = ArmWatch()
    watch.notice(identifier, bytes((0x80 | number, 0)) + value.to_bytes(4, "little", signed=True))
    assert watch.malformed <= 1
    if (identifier, number) == (0x546, 8):
        assert watch.malformed == (value not in (0, 1, 2))
