"""How far the goal of a tendon motor must be ahead of where its spool shall be.

Its position loop's gain is a spring that tension and gear friction wind up (dynamixel reference 2.4: standing, the
output is P gain × position error), its back-EMF a lag at speed, and within a dead margin it does nothing. Where these
numbers come from: `drivers/dynamixel/position_loop.py`.
"""

from __future__ import annotations

from dataclasses import dataclass


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
        """The supply to reckon with, for a whole grasp, as its last digit flickers; the law's while it is not known."""
        return measured_V if measured_V > 0.5 * self.voltage_V else self.voltage_V


def sign(rate: float) -> float:
    """+1 winding in, −1 letting out, 0 standing."""
    return 0.0 if rate == 0.0 else 1.0 if rate > 0.0 else -1.0


def towards(value: float, direction: float, step: float) -> float:
    """`value` a step nearer to `direction`; a standing motor keeps the friction it stopped with."""
    return value if direction == 0.0 else min(max(direction, value - step), value + step)
