"""Motor effort ↔ tendon tension: one straight line, and the gear's friction on either side of it.

Effort is what a motor tells of its torque: current, A (XM430), or load, its output as a part of all it could give
(RX-28, MX-28, XL430). At the shaft of a motor at rest, torque = K·effort; the gear takes K·I0 of it, against the
motion. So, for a spool of radius r that pulls its tendon in at the rate v,

    winding     tension = K (effort − b v − I0) / r      unwinding   tension = K (effort − b v + I0) / r
    holding     anywhere between the two: K·effort / r ± K·I0 / r, about ±22 N for an XM430-W350

A current is torque, whatever the speed: b = 0. A load is a voltage: b v is the back-EMF's part of it, and as a part of
a supply of V volts instead of the law's, the same load means V times more: effort is first scaled to the law's voltage.
Heat weakens the magnets, 0.1 % of K per kelvin, and adds 0.39 %/K to the winding's resistance, which takes as much of
a load's K. Half of what warmth takes off a calibrated K is uncertain, as the winding is not where the sensor is.
Effort is positive when it tightens. Without an own calibration K is uncertain by 20 % (load: 30 %), heat included.
Pure functions. Source: dynamixel reference 2.4, 3.1 to 3.4.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from drivers.dynamixel.control_tables import XM430_W210, XM430_W350, MotorModel
from drivers.errors import InputError

NOMINAL_FRICTION_PART = 0.13 / 2.3
"""Of the stall effort: known of the XM430-W350 alone, assumed of the others, of which nothing is published."""
NOMINAL_FRICTION_CURRENT_A = 0.13
"""Of the XM430-W350, and of the W210, whose stall current is the same."""
_NOMINAL_TORQUE_CONSTANT_NM_PER_A = {XM430_W350.number: 1.79, XM430_W210.number: 1.30}
LAW_VOLTAGE_V = 12.0
LOAD_SLOPE_UNCERTAINTY = 0.3
"""The stall point's torque is a momentary value, and winding resistance grows with heat: worse than by current."""
MAGNET_LOSS_PER_K = 0.001
"""Of the torque constant: a few percent with a hot motor."""
RESISTANCE_PER_K = 0.0039
"""Of copper: what a given part of full output drives less current through."""
HEAT_UNCERTAINTY = 0.5
"""Part of the heat's effect that is not relied on: motor and sensor are not equally warm."""
_SCATTER_WIDTH = 2.0
"""Standard deviations of the calibration's readings that the band takes in."""
_TEMPERATURES_C = (-20.0, 120.0)
"""Beyond, a reading is not believed to be one of a motor."""


class SpoolMotion(enum.Enum):
    """What the spool does, which decides on which side the gear's friction is."""

    WINDING = 1
    HOLDING = 0
    UNWINDING = -1


@dataclass(frozen=True, slots=True)
class TensionEstimate:
    """Tendon tension, N, and the band it lies in; all ≥ 0, a tendon only pulls."""

    tension_N: float
    low_N: float
    high_N: float

    @property
    def uncertainty_N(self) -> float:
        """The larger distance from the estimate to the band's ends, N."""
        return max(self.tension_N - self.low_N, self.high_N - self.tension_N)


