"""The faults of a running arm, by name: what each is, what the arm then does, and what its operator should do.

Where the bus itself is lost nothing can be commanded: the texts then say what the pucks do, and never claim a stop.
An arm that is still silent when its fault is cleared is started again, whatever the table says.
Source: WAM reference 4.1, 4.5, 4.6, 7; 8 for what is uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import NamedTuple


class ArmFault(Enum):
    """A fault's code; stable, for programs."""

    ESTOP = "estop"
    ARM_IDLED = "arm_idled"
    VELOCITY = "arm_velocity"
    TORQUE = "arm_torque"
    VOLTAGE = "arm_voltage"
    HEARTBEAT = "arm_heartbeat"
    SAFETY_SILENT = "safety_puck_silent"
    ARM_SILENT = "arm_silent"
    PUCK_RESET = "puck_reset"
    ZERO_LOST = "zero_lost"
    POSITION_JUMP = "position_jump"
    MOTOR_IDLE = "motor_idle"
    MODE_RAISED = "mode_raised"
    FOREIGN_TORQUE = "foreign_torque"
    STALE_FLOOD = "stale_flood"
    MALFORMED_FLOOD = "malformed_flood"
    ERROR_FRAMES = "bus_errors"
    BUS_OFF = "bus_off"
    QUEUE_FULL = "can_queue_full"
    ADAPTER_GONE = "can_adapter_gone"
    BUS_FAILED = "bus_failed"


class Recovery(IntEnum):
    """What `fault.clear` has to do before the arm can be activated again, in order."""

    NOTHING = 0
    START = 1
    """Positions or pucks are lost: find, wake and, at home, zero the arm again."""
    REOPEN = 2
    """Open the bus again, then start the arm again."""


class Reaction(Enum):
    """What the cycle does with the arm."""

    HOLD = auto()
    """Stop along the path and hold there."""
    IDLE = auto()
    """Ask the safety puck for idle; until it is so, only gravity is held up."""
    NONE = auto()
    """The pucks have acted by themselves, or nothing can be commanded."""


@dataclass(frozen=True)
class FaultText:
    """One row of the table."""

    cause: str
    arm_does: str
    operator: str
    reaction: Reaction = Reaction.NONE
    recovery: Recovery = Recovery.NOTHING
    value_names: tuple[str, ...] = ()


_BRAKES = "The motors brake; positions are kept."
_GO_ON = "then press Shift+Idle, send `fault.clear` and press Shift+Activate."
_HOME = (
    "place the arm in its home pose by hand, press Shift+Idle, send `fault.clear` to start it again, then press "
    "Shift+Activate."
)
_ASKED = "An active arm is asked to go idle; without positions it meanwhile carries its weight alone."
_LAST_TORQUE = "Nothing can be commanded: the pucks apply their last torque until the safety puck's heartbeat."
_HOLDS = "The arm stops along its path and holds."
_ADAPTER = "Keep clear of the arm; press E-stop; check the adapter; then send `fault.clear` to start it again."

