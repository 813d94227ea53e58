"""How one tendon motor is mounted, calibrated and run: all from the installation, nothing from the model.

Excursion is tendon pulled in, in metres: tightening sign · (ticks − zero ticks) · tick · spool radius. It is the
spool's, not the finger's: the tendon's own stretch is not taken off here.

Source: dynamixel reference 1.2 to 1.4 (ids, sides and even the tightening sign differ between real hands), 6.2, 6.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from drivers.dynamixel.control_tables import MotorModel, model_by_name
from drivers.dynamixel.effort_filter import LARGEST_TIME_CONSTANT_S
from drivers.dynamixel.load_law import LoadLaw
from drivers.errors import InputError

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Calibration:
    """On which motor, and how, a load law was measured. InputError for what cannot be."""

    model: str
    firmware: int
    voltage_V: float
    """Mean supply meanwhile."""
    temperature_C: float
    """Mean of the motor's own sensor meanwhile."""
    scatter_N: float
    """Standard deviation of the readings about the law."""
    date: str | None = None
    """Year-month-day."""

    def __post_init__(self) -> None:
        model_by_name(self.model)
        for wrong, what in (
            (not 0 <= self.firmware <= 255, f"firmware = {self.firmware}; expected 0…255"),
            (not 5.0 <= self.voltage_V <= 30.0, f"voltage_V = {self.voltage_V}; expected 5…30"),
            (not -20.0 <= self.temperature_C <= 120.0, f"temperature_C = {self.temperature_C}; expected -20…120"),
            (not 0.0 <= self.scatter_N <= 100.0, f"scatter_N = {self.scatter_N}; expected 0…100"),
        ):
            if wrong:
                raise InputError(f"calibration of a load law: {what}.", help="Calibrate the motor's load law again.")


