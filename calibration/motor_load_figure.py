"""The plot of a load law beside its readings, and of what it leaves over, both branches."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calibration.figures.style import BLUE, RED, as_curves, new_figure, styled
from calibration.motor_load import Acceptance, LoadFit
from drivers.dynamixel.load_law import SpoolMotion
from drivers.errors import InputError

_BRANCHES = ((SpoolMotion.WINDING, BLUE, "^", "winding"), (SpoolMotion.UNWINDING, RED, "v", "unwinding"))
_MM = 1e3


def draw_load_fits(file: Path, fits: Mapping[str, LoadFit], acceptance: Acceptance, effort_name: str) -> None:
    """A row a motor into a PNG: effort over tension, and residuals. InputError if it cannot be written."""
    with styled():
        figure, axes = new_figure(8.4, 3.3 * len(fits), len(fits), 2)
        for row, (side, fit) in enumerate(fits.items()):
            law, left = fit.law, axes[2 * row]
            residuals = axes[2 * row + 1]
            for motion, colour, marker, name in _BRANCHES:
                own = [i for i, reading in enumerate(fit.readings) if reading.motion is motion]
                tension_N = np.array([fit.readings[i].tension_N for i in own])
                effort = np.array([fit.readings[i].effort * _to_law_voltage(fit, i) for i in own])
                left.plot(tension_N, effort, marker, color=colour, markersize=5, linestyle="none")
                residuals.plot(tension_N, fit.residual_N[own], marker, color=colour, markersize=5, linestyle="none")
                for speed_m_s in sorted({round(abs(fit.readings[i].rate_m_s), 4) for i in own}):
                    ends_N = np.array([0.0, tension_N.max()])
                    acting = ends_N * law.spool_radius_m / law.torque_per_effort_Nm
                    moving = law.friction_effort + law.back_emf_effort_s_per_m * speed_m_s
                    label = f"{name}, {speed_m_s * _MM:.1f} mm/s" if law.back_emf_effort_s_per_m else name
                    left.plot(ends_N, acting + motion.value * moving, color=colour, linewidth=1.2, label=label)
                    if not law.back_emf_effort_s_per_m:
                        break
            allowed_N = acceptance.worst * fit.span_N
            residuals.axhspan(-allowed_N, allowed_N, alpha=0.08)
            residuals.axhline(0.0, linewidth=0.8, color="black")
            left.legend(loc="upper left")
            as_curves(left, "tension  N", effort_name, f"{side} motor: readings and law")
            rms = f"{fit.rms_N:.2f} N in the mean, {fit.worst_N:.2f} N at most"
            as_curves(residuals, "tension  N", "law less weight  N", rms)
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(file)
        except (OSError, ValueError) as error:
            raise InputError(f"{file}: the plot cannot be written there ({error}).") from error


def _to_law_voltage(fit: LoadFit, index: int) -> float:
    law_V = fit.law.voltage_V
    return 1.0 if law_V is None else fit.readings[index].voltage_V / law_V
