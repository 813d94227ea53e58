"""The life of a grasp, as pure functions: no I/O, no clock.

    none → prepositioned → closing → contact → squeezing → holding ⇄ carrying → releasing → none
    closing → prepositioned (time-out, one-sided contact, stop)
    any gripping phase → fault → (fault.clear) → holding or none

Arm, hand and grasp are three fields, not one: an idle arm may well hold an object.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class ArmState(IntEnum):
    """What the arm is: the operator's pendant decides, the daemon only ever lowers it."""

    OFFLINE = 0
    ESTOP = 1
    IDLE = 2
    ACTIVE = 3


class HandStatus(IntEnum):
    """What the hand is."""

    OFFLINE = 0
    OPEN = 1
    GRIPPING = 2


class GraspPhase(IntEnum):
    """Where in its life a grasp is."""

    NONE = 0
    PREPOSITIONED = 1
    CLOSING = 2
    CONTACT = 3
    SQUEEZING = 4
    HOLDING = 5
    CARRYING = 6
    RELEASING = 7
    FAULT = 8


class GraspEvent(IntEnum):
    """What can happen to a grasp."""

    PREPOSITIONED = 1
    CLOSE = 2
    CONTACT_FOUND = 3
    CLOSING_FAILED = 4
    SQUEEZE = 5
    SQUEEZED = 6
    HOLD = 7
    CARRY = 8
    CARRIED = 9
    RELEASE = 10
    RELEASED = 11
    FAULT = 12
    FAULT_CLEARED = 13
    WITHDRAWN = 14


# From first contact to release the motion table is in force and the object is kept still.
COMPENSATED: Final = frozenset(
    {GraspPhase.CLOSING, GraspPhase.CONTACT, GraspPhase.SQUEEZING, GraspPhase.HOLDING, GraspPhase.CARRYING}
    | {GraspPhase.RELEASING}
)
GRIPPING: Final = frozenset(COMPENSATED - {GraspPhase.CLOSING})

_P, _E = GraspPhase, GraspEvent
_TRANSITIONS: Final[dict[tuple[GraspPhase, GraspEvent], GraspPhase]] = {
    (_P.NONE, _E.PREPOSITIONED): _P.PREPOSITIONED,
    (_P.PREPOSITIONED, _E.PREPOSITIONED): _P.PREPOSITIONED,
    (_P.PREPOSITIONED, _E.WITHDRAWN): _P.NONE,
    (_P.PREPOSITIONED, _E.CLOSE): _P.CLOSING,
    (_P.CLOSING, _E.CONTACT_FOUND): _P.CONTACT,
    (_P.CLOSING, _E.CLOSING_FAILED): _P.PREPOSITIONED,
    (_P.CONTACT, _E.SQUEEZE): _P.SQUEEZING,
    (_P.HOLDING, _E.SQUEEZE): _P.SQUEEZING,
    (_P.CONTACT, _E.HOLD): _P.HOLDING,
    (_P.SQUEEZING, _E.HOLD): _P.HOLDING,
    (_P.SQUEEZING, _E.SQUEEZED): _P.HOLDING,
    (_P.HOLDING, _E.HOLD): _P.HOLDING,
    (_P.CARRYING, _E.HOLD): _P.HOLDING,
    (_P.HOLDING, _E.CARRY): _P.CARRYING,
    (_P.CARRYING, _E.CARRIED): _P.HOLDING,
    (_P.RELEASING, _E.HOLD): _P.HOLDING,
    (_P.RELEASING, _E.RELEASED): _P.NONE,
    **{
        (phase, _E.RELEASE): _P.RELEASING
        for phase in (_P.CLOSING, _P.CONTACT, _P.SQUEEZING, _P.HOLDING, _P.CARRYING, _P.FAULT)
    },
}


def next_phase(phase: GraspPhase, event: GraspEvent, *, gripping: bool = False) -> GraspPhase | None:
    """The phase after `event`, or None if `event` cannot happen in `phase`.

    `gripping` (both fingers on the object) decides where a cleared fault leads: to holding, else to none.
    A fault in a phase that holds nothing needs no fault phase and leads to none.
    """
    if event is GraspEvent.FAULT:
        return GraspPhase.FAULT if phase in COMPENSATED or phase is GraspPhase.FAULT else GraspPhase.NONE
    if event is GraspEvent.FAULT_CLEARED:
        if phase is not GraspPhase.FAULT:
            return None
        return GraspPhase.HOLDING if gripping else GraspPhase.NONE
    return _TRANSITIONS.get((phase, event))
