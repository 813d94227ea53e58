"""What comes of a load calibration: the fits, their plot, what is written, and what is told.

Nothing is written unless every motor's residual is accepted; readings and plot are kept all the same, so that one can
look at what went wrong. Results go to standard output, notes to standard error.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import typer

from calibration.load_calibration import LoadCalibration
from calibration.motor_file import MeasuredLaw, write_load_laws
from calibration.motor_load import Acceptance, LoadFit, fit_load_law
from calibration.motor_load_readings import MotorReadings
from controller.calibration_options import say
from controller.config import RobotConfig
from drivers.dynamixel.control_tables import model_by_name
from drivers.errors import InputError


def conclude(
    robot: RobotConfig,
    measured: Sequence[MotorReadings],
    file: Path,
    plot: Path,
    acceptance: Acceptance,
    as_json: bool,
) -> None:
    """Fit, plot, write and tell. typer.Exit 1 if a residual is not accepted; InputError for readings that hold no law,
    or files that cannot be written."""
    from calibration.motor_load_figure import draw_load_fits  # matplotlib takes a second to load

    tendons = robot.tendons
    fits: dict[str, LoadFit] = {}
    laws: dict[str, MeasuredLaw] = {}
    for one in measured:
        settings = tendons.right if one.side == "right" else tendons.left
        if tendons.model is not None and model_by_name(tendons.model) is not model_by_name(one.model):
            raise InputError(
                f"the {one.side} motor's readings are of a {one.model}; expected a {tendons.model}, as tendons.model "
                "says."
            )
        try:
            fit = fit_load_law(one.readings, model_by_name(one.model), settings.spool_radius_m)
        except InputError as error:
            raise InputError(f"{one.side} motor: {error.message} Nothing was written.", help=error.help) from error
        fits[one.side] = fit
        laws[one.side] = MeasuredLaw(settings.id, fit.law, _calibration(one, fit))
    refusals = {side: refusal for side, fit in fits.items() if (refusal := fit.refusal(acceptance))}
    by_current = model_by_name(measured[0].model).effort == "current"
    draw_load_fits(plot, fits, acceptance, "current  A" if by_current else "load, part of full output at 12 V")
    say(f"{plot}: readings, laws and residuals")
    if not refusals:
        write_load_laws(file, laws)
    _tell(file, plot, fits, laws, refusals, acceptance, as_json)
    if refusals:
        raise typer.Exit(1)


def _calibration(one: MotorReadings, fit: LoadFit) -> LoadCalibration:
    law = fit.law
    newton_per_effort = law.torque_per_effort_Nm / law.spool_radius_m
    return LoadCalibration(
        model=one.model,
        firmware=one.firmware,
        voltage_V=round(fit.voltage_V, 2),
        temperature_C=round(fit.temperature_C, 1),
        scatter_N=round(law.scatter_N, 3),
        slope_uncertainty=round(law.slope_uncertainty, 4),
        friction_uncertainty_N=round(law.friction_uncertainty * newton_per_effort, 3),
        date=date.today().isoformat(),
    )


def _tell(
    file: Path,
    plot: Path,
    fits: Mapping[str, LoadFit],
    laws: Mapping[str, MeasuredLaw],
    refusals: Mapping[str, str],
    acceptance: Acceptance,
    as_json: bool,
) -> None:
    rows = {side: _row(fit, laws[side], refusals.get(side, "")) for side, fit in fits.items()}
    if as_json:
        told = {"file": None if refusals else str(file.absolute()), "plot": str(plot.absolute()), **rows}
        typer.echo(json.dumps({**told, "accepted": not refusals}))
        return
    typer.echo(f"{'':26}" + "".join(f"{side:>14}" for side in rows))
    for name in next(iter(rows.values())):
        if name not in ("refusal", "worst_reading"):
            typer.echo(f"{name:26}" + "".join(f"{row[name]:>14}" for row in rows.values()))
    for side, refusal in refusals.items():
        say(f"{side} motor: {refusal}")
    typer.echo(
        f"accepted are residuals of {acceptance.rms:.1%} of the span in the mean and {acceptance.worst:.1%} at most"
    )
    if refusals:
        typer.echo("not accepted: nothing was written")
    else:
        typer.echo(f"{file}: written; name it in robot.toml as tendons.own_file")


def _row(fit: LoadFit, law: MeasuredLaw, refusal: str) -> dict[str, Any]:
    return {
        "motor": law.motor_id,
        **law.law_keys(),
        "friction_N": round(fit.law.friction_tension_N, 2),
        "slope_uncertainty": law.calibrated.slope_uncertainty,
        "friction_uncertainty_N": law.calibrated.friction_uncertainty_N,
        "readings": len(fit.readings),
        "span_N": round(fit.span_N, 2),
        "rms_N": round(fit.rms_N, 3),
        "worst_N": round(fit.worst_N, 3),
        "worst_reading": fit.readings[fit.worst].place,
        "voltage_V": law.calibrated.voltage_V,
        "temperature_C": law.calibrated.temperature_C,
        "model": law.calibrated.model,
        "firmware": law.calibrated.firmware,
        "refusal": refusal,
    }
