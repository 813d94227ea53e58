"""The front: commands in, answers, events and state out; supervision of the cycle. A part like the others: one `step`.

It never waits and never commands the arm itself, with one exception: if the cycle dies or falls silent, the guard on a
second CAN socket asks the safety puck for idle, and the front says what it did.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any, Protocol

from calibration.motion_table import MotionTable
from controller.messages import CYCLE_RECORD, CycleCommand, CycleEvent, EventKind, Reason
from controller.reasons import EXPLANATIONS, as_error, named_values
from controller.service import commands as asked
from controller.service.answers import encode_error, encode_event, encode_reply, error_told
from controller.service.command_socket import Address, CommandPort
from controller.service.links import LatestReader, LinkError, OrderedReader, OrderedSender
from controller.service.progress import Progress
from controller.service.requests import Plan, Planner
from controller.service.state import state_map
from controller.service.table_shelf import TableShelf
from controller.service.tactile_watch import TactileWatch
from controller.service.telemetry import StateOutlet
from drivers.clock import NANOSECONDS, Clock, nanoseconds
from drivers.errors import CommandError, StillgraspError

REQUESTS_A_STEP = 16
HEARTBEAT_S = 0.02
STATE_RATE_HZ = 100.0
WARNINGS_KEPT = 20
_ATTENTION_NS = nanoseconds(0.01)
"""A step that comes later than this after the one before has not been listening in between."""


class RecordSink(Protocol):
    """Where every cycle and event is kept."""

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None: ...

    def event(self, event: dict[str, Any], time_ns: int) -> None: ...


@dataclass(frozen=True)
class FrontLinks:
    """The front's ends of its links to the cycle."""

    commands: OrderedSender
    events: OrderedReader
    records: LatestReader
    pads: LatestReader | None = None
    """The tactile pads', where there are any."""


@dataclass
class _Running:
    """A request on its way through the cycle."""

    identity: Address
    seq: int
    command: asked.Command
    plan: Plan
    replied: bool = False
    table: MotionTable | None = None
    progress: Progress | None = None
    """Of a slow command, from its acceptance on."""
    deadline_ns: int | None = None


@dataclass
class Outlets:
    """Where the front's output goes, and how it idles the arm of a dead cycle."""

    socket: CommandPort
    publisher: StateOutlet | None = None
    recorder: RecordSink | None = None
    idle_arm: Callable[[], str] | None = None
    say: Callable[[str], None] = field(default=lambda text: None)
    wall_time_s: Callable[[], float] = field(default=time.time)
    record_pads: Callable[[dict[str, Any], int], None] | None = None
    """Keeps a frame of the tactile pads, as of a time."""


