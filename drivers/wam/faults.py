"""The faults of a running arm, by name: what each is, what the arm then does, and what its operator should do.

`ARM_FAULTS` is the table; `FaultJudge` finds which one the driver's observations mean, `bus_fault` which one an error
of the bus is. Nothing here acts. Where the bus itself is lost nothing can be commanded: the texts then say what the
pucks do, and never claim a stop. Source: WAM reference 4.1, 4.5, 4.6, 7; 8 for what is uncertain.

Before safety firmware 197 there is no pendant state (PEN): the cause of a changed mode is not told, and any of the
pendant's faults is seen as `ARM_IDLED`.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass
from enum import Enum, auto
from typing import NamedTuple

from drivers.errors import BusError
from drivers.wam.bus import bus_errno
from drivers.wam.positions import ArmSample
from drivers.wam.properties import MOTOR_IDLE, MOTOR_TORQUE
from drivers.wam.safety_puck import ArmMode, Light, PendantState
from drivers.wam.watch import ArmWatch

PATIENCE_CYCLES = 10
"""How long a changed mode waits for the pendant to tell why, before it counts as unexplained."""
FLOOD_LEVEL = 60.0
FLOOD_LEAK = 1.0
"""Frames a cycle that may be bad in the long run: a lossy bus is no flood, one bad frame for each cycle is the edge."""


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


class Recovery(Enum):
    """What `fault.clear` has to do before the arm can be activated again."""

    NOTHING = auto()
    START = auto()
    """Positions or pucks are lost: find, wake and, at home, zero the arm again."""
    REOPEN = auto()
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
_ASKED = "It was asked to go idle; until it is, its weight alone is held up."
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
        Recovery.START,
    ),
    ArmFault.ARM_SILENT: FaultText(
        "Position replies of the arm are missing.",
        _ASKED,
        "Check power, E-stop and the CAN bus; then `fault.clear`.",
        Reaction.IDLE,
        Recovery.START,
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


_GONE = {errno.ENODEV, errno.ENXIO, errno.ENETDOWN, errno.EBADF, errno.ECONNRESET, errno.EPIPE, errno.ENOTCONN}


def bus_fault(error: BusError) -> NamedFault:
    """What an error of the bus means."""
    number = bus_errno(error)
    if number in (errno.ENOBUFS, errno.EAGAIN):
        return NamedFault(ArmFault.QUEUE_FULL, ())
    return NamedFault(ArmFault.ADAPTER_GONE if number in _GONE else ArmFault.BUS_FAILED)


class FaultJudge:
    """Finds the fault that the driver's observations mean, cycle by cycle. `forget` begins anew."""

    def __init__(self, watch: ArmWatch) -> None:
        self._watch = watch
        self.forget()

    def forget(self) -> None:
        """After recovery: what was counted, and how the mode changed, is past."""
        watch = self._watch
        self._mode = watch.mode
        self._unexplained = 0
        self._pendants_seen = watch.pendants_seen
        self._foreign, self._raised = watch.foreign_torques, watch.raised_modes
        self._malformed, self._errors = watch.malformed, watch.error_frames
        self._levels = {"stale": 0.0, "malformed": 0.0, "errors": 0.0}

    @property
    def asks_pendant(self) -> bool:
        """The arm went idle, and the pendant should be asked why."""
        return self._unexplained > 0 and self._watch.pendants_seen == self._pendants_seen

    def judge(self, sample: ArmSample, jumped: tuple[int, ...], silent: bool, idle_wanted: bool) -> NamedFault | None:
        """The gravest fault there is now. `silent`: positions have been missing for too long; `idle_wanted`: the
        arm was asked to go idle."""
        watch = self._watch
        if watch.bus_off:
            return NamedFault(ArmFault.BUS_OFF)
        change = self._judge_mode(idle_wanted)
        if change is not None:
            return change
        if watch.reset_nodes:
            return NamedFault(ArmFault.PUCK_RESET, (_digits(watch.reset_nodes),))
        if jumped:
            return NamedFault(ArmFault.POSITION_JUMP, (_digits(jumped),))
        if silent:
            return NamedFault(ArmFault.ARM_SILENT, (_digits(sample.missing),))
        if watch.zeroed is False:
            return NamedFault(ArmFault.ZERO_LOST)
        return self._judge_others() or self._judge_floods(sample)

    def _judge_mode(self, idle_wanted: bool) -> NamedFault | None:
        watch, before = self._watch, self._mode
        if watch.mode is ArmMode.ESTOP:
            self._mode, self._unexplained = watch.mode, 0
            return NamedFault(ArmFault.ESTOP)
        if watch.mode is ArmMode.OFFLINE:
            return NamedFault(ArmFault.SAFETY_SILENT)
        self._mode = watch.mode
        if watch.mode is not ArmMode.IDLE:
            self._unexplained = 0
            return None
        if before is ArmMode.ACTIVE and not idle_wanted:
            self._unexplained = 1
            self._pendants_seen = watch.pendants_seen
        if self._unexplained:
            told = watch.pendants_seen != self._pendants_seen
            cause = _lit(watch.pendant) if told and watch.pendant is not None else None
            if told or self._unexplained > PATIENCE_CYCLES:
                self._unexplained = 0
                return NamedFault(cause if cause is not None else ArmFault.ARM_IDLED)
            self._unexplained += 1
        return None

    def _judge_others(self) -> NamedFault | None:
        """What other hosts do, and pucks that do not do what the arm's mode says."""
        watch = self._watch
        if watch.foreign_torques != self._foreign:
            return NamedFault(ArmFault.FOREIGN_TORQUE, (float(watch.foreign_torques - self._foreign),))
        wrong = MOTOR_IDLE if watch.mode is ArmMode.ACTIVE else MOTOR_TORQUE
        nodes = [node for node, mode in watch.motor_modes.items() if mode == wrong] if watch.motor_modes else []
        if watch.raised_modes != self._raised or (nodes and wrong == MOTOR_TORQUE):
            return NamedFault(ArmFault.MODE_RAISED, (_digits(nodes),))
        return NamedFault(ArmFault.MOTOR_IDLE, (_digits(nodes),)) if nodes else None

    def _judge_floods(self, sample: ArmSample) -> NamedFault | None:
        """Leaky buckets: bad frames now and then are no fault."""
        watch, levels = self._watch, self._levels
        malformed = sample.malformed + watch.malformed - self._malformed
        errors = watch.error_frames - self._errors
        self._malformed, self._errors = watch.malformed, watch.error_frames
        if not (sample.stale or malformed or errors) and not any(levels.values()):
            return None
        for name, count in (("stale", sample.stale), ("malformed", malformed), ("errors", errors)):
            levels[name] = max(0.0, levels[name] + count - FLOOD_LEAK)
        if levels["malformed"] > FLOOD_LEVEL:
            return NamedFault(ArmFault.MALFORMED_FLOOD)
        if levels["errors"] > FLOOD_LEVEL:
            return NamedFault(ArmFault.ERROR_FRAMES)
        return NamedFault(ArmFault.STALE_FLOOD) if levels["stale"] > FLOOD_LEVEL else None


def _lit(pendant: PendantState) -> ArmFault | None:
    """The fault whose light is red."""
    for light, fault in (
        (pendant.velocity, ArmFault.VELOCITY),
        (pendant.torque, ArmFault.TORQUE),
        (pendant.voltage, ArmFault.VOLTAGE),
        (pendant.heartbeat, ArmFault.HEARTBEAT),
    ):
        if light is Light.FAULT:
            return fault
    return None


def _digits(nodes: set[int] | tuple[int, ...] | list[int]) -> float:
    """Nodes 1 to 7 as the digits of a number."""
    return float("".join(map(str, sorted(nodes))) or 0)
