"""How far the goal of a tendon motor must be ahead of where its spool shall be.

Its position loop's gain is a spring that tension and gear friction wind up (dynamixel reference 2.4: standing, the
output is P gain × position error), its back-EMF a lag at speed, and within a dead margin it does nothing. Where these
numbers come from: `drivers/dynamixel/position_loop.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

from controller.messages import Pair

FLICKER_V = 0.25
"""Of the supply that motors tell: a tick of 0.1 V, and what their own currents pull it down by."""
SUPPLY_RATE_V_S = 2.0
LONGEST_SAMPLE_S = 0.02
"""Between two samples that count; the first comes after any time."""


@dataclass(frozen=True)
class MotorDrive:
    """What one motor's goal is led by. All but `dead_m` hold at `voltage_V`: a higher supply does more with the same
    error."""

    compliance_m_per_N: float = 0.0
    friction_N: float = 0.0
    lag_s: float = 0.0
    dead_m: float = 0.0
    voltage_V: float = 12.0

    def lead_m(self, tension_N: float, rate_m_s: float, friction_sign: float, supply_V: float) -> float:
        """How far the goal must be ahead of a spool that pulls `tension_N` at `rate_m_s`; friction against its sign."""
        load_N = tension_N + friction_sign * self.friction_N
        lead_m = (self.compliance_m_per_N * load_N + self.lag_s * rate_m_s) * self.voltage_V / supply_V
        return lead_m + min(max(lead_m, -self.dead_m), self.dead_m)

    def supply_V(self, measured_V: float) -> float:
        """The supply to reckon with; the law's while it is not known."""
        return measured_V if measured_V > 0.5 * self.voltage_V else self.voltage_V


class Supply:
    """What both motors' leads are reckoned with, right finger first: slowly behind a supply that sags or comes back,
    so that no goal jumps, and deaf to its last digits."""

    def __init__(self, drives: tuple[MotorDrive, MotorDrive]) -> None:
        self._drives = drives
        self._sample_ns = 0
        self.volts: Pair = (drives[0].voltage_V, drives[1].voltage_V)

    def begin(self, measured_V: Pair) -> None:
        """A grasp begins, and nothing is led yet."""
        self.volts = self._drives[0].supply_V(measured_V[0]), self._drives[1].supply_V(measured_V[1])

    def follow(self, measured_V: Pair, sample_ns: int) -> None:
        """What the motors tell with a sample."""
        step_V = SUPPLY_RATE_V_S * min((sample_ns - self._sample_ns) * 1e-9, LONGEST_SAMPLE_S)
        self._sample_ns = sample_ns
        self.volts = self._followed(0, measured_V[0], step_V), self._followed(1, measured_V[1], step_V)

    def _followed(self, motor: int, measured_V: float, step_V: float) -> float:
        now_V, known_V = self.volts[motor], self._drives[motor].supply_V(measured_V)
        wanted_V = min(max(now_V, known_V - FLICKER_V), known_V + FLICKER_V)
        return min(max(wanted_V, now_V - step_V), now_V + step_V)


def sign(rate: float) -> float:
    """+1 winding in, −1 letting out, 0 standing."""
    return 0.0 if rate == 0.0 else 1.0 if rate > 0.0 else -1.0


def towards(value: float, direction: float, step: float) -> float:
    """`value` a step nearer to `direction`; a standing motor keeps the friction it stopped with."""
    return value if direction == 0.0 else min(max(direction, value - step), value + step)
