"""The front's process: `stillgrasp run`. It starts the other processes, serves clients, watches, and ends all in order.

    starting   world (in simulation) → GO to hand and cycle → first cycle record
    running    until `shutdown`, SIGINT, SIGTERM, SIGHUP, or the loss of a process
    stopping   the cycle comes to rest along its path, holds, is idle and says STOPPED; then hand, world, sockets

Exit code 0 after an orderly stop, by whomever; 1 if a process was lost or could not start. One loop waits for clients,
events, children, signals and the pendant's keyboard; it wakes every 5 ms at the latest. Design 2, 5.
"""

from __future__ import annotations

import contextlib
import os
import select
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

from controller.config import RobotConfig
from controller.cycle.grasp_state import ArmState
from controller.messages import Reason
from controller.service.assembly import configured_hand
from controller.service.assignment import SceneChoice
from controller.service.beginning import find
from controller.service.command_socket import CommandSocket
from controller.service.front import HEARTBEAT_S, Front, FrontLinks, Outlets
from controller.service.lifeline import Word
from controller.service.links import (
    LatestReader,
    LinkError,
    OrderedReader,
    OrderedSender,
    SocketLink,
    socket_links,
)
from controller.service.notify import notify
from controller.service.recorder import Recorder
from controller.service.requests import Planner
from controller.service.stop_requests import StopRequests
from controller.service.supervision import Child, end_children
from controller.service.table_shelf import TableShelf
from controller.service.telemetry import StatePublisher
from drivers.clock import Clock, MonotonicClock, nanoseconds
from drivers.errors import BusError, StillgraspError
from drivers.wam.bus import SAFETY_FILTERS, PythonCanBus, open_can
from drivers.wam.safety_puck import Guard, SafetyPuck

LONGEST_WAIT_S = 0.005
SIMULATED_HEARTBEAT_S = 0.3
"""A simulated cycle on a shared machine may be kept waiting for longer than a real one's 20 ms."""
LONGEST_START_S = 20.0
LONGEST_PROMPT_S = 630.0
"""Of starting after a word to the operator: a little more than the cycle waits for them."""
LONGEST_STOP_S = 4.0
LONGEST_END_S = 1.0
GUARD_CHECK_S = 0.5
TOLD_FOR_S = 3.0
"""How long `status` still answers once the cycle is lost."""
_WATCHDOG_S = 0.1


class ButtonSource(Protocol):
    """Where the simulated pendant's buttons come from, and, as JSON objects, the devices' faults."""

    open: bool

    def fileno(self) -> int: ...

    def read(self) -> list[str]: ...


@dataclass(frozen=True)
class RunChoices:
    """What the command line decides beside the configuration. `directory_descriptor` is inherited by the world."""

    simulated: bool = False
    scene: SceneChoice = field(default_factory=SceneChoice)
    activate: bool = False
    """Press the simulated pendant's Activate once the arm is idle under control."""
    directory_descriptor: int | None = None


class DaemonFailed(StillgraspError):  # noqa: N818 - reads as what happened
    """The daemon cannot start, or lost a process without which it cannot go on."""


