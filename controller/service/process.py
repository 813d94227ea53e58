"""Where a child process begins: `python -m controller.service.process ROLE`, started by the front alone.

It takes its assignment from standard input, ties its life to the front's, loads what its role needs, waits for GO, and
runs its role until it is over. What goes wrong is told over the lifeline, in one sentence.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable

from controller.service.assignment import Assignment, Role, read_assignment
from controller.service.lifeline import Lifeline, Word
from controller.service.links import SocketLink
from controller.service.realtime import RealtimeSettings, enter_realtime, thaw_garbage
from controller.service.stop_requests import StopRequests
from drivers.clock import MonotonicClock
from drivers.errors import StillgraspError

Run = Callable[[Assignment, Lifeline, StopRequests], int]


def main() -> int:
    """Run one child; its exit code."""
    if len(sys.argv) != 2 or sys.stdin.isatty():
        print("stillgrasp: this is a part of `stillgrasp run`, which starts it by itself.", file=sys.stderr)
        return 2
    # The front ends its children in order; Ctrl-C is for the front.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assignment = read_assignment(sys.stdin.buffer)
    parent = enter_realtime(RealtimeSettings(parent=assignment.parent, timer_slack_ns=None))
    if os.getppid() != assignment.parent or parent.refused:
        return 1
    lifeline = Lifeline(SocketLink.from_fileno(assignment.descriptors["front"]), MonotonicClock())
    try:
        run = _runner(assignment.role)
        with StopRequests(keyboard=False) as stop:
            code = run(assignment, lifeline, stop)
        thaw_garbage()
        return code
    except StillgraspError as error:
        lifeline.say(Word.FAILED, str(error))
        return 1
    except ModuleNotFoundError as error:
        lifeline.say(Word.FAILED, f"{error}. A simulation needs the extra `sim`: pip install stillgrasp[sim]")
        return 1


def _runner(role: Role) -> Run:
    """The role's code, of which only this process needs the libraries."""
    if role == "cycle":
        from controller.service.cycle_process import run_cycle

        return run_cycle
    if role == "hand":
        from controller.service.hand_process import run_hand

        return run_hand
    if role == "tactile":
        from controller.service.tactile_process import run_tactile

        return run_tactile
    from controller.simulation.world_process import run_world

    return run_world


if __name__ == "__main__":
    sys.exit(main())
