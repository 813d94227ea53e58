"""The cycle's process: real time from Linux, the CAN bus, the links, and then one `step` a period.

It ends when the front asks for it, dies, or a SIGTERM comes: each time along the path, then idle. It is never ended by
its own links: what the front does not read any more is counted, and taken for the front's end.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from controller.config import RobotConfig
from controller.cycle.cycle import Cycle, CycleLinks, Parts
from controller.cycle.safety import SafetyLimits, SafetyMonitor
from controller.messages import CommandKind, CycleCommand
from controller.service.assembly import arm_parameters, cycle_parts
from controller.service.assignment import Assignment
from controller.service.beginning import find, wait_for_go
from controller.service.lifeline import Lifeline, Word
from controller.service.links import (
    LatestReader,
    LatestSender,
    LinkClosed,
    LinkFull,
    OrderedReader,
    OrderedSender,
    SocketLink,
)
from controller.service.realtime import RealtimeReport, RealtimeSettings, enter_realtime
from controller.service.stop_requests import StopRequests
from drivers.clock import Clock, MonotonicClock, nanoseconds
from drivers.wam.arm import Arm, ArmSample
from drivers.wam.bus import PythonCanBus, open_can

LONGEST_STOP_S = 5.0
"""A cycle that cannot come to rest, because its bus is dead, does not stay behind."""
SIMULATED_PAUSE_S = 0.3
"""A simulated arm stands still while its process waits for a processor; neither that it is silent nor that it did not
move is a fault before this. On virtual time, where nothing waits, the limits are those of hardware."""


class SurvivingEvents(OrderedSender):
    """Events to a front that may have died: `lost` then turns true, and the cycle goes on to its end."""

    lost = False

    def send_fds(self, payload: bytes, descriptors: Sequence[int], sample_ns: int, kind: int = 0) -> int:
        try:
            return super().send_fds(payload, descriptors, sample_ns, kind)
        except (LinkClosed, LinkFull):
            self.lost = True
            return -1


class SimulatedArm(Arm):
    """A simulated arm on a shared machine: its replies are late as often as its process has to wait.

    Positions of different times do not make joint angles, so an incomplete reading is passed over for the last complete
    one, with the time of that; the joint control then lets its last torque stand.
    """

    _complete: ArmSample | None = None

    def collect_positions(self, deadline_ns: int) -> ArmSample:
        sample = super().collect_positions(deadline_ns)
        if sample.complete:
            self._complete = sample
        elif self._complete is not None:
            return replace(sample, joint_rad=self._complete.joint_rad, sample_ns=self._complete.sample_ns)
        return sample


def run_cycle(assignment: Assignment, lifeline: Lifeline, stop: StopRequests) -> int:
    """Run the cycle to its end; the exit code."""
    config, clock = assignment.config, MonotonicClock()
    front = SocketLink.from_fileno(assignment.descriptors["commands"])
    hand = SocketLink.from_fileno(assignment.descriptors["hand"])
    records = SocketLink.from_fileno(assignment.descriptors["records"])
    if not wait_for_go(lifeline, stop):
        return 0
    events = SurvivingEvents(front)
    links = CycleLinks(OrderedReader(front), events, LatestSender(records), LatestReader(hand), LatestSender(hand))
    bus = open_can(config.arm.interface, config.arm.channel, clock)
    try:
        parts = _parts(config, bus, clock, assignment.simulated)
        cycle = Cycle(clock, links, parts, processor_time_ns=time.thread_time_ns)
        find(cycle.start, assignment.simulated)
        report = _enter_realtime(config, assignment.simulated)
        for step in report.refused:
            lifeline.say(Word.SAID, f"the cycle runs without {step.name}: {step.detail}")
        lifeline.say(Word.READY)
        cycle.pacer.restart()
        return _loop(cycle, parts, events, stop, clock)
    finally:
        bus.close()


def _loop(cycle: Cycle, parts: Parts, events: SurvivingEvents, stop: StopRequests, clock: Clock) -> int:
    orders, deadline_ns = parts.orders, 0
    while not cycle.finished:
        cycle.pacer.wait()
        cycle.step()
        if orders.shutting_down:
            deadline_ns = deadline_ns or clock.now_ns() + nanoseconds(LONGEST_STOP_S)
            if clock.now_ns() > deadline_ns:
                return 1
        elif stop.received is not None or events.lost:
            orders.take(CycleCommand(CommandKind.SHUTDOWN, 0))
    return 0


def _parts(config: RobotConfig, bus: PythonCanBus, clock: Clock, simulated: bool) -> Parts:
    parts = cycle_parts(config, bus, clock)
    if simulated:
        limits = SafetyLimits(
            offset_m=config.compensation.max_offset_m,
            offset_rad=config.compensation.max_offset_rad,
            silent_cycles=round(SIMULATED_PAUSE_S / config.cycle.period_s),
            residual_time_s=SIMULATED_PAUSE_S,
        )
        parts.arm = SimulatedArm(bus, clock, arm_parameters(config))
        parts.safety = SafetyMonitor(limits, config.cycle.period_s)
    return parts


def _enter_realtime(config: RobotConfig, simulated: bool) -> RealtimeReport:
    return enter_realtime(
        RealtimeSettings(
            priority=config.cycle.priority,
            cpu=config.cycle.cpu,
            lock_memory=not simulated,  # a simulation is a guest on its machine
            cpu_latency_us=None if simulated else 0,
            freeze_garbage=True,
        )
    )