@dataclass(frozen=True, slots=True)
class LoadLaw:
    """The law of one motor with its spool. Defaults: XM430-W350, effort in A, T42 spool; `nominal_law` has the others.

    One unit of effort is 1 A, or all output at the law's voltage.
    """

    torque_per_effort_Nm: float = 1.79
    friction_effort: float = 0.13
    spool_radius_m: float = 0.0105
    slope_uncertainty: float = 0.2
    """Relative, of K."""
    friction_uncertainty: float = 0.05
    """Of I0 while the spool turns, in effort."""
    still_rate_m_s: float = 0.0006
    """Tendon slower than this counts as holding: just above two velocity counts of an XM430."""
    back_emf_effort_s_per_m: float = 0.0
    """b: effort that the speed alone takes, per m/s of tendon."""
    voltage_V: float | None = None
    """Supply at which an effort that is a part of it has this K; None: effort is a current, the supply is nothing to
    it."""
    temperature_C: float | None = None
    """At which K was measured; None: not measured, the uncertainty holds for any."""
    scatter_N: float = 0.0
    """Standard deviation of the calibration's readings about the law."""

    def __post_init__(self) -> None:
        positive = (self.torque_per_effort_Nm, self.spool_radius_m, self.still_rate_m_s, self.voltage_V or 1.0)
        not_negative = (
            self.friction_effort,
            self.slope_uncertainty,
            self.friction_uncertainty,
            self.back_emf_effort_s_per_m,
            self.scatter_N,
        )
        lowest_C, highest_C = _TEMPERATURES_C
        if not all(math.isfinite(x) and x > 0 for x in positive) or not all(
            math.isfinite(x) and x >= 0 for x in not_negative
        ):
            raise InputError(
                f"{self} is not a load law; expected torque per effort, spool radius, still rate and voltage above 0, "
                "friction, back-EMF, scatter and uncertainties not below 0, all finite."
            )
        if self.temperature_C is not None and not lowest_C <= self.temperature_C <= highest_C:
            raise InputError(
                f"{self} is not a load law; expected a temperature of {lowest_C:g} to {highest_C:g} °C, or none."
            )

    @property
    def friction_tension_N(self) -> float:
        """Half the width of the holding band, N."""
        return self.torque_per_effort_Nm * self.friction_effort / self.spool_radius_m

    def motion(self, rate_m_s: float, before: SpoolMotion = SpoolMotion.HOLDING) -> SpoolMotion:
        """What the spool does at this tendon rate (positive = pulling in), m/s, if it did `before` until now.

        A spool that turns is at rest only below half the still rate: friction stays on its side until then, and a rate
        at the threshold does not make the tension flicker.
        """
        if rate_m_s >= self.still_rate_m_s * (0.5 if before is SpoolMotion.WINDING else 1.0):
            return SpoolMotion.WINDING
        if rate_m_s <= -self.still_rate_m_s * (0.5 if before is SpoolMotion.UNWINDING else 1.0):
            return SpoolMotion.UNWINDING
        return SpoolMotion.HOLDING

    def tension(
        self,
        effort: float,
        motion: SpoolMotion,
        *,
        rate_m_s: float = 0.0,
        supply_V: float | None = None,
        temperature_C: float | None = None,
    ) -> TensionEstimate:
        """Tension for an effort (positive = tightening) of a spool in this motion.

        `rate_m_s` and `supply_V` matter where effort is a load; None: at the law's voltage. `temperature_C`: the
        motor's own; None: as warm as when it was calibrated.
        """
        newton_per_effort = self.torque_per_effort_Nm / self.spool_radius_m
        warmth = self._warmth(temperature_C)
        acting = effort * self._voltage_ratio(supply_V) - self.back_emf_effort_s_per_m * rate_m_s
        driving_N = newton_per_effort * warmth * acting
        tension_N = max(0.0, driving_N - motion.value * newton_per_effort * self.friction_effort)
        turning = motion is not SpoolMotion.HOLDING
        band = self.friction_uncertainty if turning else self.friction_effort
        half_N = newton_per_effort * band + self.slope_uncertainty * tension_N
        half_N += _SCATTER_WIDTH * self.scatter_N + HEAT_UNCERTAINTY * abs(1.0 - warmth) * abs(driving_N)
        return TensionEstimate(tension_N, max(0.0, tension_N - half_N), tension_N + half_N)

    def effort_cap(
        self, tension_N: float, *, supply_V: float | None = None, temperature_C: float | None = None
    ) -> float:
        """Effort at which a winding spool stalls at `tension_N`: the inverse of `tension` while winding. InputError."""
        if not (math.isfinite(tension_N) and tension_N >= 0.0):
            raise InputError(f"load cap {tension_N} N is not a tension; expected a finite number not below 0.")
        driving = tension_N * self.spool_radius_m / self.torque_per_effort_Nm + self.friction_effort
        return driving / (self._warmth(temperature_C) * self._voltage_ratio(supply_V))

    def cap_supply_V(self, supply_V: float | None) -> float | None:
        """The supply to work a cap out for: never below the law's, as a supply that sags comes back; in steps of 0.5 V
        upwards, so that its noise does not move the ceiling. None where the supply does not matter."""
        if self.voltage_V is None or supply_V is None or not supply_V > self.voltage_V:
            return None
        return math.ceil(2.0 * supply_V) / 2.0

    def cap_temperature_C(self, temperature_C: float | None) -> float | None:
        """The temperature to work a cap out for: a motor colder than when it was calibrated pulls harder; in steps of
        5 K downwards. None for a warmer one, which pulls less than its cap and may cool, and where no K was measured.
        """
        if self.temperature_C is None or temperature_C is None or not temperature_C < self.temperature_C:
            return None
        return 5.0 * math.floor(temperature_C / 5.0)

    def _voltage_ratio(self, supply_V: float | None) -> float:
        """Part of full output at this supply → part of full output at the law's."""
        if self.voltage_V is None or supply_V is None or not supply_V > 0.0:
            return 1.0
        return supply_V / self.voltage_V

    def _warmth(self, temperature_C: float | None) -> float:
        """K at this temperature, as a part of K when it was measured."""
        if self.temperature_C is None or temperature_C is None:
            return 1.0
        lowest_C, highest_C = _TEMPERATURES_C
        rise_K = max(lowest_C, min(highest_C, temperature_C)) - self.temperature_C
        return torque_at_heat(rise_K, by_load=self.voltage_V is not None)