class Daemon:
    """One run of the robot. `say` is for the operator, `announce` gets one map when all runs."""

    def __init__(
        self,
        config: RobotConfig,
        choices: RunChoices,
        *,
        say: Callable[[str], None],
        announce: Callable[[Mapping[str, Any]], None] = lambda _: None,
        recorder: Recorder | None = None,
        buttons: ButtonSource | None = None,
    ) -> None:
        self._config = config
        self._choices = choices
        self._say = say
        self._announce = announce
        self._recorder = recorder
        self._buttons = buttons
        self._clock: Clock = MonotonicClock()
        self._children: dict[str, Child] = {}
        self._guard_bus: PythonCanBus | None = None
        self._guard: Guard | None = None
        self._links: tuple[SocketLink, ...] = ()
        self._begun = False
        self._phase: Literal["starting", "running", "stopping"] = "starting"
        self._phase_end_ns = self._clock.now_ns() + nanoseconds(LONGEST_START_S)
        self._arm_state: ArmState | None = None
        self._activated = False
        self._last_cycle = -1.0
        self._watchdog_ns = 0
        self._guard_ns = 0
        self._lost_ns = 0
        self._recording_failed = False

    def run(self, stop: StopRequests) -> int:
        """Run until the end, or until `stop`; the exit code. Raises StillgraspError if it cannot start."""
        config = self._config
        with contextlib.closing(CommandSocket(config.front.command_endpoint)) as socket:
            publisher = StatePublisher(config.front.state_endpoint)
            try:
                shelf = TableShelf(Path(config.tables.directory), configured_hand(config))
                links = self._start_children()
                self._front = Front(
                    self._clock,
                    links,
                    Outlets(
                        socket,
                        publisher,
                        self._recorder,
                        self._idle_arm,
                        self._say,
                        record_pads=None if self._recorder is None else self._recorder.record_pads,
                    ),
                    Planner(config, shelf),
                    shelf,
                    heartbeat_s=SIMULATED_HEARTBEAT_S if self._choices.simulated else HEARTBEAT_S,
                    state_rate_hz=config.front.state_rate_hz,
                )
                return self._loop(stop, [socket.fileno(), links.commands.link.fileno()])
            finally:
                self._end()
                publisher.close()

    def _start_children(self) -> FrontLinks:
        """All processes at once, so that they load their libraries side by side; they wait for GO."""
        config, choices, clock = self._config, self._choices, self._clock
        commands, cycle_commands = socket_links()
        records, cycle_records = socket_links()
        cycle_hand, hand_cycle = socket_links()

        def start(role: Any, **more: Any) -> None:
            child = Child.start(role, config, clock, simulated=choices.simulated, scene=choices.scene, **more)
            self._children[role] = child

        if choices.simulated:
            held = choices.directory_descriptor
            start("world", descriptors={} if held is None else {"directory": held})
        start("hand", links={"cycle": hand_cycle})
        cycle_links = {"commands": cycle_commands, "records": cycle_records, "hand": cycle_hand}
        self._links = commands, records
        pads: LatestReader | None = None
        if config.tactile is not None:
            cycle_links["tactile"], tactile_cycle = socket_links()
            front_pads, tactile_front = socket_links()
            start("tactile", links={"cycle": tactile_cycle, "pads": tactile_front})
            self._links, pads = (*self._links, front_pads), LatestReader(front_pads)
        start("cycle", links=cycle_links)
        return FrontLinks(OrderedSender(commands), OrderedReader(commands), LatestReader(records), pads)

    def _begin(self) -> None:
        """The buses are there: take our own place on the CAN bus, and let hand and cycle begin."""
        self._begun = True
        arm = self._config.arm
        self._guard_bus = open_can(arm.interface, arm.channel, self._clock, filters=SAFETY_FILTERS)
        puck = SafetyPuck(self._guard_bus, self._clock)
        firmware = find(lambda: puck.get("VERS"), self._choices.simulated)
        self._guard = Guard(self._guard_bus, self._clock, firmware)
        self._children["hand"].begin()
        self._children["cycle"].begin()
        if "tactile" in self._children:
            self._children["tactile"].begin()

    def _loop(self, stop: StopRequests, descriptors: list[int]) -> int:
        front, buttons = self._front, self._buttons
        poll = select.poll()
        for source in (*descriptors, stop.fileno(), *(child.lifeline.fileno() for child in self._children.values())):
            poll.register(source, select.POLLIN)
        if buttons is not None and buttons.open:
            poll.register(buttons.fileno(), select.POLLIN)
        while True:
            ready = dict(poll.poll(0 if front.busy else LONGEST_WAIT_S * 1e3))
            stop.drain()
            front.step()
            if buttons is not None and ready.pop(buttons.fileno(), 0):
                for line in buttons.read():
                    self._children["world"].lifeline.say(Word.FAULT if "{" in line else Word.PRESS, line)
                if not buttons.open:
                    poll.unregister(buttons.fileno())
            for child in self._children.values():
                self._hear(child)
            for descriptor, seen in ready.items():
                if seen & ~select.POLLIN:
                    poll.unregister(descriptor)  # who was there has gone, which would wake us for ever
            code = self._supervise(stop)
            if code is not None:
                return code
            self._keep_watchdog()

    def _hear(self, child: Child) -> None:
        """Pass on what a child says; while an operator is waited for, starting takes as long as they do."""
        for line in child.listen():
            self._say(line)
        for code, text in child.prompts:
            self._front.tell("prompt", code, text)
            if self._phase == "starting":
                self._phase_end_ns = self._clock.now_ns() + nanoseconds(LONGEST_PROMPT_S)
        child.prompts.clear()
        for code, text in child.warnings:
            self._front.warn(code, text)
        child.warnings.clear()
        if child.motor_firmware is not None and self._guard_bus is not None and self._guard is not None:
            self._guard = Guard(self._guard_bus, self._clock, self._guard.safety_firmware, child.motor_firmware)
            child.motor_firmware = None

    def _supervise(self, stop: StopRequests) -> int | None:
        """Move on from phase to phase; the exit code once all is over."""
        front, now_ns = self._front, self._clock.now_ns()
        if front.cycle_lost:
            return self._after_loss(now_ns, stop)
        if front.stopped:
            if front.stop_reason is not Reason.NONE:
                self._say(f"the arm did not confirm that it is idle. {self._idle_arm()}")
                return 1
            return 0
        self._check_children()
        if self._phase == "starting":
            self._continue_start(now_ns)
        self._watch_arm()
        if stop.received is not None and self._phase != "stopping":
            self._say(f"{stop.received.name}: stopping the arm along its path")
            if not self._children["cycle"].ready:
                return 0
            self._phase, self._phase_end_ns = "stopping", now_ns + nanoseconds(LONGEST_STOP_S)
            notify("STOPPING=1")
            with contextlib.suppress(LinkError):  # then its death shows next
                front.shut_down()
        if self._phase == "stopping" and now_ns > self._phase_end_ns:
            self._say(f"the cycle did not stop within {LONGEST_STOP_S:g} s. {self._idle_arm()}")
            self._children["cycle"].kill()
            return 1
        return None

    def _check_children(self) -> None:
        """What the loss of a process means. Raises DaemonFailed where it is the end."""
        for role, child in self._children.items():
            if not child.gone or (role == "hand" and self._front.hand_lost):
                continue
            if role == "tactile" and self._front.tactile_lost:
                continue
            child.listen()
            if role == "world":
                self._children["cycle"].kill()  # there is no arm left that it could bring to rest
            if self._phase == "starting" or role == "world":
                raise DaemonFailed(child.failure or f"The {role} process: {child.fate()}.")
            if role == "hand":
                self._front.hand_lost = f"The hand process has gone ({child.fate()}); the motors go on holding."
                self._front.tell("fault", "hand_lost", self._front.hand_lost, "Restart the daemon.")
            if role == "tactile":
                why = child.failure or child.fate()
                self._front.tactile_lost = f"The tactile pads are lost ({why}); the motors' load finds contact."
                self._front.tell("warning", "tactile_lost", self._front.tactile_lost, "Restart the daemon.")

    def _continue_start(self, now_ns: int) -> None:
        world, cycle, hand = self._children.get("world"), self._children["cycle"], self._children["hand"]
        if not self._begun and (world is None or world.ready):
            self._begin()
        tactile = self._children.get("tactile")
        if cycle.ready and hand.ready and (tactile is None or tactile.ready) and self._front.record is not None:
            self._phase = "running"
            self._announce(self._description())
            notify("READY=1\nSTATUS=running")
        elif now_ns > self._phase_end_ns:
            late = ", ".join(child.role for child in self._children.values() if not child.ready)
            raise DaemonFailed(
                f"Not all processes run after {LONGEST_START_S:g} s; still waiting for: {late or 'the first cycle'}."
            )

    def _watch_arm(self) -> None:
        """Tell the operator of the arm's state, and press Activate for him where that was asked for."""
        record = self._front.record
        if record is None or self._phase != "running":
            return
        state = ArmState(int(record["arm_state"]))
        if state is self._arm_state:
            return
        self._arm_state = state
        if state is ArmState.IDLE and self._choices.activate and not self._activated:
            self._activated = True
            self._children["world"].lifeline.say(Word.PRESS, "activate")
            return
        if state is ArmState.IDLE:
            text = "The arm is idle: press Shift+Activate on the pendant to let it move."
            self._front.tell("prompt", "press_activate", text)
        else:
            self._say(f"the arm is {state.name.lower()}")

    def _after_loss(self, now_ns: int, stop: StopRequests) -> int | None:
        """The arm was idled and clients were told; `status` answers a moment longer."""
        if not self._lost_ns:
            self._lost_ns = now_ns
            notify("STOPPING=1\nSTATUS=the cycle is lost")
            cycle = self._children["cycle"]
            if cycle.gone:
                cycle.wait(0.1)
                self._say(f"the cycle process: {cycle.fate()}")
            cycle.kill()  # one that only hung must not come back to an arm that others were told of
        over = now_ns - self._lost_ns > nanoseconds(TOLD_FOR_S) or stop.received is not None
        return 1 if over else None

    def _keep_guard(self, now_ns: int) -> None:
        """The guard's bus must work when it is needed: what nobody reads is dropped, and a lost one opened again."""
        if self._guard_bus is None or now_ns < self._guard_ns:
            return
        self._guard_ns = now_ns + nanoseconds(GUARD_CHECK_S)
        try:
            while self._guard_bus.receive(0) is not None:
                pass
        except BusError:
            with contextlib.suppress(BusError):  # the next time, then
                self._guard_bus.reopen()

    def _keep_watchdog(self) -> None:
        """systemd hears of us as long as cycles are completed."""
        record, now_ns = self._front.record, self._clock.now_ns()
        self._keep_guard(now_ns)
        if record is None or now_ns < self._watchdog_ns:
            return
        self._watchdog_ns = now_ns + nanoseconds(_WATCHDOG_S)
        if record["cycle"] != self._last_cycle:
            self._last_cycle = record["cycle"]
            notify("WATCHDOG=1")
        if self._recorder is not None and self._recorder.failure and not self._recording_failed:
            self._recording_failed = True
            self._say(self._recorder.failure)

    def _idle_arm(self) -> str:
        if self._guard is None:
            return "nothing was done: the arm had not been reached yet"
        return self._guard.idle_arm()

    def _description(self) -> dict[str, Any]:
        config = self._config
        return {
            "command_endpoint": config.front.command_endpoint,
            "state_endpoint": config.front.state_endpoint,
            "can": {"interface": config.arm.interface, "channel": config.arm.channel},
            "tendons": {"port": config.tendons.port},
            "pids": {"front": os.getpid(), **{role: child.pid for role, child in self._children.items()}},
        }

    def _end(self) -> None:
        """End what still runs: first who commands, then who holds, then the world they live in."""
        clock, children = self._clock, self._children
        for link in self._links:
            link.close()
        world = children.pop("world", None)
        killed = end_children(list(children.values()), clock, clock.now_ns() + nanoseconds(LONGEST_STOP_S))
        if "cycle" in killed:
            self._say(self._idle_arm())
        if self._guard_bus is not None:
            self._guard_bus.close()
        if world is not None:
            killed += end_children([world], clock, clock.now_ns() + nanoseconds(LONGEST_END_S))
        for role in killed:
            self._say(f"the {role} process did not end and was killed")
