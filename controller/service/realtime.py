"""What a process asks of Linux before it enters its loop: priority, place, memory, clock (design 2).

Nothing here fails hard: on a machine that does not allow a step the process runs on without it, and the report says
which step was refused, why, and what would allow it. Every step is read back where the kernel lets it be.
Source: real-time-python reference 4a (what each step brings) and 4d.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

_MCL_CURRENT, _MCL_FUTURE = 1, 2  # <sys/mman.h>
_PR_SET_PDEATHSIG, _PR_GET_PDEATHSIG = 1, 2  # <sys/prctl.h>
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_LATENCY_FILE = "/dev/cpu_dma_latency"


@dataclass(frozen=True)
class RealtimeSettings:
    """What to ask for; None or False leaves a step out."""

    priority: int | None = None
    """SCHED_FIFO priority, 1 to 99; children do not inherit it."""
    cpu: int | None = None
    """Processor to be pinned to."""
    lock_memory: bool = False
    """Keep all memory, present and future, in RAM."""
    timer_slack_ns: int | None = 1
    """How late a sleep under ordinary scheduling may end; Linux's own is 50 000."""
    freeze_garbage: bool = False
    """Collect once, then never again. For a loop that makes no reference cycles."""
    cpu_latency_us: int | None = None
    """Longest wake-up latency of idle processors, for as long as the report lives."""
    parent: int | None = None
    """Process id of the parent: SIGTERM comes when it ends, or the thread of it that started this process."""


@dataclass(frozen=True)
class Step:
    """One step: what was asked, whether it was achieved, and the value now or the reason why not."""

    name: str
    achieved: bool
    detail: str

    def __str__(self) -> str:
        return f"{self.name}: {'' if self.achieved else 'refused, '}{self.detail}"


@dataclass
class RealtimeReport:
    """All steps asked for, in order. Holds the latency file open: keep the report as long as the loop runs."""

    steps: list[Step] = field(default_factory=list)
    _latency_fd: int = -1

    @property
    def refused(self) -> list[Step]:
        """The steps that were not achieved."""
        return [step for step in self.steps if not step.achieved]

    def close(self) -> None:
        """Give the latency request back; the other steps hold until the process ends."""
        if self._latency_fd >= 0:
            os.close(self._latency_fd)
            self._latency_fd = -1


def enter_realtime(settings: RealtimeSettings) -> RealtimeReport:
    """Ask for all of `settings`, for the calling thread or its process. Never raises for a refusal."""
    report = RealtimeReport()

    def attempt(name: str, act: Callable[[], str], cure: str) -> None:
        try:
            report.steps.append(Step(name, True, act()))
        except OSError as error:
            report.steps.append(Step(name, False, f"{error.strerror or error}; {cure}"))

    if settings.parent is not None:
        parent = settings.parent
        attempt("end with the parent", lambda: _end_with(parent), "the parent has to start it again")
    if settings.cpu is not None:
        cpu = settings.cpu
        attempt("processor", lambda: _pin(cpu), f"allowed are {sorted(os.sched_getaffinity(0))}")
    if settings.lock_memory:
        attempt("memory lock", _lock_memory, "allow it with LimitMEMLOCK=infinity")
    if settings.timer_slack_ns is not None:
        slack_ns = settings.timer_slack_ns
        attempt("timer slack", lambda: _set_timer_slack(slack_ns), "the kernel is too old")
    if settings.cpu_latency_us is not None:
        latency_us = settings.cpu_latency_us
        attempt("idle latency", lambda: _hold_latency(report, latency_us), f"give write access to {_LATENCY_FILE}")
    if settings.freeze_garbage:
        attempt("garbage collector", _freeze_garbage, "")
    if settings.priority:
        priority = settings.priority
        attempt("priority", lambda: _set_priority(priority), "allow it with LimitRTPRIO=90")
    return report


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def _end_with(parent: int) -> str:
    libc = _libc()
    _checked(libc.prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGTERM), 0, 0, 0))
    read_back = ctypes.c_int()
    _checked(libc.prctl(_PR_GET_PDEATHSIG, ctypes.byref(read_back), 0, 0, 0))
    if os.getppid() != parent:  # it died before the request was made, so no signal will come
        raise OSError(0, f"the parent {parent} has already gone")
    return signal.Signals(read_back.value).name


def _pin(cpu: int) -> str:
    try:
        os.sched_setaffinity(0, {cpu})
    except (ValueError, OverflowError) as error:
        raise OSError(0, f"there is no processor {cpu}") from error
    return f"on {sorted(os.sched_getaffinity(0))}"


def _lock_memory() -> str:
    _checked(_libc().mlockall(_MCL_CURRENT | _MCL_FUTURE))
    return "present and future"


def _set_timer_slack(slack_ns: int) -> str:
    libc = _libc()
    _checked(libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), 0, 0, 0))
    return f"{_checked(libc.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0))} ns"


def _hold_latency(report: RealtimeReport, latency_us: int) -> str:
    fd = os.open(_LATENCY_FILE, os.O_WRONLY | os.O_CLOEXEC)
    try:
        os.write(fd, struct.pack("=i", latency_us))
    except OSError:
        os.close(fd)
        raise
    report._latency_fd = fd
    return f"{latency_us} µs"


def _freeze_garbage() -> str:
    gc.collect()
    gc.freeze()
    gc.disable()
    return f"{gc.get_freeze_count()} objects frozen, collection off"


def _set_priority(priority: int) -> str:
    lowest, highest = os.sched_get_priority_min(os.SCHED_FIFO), os.sched_get_priority_max(os.SCHED_FIFO)
    if not lowest <= priority <= highest:
        raise OSError(0, f"{priority} is not from {lowest} to {highest}")
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_FIFO:
        raise OSError(0, "the kernel kept ordinary scheduling")
    return f"SCHED_FIFO {os.sched_getparam(0).sched_priority}"


def thaw_garbage() -> None:
    """Collect what was frozen: compiled libraries complain of objects that are still there when the process ends."""
    gc.unfreeze()
    gc.enable()
    gc.collect()
