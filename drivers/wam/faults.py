"""Finds the fault that the driver's observations mean: `FaultJudge`; and that an error of the bus means: `bus_fault`.

Nothing here acts; the faults themselves are in `fault_table.py`. Before safety firmware 197 there is no pendant state
(PEN): the cause of a changed mode is not told, and any of the pendant's faults is seen as `ARM_IDLED`.
Source: WAM reference 4.1, 4.5, 4.6, 7.
"""

from __future__ import annotations

import errno

from drivers.errors import BusError
from drivers.wam.bus import bus_errno
from drivers.wam.fault_table import ArmFault, NamedFault
from drivers.wam.positions import ArmSample
from drivers.wam.properties import MOTOR_IDLE, MOTOR_TORQUE
from drivers.wam.safety_puck import ArmMode, Light, PendantState
from drivers.wam.watch import ArmWatch

PATIENCE_CYCLES = 10
"""How long a changed mode waits for the pendant to tell why, before it counts as unexplained."""
FLOOD_LEVEL = 60.0
FLOOD_LEAK = 1.0
"""Frames a cycle that may be bad in the long run: a lossy bus is no flood, one bad frame for each cycle is the edge."""


_GONE = {errno.ENODEV, errno.ENXIO, errno.ENETDOWN, errno.EBADF, errno.ECONNRESET, errno.EPIPE, errno.ENOTCONN}


def bus_fault(error: BusError) -> NamedFault:
    """What an error of the bus means."""
    number = bus_errno(error)
    if number in (errno.ENOBUFS, errno.EAGAIN):
        return NamedFault(ArmFault.QUEUE_FULL, ())
    return NamedFault(ArmFault.ADAPTER_GONE if number in _GONE else ArmFault.BUS_FAILED)


class FaultJudge:
    """Finds the fault that the driver's observations mean, cycle by cycle. `forget` begins anew."""

    def __init__(self, watch: ArmWatch, *, late_is_fault: bool = True) -> None:
        """`late_is_fault`: whether positions that come late or twice in most cycles are one."""
        self._watch = watch
        self._late_is_fault = late_is_fault
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
    def unexplained(self) -> bool:
        """The arm went idle unasked, and why is not known yet."""
        return self._unexplained > 0

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
        late = sample.stale if self._late_is_fault else 0
        if not (late or malformed or errors) and not any(levels.values()):
            return None
        for name, count in (("stale", late), ("malformed", malformed), ("errors", errors)):
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