class Front:
    """Serves clients and watches the cycle."""

    def __init__(
        self,
        clock: Clock,
        links: FrontLinks,
        outlets: Outlets,
        planner: Planner,
        shelf: TableShelf,
        *,
        heartbeat_s: float = HEARTBEAT_S,
        state_rate_hz: float = STATE_RATE_HZ,
    ) -> None:
        self._clock, self._links, self._out = clock, links, outlets
        self._planner, self._shelf = planner, shelf
        self._tactile = None if links.pads is None else TactileWatch(links.pads, self.tell, outlets.record_pads)
        self._running: dict[int, _Running] = {}
        self._clients: dict[Address, None] = {}  # in order of their coming: events go out in the same order every time
        self._next_token = 1
        self._record: dict[str, Any] | None = None
        self._record_ns = 0
        self._last_step_ns = 0
        self._silence_ns = 0
        self._heartbeat_ns = nanoseconds(heartbeat_s)
        self._next_state_ns = 0
        self._state_period_ns = round(NANOSECONDS / state_rate_hz)
        self.cycle_lost = ""
        self.hand_lost = ""
        """Why there is no hand process any more, where that is so; set by who supervises it, shown in `status`."""
        self.tactile_lost = ""
        """The same of the tactile process; pads that are away themselves are told by `TactileWatch`."""
        self._warnings: list[dict[str, str]] = []
        self.stopped = False
        self.stop_reason = Reason.NONE
        """With `stopped`: NONE if the arm is idle, else why that is not known."""
        self.busy = False
        """More requests may wait than one step takes; the next step should not wait."""

    def step(self) -> None:
        """Serve what has come."""
        now_ns = self._clock.now_ns()
        self.busy = True
        for _ in range(REQUESTS_A_STEP):
            received = self._out.socket.receive()
            if received is None:
                self.busy = False
                break
            self._serve(*received, now_ns)
        cycle_gone = self._links.events.closed  # asked before reading: its last words were said before it went
        while (message := self._links.events.receive()) is not None:
            self._on_event(CycleEvent.unpack(message.payload), now_ns)
        self._take_records(now_ns)
        self._tell_progress(now_ns)
        self._watch(now_ns, cycle_gone)

    @property
    def record(self) -> dict[str, Any] | None:
        """The newest cycle record; None before the first."""
        return self._record

    def tell(self, event: str, code: str, message: str, help: str = "") -> None:
        """Tell all clients and the operator of something that no request caused."""
        self._broadcast(event, {"code": code, "message": message, "help": help}, self._clock.now_ns())

    def warn(self, code: str, message: str) -> None:
        """Tell it, and go on showing it in `status`: something about a device that whoever comes later should know."""
        if (warning := {"code": code, "message": message}) not in self._warnings:
            self._warnings = [*self._warnings[1 - WARNINGS_KEPT :], warning]
            self.tell("warning", code, message)

    def shut_down(self) -> None:
        """Ask the cycle to stop along its path, hold and go idle. Raises LinkError if it cannot be asked."""
        self._send_to_cycle(self._start((), 0, asked.Shutdown(), self._planner.plan(asked.Shutdown())))

    def _serve(self, identity: Address, data: bytes, now_ns: int) -> None:
        self._clients[identity] = None
        try:
            request = asked.decode_request(data)
        except asked.RequestError as error:
            self._send(identity, encode_error(error.seq, error))
            return
        try:
            result = self._answer_at_once(request.command)
            if result is not None:
                self._send(identity, encode_reply(request.seq, result))
                return
            if self.cycle_lost:
                raise CommandError("cycle_lost", self.cycle_lost, help="Restart the daemon.")
            running = self._start(identity, request.seq, request.command, self._planner.plan(request.command))
            if request.deadline_s is not None:
                running.deadline_ns = now_ns + nanoseconds(request.deadline_s)
            self._send_to_cycle(running)
        except StillgraspError as error:
            self._send(identity, encode_error(request.seq, error))

    def _send(self, identity: Address, data: bytes) -> None:
        if not self._out.socket.send(identity, data):
            self._clients.pop(identity, None)

    def _answer_at_once(self, command: asked.Command) -> dict[str, Any] | None:
        """What the front knows by itself; None for commands that are the cycle's."""
        if isinstance(command, asked.Hello):
            return {
                "name": "stillgrasp",
                "version": version("stillgrasp"),
                "protocol": asked.VERSION,
                "commands": list(asked.COMMANDS),
                "tables": self._shelf.names(),
            }
        if isinstance(command, asked.Status):
            state = {} if self._record is None else self._state(self._record)
            return {
                "state": state,
                "state_age_s": (self._clock.now_ns() - self._record_ns) * 1e-9 if state else None,
                "table": self._planner.table_name,
                "cycle_lost": self.cycle_lost,
                "hand_lost": self.hand_lost,
                "tactile_lost": self.tactile_lost or ("" if self._tactile is None else self._tactile.lost),
                "warnings": self._warnings,
            }
        if isinstance(command, asked.TableList):
            return {"tables": self._shelf.listing()}
        return None

    def _start(self, identity: Address, seq: int, command: asked.Command, plan: Plan) -> _Running:
        return _Running(identity, seq, command, plan)

    def _send_to_cycle(self, running: _Running) -> None:
        step = running.plan.steps.popleft()
        token, self._next_token = self._next_token, self._next_token + 1
        payload = CycleCommand(step.kind, token, step.values).pack()
        now_ns = self._clock.now_ns()
        if step.table is None:
            self._links.commands.send(payload, now_ns)
        else:
            descriptor = step.table.to_memfd()
            try:
                self._links.commands.send_fds(payload, (descriptor,), now_ns)
            finally:
                os.close(descriptor)
        running.table = step.table
        self._running[token] = running

    def _on_event(self, event: CycleEvent, now_ns: int) -> None:
        if event.kind is EventKind.STOPPED:
            self.stopped, self.stop_reason = True, event.reason
        if event.kind in (EventKind.FAULT, EventKind.WARNING, EventKind.STOPPED):
            explanation = EXPLANATIONS[event.reason]
            told: dict[str, Any] = {"code": explanation.code, "message": explanation.message, "help": explanation.help}
            if event.kind is EventKind.STOPPED and event.reason is Reason.NONE:
                told["message"] = "The cycle has ended and the arm is idle."
            told |= named_values(event.reason, event.values)
            self._broadcast(event.kind.name.lower(), told, now_ns)
            return
        running = self._running.get(event.token)
        if running is None:
            return
        if event.kind is EventKind.ACCEPTED:
            if isinstance(running.command, asked.CompensationSet) and running.command.index is not None:
                self._planner.compensation_index = running.command.index
            if running.table is not None:
                self._planner.table, self._planner.table_name = running.table, _table_name(running.command)
            if running.command.slow and not running.replied:
                running.replied = True
                running.progress = Progress(running.command, running.plan.desired, now_ns)
                self._reply(running, {"accepted": True, "cycle": event.cycle, "desired": running.plan.desired})
        elif event.kind is EventKind.REJECTED:
            del self._running[event.token]
            self._fail(running, as_error(event.reason), now_ns)
        elif event.kind is EventKind.COMPLETED:
            del self._running[event.token]
            if running.plan.steps:
                self._go_on(running, now_ns)
            else:
                self._complete(running, event, now_ns)
        elif event.kind is EventKind.FAILED:
            del self._running[event.token]
            self._fail(running, as_error(event.reason), now_ns)

    def _go_on(self, running: _Running, now_ns: int) -> None:
        try:
            self._send_to_cycle(running)
        except StillgraspError as error:
            self._fail(running, error, now_ns)

    def _complete(self, running: _Running, event: CycleEvent, now_ns: int) -> None:
        applied = _applied(running.command, event)
        if not running.replied:
            self._reply(running, {"cycle": event.cycle, **applied})
            return
        fields = {"command": running.command.name, "cycle": event.cycle, "desired": running.plan.desired, **applied}
        self._event(running, "completed", fields, now_ns)

    def _fail(self, running: _Running, error: StillgraspError, now_ns: int) -> None:
        if running.replied:
            self._event(running, "failed", {"command": running.command.name, "error": error_told(error)}, now_ns)
        elif running.identity:
            self._send(running.identity, encode_error(running.seq, error))

    def _reply(self, running: _Running, result: dict[str, Any]) -> None:
        if running.identity:
            self._send(running.identity, encode_reply(running.seq, result))

    def _event(self, running: _Running, name: str, fields: dict[str, Any], now_ns: int) -> None:
        if running.identity:
            self._send(running.identity, encode_event(name, running.seq, **fields))
        self._keep_event({"event": name, "seq": running.seq, "command": running.command.name}, now_ns)

    def _broadcast(self, name: str, fields: dict[str, Any], now_ns: int) -> None:
        for identity in tuple(self._clients):
            self._send(identity, encode_event(name, None, **fields))
        self._keep_event({"event": name, "seq": -1, "command": ""}, now_ns)
        self._out.say(f"{name}: {fields.get('message', '')} {fields.get('help', '')}".strip())

    def _keep_event(self, event: dict[str, Any], now_ns: int) -> None:
        if self._out.recorder is not None:
            self._out.recorder.event(event, now_ns)

    def _take_records(self, now_ns: int) -> None:
        if self._tactile is not None:
            self._tactile.step()
        for payload, sample_ns in self._links.records.new_values():
            self._record, self._record_ns, self._silence_ns = CYCLE_RECORD.read(payload), sample_ns, 0
            if self._tactile is not None:
                self._record |= self._tactile.record()
            if self._out.recorder is not None:
                self._out.recorder.record_cycle(self._record, sample_ns)
        if self._out.publisher is not None and self._record is not None and now_ns >= self._next_state_ns:
            self._next_state_ns = max(self._next_state_ns + self._state_period_ns, now_ns)
            self._out.publisher.publish(self._state(self._record), self._out.wall_time_s())

    def _state(self, record: dict[str, Any]) -> dict[str, Any]:
        """What clients see; of tactile pads only where there are some."""
        pads = {} if self._tactile is None else self._tactile.state(self._clock.now_ns())
        return state_map(record) | pads

    def _tell_progress(self, now_ns: int) -> None:
        """To whoever sent a slow command, how far it is; not recorded, for the records have it all."""
        for running in self._running.values():
            if running.progress is not None and running.identity and self._record is not None:
                fields = running.progress.take(self._record, now_ns)
                if fields is not None:
                    self._send(running.identity, encode_event("progress", running.seq, **fields))

    def _watch(self, now_ns: int, cycle_gone: bool) -> None:
        """Deadlines of requests, and the cycle's heartbeat."""
        for token, running in list(self._running.items()):
            if running.deadline_ns is not None and now_ns > running.deadline_ns:
                del self._running[token]
                self._fail(running, CommandError("deadline", "The command took longer than its deadline_s."), now_ns)
                with contextlib.suppress(LinkError):  # a cycle that cannot be asked to stop is found lost below
                    self._send_to_cycle(self._start((), 0, asked.Stop(), self._planner.plan(asked.Stop())))
        # Silence counts only while the front was listening: its own pauses (a table to read) are not the cycle's.
        self._silence_ns += min(now_ns - self._last_step_ns, _ATTENTION_NS)
        self._last_step_ns = now_ns
        if self.stopped or self.cycle_lost or self._record is None:
            return
        if cycle_gone or self._silence_ns > self._heartbeat_ns:
            self._idle_the_arm("The cycle process has died." if cycle_gone else "The cycle sends no heartbeat.", now_ns)

    def _idle_the_arm(self, why: str, now_ns: int) -> None:
        done = self._out.idle_arm() if self._out.idle_arm is not None else "nothing can be done from here"
        self.cycle_lost = f"{why} The arm: {done}"
        fields = {"code": "cycle_lost", "message": self.cycle_lost, "help": "Restart the daemon."}
        self._broadcast("fault", fields, now_ns)
        for running in self._running.values():
            self._fail(running, CommandError("cycle_lost", self.cycle_lost), now_ns)
        self._running.clear()


def _table_name(command: asked.Command) -> str:
    return command.table if isinstance(command, asked.GraspPreposition | asked.TableLoad) else ""


def _applied(command: asked.Command, event: CycleEvent) -> dict[str, Any]:
    """What was applied, beside what was desired, with the reason where they differ."""
    applied: dict[str, Any] = {}
    if isinstance(command, asked.GraspSqueeze) and len(event.values) == 3:
        mean_m, load_N, model_load_N = event.values
        applied = {"applied": {"mean_excursion_m": mean_m, "measured_load_N": load_N, "table_load_N": model_load_N}}
    elif isinstance(command, asked.GraspClose) and len(event.values) == 5:
        found, expected, object_offset_m = list(event.values[:2]), list(event.values[2:4]), event.values[4]
        applied = {"contact_excursion_m": found, "expected_excursion_m": expected}
        if event.reason is Reason.OFF_CENTRE:
            applied["object_offset_m"] = object_offset_m
    if event.reason is not Reason.NONE:
        explanation = EXPLANATIONS[event.reason]
        applied["reason"] = {"code": explanation.code, "message": explanation.message}
    return applied
