"""How a row of the tendon motors' fault matrix is written: its faults, and what most phases are expected to show."""

from __future__ import annotations

from typing import Any

from drivers.simulated.faults import Fault
from drivers.simulated.serial_fault_actions import (
    SetRegister,
)
from tests.system.motor_fault_matrix import (
    GOES_ON,
    STARTS,
    WATCH_S,
    XM,
    After,
    Case,
    Cell,
    holds,
    refuses,
)
from tests.system.motor_fault_rig import HandStall

LASTING = WATCH_S
MX, XL = "MX-28", "XL430-W250"


def fault(action: Any, at_s: float = 0.0, for_s: float | None = None, **more: Any) -> Fault[Any]:
    return Fault(action=action, at_s=at_s, for_s=for_s, **more)


def setting(name: str, value: int, motors: tuple[int, ...] | None = None, at_s: float = 0.0) -> Fault[Any]:
    return fault(SetRegister(name=name, value=value, motors=motors), at_s)


def row(
    name: str,
    *faults: Fault[Any] | HandStall,
    running: Cell | None = GOES_ON,
    start: Cell | None = STARTS,
    after: After = "",
    let_go: tuple[int, ...] = (),
    mend: tuple[Fault[Any], ...] = (),
    model: str = XM,
    watch_s: float = WATCH_S,
    opens: bool = True,
    **cells: Cell | None,
) -> Case:
    """`running`: squeezing and, where something happens with the first model, holding. Other phases as `cells` names
    them, else not looked at."""
    squeezing = cells.get("squeezing", running)
    holding = cells.get("holding", running if model == XM and running is not GOES_ON else None)
    phases = (start, cells.get("open"), cells.get("closing"), squeezing, holding, cells.get("adoption"))
    return Case(name, faults, phases, after, let_go, mend, model, watch_s, opens)


SILENT, ONE_SILENT = holds("hand_silent"), holds("hand_motor_silent")
NOBODY = refuses("NoReplyError", "no reply at 1000000 bit/s")
ALONE: dict[str, Any] = {"start": refuses("NoReplyError", "the other motor answers")}
DAMAGED = refuses("ProtocolError", "damaged reply")