@dataclass(frozen=True, slots=True)
class MotorSettings:
    """One motor. InputError for what no hand has."""

    motor_id: int
    tightening_sign: int
    """+1 if growing ticks tighten the tendon, −1 if they loosen it."""
    zero_ticks: int
    """Position at which the tendon is just taut on the open finger."""
    spool_radius_m: float = 0.0105
    load_law: LoadLaw = field(default_factory=LoadLaw)
    model: str | None = None
    """What was calibrated; another one is refused. None = whatever answers."""
    calibrated: Calibration | None = None
    """Where the load law is from; None = from a data sheet or a hand."""
    effort_filter_s: float = 0.01
    """Time constant of the low-pass between effort and tension; 0 = none. Usual are 5…20 ms."""
    travel_m: Pair = (-0.005, 0.0495)
    """Excursions that may be commanded; the default is a little slack to three quarters of a turn."""
    position_gain: int | None = None
    """Stiffness of the position loop, in the model's own register; None = the model's default."""
    start_cap_N: float = 12.0
    """Load cap from start until the first command, if the motor did not hold yet."""
    holding_cap_N: float | None = None
    """Load cap of a frozen or stalled motor, if lower than the one commanded; None = the one commanded."""
    watchdog_s: float = 0.2
    """Bus silence after which the motor stops and holds; 0 = never. Protocol 1.0 has no watchdog."""
    derating_start_C: float = 65.0
    """From here on the load cap shrinks as the motor gets hotter: at its limit (80 °C) it would let go."""
    derating_per_K: float = 0.05
    """Part of the load cap that goes with each kelvin."""
    derating_floor: float = 0.3
    """What remains of it at most heat: a hot motor still holds."""
    stall_timeout_s: float = 10.0
    """At its ceiling and at rest for so long, a motor gives up its goal and holds where it is."""

    def __post_init__(self) -> None:
        lower_m, upper_m = self.travel_m
        cap_N = self.holding_cap_N
        for wrong, what in (
            (not 0 <= self.motor_id <= 253, f"motor_id = {self.motor_id}; expected 0…253"),
            (self.tightening_sign not in (1, -1), f"tightening_sign = {self.tightening_sign}; expected 1 or -1"),
            (abs(self.zero_ticks) > 1_000_000, f"zero_ticks = {self.zero_ticks}; expected at most 1 000 000 each way"),
            (not 0.001 <= self.spool_radius_m <= 0.1, f"spool_radius_m = {self.spool_radius_m}; expected 0.001…0.1"),
            (
                self.spool_radius_m != self.load_law.spool_radius_m,
                f"spool_radius_m = {self.spool_radius_m}; expected the load law's {self.load_law.spool_radius_m}",
            ),
            (not -0.1 <= lower_m < upper_m <= 0.5, f"travel_m = {self.travel_m}; expected lower < upper in -0.1…0.5"),
            (
                self.position_gain is not None and not 1 <= self.position_gain <= 16383,
                f"position_gain = {self.position_gain}; expected 1…16383",
            ),
            (not 0.0 <= self.start_cap_N <= 300.0, f"start_cap_N = {self.start_cap_N}; expected 0…300"),
            (cap_N is not None and not 0.0 < cap_N <= 300.0, f"holding_cap_N = {cap_N}; expected above 0, to 300"),
            (
                self.watchdog_s != 0 and not 0.02 <= self.watchdog_s <= 2.54,
                f"watchdog_s = {self.watchdog_s}; expected 0 (off) or 0.02…2.54",
            ),
            (
                not 30.0 <= self.derating_start_C <= 100.0,
                f"derating_start_C = {self.derating_start_C}; expected 30…100",
            ),
            (not 0.0 <= self.derating_per_K <= 1.0, f"derating_per_K = {self.derating_per_K}; expected 0…1"),
            (not 0.0 <= self.derating_floor <= 1.0, f"derating_floor = {self.derating_floor}; expected 0…1"),
            (
                not 0.0 <= self.effort_filter_s <= LARGEST_TIME_CONSTANT_S,
                f"effort_filter_s = {self.effort_filter_s}; expected 0 (off) to {LARGEST_TIME_CONSTANT_S:g}",
            ),
            (not 0.1 <= self.stall_timeout_s <= 3600, f"stall_timeout_s = {self.stall_timeout_s}; expected 0.1…3600"),
        ):
            if wrong:
                raise InputError(f"motor settings: {what}.", help="Correct the motor's settings.")
        if self.model is not None:
            model_by_name(self.model)

    @property
    def expected_model(self) -> MotorModel | None:
        """The model that was calibrated, if it is known."""
        return None if self.model is None else model_by_name(self.model)

    def gain(self, model: MotorModel) -> int:
        """Value of the model's gain register."""
        return model.default_position_gain if self.position_gain is None else self.position_gain

    def excursion_m(self, ticks: int, model: MotorModel) -> float:
        """Tendon pulled in at a position."""
        return self.tightening_sign * (ticks - self.zero_ticks) * model.tick_rad * self.spool_radius_m

    def ticks(self, excursion_m: float, model: MotorModel) -> int:
        """Nearest position for an excursion."""
        return self.zero_ticks + self.tightening_sign * round(excursion_m / (model.tick_rad * self.spool_radius_m))

    def derating(self, temperature_C: float) -> float:
        """Part of the load cap that is allowed at this temperature, 0…1."""
        excess_K = max(0.0, temperature_C - self.derating_start_C)
        return max(self.derating_floor, 1.0 - self.derating_per_K * excess_K)

    def ceiling_counts(
        self, cap_N: float, model: MotorModel, supply_V: float | None = None, temperature_C: float | None = None
    ) -> int:
        """Counts of the ceiling register at which a winding spool stalls at `cap_N`, never above. InputError.

        `supply_V` matters to a model that tells its load; None, for the temperature too: the load law's.
        """
        effort = self.load_law.effort_cap(cap_N, supply_V=supply_V, temperature_C=temperature_C)
        return math.floor(effort / model.ceiling_unit)
