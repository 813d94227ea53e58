"""What wears on a simulated motor: the heat in its winding and the time it pushes in vain.

Temperature follows the square of the current with one time constant: at 40 % of the stall current, which is advised as
the most for lasting use (dynamixel reference 1.5, 3.2), it ends at 80 °C, and fully stalled it is there in about a
minute. Overload is judged by the output that the position loop asks for, not by the current (reference 6.2), so that a
motor with a low Goal Current trips although it stays cool: 80 % of full output for 3 s without turning. All four
numbers are assumptions; no document has them.
"""

from __future__ import annotations

AMBIENT_C = 30.0
TIME_CONSTANT_S = 400.0
LASTING_PART_OF_STALL = 0.4
LASTING_RISE_K = 50.0
OVERLOAD_OUTPUT = 0.8
OVERLOAD_S = 3.0
STANDING_PART_OF_NO_LOAD = 0.05


class MotorStress:
    """Heat and overload of one motor in time."""

    def __init__(self, stall_current_A: float, no_load_speed_rad_s: float) -> None:
        self._rise_K_per_A2 = LASTING_RISE_K / (LASTING_PART_OF_STALL * stall_current_A) ** 2
        self._standing_rad_s = STANDING_PART_OF_NO_LOAD * no_load_speed_rad_s
        self._temperature_C = AMBIENT_C
        self._overload_s = 0.0
        self.held_at_C: float | None = None
        """A scripted temperature instead of its own."""

    @property
    def temperature_C(self) -> float:
        """Of the motor, as its sensor sees it."""
        return self._temperature_C if self.held_at_C is None else self.held_at_C

    @property
    def overloaded(self) -> bool:
        """Whether it has pushed in vain for too long."""
        return self._overload_s >= OVERLOAD_S

    def forget_overload(self) -> None:
        """The load is off: a restart, or no torque."""
        self._overload_s = 0.0

    def step(self, period_s: float, current_A: float, output: float, velocity_rad_s: float) -> None:
        """`output`: what the loop asks for as part of full output, 0…1."""
        final_C = AMBIENT_C + self._rise_K_per_A2 * current_A * current_A
        self._temperature_C += (final_C - self._temperature_C) * period_s / (TIME_CONSTANT_S + period_s)
        if output >= OVERLOAD_OUTPUT and abs(velocity_rad_s) < self._standing_rad_s:
            self._overload_s += period_s
        else:
            self._overload_s = 0.0
