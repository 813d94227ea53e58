"""The cycle's process: real time from Linux, the CAN bus, the links, and then one `step` a period.

It ends when the front asks for it, dies, or a SIGTERM comes: each time along the path, then idle. It is never ended by
its own links: what the front does not read any more is counted, and taken for the front's end.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from controller.config import RobotConfig
from controller.cycle.attentive_clock import AttentiveClock
from controller.cycle.cycle import Cycle, CycleLinks, Parts
from controller.cycle.pads import PadWatch
from controller.cycle.safety import SafetyMonitor
from controller.messages import CommandKind, CycleCommand
from controller.service.assembly import arm_parameters, cycle_parts, safety_limits
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
from drivers.wam.arm import Arm, ReadingOptions
from drivers.wam.bus import PythonCanBus, open_can
from drivers.wam.startup import Operator, Prompt

LONGEST_STOP_S = 5.0
"""A cycle that cannot come to rest, because its bus is dead, does not stay behind."""
SIMULATED_PAUSE_S = 0.3
"""A simulated arm stands still while its process waits for a processor; neither that it is silent nor that it did not
move is a fault before this. On virtual time, where nothing waits, the limits are those of hardware."""
SIMULATED_READING = ReadingOptions(extrapolated_cycles=0, repeat=False, late_is_fault=False)
"""Its replies are late as often as its process has to wait: carrying its motion on would invent one, and asking again
would keep it longer. The last whole reading stands, with its own time, and the joint control lets its torque stand."""
LONGEST_OPERATOR_WAIT_S = 600.0
"""For E-stop to be released, or Shift+Idle to be pressed, when the daemon starts."""


class SurvivingEvents(OrderedSender):
    """Events to a front that may have died: `lost` then turns true, and the cycle goes on to its end."""

    lost = False

    def send_fds(self, payload: bytes, descriptors: Sequence[int], sample_ns: int, kind: int = 0) -> int:
        try:
            return super().send_fds(payload, descriptors, sample_ns, kind)
        except (LinkClosed, LinkFull):
            self.lost = True
            return -1


def run_cycle(assignment: Assignment, lifeline: Lifeline, stop: StopRequests) -> int:
    """Run the cycle to its end; the exit code."""
    config, clock = assignment.config, AttentiveClock(MonotonicClock())
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
        operator = Operator(
            on_prompt=lambda prompt: _prompt(lifeline, prompt),
            wait_s=LONGEST_OPERATOR_WAIT_S,
            still_wanted=lambda: stop.received is None and not lifeline.closed and not parts.orders.shutting_down,
        )

        def say(text: str) -> None:
            lifeline.say(Word.SAID, text)

        if "tactile" in assignment.descriptors:
            tactile = SocketLink.from_fileno(assignment.descriptors["tactile"])
            parts.grasping.pads = PadWatch(LatestReader(tactile), LatestSender(tactile))
        cycle = Cycle(clock, links, parts, time.thread_time_ns, operator, say)
        find(cycle.start, assignment.simulated)
        lifeline.say(Word.MOTORS, str(cycle.motor_firmware))
        report = _enter_realtime(config, assignment.simulated)
        for step in report.refused:
            lifeline.say(Word.SAID, f"the cycle runs without {step.name}: {step.detail}")
        lifeline.say(Word.READY)
        cycle.pacer.restart()
        return _loop(cycle, parts, events, stop, clock)
    finally:
        bus.close()


def _prompt(lifeline: Lifeline, prompt: Prompt) -> None:
    lifeline.say(Word.PROMPT, f"{prompt.kind.value}\n{prompt.text}")


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
        limits = replace(
            safety_limits(config),
            silent_cycles=round(SIMULATED_PAUSE_S / config.cycle.period_s),
            residual_time_s=SIMULATED_PAUSE_S,
        )
        parts.arm = Arm(bus, clock, arm_parameters(config), SIMULATED_READING)
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
