"""Fault scripts: what goes wrong with a simulated bus or device, when, and for how long.

A script is a list of faults; each begins at a time, at an event or at the n-th frame, and lasts for a time or for a
number of frames. What an action does is the device's: `can_faults.py` has those of a CAN bus, `arm_faults.py` those of
the simulated WAM. `Schedule` runs the times; it is told of frames and events and has no other source of chance than
the script's seed. Times in ns of the simulation, in the script in s. Same script, same calls: same faults.

    seed = 7
    [[fault]]
    on = "active"                                   # half a second after Shift-Activate,
    at_s = 0.5
    for_s = 0.1                                     # for a tenth of a second,
    chance = 0.3                                    # three in ten
    action = { kind = "drop", node = 3 }            # of puck 3's frames are lost
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Annotated, Generic, Literal, TypeVar

import msgspec
from msgspec import Meta

from drivers.clock import nanoseconds
from drivers.errors import InputError

A = TypeVar("A")

START = "start"
"""The event from which faults without another are timed: the first moment of the simulation."""
Edge = Literal["begin", "end"]
_Time = Annotated[float, Meta(ge=0, le=1e6)]
_Duration = Annotated[float, Meta(gt=0, extra={"infinite": True})]
_Count = Annotated[int, Meta(ge=1)]


class Fault(msgspec.Struct, Generic[A], frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """One fault. Frame actions without `for_s` and `for_frames` concern one frame; lasting ones then never end."""

    action: A
    name: str = ""
    """For the reader, and for messages about this fault."""
    on: str = START
    """Event after which it is timed, at its first occurrence."""
    at_s: _Time = 0.0
    """When it begins, after `on`."""
    at_frame: _Count | None = None
    """Begin with the n-th frame after that; of the frames that the action concerns, or else of all."""
    for_s: _Duration | None = None
    for_frames: _Count | None = None
    chance: Annotated[float, Meta(gt=0, le=1)] = 1.0
    """Share of the frames that a frame action strikes, drawn from the script's seed."""


