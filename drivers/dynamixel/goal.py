"""What one tendon's motor is told: goal position and ceiling, worked out from set-points, caps and what it last said.

No I/O. Goals are ticks, ceilings counts of the model's ceiling register (current, PWM or torque limit). A frozen or
stalled motor *holds*: its goal keeps the lead over the measured position that the present effort needs, so that
tension does not drop, and no more, so that it does not go on pulling towards a goal it could not reach.

A motor trips on overload by the output that its position loop asks for, even if a low current ceiling keeps it cool
(reference 6.2). So the goal on the wire never leads farther than `LEAD_OUTPUT` of full output needs, or the ceiling.

Source: design 4 "Drive", 5 "A fault keeps the object"; dynamixel reference 6.2, 6.4.
"""

from __future__ import annotations

from drivers.dynamixel.control_tables import MotorModel
from drivers.dynamixel.load_drive import LoadPhase, first_phase, load_step
from drivers.dynamixel.motor import Inspection
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import InputError

LEAD_OUTPUT = 0.7
"""Part of full output that the lead of a goal may ask for: it bounds the speed too, at some 30 mm/s of tendon."""
LOAD_OUTPUT = 0.2
"""Part of full output that drives a spool on to its load: some 10 mm/s if the object is gone."""
_AT_CEILING = 0.95
"""Part of the ceiling that counts as pulling at it: readings are noisy and quantised."""


