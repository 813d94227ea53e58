"""The hand's process: the tendon motors' serial line, exchanged with once a period.

It outlives the cycle by a moment: it ends once the front wants it to and the cycle has gone, and then leaves both
motors holding what they hold. It never opens the hand.
"""

from __future__ import annotations

import contextlib
import sys

from controller.service.assembly import hand_settings, tendon_motors
from controller.service.assignment import Assignment
from controller.service.beginning import find, wait_for_go
from controller.service.hand import HandPart
from controller.service.lifeline import Lifeline, Word
from controller.service.links import LatestReader, LatestSender, SocketLink
from controller.service.realtime import RealtimeSettings, enter_realtime
from controller.service.stop_requests import StopRequests
from drivers.clock import MonotonicClock, nanoseconds
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.discovery import reply_margin_s
from drivers.dynamixel.motor import MotorIdentity
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.reopening_line import ReopeningLine
from drivers.dynamixel.tendons import TendonPair

LONGEST_END_S = 6.0
"""How long the cycle may take to stop once the front has gone."""
SIMULATED_REPLY_MARGIN_S = 0.02
"""A simulated motor on a shared machine may answer later than a real one through its USB adapter."""
_BELOW_CYCLE = 15
"""Drivers run below the cycle's priority (real-time-python reference 4d)."""


def run_hand(assignment: Assignment, lifeline: Lifeline, stop: StopRequests) -> int:
    """Run the hand to its end; the exit code."""
    config, clock = assignment.config, MonotonicClock()
    cycle = SocketLink.from_fileno(assignment.descriptors["cycle"])
    if not wait_for_go(lifeline, stop):
        return 0
    tendons = config.tendons
    serial_line = SerialLine(tendons.port, tendons.baud)
    line = ReopeningLine(serial_line, lambda: SerialLine(tendons.port, tendons.baud), clock)
    try:
        if serial_line.advice:
            lifeline.say(Word.WARNING, f"latency_timer\n{serial_line.advice}")
        margin_s = SIMULATED_REPLY_MARGIN_S if assignment.simulated else reply_margin_s(serial_line.latency_timer_ms)
        port = WaitingPort(line, clock, baud=tendons.baud, reply_margin_s=margin_s)
        pair = TendonPair(port, clock, tendon_motors(config))
        hand = HandPart(clock, pair, LatestReader(cycle), LatestSender(cycle), hand_settings(config))
        find(hand.start, assignment.simulated)
        for identity in pair.identities:
            _say(_introduction(identity))
        _warn(hand, lifeline)
        priority = config.cycle.priority - _BELOW_CYCLE
        enter_realtime(RealtimeSettings(priority=priority if priority > 0 else None, freeze_garbage=True))
        lifeline.say(Word.READY)
        end_ns = 0
        while not (end_ns and (cycle.closed or clock.now_ns() > end_ns)):
            clock.sleep_until_ns(hand.pacer.deadline_ns)
            hand.step()
            _warn(hand, lifeline)
            if not end_ns and (stop.received is not None or lifeline.closed):
                end_ns = clock.now_ns() + nanoseconds(LONGEST_END_S)
        hand.stop()
        return 0
    finally:
        line.close()


def _introduction(motor: MotorIdentity) -> str:
    """Who a motor is and how it was found, for the journal."""
    how = "holds already and is taken over as it is" if motor.adopted else "was off and now holds where it stands"
    if motor.refusal:
        how = f"is left as it is and takes no set-points, as it {motor.refusal.removesuffix('.')}"
    watched = "" if motor.protocol == 2 else "; it has no bus watchdog, so that it goes on holding if this process dies"
    return (
        f"tendon motor {motor.motor_id} is a {motor.model_name}, firmware {motor.firmware}, protocol "
        f"{motor.protocol}.0; it {how}{watched}; it lets go on {motor.shuts_down_on}."
    )


def _warn(hand: HandPart, lifeline: Lifeline) -> None:
    """Let the front tell what there is to know of the motors."""
    for text in hand.take_warnings():
        lifeline.say(Word.WARNING, f"hand_motor\n{text}")


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        print(f"stillgrasp: {text}", file=sys.stderr, flush=True)
