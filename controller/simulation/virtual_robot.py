"""The whole robot in one process on virtual time: the same parts that run as processes, in front of the same world.

Links, CAN wire and serial line are their in-memory twins; a client talks to the front as a task planner would.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from controller.client import Client
from controller.config import RobotConfig, Tactile
from controller.cycle.attentive_clock import AttentiveClock
from controller.cycle.cycle import Cycle, CycleLinks
from controller.cycle.grasping import Grasping
from controller.cycle.pads import PadWatch
from controller.service.assembly import configured_hand, cycle_parts, hand_settings, tendon_motors
from controller.service.command_socket import MemoryCommandSocket, MemoryConnection
from controller.service.front import Front, FrontLinks, Outlets, RecordSink
from controller.service.hand import HandPart
from controller.service.links import LatestReader, LatestSender, OrderedReader, OrderedSender, VirtualLink
from controller.service.requests import Planner
from controller.service.table_shelf import TableShelf
from controller.service.tactile import TactilePart
from controller.service.tactile_assembly import configured_pads
from controller.simulation.scene import Devices, Scene, build_devices
from controller.simulation.virtual_time import Part, VirtualTime
from controller.simulation.world import World
from drivers.clock import VirtualClock, nanoseconds
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.reopening_line import ReopeningLine
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import InputError, NoReplyError
from drivers.simulated.can_faults import CanFaults
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.serial_fault_actions import SerialAction
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.takktile import SimulatedTakktile
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.touch import TouchSettings
from drivers.wam.safety_puck import Guard

FRONT_PERIOD_S = 0.01
LONGEST_START_S = 20.0
RECORDS_WAITING = 16


class VirtualRobot:
    """Cycle, hand, front, devices and world of one installation and scene.

    `observe` is called with the world every `observe_period_s`, for a reporter. `faults`: a script of what goes wrong
    with the arm and its bus, perhaps an empty one to which `add_fault` adds. `motor_faults`: the same for the tendon
    motors and their bus; `add_motor_fault` adds to it.
    """

    def __init__(
        self,
        config: RobotConfig,
        scene: Scene,
        *,
        recorder: RecordSink | None = None,
        record_pads: Callable[[dict[str, Any], int], None] | None = None,
        observe: Callable[[World], None] | None = None,
        observe_period_s: float = 0.002,
        faults: FaultScript[Any] | None = None,
        motor_faults: FaultScript[SerialAction] | None = None,
    ) -> None:
        hand = configured_hand(config)
        self.devices: Devices = build_devices(config, hand, scene, motor_faults=motor_faults)
        self.time = VirtualTime()
        self._observe = observe
        self._observe_period_ns = nanoseconds(observe_period_s)
        clocks = {
            name: VirtualClock() for name in ("world", "hub", "cycle", "hand", "front", "guard", "client", "tactile")
        }
        self._clocks = clocks
        self._faults = None if faults is None else CanFaults(faults, self.devices.wam)
        self._hub = MemoryCanHub([self.devices.wam], self._faults)

        set_points = VirtualLink(clocks["cycle"], clocks["hand"])
        states = VirtualLink(clocks["hand"], clocks["cycle"])
        commands = VirtualLink(clocks["front"], clocks["cycle"])
        events = VirtualLink(clocks["cycle"], clocks["front"])
        records = VirtualLink(clocks["cycle"], clocks["front"], capacity=RECORDS_WAITING)

        attentive = AttentiveClock(clocks["cycle"], self._let_others_catch_up)
        parts = cycle_parts(config, MemoryCanBus(self._hub, attentive), attentive)
        self.grasping = parts.grasping
        self.cycle = Cycle(
            attentive,
            CycleLinks(
                OrderedReader(commands),
                OrderedSender(events),
                LatestSender(records),
                LatestReader(states),
                LatestSender(set_points),
            ),
            parts,
        )
        self._make_hand: Callable[[], HandPart] = lambda: self._hand_part(
            config, LatestReader(set_points), LatestSender(states)
        )
        self.hand = self._make_hand()
        self._hand_begins = True
        self._hand_stands_until_ns = 0
        self._tactile = None
        pads: LatestReader | None = None
        if config.tactile is not None and self.devices.pads is not None:
            to_front = VirtualLink(clocks["tactile"], clocks["front"])
            pads = LatestReader(to_front)
            self._tactile = self._tactile_part(
                config.tactile, self.devices.pads, parts.grasping, LatestSender(to_front)
            )
        self.socket = MemoryCommandSocket(clocks["front"])
        guard = Guard(MemoryCanBus(self._hub, clocks["guard"]), clocks["guard"], 197)
        shelf = TableShelf(Path(config.tables.directory), hand)
        outlets = Outlets(
            self.socket,
            recorder=recorder,
            idle_arm=guard.idle_arm,
            wall_time_s=lambda: 0.0,
            record_pads=record_pads,
        )
        self.front = Front(
            clocks["front"],
            FrontLinks(OrderedSender(commands), OrderedReader(events), LatestReader(records), pads),
            outlets,
            Planner(config, shelf),
            shelf,
        )
        self._cycle_runs = False
        self._front_period_ns = nanoseconds(FRONT_PERIOD_S)
        self.time.add(Part("world", clocks["world"], self._step_world))
        self.time.add(Part("hub", clocks["hub"], self._step_hub))
        self.time.add(Part("cycle", clocks["cycle"], self._starting(self.cycle.start, self._step_cycle)))
        self.time.add(Part("hand", clocks["hand"], self._step_hand))
        self.time.add(Part("front", clocks["front"], self._step_front))
        if self._tactile is not None:
            self.time.add(
                Part(
                    "tactile", clocks["tactile"], self._starting(self._tactile.start, self._tactile_step(self._tactile))
                )
            )

    def _hand_part(self, config: RobotConfig, set_points: LatestReader, states: LatestSender) -> HandPart:
        """The hand as its process has it: with a line that is opened again when it comes back."""
        clock, baud, motors = self._clocks["hand"], config.tendons.baud, self.devices.motors

        def open_line() -> MemoryLine:
            return MemoryLine(motors, clock, baud)

        port = WaitingPort(ReopeningLine(open_line(), open_line, clock), clock, baud=baud)
        return HandPart(
            clock, TendonPair(port, clock, tendon_motors(config)), set_points, states, hand_settings(config)
        )

    def _tactile_part(
        self, tactile: Tactile, device: SimulatedTakktile, grasping: Grasping, front: LatestSender
    ) -> TactilePart:
        """The pads' part, and its links to the cycle."""
        clock, cycle_clock = self._clocks["tactile"], self._clocks["cycle"]
        states, orders = VirtualLink(clock, cycle_clock), VirtualLink(cycle_clock, clock)
        grasping.pads = PadWatch(LatestReader(states), LatestSender(orders))
        return TactilePart(
            clock,
            lambda: MemoryTransport(device, clock),
            configured_pads(tactile),
            LatestReader(orders),
            LatestSender(states),
            front,
            period_s=tactile.period_s,
            touch=TouchSettings(tactile.touch_N, tactile.release_N),
        )

    def _tactile_step(self, part: TactilePart) -> Callable[[], int | None]:
        """A frame when it is ready: its forces are those of that moment. Without a bridge, when it is looked for."""
        device, clock = self.devices.pads, self._clocks["tactile"]
        assert device is not None

        def next_ns() -> int:
            ready_ns = device.next_frame_ns() if part.present else part.retry_ns
            return clock.now_ns() if ready_ns is None else ready_ns

        def step() -> int | None:
            if next_ns() > clock.now_ns():
                return next_ns()
            part.step()
            return next_ns()

        return step

    @property
    def world(self) -> World:
        """The world behind the devices."""
        return self.devices.world

    def press(self, button: str) -> None:
        """Press a button of the arm's pendant: idle, activate, estop, release."""
        self._hub.transmit(self.devices.wam.press(button, self.time.now_ns), self.devices.wam)

    def add_fault(self, fault: Fault[Any]) -> None:
        """Let something go wrong with the arm or its bus, timed from now. InputError if it does not fit."""
        if self._faults is None:
            raise InputError("this robot was made without a fault script; expected one, which may be empty.")
        self._faults.add(fault, self.time.now_ns)

    def add_motor_fault(self, fault: Fault[SerialAction]) -> None:
        """Let something go wrong with the tendon motors or their bus, timed from now. InputError if it does not fit."""
        self.devices.motors.faults.add(fault, self.time.now_ns)

    def stall_hand(self, duration_s: float) -> None:
        """The hand process does nothing for so long."""
        self._hand_stands_until_ns = self.time.now_ns + nanoseconds(duration_s)

    def restart_hand(self) -> None:
        """The hand process is gone without a word, and another begins in its place."""
        self.hand = self._make_hand()
        self._hand_begins = True

    def run_for(self, duration_s: float) -> None:
        """Let virtual time pass, for the client too."""
        self.time.run_until(self.time.now_ns + nanoseconds(duration_s))
        self._clocks["client"].advance_to_ns(self.time.now_ns)

    def activate(self) -> None:
        """Let the arm start up, then press Shift+Activate, as an operator would."""
        if not self.time.run_until(self.time.now_ns + nanoseconds(LONGEST_START_S), lambda: self._cycle_runs):
            raise NoReplyError("WAM", f"the simulated arm did not start up within {LONGEST_START_S:g} s.")
        self.run_for(0.05)
        self.press("activate")
        self.run_for(0.1)

    def client(self) -> Client:
        """A client of the front; while it waits, virtual time runs."""
        clock = self._clocks["client"]
        clock.advance_to_ns(self.time.now_ns)
        return Client(_VirtualTransport(self.time, clock, self.socket.connect(clock)), clock=clock)

    def _let_others_catch_up(self) -> None:
        """While the arm is started again within a step of the cycle, the others go on."""
        self.time.run_until(self._clocks["cycle"].now_ns())

    def _step_world(self) -> int:
        now_ns = self._clocks["world"].now_ns()
        self.world.advance_to(now_ns)
        if self._observe is not None and now_ns % self._observe_period_ns == 0:
            self._observe(self.world)
        return now_ns + self.world.physics_period_ns

    def _step_hub(self) -> int:
        now_ns = self._clocks["hub"].now_ns()
        self._hub.step(now_ns)
        return now_ns + nanoseconds(0.002)

    def _step_cycle(self) -> int | None:
        self._cycle_runs = True
        self.cycle.step()
        return None if self.cycle.finished else self.cycle.pacer.deadline_ns

    def _step_hand(self) -> int:
        if self._clocks["hand"].now_ns() < self._hand_stands_until_ns:
            return self._hand_stands_until_ns
        if self._hand_begins:
            self._hand_begins = False
            self.hand.start()
            return 0
        self.hand.step()
        for text in self.hand.take_warnings():
            self.front.warn("hand_motor", text)
        return self.hand.pacer.deadline_ns

    def _step_front(self) -> int:
        self.front.step()
        return self._clocks["front"].now_ns() + self._front_period_ns

    @staticmethod
    def _starting(start: Callable[[], None], step: Callable[[], int | None]) -> Callable[[], int | None]:
        """First `start`, then `step`: start-up too happens at the part's own time."""
        started = False

        def turn() -> int | None:
            nonlocal started
            if not started:
                started = True
                start()
                return 0
            return step()

        return turn


class _VirtualTransport:
    """A client's connection: waiting for an answer lets virtual time run until it is there."""

    def __init__(self, time: VirtualTime, clock: VirtualClock, connection: MemoryConnection) -> None:
        self._time = time
        self._clock = clock
        self._connection = connection

    def send(self, data: bytes) -> None:
        self._connection.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        deadline_ns = self._clock.now_ns() + nanoseconds(timeout_s)

        def arrived() -> bool:
            arrival_ns = self._connection.next_arrival_ns()
            return arrival_ns is not None and arrival_ns <= max(self._time.now_ns, self._clock.now_ns())

        found = arrived() or self._time.run_until(deadline_ns, arrived)
        self._clock.advance_to_ns(self._time.now_ns if found else deadline_ns)
        return self._connection.take() if found else None

    def close(self) -> None:
        pass