class TendonGoal:
    """Goal and ceiling of one motor."""

    def __init__(self, settings: MotorSettings, model: MotorModel, found: Inspection, ticks: int, ceiling: int) -> None:
        self.ticks = ticks
        self.ceiling = ceiling
        self.stalled = False
        """It stood at its ceiling for too long and gave its goal up; until another goal or cap is given."""
        self._settings = settings
        self._model = model
        self._found = found
        self._asked_ticks = ticks
        self._cap_N: float | None = None  # none was commanded: the ceiling stays as it was found
        self._load_N: float | None = None
        self._phase = LoadPhase.WINDING
        self._holding = False
        self._at_ceiling_since_s: float | None = None
        gain = settings.gain(model)
        self._output_per_tick = model.output_per_tick(gain)
        self._ceiling_ticks = model.ceiling_unit / model.holding_effort_per_tick(gain)
        """Lead, ticks, that asks for one count of the ceiling."""
        self._effort_per_tick = model.holding_effort_per_tick(gain)
        self._derated: tuple[float | None, bool, float, float | None, float | None] | None = None
        """Cap, holding, factor, supply and temperature for which the ceiling was worked out."""
        self._supply_V: float | None = None
        """The newest that was told; None: not yet, the load law's is taken."""

    @property
    def takes_ceilings(self) -> bool:
        """Whether the motor may be driven at all; one that was found holding in another mode may not."""
        return not self._found.identity.refusal

    @property
    def takes_goals(self) -> bool:
        """The same for goals: one that follows positions, in whatever mode, may at least be paid out."""
        return self.takes_ceilings or self._found.may_pay_out

    def commanded(self, ticks: int) -> int:
        """The goal for the wire, from the measured position, ticks."""
        longest = 1 + round(max(self.ceiling * self._ceiling_ticks, LEAD_OUTPUT / self._output_per_tick))
        return max(ticks - longest, min(ticks + longest, self.ticks))

    def check(self, excursion_m: float, cap_N: float) -> int:
        """The goal for an excursion, ticks; nothing is changed. InputError for what the motor cannot or may not do."""
        settings, found = self._settings, self._found
        lower_m, upper_m = settings.travel_m
        if not lower_m <= excursion_m <= upper_m:  # also catches NaN and infinity
            raise InputError(
                f"tendon excursion {excursion_m} m of motor {settings.motor_id} is out of travel; "
                f"expected {lower_m}…{upper_m} m."
            )
        ticks = settings.ticks(excursion_m, self._model)
        if not self.takes_ceilings:
            tightens = settings.tightening_sign * (ticks - self.ticks) > 0
            if tightens or not found.may_pay_out:
                raise self._refusal()
        lowest, highest = found.goal_range
        if not lowest <= ticks <= highest:
            raise InputError(
                f"tendon excursion {excursion_m} m of motor {settings.motor_id} is position {ticks}; it takes "
                f"{lowest}…{highest}.",
                help="Clamp the spool so that its travel lies inside the motor's range, and calibrate zero_ticks.",
            )
        self.check_cap(cap_N)
        return ticks

    def check_cap(self, cap_N: float) -> None:
        """InputError for a load cap that is no tension, or above what the motor may give."""
        if cap_N == self._cap_N:
            return  # it was taken before
        supply_V = self._settings.load_law.cap_supply_V(self._supply_V)
        counts, limit = self._settings.ceiling_counts(cap_N, self._model, supply_V), self._found.ceiling_limit
        if counts > limit:
            unit = self._model.ceiling_unit
            kind = "A" if self._model.effort == "current" else "of full output"
            raise InputError(
                f"load cap {cap_N} N of motor {self._settings.motor_id} needs {counts * unit:.2f} {kind}; its own "
                f"limit is {limit * unit:.2f} {kind}.",
                help="Lower the load cap, or raise the motor's limit (Current Limit, PWM Limit or Max Torque).",
            )

    def take(self, ticks: int, cap_N: float) -> None:
        """Go there, pulling no more than the cap. The same goal again does not revive a stalled motor."""
        self._load_N = None
        self.take_cap(cap_N)
        if ticks != self._asked_ticks:
            self._forget_stall()
        self._asked_ticks = ticks
        if not self.stalled:
            self.ticks, self._holding = ticks, False

    def take_cap(self, cap_N: float) -> None:
        """Another load cap."""
        if cap_N != self._cap_N:
            self._cap_N = cap_N
            self._forget_stall()

    def check_load(self, load_N: float) -> None:
        """InputError for a load that the motor cannot or may not pull with."""
        if not self.takes_ceilings:
            raise self._refusal()
        self.check_cap(load_N)

    def pull(self, load_N: float, effort: float) -> None:
        """Go to this load, from the present effort."""
        self.take_cap(load_N)
        self._load_N, self._holding = load_N, False
        self._phase = first_phase(self._settings.load_law, effort, load_N, self._supply_V)

    def hold(self, ticks: int, effort: float) -> None:
        """Stay at the measured position, with the present effort."""
        self._load_N, self._holding = None, True
        lead_ticks = round(abs(effort) / self._effort_per_tick)
        lead = self.ticks - ticks
        lowest, highest = self._found.goal_range
        self.ticks = max(lowest, min(highest, ticks + max(-lead_ticks, min(lead_ticks, lead))))

    def step(self, now_s: float, elapsed_s: float, *, ticks: int, effort: float, rate_m_s: float) -> None:
        """Follow a load, notice a stall."""
        if self._load_N is not None:
            self._follow_load(self._load_N, elapsed_s, ticks, effort, rate_m_s)
        else:
            self._watch_stall(now_s, ticks, effort, rate_m_s)

    def derate(self, factor: float, supply_V: float | None = None, temperature_C: float | None = None) -> None:
        """Work the ceiling out for this part of the cap, at this supply and temperature."""
        self._supply_V = supply_V
        law = self._settings.load_law
        state = law.cap_supply_V(supply_V), law.cap_temperature_C(temperature_C)
        conditions = self._cap_N, self._holding, factor, *state
        if conditions == self._derated:
            return
        self._derated = conditions
        if self._cap_N is not None:
            counts = self._settings.ceiling_counts(self._cap_N * factor, self._model, *state)
            self.ceiling = min(counts, self._found.ceiling_limit)
        holding_N = self._settings.holding_cap_N
        if holding_N is not None and self._holding:
            counts = self._settings.ceiling_counts(holding_N * factor, self._model, *state)
            self.ceiling = min(self.ceiling, counts)

    def _follow_load(self, load_N: float, elapsed_s: float, ticks: int, effort: float, rate_m_s: float) -> None:
        settings, model = self._settings, self._model
        lead_ticks = 1 + round(self.ceiling * self._ceiling_ticks + LOAD_OUTPUT / self._output_per_tick)
        step = load_step(
            settings.load_law,
            self._phase,
            load_N=load_N,
            effort=effort,
            supply_V=self._supply_V,
            excursion_m=settings.excursion_m(ticks, model),
            rate_m_s=rate_m_s,
            goal_m=settings.excursion_m(self.ticks, model),
            lead_m=lead_ticks * model.tick_rad * settings.spool_radius_m,
            elapsed_s=elapsed_s,
        )
        lower_m, upper_m = settings.travel_m
        lowest, highest = self._found.goal_range
        self._phase = step.phase
        self.ticks = max(lowest, min(highest, settings.ticks(max(lower_m, min(upper_m, step.goal_m)), model)))

    def _watch_stall(self, now_s: float, ticks: int, effort: float, rate_m_s: float) -> None:
        ceiling = self.ceiling * self._model.ceiling_unit
        moving = abs(rate_m_s) >= self._settings.load_law.still_rate_m_s
        if moving or not abs(effort) >= _AT_CEILING * ceiling > 0.0:
            self._at_ceiling_since_s = None
        elif self._at_ceiling_since_s is None:
            self._at_ceiling_since_s = now_s
        elif not self.stalled and now_s - self._at_ceiling_since_s >= self._settings.stall_timeout_s:
            self.stalled = True
            self.hold(ticks, effort)

    def _forget_stall(self) -> None:
        self.stalled = False
        self._at_ceiling_since_s = None

    def _refusal(self) -> InputError:
        return InputError(f"tendon motor {self._settings.motor_id} {self._found.identity.refusal}")
