"""Real-time set-up: each step is checked against what the kernel says, in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

PROLOGUE = """
import ctypes, gc, json, os, resource, signal, sys
from pathlib import Path
from controller.service.realtime import RealtimeSettings, enter_realtime
def told(report, **more):
    steps = {step.name: [step.achieved, step.detail] for step in report.steps}
    print(json.dumps({"steps": steps, "refused": len(report.refused), **more}))
"""


def run(program: str) -> dict[str, Any]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", PROLOGUE + program],
        capture_output=True,
        text=True,
        timeout=30,
        env=environment,
        check=True,
    )
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_what_needs_no_privilege_is_achieved() -> None:
    """Timer slack, garbage collector, processor and the parent's death signal work for every user."""
    answer = run(
        "cpu = min(os.sched_getaffinity(0))\n"
        "report = enter_realtime(RealtimeSettings(cpu=cpu, freeze_garbage=True, parent=os.getppid()))\n"
        "death = ctypes.c_int(); ctypes.CDLL(None).prctl(2, ctypes.byref(death), 0, 0, 0)\n"
        "slack = ctypes.CDLL(None).prctl(30, 0, 0, 0, 0)\n"
        "status = dict(line.split(':', 1) for line in Path('/proc/self/status').read_text().splitlines())\n"
        "allowed = status['Cpus_allowed_list'].strip()\n"
        "told(report, slack=slack, gc=gc.isenabled(), death=death.value, allowed=allowed, cpu=cpu)"
    )
    assert answer["refused"] == 0
    assert (answer["slack"], answer["gc"], answer["death"]) == (1, False, 15)
    assert answer["allowed"] == str(answer["cpu"])


def test_every_refusal_is_told_with_its_cure_and_stops_nothing() -> None:
    """An unprivileged user, a missing processor and a dead parent leave a running process and a full report."""
    answer = run(
        "resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))\n"
        "resource.setrlimit(resource.RLIMIT_MEMLOCK, (4096, 4096))\n"
        "if os.getuid() == 0: os.setresgid(65534, 65534, 65534); os.setresuid(65534, 65534, 65534)\n"
        "asked = dict(priority=80, cpu=1000, lock_memory=True, cpu_latency_us=0, parent=1 << 22)\n"
        "told(enter_realtime(RealtimeSettings(**asked)))"
    )
    steps = answer["steps"]
    assert steps.pop("timer slack")[0]
    assert {name for name, (achieved, _) in steps.items() if not achieved} == {
        "priority", "processor", "memory lock", "idle latency", "end with the parent",
    }  # fmt: skip
    assert "LimitRTPRIO" in steps["priority"][1]
    assert "LimitMEMLOCK" in steps["memory lock"][1]
    assert "allowed are" in steps["processor"][1]
    assert "already gone" in steps["end with the parent"][1]


def test_children_do_not_inherit_the_priority() -> None:
    """A process that a real-time one starts runs under ordinary scheduling; an impossible priority is refused."""
    answer = run(
        "impossible = enter_realtime(RealtimeSettings(priority=1000)).refused\n"
        "report = enter_realtime(RealtimeSettings(priority=10))\n"
        "own, child = os.sched_getscheduler(0) & 15, os.fork()\n"
        "if child == 0: os._exit(os.sched_getscheduler(0) & 15)\n"
        "told(report, own=own, child=os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), impossible=len(impossible))"
    )
    assert answer["impossible"] == 1
    assert answer["own"] == (0 if answer["refused"] else os.SCHED_FIFO)
    assert answer["child"] == os.SCHED_OTHER
