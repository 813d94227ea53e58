"""The cycle's commands in the order in which they were sent, each when it is due; tables are taken here.

A motion table's memory travels beside its message, so that the message cannot wait: it takes effect at once or not.
"""

from __future__ import annotations

import os

from calibration.motion_table import MotionTable
from controller.cycle.grasping import Grasping
from controller.cycle.outcome import Outcome
from controller.messages import CommandKind, CycleCommand, EventKind, Reason
from controller.service.links import OrderedReader
from drivers.errors import TableError


class CommandQueue:
    """What has been received and not been carried out. `told`: what there is to tell about tables."""

    def __init__(self, reader: OrderedReader, grasping: Grasping) -> None:
        self._reader = reader
        self._grasping = grasping
        self._waiting: CycleCommand | None = None
        self.told: list[Outcome] = []

    @property
    def closed(self) -> bool:
        """Whether the front has gone."""
        return self._reader.closed

    def due(self, number: int) -> CycleCommand | None:
        """The next command, if it takes effect in cycle `number` or before; those behind it wait for it."""
        while True:
            command, self._waiting = self._waiting, None
            if command is None:
                message = self._reader.receive()
                if message is None:
                    return None
                command = CycleCommand.unpack(message.payload)
                if command.kind is CommandKind.LOAD_TABLE:
                    self._take_table(command, message.descriptors)
                    continue
            if command.effective_cycle > number:
                self._waiting = command
                return None
            return command

    def _take_table(self, command: CycleCommand, descriptors: tuple[int, ...]) -> None:
        try:
            reason = self._grasping.use_table(MotionTable.from_memfd(descriptors[0]))
        except (TableError, IndexError):
            reason = Reason.NO_TABLE
        for descriptor in descriptors:
            os.close(descriptor)  # the mapping lives on without it
        accepted = reason is Reason.NONE
        self.told.append(Outcome(EventKind.ACCEPTED if accepted else EventKind.REJECTED, command.token, reason))
        if accepted:
            self.told.append(Outcome(EventKind.COMPLETED, command.token))
