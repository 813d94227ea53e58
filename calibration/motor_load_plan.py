"""What to hang on a motor, in which order, and how far and fast the spool turns meanwhile.

A weight pulls the same wherever it hangs, so at each one the spool winds a stroke and unwinds it again: both branches
at the same tension. A spring scale pulls by how far it is stretched: the spool winds on to each level and stops for the
scale to be read, and comes back over the levels unwinding.

A motor that tells its load turns at two speeds, as the load of one alone cannot tell friction from back-EMF.
Pure; SI. Source: dynamixel reference 1.3 (travel), 2.1 (horn: 40 N), 3.2 (lasting loads below 40 % of stall), 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.grasp.friction import STANDARD_GRAVITY_M_PER_S2
from calibration.motor_load import FEWEST_TENSIONS
from drivers.dynamixel.control_tables import MotorModel
from drivers.dynamixel.load_law import LoadLaw, SpoolMotion
from drivers.errors import InputError

DEFAULT_MASSES_KG = (0.5, 1.0, 2.0, 4.0, 6.0)
DEFAULT_LEVELS_N = (8.0, 15.0, 25.0, 40.0, 55.0)
LASTING_PART_OF_STALL = 0.4
"""The most that a motor may carry for minutes."""
HORN_N = 40.0
"""Radial load that the horn is rated for; a cord adds all of its pull to it."""
CURRENT_SPEEDS_M_S = (0.003,)
LOAD_SPEEDS_M_S = (0.003, 0.008)
DEFAULT_STROKE_M = 0.010
LEAST_STROKE_M = 0.004
_CAP_FACTOR = 1.6
_CAP_MARGIN_N = 30.0
"""A weight must be lifted though the law that the cap is worked out by is not known yet."""


@dataclass(frozen=True, slots=True)
class LoadPlan:
    """For one motor. Excursions in m of tendon."""

    scale: bool
    steps_N: tuple[float, ...]
    """Tensions, in the order of their turn."""
    speeds_m_s: tuple[float, ...]
    start_m: float
    stroke_m: float
    """Of a weight, up from `start_m`; of a scale the longest, all the way up."""
    cap_N: float
    """What the motor may pull, by the law that is published."""
    notes: tuple[str, ...]

    @property
    def most_N(self) -> float:
        """The largest tension of the plan."""
        return max(self.steps_N)

    def motion(self, step: int) -> SpoolMotion:
        """How a scale is brought to the tension of this step, counted from 0."""
        return SpoolMotion.WINDING if step <= self.steps_N.index(self.most_N) else SpoolMotion.UNWINDING

    def speed_m_s(self, step: int) -> float:
        """At which speed a scale is brought there: in turn, so that no speed belongs to high levels alone."""
        return self.speeds_m_s[step % len(self.speeds_m_s)]


def plan_load(
    model: MotorModel,
    law: LoadLaw,
    *,
    travel_m: tuple[float, float],
    start_m: float,
    scale: bool = False,
    tensions_N: Sequence[float] = (),
    stroke_m: float | None = None,
    speeds_m_s: Sequence[float] = (),
    up_only: bool = False,
) -> LoadPlan:
    """The plan for a motor that stands at `start_m`. Without tensions, speeds or stroke usual ones; they go up and
    down again, weights with `up_only` do not. InputError for what the motor may not carry, or its travel does not hold.
    """
    stall_N = law.torque_per_effort_Nm * _full_effort(model, law) / law.spool_radius_m
    lasting_N = LASTING_PART_OF_STALL * stall_N
    usual_N = DEFAULT_LEVELS_N if scale else tuple(mass * STANDARD_GRAVITY_M_PER_S2 for mass in DEFAULT_MASSES_KG)
    wanted_N = sorted(set(tensions_N)) or [tension_N for tension_N in usual_N if tension_N <= lasting_N]
    if not 0.0 < wanted_N[0] <= wanted_N[-1] <= lasting_N:
        raise InputError(
            f"a {model.name} is not to be loaded with {wanted_N[0]:.1f} to {wanted_N[-1]:.1f} N for minutes; expected "
            f"above 0, to {lasting_N:.0f} N ({lasting_N / STANDARD_GRAVITY_M_PER_S2:.1f} kg), 40 % of its stall.",
            help="Take lighter weights.",
        )
    fewest = FEWEST_TENSIONS + 1 if scale else FEWEST_TENSIONS  # a scale is not read unwinding at the topmost
    if len(wanted_N) < fewest:
        raise InputError(
            f"{len(wanted_N)} different tensions; expected {fewest} or more, to see whether they agree with each other."
        )
    stroke_m = (travel_m[1] - start_m if scale else DEFAULT_STROKE_M) if stroke_m is None else stroke_m
    if stroke_m < LEAST_STROKE_M or not travel_m[0] <= start_m <= start_m + stroke_m <= travel_m[1] + 1e-9:
        raise InputError(
            f"a stroke of {stroke_m * 1e3:.1f} mm from {start_m * 1e3:.1f} mm of excursion; expected "
            f"{LEAST_STROKE_M * 1e3:g} mm or more within the travel, {travel_m[0] * 1e3:.1f} to "
            f"{travel_m[1] * 1e3:.1f} mm.",
            help="Name another --start-mm or --stroke-mm.",
        )
    speeds_m_s = tuple(speeds_m_s) or (CURRENT_SPEEDS_M_S if law.voltage_V is None else LOAD_SPEEDS_M_S)
    slowest_m_s = 2.0 * law.still_rate_m_s
    if not all(slowest_m_s <= speed_m_s <= 0.02 for speed_m_s in speeds_m_s):
        raise InputError(f"speeds of {_mm(speeds_m_s)} mm/s; expected {slowest_m_s * 1e3:g} to 20 mm/s.")
    notes = []
    if wanted_N[-1] > HORN_N:
        notes.append(
            f"{wanted_N[-1]:.0f} N are more than the {HORN_N:g} N that a horn is rated for: let them hang no longer "
            "than is needed"
        )
    if law.voltage_V is not None and max(speeds_m_s) < 1.5 * min(speeds_m_s):
        notes.append("one speed cannot tell friction from back-EMF: the data sheet's back-EMF is taken")
    moving_N = law.back_emf_effort_s_per_m * max(speeds_m_s) * law.torque_per_effort_Nm / law.spool_radius_m
    down_N = () if up_only and not scale else tuple(reversed(wanted_N[:-1]))
    return LoadPlan(
        scale=scale,
        steps_N=(*wanted_N, *down_N),
        speeds_m_s=speeds_m_s,
        start_m=start_m,
        stroke_m=stroke_m,
        cap_N=min(_CAP_FACTOR * wanted_N[-1] + _CAP_MARGIN_N + moving_N, 0.95 * stall_N),
        notes=tuple(notes),
    )


def _full_effort(model: MotorModel, law: LoadLaw) -> float:
    """A at stall, or all output, at 12 V."""
    return model.stall_current_A if law.voltage_V is None else 1.0


def _mm(values_m: Sequence[float]) -> str:
    return ", ".join(f"{value * 1e3:g}" for value in values_m)
