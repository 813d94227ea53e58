"""What the simulated safety puck watches: speeds, torques, supply and life signs, and the lights that tell of them.

It learns positions and torques from the same frames as everybody. A limit passed is a warning (yellow) or a fault
(red); a fault stays until Shift-Idle and asks for idle, and for E-stop if speed or torque is still too high half a
second later. Counts and puck units as on the wire; times in ns. What the sources leave open [assumed]: the reaction
to a voltage fault is idle; a puck that falls silent is as bad as all; a speed is the way between two readings over the
time between them, but over 50 ms at most, so that an arm moved by hand between two programs faults. Source: WAM
reference 4.3, 4.5, 4.7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from drivers.clock import nanoseconds, seconds
from drivers.simulated.elbow_speed import elbow_speeds_m_s
from drivers.simulated.puck_frames import counts_between
from drivers.wam.properties import SAFETY_ACTIVE, SAFETY_ESTOP, SAFETY_IDLE
from drivers.wam.transmission import motor_to_joint

_STILL_ABOVE_NS = nanoseconds(0.5)
_LONGEST_BETWEEN_NS = nanoseconds(0.05)
_NEVER_NS = 1 << 62
_RECENT_NS = nanoseconds(0.1)
_LIMIT_UNIT = 4096  # VL: Q4.12
_NEVER_TORQUE = 8191
_WATCHED = 4
"""Motors 1 to 4: wrist motion is not counted."""
_JOINT_PER_MOTOR = np.array([motor_to_joint(row)[:_WATCHED] for row in np.eye(7)[:_WATCHED]]).T.tolist()


class Light(IntEnum):
    """A warning light, by its code in PEN."""

    SAFE = 1
    WARNING = 2
    FAULT = 4


@dataclass(frozen=True)
class SafetySettings:
    """What no source tells of the safety puck, and what differs between arms."""

    heartbeat_s: float = 0.1
    """How long position replies may be missing in an active arm."""
    heartbeat_estop: bool = False
    """Whether a missing heartbeat is an E-stop; otherwise idle."""
    velocity_samples: int = 1
    """Readings in a row above VL2 that make a fault. One, or more in front of a world that runs in bursts."""
    set_gap_s: float = 0.0
    """A property set within this time of the last is lost; the vendor asks for 0.01."""


class SafetyWatch:
    """Eyes, ears and lights. `values`: the safety puck's properties by name; IFAULT among them is counted down.

    Methods that watch return the mode that follows (0 E-stop, 1 idle), or None. Faults that have happened since the
    last look are in `told`.
    """

    def __init__(self, values: dict[str, int], settings: SafetySettings, counts_per_turn: Sequence[int]) -> None:
        self._values = values
        self._settings = settings
        self._heartbeat_ns = nanoseconds(settings.heartbeat_s)
        self._radian_per_count = [2.0 * np.pi / counts for counts in counts_per_turn[:_WATCHED]]
        self.lights = dict.fromkeys(("velocity", "torque", "voltage", "heartbeat"), Light.SAFE)
        self.told: list[str] = []
        self._seen_ns: dict[int, int] = {}
        self._round: dict[int, int] = {}
        self._last_counts: list[int] = []
        self._last_joint_rad: list[float] = []
        self._last_ns = 0
        self._samples_above = 0
        self._above: dict[str, tuple[bool, int]] = {}
        self._recheck: dict[str, int] = {}
        self.due_ns = _NEVER_NS
        """When `tick` has something to do."""
        self.speed = 0.0
        """The greatest that was measured in the last reading: rad/s of a joint before zeroing, then m/s."""

    # --- what it hears

    def hear_position(self, node: int, counts: int, now_ns: int, mode: int) -> int | None:
        """A puck reports its position; with those of motors 1 to 4 there is a speed."""
        first = node not in self._seen_ns
        self._seen_ns[node] = now_ns
        if first:
            self._plan()
        if not 1 <= node <= _WATCHED:
            return None
        if node in self._round:
            self._round.clear()
        self._round[node] = counts
        if len(self._round) < _WATCHED:
            return None
        reading = [self._round[watched] for watched in range(1, _WATCHED + 1)]
        self._round.clear()
        return self._judge_speed(reading, now_ns, mode)

    def hear_torques(self, values: Sequence[int], now_ns: int, mode: int) -> int | None:
        """Torques are commanded to three or four motors."""
        if mode == SAFETY_ESTOP:
            return None
        greatest = max(max(values), -min(values))
        warning, limit = self._values["TL1"], self._values["TL2"]
        above = limit <= _NEVER_TORQUE and greatest > limit
        return self._judge("torque", above, warning <= _NEVER_TORQUE and greatest > warning, now_ns, mode)

    def see_supply(self, volts: float, now_ns: int, mode: int) -> int | None:
        """The motors' supply has this voltage."""
        values = self._values
        if volts >= values["VOLTL1"] and volts <= values["VOLTH1"] and self.lights["voltage"] is Light.WARNING:
            self.lights["voltage"] = Light.SAFE
        above = volts < values["VOLTL2"] or volts > values["VOLTH2"]
        warning = volts < values["VOLTL1"] or volts > values["VOLTH1"]
        return self._judge("voltage", above, warning, now_ns, mode)

    def tick(self, now_ns: int, mode: int) -> int | None:
        """Time has passed: are pucks still alive, has a speed or torque come down after its fault?"""
        reaction: int | None = None
        for cause, due_ns in tuple(self._recheck.items()):
            if now_ns >= due_ns:
                del self._recheck[cause]
                above, heard_ns = self._above[cause]
                if above and now_ns - heard_ns <= _RECENT_NS:
                    self.told.append(f"still_{cause}")
                    reaction = SAFETY_ESTOP
        if mode == SAFETY_ACTIVE and self._seen_ns and now_ns - min(self._seen_ns.values()) > self._heartbeat_ns:
            self.lights["heartbeat"] = Light.FAULT
            self.told.append("heartbeat_fault")
            self._seen_ns.clear()
            reaction = SAFETY_ESTOP if self._settings.heartbeat_estop or reaction == SAFETY_ESTOP else SAFETY_IDLE
        self._plan()
        return reaction

    # --- what the operator and the power do

    def clear(self) -> None:
        """Shift-Idle: forget faults."""
        self.lights.update(dict.fromkeys(self.lights, Light.SAFE))
        self._recheck.clear()

    def listen_anew(self) -> None:
        """The arm is activated: life signs count from the first that comes."""
        self._seen_ns.clear()
        self._plan()

    def forget_positions(self) -> None:
        """Motor pucks have lost their power."""
        self._seen_ns.clear()
        self._round.clear()
        self._last_counts = []
        self._plan()

    @property
    def faulty(self) -> bool:
        """Whether a fault waits for Shift-Idle."""
        return Light.FAULT in self.lights.values()

    # --- judging

    def _judge_speed(self, reading: list[int], now_ns: int, mode: int) -> int | None:
        ignored = self._values["IFAULT"] > 0
        self._values["IFAULT"] = max(0, self._values["IFAULT"] - 1)
        last, last_rad, last_ns = self._last_counts, self._last_joint_rad, self._last_ns
        if last and now_ns > last_ns and reading == last:
            self.speed, self._last_ns = 0.0, now_ns
        else:
            joint_rad = self._joint_rad(reading)
            self._last_counts, self._last_joint_rad, self._last_ns = reading, joint_rad, now_ns
            if not last or now_ns <= last_ns:
                return None
            moved = self._joint_rad([counts_between(*pair) for pair in zip(reading, last, strict=True)])
            elapsed_s = seconds(min(now_ns - last_ns, _LONGEST_BETWEEN_NS))
            joint_rad_s = [way / elapsed_s for way in moved]
            if self._values["ZERO"]:
                self.speed = max(elbow_speeds_m_s(last_rad, joint_rad_s))
            else:
                self.speed = max(map(abs, joint_rad_s))
        if ignored or mode == SAFETY_ESTOP:
            return None
        warning, limit = self._values["VL1"] / _LIMIT_UNIT, self._values["VL2"] / _LIMIT_UNIT
        above = 0.0 < limit < self.speed
        self._samples_above = self._samples_above + 1 if above else 0
        above = self._samples_above >= self._settings.velocity_samples
        return self._judge("velocity", above, 0.0 < warning < self.speed, now_ns, mode)

    def _joint_rad(self, counts: Sequence[int]) -> list[float]:
        motor_rad = [count * unit for count, unit in zip(counts, self._radian_per_count, strict=True)]
        return [sum(map(float.__mul__, row, motor_rad)) for row in _JOINT_PER_MOTOR]

    def _judge(self, cause: str, above: bool, warning: bool, now_ns: int, mode: int) -> int | None:
        if not (above or warning) and self.lights[cause] is Light.SAFE:
            return None
        self._above[cause] = above, now_ns
        if self.lights[cause] is Light.FAULT:
            return None
        if not above:
            self.lights[cause] = Light.WARNING if warning else Light.SAFE
            return None
        self.lights[cause] = Light.FAULT
        self.told.append(f"{cause}_fault")
        self._recheck[cause] = now_ns + _STILL_ABOVE_NS
        self._plan()
        return SAFETY_IDLE if mode == SAFETY_ACTIVE else None

    def _plan(self) -> None:
        """When to look next."""
        times = list(self._recheck.values())
        if self._seen_ns:
            times.append(min(self._seen_ns.values()) + self._heartbeat_ns + 1)
        self.due_ns = min(times, default=_NEVER_NS)


def lights_value(lights: Mapping[str, Light], estop: bool) -> int:
    """The lowest 15 bits of PEN: velocity, torque, voltage, heartbeat, other; the last is E-stop's."""
    codes = (*(lights[name] for name in ("velocity", "torque", "voltage", "heartbeat")),)
    codes = (*codes, Light.FAULT if estop else Light.SAFE)
    return sum(code << 3 * place for place, code in enumerate(codes))