def torque_at_heat(rise_K: float, *, by_load: bool) -> float:
    """Torque of a motor that is warmer by this much, as a part of what the same current, or load, gave before."""
    return (1.0 - MAGNET_LOSS_PER_K * rise_K) / (1.0 + RESISTANCE_PER_K * rise_K if by_load else 1.0)


def published_law(model: MotorModel, spool_radius_m: float) -> LoadLaw:
    """The law of a model by what is published of it, at 12 V."""
    if model.effort == "current":
        return current_law(model, spool_radius_m)
    return nominal_law(model, spool_radius_m)


def current_law(
    model: MotorModel,
    spool_radius_m: float,
    *,
    torque_constant_Nm_per_A: float | None = None,
    friction_current_A: float | None = None,
) -> LoadLaw:
    """The law of a model that measures its current, from what is published; measured numbers replace that. InputError
    for a model that tells its load."""
    if model.effort != "current":
        raise InputError(f"a {model.name} tells its load, not its current; its law needs its stall torque.")
    nominal = _NOMINAL_TORQUE_CONSTANT_NM_PER_A[model.number]
    return LoadLaw(
        torque_per_effort_Nm=nominal if torque_constant_Nm_per_A is None else torque_constant_Nm_per_A,
        friction_effort=NOMINAL_FRICTION_CURRENT_A if friction_current_A is None else friction_current_A,
        spool_radius_m=spool_radius_m,
    )


def nominal_law(
    model: MotorModel,
    spool_radius_m: float,
    *,
    stall_torque_Nm: float | None = None,
    friction_load: float | None = None,
) -> LoadLaw:
    """The law of a model that tells its load, at 12 V, from its data sheet; measured numbers replace the sheet's.

    `stall_torque_Nm`: at 12 V and full output. `friction_load`: what the gear takes, as a part of full output at 12 V.
    InputError for a model that measures its current, or numbers that are no law.
    """
    if model.effort != "load":
        raise InputError(f"a {model.name} tells its current, not its load; its law needs torque constant and friction.")
    friction = NOMINAL_FRICTION_PART if friction_load is None else friction_load
    # the no-load speed is that of the highest supply with a stall point, an RX-28's at 18.5 V, all others' at 12 V
    no_load_V = max(LAW_VOLTAGE_V, model.stall_points[0][0])
    output_s_per_rad = (no_load_V / LAW_VOLTAGE_V - friction) / model.no_load_speed_rad_s
    return LoadLaw(
        torque_per_effort_Nm=model.stall_torque_Nm(LAW_VOLTAGE_V) if stall_torque_Nm is None else stall_torque_Nm,
        friction_effort=friction,
        spool_radius_m=spool_radius_m,
        slope_uncertainty=LOAD_SLOPE_UNCERTAINTY,
        friction_uncertainty=NOMINAL_FRICTION_PART / 2.0,
        back_emf_effort_s_per_m=output_s_per_rad / spool_radius_m,
        voltage_V=LAW_VOLTAGE_V,
    )