ARM_FAULTS: dict[ArmFault, FaultText] = {
    ArmFault.ESTOP: FaultText(
        "E-stop was pressed.",
        "The motors have no power, and their positions are lost.",
        f"Hold the arm's weight; when all is safe release E-stop, {_HOME}",
        recovery=Recovery.START,
    ),
    ArmFault.ARM_IDLED: FaultText(
        "The arm went idle while an object was held.",
        "The motors brake; the hand still holds.",
        "Activate the arm again, then `fault.clear`.",
    ),
    ArmFault.VELOCITY: FaultText(
        "The safety puck saw the elbow or forearm too fast.",
        _BRAKES,
        f"See what moved it; {_GO_ON}",
    ),
    ArmFault.TORQUE: FaultText(
        "The safety puck saw a motor torque above its limit.",
        _BRAKES,
        f"Look for a wrong load, gain or gravity model; {_GO_ON}",
    ),
    ArmFault.VOLTAGE: FaultText(
        "The safety puck saw the motors' supply out of its range.",
        _BRAKES,
        f"Check the power supply; {_GO_ON}",
    ),
    ArmFault.HEARTBEAT: FaultText(
        "The safety puck missed position replies of the pucks.",
        _BRAKES,
        f"Look for missed periods and lost frames; {_GO_ON}",
    ),
    ArmFault.SAFETY_SILENT: FaultText(
        "The safety puck does not answer any more.",
        "The arm stops along its path and holds, with nobody to watch it.",
        "Press E-stop; check the arm's power supply and the CAN cable; then send `fault.clear` to start it again.",
        Reaction.HOLD,
    ),
    ArmFault.ARM_SILENT: FaultText(
        "Position replies of the arm are missing.",
        _ASKED,
        "Check power, E-stop and the CAN bus; then `fault.clear`.",
        Reaction.IDLE,
        Recovery.NOTHING,
        ("silent_nodes",),
    ),
    ArmFault.PUCK_RESET: FaultText(
        "Motor pucks were reset: the supply dipped, or a cable is loose. Their positions are lost.",
        _ASKED,
        f"Check supply and cables; {_HOME}",
        Reaction.IDLE,
        Recovery.START,
        ("reset_nodes",),
    ),
    ArmFault.ZERO_LOST: FaultText(
        "The safety puck says that the arm is not zeroed.",
        _ASKED,
        f"Find out who wrote ZERO, or whether it was reset; {_HOME}",
        Reaction.IDLE,
        Recovery.START,
    ),
    ArmFault.POSITION_JUMP: FaultText(
        "The position of a motor is all at once somewhere else, and stays there: its zero is lost.",
        _ASKED,
        f"Find out who wrote P, or have the encoder checked. Press E-stop and release it; {_HOME}",
        Reaction.IDLE,
        Recovery.START,
        ("jumped_nodes",),
    ),
    ArmFault.MOTOR_IDLE: FaultText(
        "A motor puck is idle in an active arm: its joint has no torque.",
        _ASKED,
        f"Find out who lowered its mode; {_GO_ON}",
        Reaction.IDLE,
        Recovery.NOTHING,
        ("idle_nodes",),
    ),
    ArmFault.MODE_RAISED: FaultText(
        "Another host has put motor pucks into torque mode, which is the operator's to do.",
        _ASKED,
        f"Press E-stop; stop that program; release, {_HOME}",
        Reaction.IDLE,
        Recovery.START,
        ("raised_nodes",),
    ),
    ArmFault.FOREIGN_TORQUE: FaultText(
        "Another host sends torques to the arm.",
        _ASKED,
        f"Stop that program; {_GO_ON}",
        Reaction.IDLE,
        Recovery.NOTHING,
        ("foreign_frames",),
    ),
    ArmFault.STALE_FLOOD: FaultText(
        "Positions come late or twice in most cycles.",
        _HOLDS,
        "Look for another program that asks for positions, or a slow adapter; then `fault.clear`.",
        Reaction.HOLD,
    ),
    ArmFault.MALFORMED_FLOOD: FaultText(
        "Frames that no puck sends fill the bus.",
        _HOLDS,
        "Look for another device or a wrong bit rate on the bus; then `fault.clear`.",
        Reaction.HOLD,
    ),
    ArmFault.ERROR_FRAMES: FaultText(
        "The CAN adapter reports errors in most cycles.",
        _HOLDS,
        "Check cable, termination and bit rate; then `fault.clear`.",
        Reaction.HOLD,
    ),
    ArmFault.BUS_OFF: FaultText(
        "The CAN adapter has left the bus after too many errors.",
        _LAST_TORQUE,
        f"{_ADAPTER} A bus that does not come back needs `ip link set can0 type can restart-ms 100`.",
        recovery=Recovery.REOPEN,
    ),
    ArmFault.QUEUE_FULL: FaultText(
        "The CAN adapter's queue is full: nobody acknowledges frames. None is sent later.",
        _LAST_TORQUE,
        f"Check that the arm is on and the bus terminated, with a short txqueuelen. {_ADAPTER}",
        recovery=Recovery.REOPEN,
    ),
    ArmFault.ADAPTER_GONE: FaultText(
        "The CAN adapter is gone.",
        _LAST_TORQUE,
        _ADAPTER,
        recovery=Recovery.REOPEN,
    ),
    ArmFault.BUS_FAILED: FaultText(
        "The CAN bus takes no frames.",
        _LAST_TORQUE,
        _ADAPTER,
        recovery=Recovery.REOPEN,
    ),
}


class NamedFault(NamedTuple):
    """A fault with its values, in the order of `value_names` of its text. Nodes are written as digits: 135."""

    code: ArmFault
    values: tuple[float, ...] = ()
