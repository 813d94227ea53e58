"""A simulated motor's inner loop: from what its registers order to output and current.

    position    output = gain × (trajectory − position), beyond a dead margin and at least the punch   (RX-28: slope)
    velocity    output = P × error + I × its integral, error in counts of velocity
    current     the output that drives this current, as far as the supply reaches
    output      as ordered

then within the output cap and, in current-based position mode, the current within its cap, as the motor measures it.
Position loop: P part only; its other gains have no effect. Positive = counter-clockwise. Scales: dynamixel reference
2.2, 2.3; velocity gains (/128, /65 536 a millisecond) from the ROBOTIS e-manual.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from drivers.simulated.dynamixel_electrics import Electrics


class Drive(enum.Enum):
    """What is controlled."""

    POSITION = enum.auto()
    VELOCITY = enum.auto()
    CURRENT = enum.auto()
    OUTPUT = enum.auto()


@dataclass(frozen=True, slots=True)
class Order:
    """What the registers ask for. Outputs in counts."""

    drive: Drive
    goal: float
    """Ticks, counts of velocity, A, or counts of output."""
    output_cap: float
    current_cap_A: float = math.inf
    gain: tuple[float, float] = (0.0, 0.0)
    """Counts of output per tick, for errors that turn the shaft clockwise and counter-clockwise."""
    margin_ticks: tuple[float, float] = (0.0, 0.0)
    punch: float = 0.0
    velocity_gain: tuple[float, float] = (0.0, 0.0)
    """P in counts per count, I in counts per count and s."""
    profile_ticks_s: float = 0.0
    """Speed of the trajectory; 0 = it jumps to its goal."""
    profile_ticks_s2: float = 0.0
    """Its acceleration; 0 = at once."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the motor does in one step."""

    output: float
    current_A: float
    demand: float
    """Output before the current's cap, as part of full output, 0…1."""


class Trajectory:
    """A position on its way to a goal with limited speed and acceleration, ticks."""

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0

    def reset(self, position: float) -> None:
        """Begin at rest here."""
        self.position, self.velocity = position, 0.0

    def step(self, goal: float, limit: float, acceleration: float, period_s: float) -> float:
        """The position after `period_s`; `limit` 0 jumps to the goal."""
        if limit <= 0.0:
            self.reset(goal)
            return goal
        distance = goal - self.position
        allowed = limit
        if acceleration > 0.0:
            stopping = math.sqrt(2.0 * acceleration * abs(distance))
            allowed = min(limit, stopping)
        wanted = math.copysign(allowed, distance)
        if acceleration > 0.0:
            change = acceleration * period_s
            wanted = max(self.velocity - change, min(self.velocity + change, wanted))
        move = wanted * period_s
        if abs(distance) <= max(abs(move), 0.5) and distance * wanted >= 0.0:
            self.reset(goal)
        else:
            self.position += move
            self.velocity = wanted
        return self.position


class InnerLoop:
    """The loop of one motor."""

    def __init__(self, electrics: Electrics, full_output: float) -> None:
        self.trajectory = Trajectory()
        self.electrics = electrics
        """As warm as the motor is."""
        self._full = full_output
        self._integral = 0.0

    def reset(self, position_ticks: float) -> None:
        """Torque comes on, or the mode is another."""
        self.trajectory.reset(position_ticks)
        self._integral = 0.0

    def step(
        self,
        order: Order,
        position_ticks: int,
        velocity_counts: float,
        shaft_rad_s: float,
        supply_V: float,
        period_s: float,
        sensor_error_A: float = 0.0,
    ) -> Outcome:
        """One step of `period_s`, from what the sensors tell; `sensor_error_A`: of the current."""
        electrics = self.electrics
        volt_per_count = supply_V / self._full
        back_emf_V = electrics.back_emf_V_s * shaft_rad_s
        if order.drive is Drive.POSITION:
            target = self.trajectory.step(order.goal, order.profile_ticks_s, order.profile_ticks_s2, period_s)
            output = _position_output(order, target - position_ticks)
        elif order.drive is Drive.VELOCITY:
            output = self._velocity_output(order, order.goal - velocity_counts, period_s)
        elif order.drive is Drive.CURRENT:
            output = ((order.goal - sensor_error_A) * electrics.resistance_ohm + back_emf_V) / volt_per_count
        else:
            output = order.goal
        cap = order.output_cap
        output = max(-cap, min(cap, output))
        demand = abs(output) / self._full
        current_A = (output * volt_per_count - back_emf_V) / electrics.resistance_ohm
        measured_A = current_A + sensor_error_A
        if abs(measured_A) > order.current_cap_A:
            current_A = math.copysign(order.current_cap_A, measured_A) - sensor_error_A
            output = (current_A * electrics.resistance_ohm + back_emf_V) / volt_per_count
        return Outcome(output, current_A, demand)

    def _velocity_output(self, order: Order, error: float, period_s: float) -> float:
        proportional, integral = order.velocity_gain
        cap = order.output_cap
        self._integral = max(-cap, min(cap, self._integral + integral * error * period_s))
        return proportional * error + self._integral


def _position_output(order: Order, error_ticks: float) -> float:
    side = 1 if error_ticks > 0.0 else 0
    excess = abs(error_ticks) - order.margin_ticks[side]
    if excess <= 0.0:
        return 0.0
    return math.copysign(max(order.punch, order.gain[side] * excess), error_ticks)