class FaultScript(msgspec.Struct, Generic[A], frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Faults in the order in which those that concern the same frame act on it."""

    seed: Annotated[int, Meta(ge=0)] = 0
    faults: tuple[Fault[A], ...] = msgspec.field(name="fault", default=())


class Running(Generic[A]):
    """One fault of a script while it runs."""

    def __init__(self, fault: Fault[A], index: int, seed: int, is_frame_action: bool) -> None:
        self.action = fault.action
        self.label = label(index, fault.name)
        self.random = random.Random(f"{seed}/{index}")
        self.is_frame_action = is_frame_action
        self._fault = fault
        self._armed_ns: int | None = None
        self._begin_ns: int | None = None
        self._seen = self._struck = 0
        self._most = fault.for_frames or (1 if is_frame_action and fault.for_s is None else None)

    def arm(self, event: str, now_ns: int) -> None:
        """Hear of an event; only the first of its kind counts."""
        if self._armed_ns is None and event == self._fault.on:
            self._armed_ns = now_ns + nanoseconds(self._fault.at_s)
            if self._fault.at_frame is None:
                self._begin_ns = self._armed_ns

    @property
    def begin_ns(self) -> int | None:
        """When it begins; None as long as that is not known."""
        return self._begin_ns

    @property
    def end_ns(self) -> int | None:
        """When it ends; None as long as that is not known, or never."""
        duration_s = self._fault.for_s
        if self._begin_ns is None or duration_s is None or duration_s == float("inf"):
            return None
        return self._begin_ns + nanoseconds(duration_s)

    def count(self, now_ns: int) -> None:
        """A frame passes that concerns it: perhaps the one with which it begins."""
        if self._begin_ns is None and self._armed_ns is not None and now_ns >= self._armed_ns:
            self._seen += 1
            if self._seen == self._fault.at_frame:
                self._begin_ns = now_ns

    def strikes(self, now_ns: int) -> bool:
        """Whether a frame action acts on the frame that passes now; it is counted."""
        self.count(now_ns)
        if self._begin_ns is None or now_ns < self._begin_ns or (self._most is not None and self._struck >= self._most):
            return False
        end_ns = self.end_ns
        if (end_ns is not None and now_ns >= end_ns) or self.random.random() >= self._fault.chance:
            return False
        self._struck += 1
        return True


class Schedule(Generic[A]):
    """The faults of a script in time. Raises InputError for a combination that means nothing.

    `frame_actions` act on single frames, `instants` have no duration; all others last. `events`: what faults may wait
    for.
    """

    def __init__(
        self,
        script: FaultScript[A],
        frame_actions: tuple[type, ...],
        instants: tuple[type, ...],
        events: tuple[str, ...],
        start_ns: int,
    ) -> None:
        self._seed = script.seed
        self._frame_actions, self._instants, self._events = frame_actions, instants, (START, *events)
        self.running: list[Running[A]] = []
        self.frame_faults: list[Running[A]] = []
        """Those whose action acts on single frames."""
        self._waiting: list[Running[A]] = []
        self._lasting: list[Running[A]] = []
        self._counting: list[Running[A]] = []
        for fault in script.faults:
            self.add(fault)
        self.notice(START, start_ns)

    def add(self, fault: Fault[A]) -> Running[A]:
        """Take one more fault; its `START` is the next of which `notice` is told."""
        running = Running(fault, len(self.running), self._seed, isinstance(fault.action, self._frame_actions))
        self._check(fault, running)
        self.running.append(running)
        (self.frame_faults if running.is_frame_action else self._waiting).append(running)
        if fault.at_frame is not None and not running.is_frame_action:
            self._counting.append(running)
        return running

    def notice(self, event: str, now_ns: int) -> None:
        """Something has happened that faults may wait for."""
        for one in self.running:
            one.arm(event, now_ns)

    def count_frame(self, now_ns: int) -> None:
        """A frame passes, whatever it is."""
        for one in self._counting:
            one.count(now_ns)

    def next_ns(self) -> int | None:
        """When something but a frame action begins or ends next, as far as that is known."""
        times = [one.begin_ns for one in self._waiting if one.begin_ns is not None]
        times += [one.end_ns for one in self._lasting if one.end_ns is not None]
        return min(times, default=None)

    def due(self, now_ns: int) -> Iterator[tuple[int, Edge, Running[A]]]:
        """What begins and ends by `now_ns`, in order of time; ends before beginnings, then in the script's order."""
        while (time_ns := self.next_ns()) is not None and time_ns <= now_ns:
            ending = next((one for one in self._lasting if one.end_ns == time_ns), None)
            if ending is not None:
                self._lasting.remove(ending)
                yield time_ns, "end", ending
                continue
            beginning = next(one for one in self._waiting if one.begin_ns == time_ns)
            self._waiting.remove(beginning)
            if not isinstance(beginning.action, self._instants):
                self._lasting.append(beginning)
            yield time_ns, "begin", beginning

    def check_actions(self, check: Callable[[A], None]) -> None:
        """Have every action checked by what it is for; an InputError names the fault."""
        for one in self.running:
            try:
                check(one.action)
            except InputError as error:
                raise InputError(f"{one.label}: {error.message}", help=error.help) from error

    def _check(self, fault: Fault[A], running: Running[A]) -> None:
        if fault.on not in self._events:
            known = ", ".join(self._events)
            raise InputError(f"{running.label}: on = {fault.on!r} is no event; expected one of {known}.")
        if isinstance(fault.action, self._instants) and fault.for_s is not None:
            raise InputError(f"{running.label}: for_s = {fault.for_s} means nothing; this action is a moment.")
        if not running.is_frame_action and (fault.for_frames is not None or fault.chance != 1.0):
            raise InputError(f"{running.label}: for_frames and chance belong to actions on frames.", help="Use for_s.")


def label(index: int, name: str) -> str:
    """How messages name a fault of a script."""
    return f"fault {index + 1}" + (f" ({name})" if name else "")
