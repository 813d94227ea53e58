"""The tactile process: owns the TakkTile bridge; only started where pads are configured.

Without it everything else goes on: contact is then found by the motors' load. A bridge must be there when it starts;
one that goes later is opened again.
"""

from __future__ import annotations

from controller.service.assignment import Assignment
from controller.service.beginning import wait_for_go
from controller.service.lifeline import Lifeline, Word
from controller.service.links import LatestReader, LatestSender, SocketLink
from controller.service.realtime import RealtimeSettings, enter_realtime
from controller.service.stop_requests import StopRequests
from controller.service.tactile import LONGEST_SILENCE_S, TactilePart
from controller.service.tactile_assembly import configured_pads, open_bridge
from drivers.clock import MonotonicClock
from drivers.errors import InputError
from drivers.takktile.touch import TouchSettings

SIMULATED_SILENCE_S = 3.0
"""A simulated bridge on a shared machine may have to wait for a processor."""
_BELOW_CYCLE = 20


def run_tactile(assignment: Assignment, lifeline: Lifeline, stop: StopRequests) -> int:
    """Run the pads to their end; the exit code."""
    config, clock = assignment.config, MonotonicClock()
    tactile = config.tactile
    if tactile is None:
        raise InputError("no tactile pads are configured.", help="Fill in [tactile] of robot.toml.")
    cycle = SocketLink.from_fileno(assignment.descriptors["cycle"])
    front = SocketLink.from_fileno(assignment.descriptors["pads"])
    if not wait_for_go(lifeline, stop):
        return 0
    part = TactilePart(
        clock,
        lambda: open_bridge(tactile, clock),
        configured_pads(tactile),
        LatestReader(cycle),
        LatestSender(cycle),
        LatestSender(front),
        period_s=tactile.period_s,
        touch=TouchSettings(tactile.touch_N, tactile.release_N),
        say=lambda text: _said(lifeline, text),
        longest_silence_s=SIMULATED_SILENCE_S if assignment.simulated else LONGEST_SILENCE_S,
    )
    try:
        part.start()
        priority = config.cycle.priority - _BELOW_CYCLE
        enter_realtime(RealtimeSettings(priority=priority if priority > 0 else None, freeze_garbage=True))
        lifeline.say(Word.READY)
        while stop.received is None and not lifeline.closed:
            part.step()
            stop.drain()
        return 0
    finally:
        part.stop()


def _said(lifeline: Lifeline, text: str) -> None:
    lifeline.say(Word.SAID, text)
