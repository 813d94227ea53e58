"""What the processes say to each other: fixed binary payloads, one a message.

The links of `controller/service/links.py` put schema number, sequence and the monotonic time of the sample in front
of these payloads and carry them whole. Finger order everywhere: right, left. SI units.

    hand  → cycle   HandState      latest value     cycle → hand    HandSetPoint   latest value
    front → cycle   CycleCommand   ordered          cycle → front   CycleEvent     ordered
                                                    cycle → front   CYCLE_RECORD   latest value, every cycle
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag, unique
from typing import Any, Final

import numpy as np

from drivers.errors import ProtocolError

Pair = tuple[float, float]


class HandMode(IntEnum):
    """What the hand process does with the motors."""

    TRACK = 0  # follow the excursion set-points under the load cap
    FREEZE = 1  # hold both excursions where they are, under the holding cap: the reaction to a fault
    OPEN = 2  # pay out to the open position


@unique
class HandFault(IntFlag):
    """What is wrong with the tendon motors; 0 = nothing."""

    NONE = 0
    NO_REPLY = 1
    HARDWARE = 2
    TORQUE_LOST = 4
    BUS_LOST = 8
    REFUSED = 16  # a set-point was out of travel or above what the motor may give
    OVERHEATED = 32
    OVERLOADED = 64
    VOLTAGE = 128
    RESTARTED = 256  # a motor was without supply for a moment: it lost its settings, and its torque
    OTHER_MODE = 512  # a motor was found holding in a mode, or with a zero, in which it cannot be driven; it is left so
    ONE_SILENT = 1024  # one motor answers and the other does not: it may be without supply
    OUTSIDE_TURN = 2048  # a spool left the one turn in which its motor knows its place
    HOT = 4096  # heat lowers what a motor may give
    ASTRAY = 8192  # a spool is not where it was wound to; the cycle's own finding
    POSITION_JUMP = 16384  # a motor's position was all at once somewhere else, and stayed there


@dataclass(frozen=True)
class HandState:
    """Newest sample of the two tendons. Excursions are spool-side, from the calibrated zero, positive = pulled in."""

    excursion_m: Pair
    rate_m_s: Pair
    tension_N: Pair
    effort: Pair
    """Current, A, or load, a fraction of full output, as the motors' model has it; positive = tightening."""
    mode: HandMode = HandMode.TRACK
    fault: HandFault = HandFault.NONE
    tension_uncertainty_N: Pair = (0.0, 0.0)
    temperature_C: Pair = (0.0, 0.0)
    voltage_V: Pair = (0.0, 0.0)
    derating: Pair = (1.0, 1.0)
    """Part of the load cap that each motor's temperature allows."""
    read_rate_hz: float = 0.0
    """Samples of both motors a second, measured."""

    _LAYOUT = struct.Struct("<8dII9d")

    def pack(self) -> bytes:
        return self._LAYOUT.pack(
            *self.excursion_m,
            *self.rate_m_s,
            *self.tension_N,
            *self.effort,
            self.mode,
            self.fault,
            *self.tension_uncertainty_N,
            *self.temperature_C,
            *self.voltage_V,
            *self.derating,
            self.read_rate_hz,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> HandState:
        e0, e1, r0, r1, t0, t1, f0, f1, mode, fault, u0, u1, c0, c1, v0, v1, d0, d1, rate = _unpack(
            cls._LAYOUT, payload, cls.__name__
        )
        motors = (u0, u1), (c0, c1), (v0, v1), (d0, d1)
        return cls((e0, e1), (r0, r1), (t0, t1), (f0, f1), HandMode(mode), HandFault(fault), *motors, rate)


@dataclass(frozen=True)
class HandSetPoint:
    """Where the tendons shall be, and how hard they may pull."""

    excursion_m: Pair
    load_cap_N: Pair
    mode: HandMode = HandMode.TRACK

    _LAYOUT = struct.Struct("<4dI")

    def pack(self) -> bytes:
        return self._LAYOUT.pack(*self.excursion_m, *self.load_cap_N, self.mode)

    @classmethod
    def unpack(cls, payload: bytes) -> HandSetPoint:
        e0, e1, cap0, cap1, mode = _unpack(cls._LAYOUT, payload, cls.__name__)
        return cls((e0, e1), (cap0, cap1), HandMode(mode))


class CommandKind(IntEnum):
    """What the front may ask of the cycle. `values` of each kind in brackets."""

    STOP = 1
    FAULT_CLEAR = 2
    SHUTDOWN = 3
    ARM_HOLD = 4
    MOVE_JOINTS = 5  # [joint_rad × 7, speed fraction]
    MOVE_WRIST = 6  # [T_world_wrist: xyz_m, quaternion wxyz; speed fraction]
    PREPOSITION = 7  # [as MOVE_WRIST; 1: there the grasp begins, 0: on the way to it]
    CLOSE = 8  # [rate_m_s]
    SQUEEZE = 9  # [mean excursion since contact m, mean load N, duration_s]
    HOLD = 10
    RELEASE = 11
    OPEN = 12
    SET_COMPENSATION = 13  # [enabled, index]
    LOAD_TABLE = 14  # the table's memfd travels with the message


class CompensationIndex(IntEnum):
    """What the motion table is looked up with."""

    EXCURSION = 0
    LOAD = 1
    FUSED = 2


COMMAND_VALUES: Final = 9


@dataclass(frozen=True)
class CycleCommand:
    """One validated command; `token` comes back in every event about it. Takes effect in cycle `effective_cycle` or,
    if that is past, in the cycle that receives it."""

    kind: CommandKind
    token: int
    values: tuple[float, ...] = ()
    effective_cycle: int = 0

    _LAYOUT = struct.Struct(f"<IIqq{COMMAND_VALUES}d")

    def pack(self) -> bytes:
        padded = (*self.values, *([0.0] * (COMMAND_VALUES - len(self.values))))
        return self._LAYOUT.pack(self.kind, len(self.values), self.token, self.effective_cycle, *padded)

    @classmethod
    def unpack(cls, payload: bytes) -> CycleCommand:
        kind, count, token, effective_cycle, *values = _unpack(cls._LAYOUT, payload, cls.__name__)
        return cls(CommandKind(kind), token, tuple(values[:count]), effective_cycle)


class EventKind(IntEnum):
    """What the cycle tells about a command (token > 0) or of itself (token 0)."""

    ACCEPTED = 1
    REJECTED = 2
    COMPLETED = 4
    FAILED = 5
    FAULT = 6
    STOPPED = 7
    WARNING = 8  # something is wrong that nothing suffers from yet


@unique
class Reason(IntEnum):
    """Why a command was refused or failed, or what the fault is. Texts: `controller/reasons.py`."""

    NONE = 0
    ARM_NOT_ACTIVE = 1
    WRONG_PHASE = 2
    BUSY = 3
    NO_TABLE = 4
    OUTSIDE_TABLE = 5
    LOAD_ABOVE_CAP = 6
    UNREACHABLE = 7
    SUPERSEDED = 8
    STOPPED_BY_COMMAND = 9
    NO_CONTACT = 20
    ONE_SIDED_CONTACT = 21
    CONTACT_UNEXPECTED = 22
    LOAD_CAP_REACHED = 23
    TABLE_END_REACHED = 24
    OFF_CENTRE = 25
    HAND_NOT_OPEN = 26
    WOUND_SHORT = 27
    ARM_SILENT = 40
    ARM_IDLED = 41
    TRACKING_ERROR = 43
    COLLISION = 44
    OFFSET_LIMIT = 45
    OFFSET_LAG = 46
    HAND_SILENT = 50
    HAND_HARDWARE = 51
    HAND_TORQUE_LOST = 52
    HAND_REFUSED = 54
    BUS_FAILED = 55
    ARM_ESTOP = 60
    ARM_VELOCITY = 61
    ARM_TORQUE = 62
    ARM_VOLTAGE = 63
    ARM_HEARTBEAT = 64
    SAFETY_SILENT = 65
    PUCK_RESET = 66
    ZERO_LOST = 67
    POSITION_JUMP = 68
    MOTOR_IDLE = 69
    MODE_RAISED = 70
    FOREIGN_TORQUE = 71
    STALE_FLOOD = 72
    MALFORMED_FLOOD = 73
    BUS_ERRORS = 74
    BUS_OFF = 75
    QUEUE_FULL = 76
    ADAPTER_GONE = 77
    ARM_NOT_READY = 78
    HAND_BUS_LOST = 100
    HAND_OVERHEATED = 101
    HAND_OVERLOADED = 102
    HAND_VOLTAGE = 103
    HAND_RESTARTED = 104
    HAND_OTHER_MODE = 105
    HAND_MOTOR_SILENT = 106
    HAND_HOT = 108
    HAND_NOT_FOLLOWING = 109
    HAND_OUTSIDE_TURN = 107
    HAND_POSITION_JUMP = 110


EVENT_VALUES: Final = 8


@dataclass(frozen=True)
class CycleEvent:
    """What happened to the command `token` (0: to the cycle itself) in cycle `cycle`."""

    kind: EventKind
    token: int
    cycle: int
    reason: Reason = Reason.NONE
    values: tuple[float, ...] = ()

    _LAYOUT = struct.Struct(f"<IIIIqq{EVENT_VALUES}d")

    def pack(self) -> bytes:
        padded = (*self.values, *([0.0] * (EVENT_VALUES - len(self.values))))
        return self._LAYOUT.pack(self.kind, self.reason, len(self.values), 0, self.token, self.cycle, *padded)

    @classmethod
    def unpack(cls, payload: bytes) -> CycleEvent:
        kind, reason, count, _, token, cycle, *values = _unpack(cls._LAYOUT, payload, cls.__name__)
        return cls(EventKind(kind), token, cycle, Reason(reason), tuple(values[:count]))


@dataclass(frozen=True)
class RecordLayout:
    """A flat record of float64 with named slices: written in place by the cycle, read by name in the front."""

    fields: tuple[tuple[str, int], ...]
    slices: dict[str, slice] = field(init=False)
    length: int = field(init=False)

    def __post_init__(self) -> None:
        slices: dict[str, slice] = {}
        start = 0
        for name, count in self.fields:
            slices[name] = slice(start, start + count)
            start += count
        object.__setattr__(self, "slices", slices)
        object.__setattr__(self, "length", start)

    def read(self, payload: bytes) -> dict[str, float | list[float]]:
        """The record as name → value or list of values."""
        if len(payload) != 8 * self.length:
            raise ProtocolError("link", f"a cycle record has {len(payload)} bytes; expected {8 * self.length}.")
        values: list[float] = np.frombuffer(payload).tolist()
        return {
            name: values[self.slices[name]] if count > 1 else values[self.slices[name].start]
            for name, count in self.fields
        }


CYCLE_RECORD: Final = RecordLayout(
    (
        ("cycle", 1),
        ("missed_periods", 1),
        ("late_us", 1),
        ("cpu_us", 1),
        ("arm_state", 1),
        ("hand_state", 1),
        ("grasp_phase", 1),
        ("reason", 1),
        ("compensation_enabled", 1),
        ("compensation_index", 1),
        ("joint_rad", 7),
        ("joint_command_rad", 7),
        ("joint_command_rad_s", 7),
        ("joint_torque_Nm", 7),
        ("wrist_xyz_m", 3),
        ("wrist_plan_xyz_m", 3),
        ("wrist_plan_rotation", 9),
        ("payload_fraction", 1),
        ("offset_target", 3),
        ("offset", 3),
        ("offset_rate", 3),
        ("inverse_kinematics_scale", 1),
        ("governor", 1),
        ("winding_m", 1),
        ("winding_rate_m_s", 1),
        ("index_mean_m", 1),
        ("index_difference_m", 1),
        ("index_rate_m_s", 1),
        ("load_index_N", 1),
        ("predicted_motion", 3),
        ("table_status", 1),
        ("hand_excursion_m", 2),
        ("hand_tension_N", 2),
        ("hand_age_us", 1),
        ("hand_effort", 2),
        ("hand_tension_uncertainty_N", 2),
        ("hand_temperature_C", 2),
        ("hand_voltage_V", 2),
        ("hand_derating", 2),
        ("hand_read_rate_hz", 1),
        ("hand_fault", 1),
        ("can_replies", 1),
    )
)


def _unpack(layout: struct.Struct, payload: bytes, name: str) -> tuple[Any, ...]:
    if len(payload) != layout.size:
        raise ProtocolError("link", f"a {name} has {len(payload)} bytes; expected {layout.size}.")
    return layout.unpack(payload)
