"""A front on one virtual clock and in-memory links; the test is client and cycle."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from controller.config import load_config
from controller.messages import CYCLE_RECORD, CycleCommand, CycleEvent, EventKind, Reason
from controller.service.command_socket import MemoryCommandSocket, MemoryConnection
from controller.service.front import Front, FrontLinks, Outlets
from controller.service.links import LatestReader, LatestSender, OrderedReader, OrderedSender, VirtualLink
from controller.service.requests import Planner
from controller.service.table_shelf import TableShelf
from controller.service.telemetry import MemoryStateOutlet
from drivers.clock import VirtualClock

HAND = load_hand("t42pp", preset="fitted")
TABLE = build_table(HAND, load_object("cylinder40"), GraspSpec(), nodes=9)
PERIOD_NS = 2_000_000
PLACE: dict[str, Any] = {"object_xyz_m": [0.7, 0.0, 0.5]}
COMMANDS_WAITING = 4


class Recorder:
    """Keeps what it is given."""

    def __init__(self) -> None:
        self.cycles: list[tuple[float, int]] = []
        self.events: list[str] = []

    def record_cycle(self, record: dict[str, Any], time_ns: int) -> None:
        self.cycles.append((record["cycle"], time_ns))

    def event(self, event: dict[str, Any], time_ns: int) -> None:
        self.events.append(event["event"])


class Office:
    """A front with its links; the test is client and cycle."""

    def __init__(self, tables: Path) -> None:
        self.clock = VirtualClock()
        self.commands = VirtualLink(self.clock, self.clock, capacity=COMMANDS_WAITING)
        self.event_link = VirtualLink(self.clock, self.clock)
        records = VirtualLink(self.clock, self.clock)
        self._to_front = OrderedSender(self.event_link)
        self._records = LatestSender(records)
        self._from_front = OrderedReader(self.commands)
        self.socket = MemoryCommandSocket(self.clock)
        self.publisher, self.recorder = MemoryStateOutlet(), Recorder()
        self.idled: list[int] = []
        self.said: list[str] = []
        config = load_config()
        shelf = TableShelf(tables, HAND)
        self.planner = Planner(config, shelf)
        outlets = Outlets(
            self.socket, self.publisher, self.recorder, self._idle_arm, self.said.append, wall_time_s=lambda: 7.0
        )
        links = FrontLinks(OrderedSender(self.commands), OrderedReader(self.event_link), LatestReader(records))
        self.front = Front(self.clock, links, outlets, self.planner, shelf)
        self.client = self.connect()
        self.cycle = 0

    def _idle_arm(self) -> str:
        self.idled.append(self.clock.now_ns())
        return "is asked for idle"

    def connect(self) -> MemoryConnection:
        return self.socket.connect(self.clock)

    def beat(self, times: int = 1, *, record: bool = True) -> None:
        """Cycles pass; each sends a record, unless it is silent."""
        for _ in range(times):
            self.clock.advance_to_ns(self.clock.now_ns() + PERIOD_NS)
            self.cycle += 1
            if record:
                values = np.zeros(CYCLE_RECORD.length)
                values[CYCLE_RECORD.slices["cycle"]] = self.cycle
                self._records.send(values.tobytes(), self.clock.now_ns())
            self.front.step()

    def ask(self, command: str, seq: int = 1, deadline_s: float | None = None, **args: Any) -> None:
        request: dict[str, Any] = {"v": 1, "seq": seq, "command": command, "args": args}
        if deadline_s is not None:
            request["deadline_s"] = deadline_s
        self.client.send(msgspec.msgpack.encode(request))
        self.beat()

    def heard(self) -> list[CycleCommand]:
        """What the cycle has been sent since the last time; tables' descriptors are closed."""
        commands = []
        while (message := self._from_front.receive()) is not None:
            for descriptor in message.descriptors:
                os.close(descriptor)
            commands.append(CycleCommand.unpack(message.payload))
        return commands

    def tell(self, kind: EventKind, token: int, reason: Reason = Reason.NONE, *values: float) -> None:
        self._to_front.send(CycleEvent(kind, token, self.cycle, reason, values).pack(), self.clock.now_ns())
        self.beat()

    def answers(self, connection: MemoryConnection | None = None) -> list[dict[str, Any]]:
        answers = []
        while (data := (connection or self.client).take()) is not None:
            answers.append(msgspec.msgpack.decode(data))
        return answers

    def only_answer(self) -> dict[str, Any]:
        (answer,) = self.answers()
        return answer
