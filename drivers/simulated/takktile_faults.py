"""A fault script at work on a simulated TakkTile bridge: on its frames, on the bridge, and on its cells.

The bridge tells how time passes and asks what is so now. Same script, same calls: same faults. Times in ns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from drivers.errors import InputError
from drivers.simulated.faults import START, Fault, FaultScript, Running, Schedule
from drivers.simulated.takktile_fault_actions import (
    EVENTS,
    CellAction,
    Dead,
    FrameAction,
    Garbage,
    Lose,
    MoreCells,
    Noise,
    Press,
    Repeat,
    Silence,
    Stuck,
    TakktileAction,
    Truncate,
    Unplug,
    Warmth,
)
from drivers.takktile.frames import Cell

_FRAME_ACTIONS = (Lose, Truncate, MoreCells, Garbage, Repeat)
_BYTES_A_CELL = 4


class TakktileFaults:
    """The faults of one bridge whose cells are `cells`. `unplug(gone)` is called when it goes and when it is back.

    Raises InputError for faults that mean nothing, and for cells that there are not.
    """

    def __init__(
        self,
        script: FaultScript[TakktileAction],
        cells: Iterable[Cell],
        unplug: Callable[[bool], None],
        start_ns: int,
    ) -> None:
        self._cells = frozenset(cells)
        self._unplug = unplug
        self._now: list[Running[TakktileAction]] = []
        self._schedule: Schedule[TakktileAction] = Schedule(script, _FRAME_ACTIONS, (), EVENTS, start_ns)
        self._schedule.check_actions(self._check)

    def add(self, fault: Fault[TakktileAction], now_ns: int) -> None:
        """One more fault, timed from now. Raises InputError."""
        self._check(fault.action)
        self._schedule.add(fault).arm(START, now_ns)

    def notice(self, event: str, now_ns: int) -> None:
        """Something has happened that faults may wait for."""
        self._schedule.notice(event, now_ns)

    def advance(self, now_ns: int) -> None:
        """Let begin and end what is due."""
        for _, edge, running in self._schedule.due(now_ns):
            if edge == "begin":
                self._now.append(running)
            else:
                self._now.remove(running)
            if isinstance(running.action, Unplug):
                self._unplug(edge == "begin")

    @property
    def silent(self) -> bool:
        """Whether no frame comes."""
        return any(isinstance(one.action, Silence) for one in self._now)

    def of_cell(self, cell: Cell, kind: type[CellAction]) -> CellAction | None:
        """What befalls a cell now, of one kind."""
        for one in self._now:
            if isinstance(one.action, kind) and (one.action.cells is None or tuple(cell) in one.action.cells):
                return one.action
        return None

    def noise_counts(self, cell: Cell) -> float:
        """Noise on top of its own, standard deviation in raw counts."""
        action = self.of_cell(cell, Noise)
        return action.counts if isinstance(action, Noise) else 0.0

    def warmth_K(self, cell: Cell) -> float:
        """By how much its temperature is off."""
        action = self.of_cell(cell, Warmth)
        return action.kelvin if isinstance(action, Warmth) else 0.0

    def press_N(self, cell: Cell) -> float:
        """Force beside those of the world."""
        action = self.of_cell(cell, Press)
        return action.newtons if isinstance(action, Press) else 0.0

    def is_dead(self, cell: Cell) -> bool:
        """Whether it answers nothing."""
        return self.of_cell(cell, Dead) is not None

    def is_stuck(self, cell: Cell) -> bool:
        """Whether it gives the words that it gave last."""
        return self.of_cell(cell, Stuck) is not None

    def strikes(self, now_ns: int) -> list[tuple[FrameAction, Running[TakktileAction]]]:
        """What befalls the frame that is made now; each is counted."""
        struck = []
        for one in self._schedule.frame_faults:
            if isinstance(one.action, _FRAME_ACTIONS) and one.strikes(now_ns):
                struck.append((one.action, one))
        return struck

    def _check(self, action: TakktileAction) -> None:
        if isinstance(action, CellAction) and action.cells is not None:
            unknown = [place for place in action.cells if Cell(*place) not in self._cells]
            if unknown:
                raise InputError(f"cells {unknown} are not there; expected some of {sorted(map(tuple, self._cells))}.")


def struck_frame(frame: bytes, struck: Iterable[tuple[FrameAction, Running[TakktileAction]]]) -> bytes | None:
    """What becomes of a frame; None: it is lost."""
    for action, running in struck:
        if isinstance(action, Lose):
            return None
        if isinstance(action, Truncate):
            frame = frame[: action.length]
        elif isinstance(action, MoreCells):
            frame += frame[:_BYTES_A_CELL] * action.cells
        elif isinstance(action, Garbage):
            frame = running.random.randbytes(len(frame))
    return frame
