"""Pulling with a given load instead of to a given excursion: position steps under the ceiling, with load feedback.

Every model can do it, as all of them hold a position under a ceiling: winding, the goal is kept just so far ahead of
the spool that the ceiling is reached, and the motor stalls where the tendon pulls as hard; if the object is gone, it
winds no faster than that lead drives it. To pull *less*, gear friction has to be overcome the other way: the tendon is
paid out in steps until the unwinding branch of the load law reads the load.

Pure. Source: dynamixel reference 3.2, 3.3; design 4 "Drive" (load drive of a grasp is unstable beyond part of the way:
this is for identification and calibration).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from drivers.dynamixel.load_law import LoadLaw, SpoolMotion

PAY_OUT_RATE_M_S = 0.005


class LoadPhase(enum.Enum):
    """What a motor does to come to its load."""

    WINDING = "winding"
    PAYING_OUT = "paying out"
    REACHED = "reached"
    """Paid out to the load; a winding motor never gets here, it stalls at its ceiling."""


@dataclass(frozen=True, slots=True)
class LoadStep:
    """Where the goal goes, m of excursion, and what comes next."""

    goal_m: float
    phase: LoadPhase


def first_phase(law: LoadLaw, effort: float, load_N: float, supply_V: float | None = None) -> LoadPhase:
    """Paying out if even the least tension that this effort can mean is above the load."""
    least_N = law.tension(effort, SpoolMotion.WINDING, supply_V=supply_V).tension_N
    return LoadPhase.PAYING_OUT if least_N > load_N else LoadPhase.WINDING


def load_step(
    law: LoadLaw,
    phase: LoadPhase,
    *,
    load_N: float,
    effort: float,
    excursion_m: float,
    rate_m_s: float,
    goal_m: float,
    lead_m: float,
    elapsed_s: float,
    supply_V: float | None = None,
) -> LoadStep:
    """The next goal: from what was measured, the present goal, and the lead at which the ceiling acts.

    Whether enough was paid out is judged at rest, because the load of a moving motor holds its back-EMF too.
    """
    if phase is LoadPhase.WINDING:
        return LoadStep(excursion_m + lead_m, phase)
    most_N = law.tension(effort, SpoolMotion.UNWINDING, supply_V=supply_V).tension_N
    if phase is LoadPhase.REACHED or most_N <= load_N:
        still = phase is LoadPhase.REACHED or abs(rate_m_s) < law.still_rate_m_s
        return LoadStep(goal_m, LoadPhase.REACHED if still else phase)
    return LoadStep(min(goal_m, excursion_m + lead_m) - PAY_OUT_RATE_M_S * elapsed_s, phase)
