"""How far a tendon motor's position loop stays behind its goal: worked out from the model, its gain and its load law.

The loop is proportional: its output is gain × position error. So, on the tendon,

    standing   error = compliance × (tension ± gear friction), beyond a dead margin of some models
    moving     error = lag × rate, because the output must also make up for the back-EMF

Both hold at the load law's voltage; a higher supply does more with the same error. Pure functions. Source: dynamixel
reference 2.4 ("standing still, the output is P gain × error"), 3.1 (stall points); RX-28: slope and margin, 2.2.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.dynamixel.control_tables import MotorModel
from drivers.dynamixel.settings import MotorSettings


@dataclass(frozen=True, slots=True)
class PositionLoop:
    """Error of one motor's position loop, on its tendon, at the load law's voltage."""

    compliance_m_per_N: float
    lag_s: float
    dead_m: float
    """Error within which the loop does nothing; it adds to any other."""
    resolution_m: float
    """Tendon that one count of position stands for."""


def position_loop(settings: MotorSettings, model: MotorModel) -> PositionLoop:
    """The loop of a motor of this model with these settings."""
    law, gain = settings.load_law, settings.gain(model)
    tick_m = model.tick_rad * settings.spool_radius_m
    newton_per_tick = model.holding_effort_per_tick(gain) * law.torque_per_effort_Nm / law.spool_radius_m
    if model.effort == "current":
        friction_part = law.friction_effort / model.stall_current_A
        output_s_per_m = (1.0 - friction_part) / (model.no_load_speed_rad_s * settings.spool_radius_m)
    else:
        output_s_per_m = law.back_emf_effort_s_per_m
    margin = model.registers.get("cw_compliance_margin")
    return PositionLoop(
        compliance_m_per_N=tick_m / newton_per_tick,
        lag_s=output_s_per_m / model.output_per_tick(gain) * tick_m,
        dead_m=0.0 if margin is None else margin.default * tick_m,
        resolution_m=tick_m,
    )
