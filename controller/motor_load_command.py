"""`stillgrasp calibrate motor-load`: known weights on a tendon motor, and what its current or load is worth in newtons.

Plan, fit and acceptance are `calibration/motor_load*.py`'s, the strokes `motor_load_run.py`'s, the prompts
`motor_load_dialogue.py`'s, what comes of it `motor_load_report.py`'s. Stop the daemon first: the serial line has one
user. Results go to standard output, prompts and notes to standard error.
Source: dynamixel reference 3; docs/calibration-motors.md.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from calibration.motor_file import SIDES, read_motor_file
from calibration.motor_load import ACCEPTED_RMS, ACCEPTED_WORST, Acceptance
from calibration.motor_load_plan import LoadPlan, plan_load
from calibration.motor_load_readings import MotorReadings, read_readings, write_readings
from controller.calibration_options import AsJson, Config, say
from controller.config import RobotConfig, load_config
from controller.motor_line import opened_port
from controller.motor_load_dialogue import LoadDialogue, Unit
from controller.motor_load_report import conclude
from controller.motor_load_run import LoadRun, held
from controller.prompts import Prompts
from controller.service.assembly import tendon_motors
from drivers.clock import MonotonicClock
from drivers.dynamixel.control_tables import XM430_W350, MotorModel, model_by_name
from drivers.dynamixel.load_law import published_law
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import InputError

MOTOR_LOAD_EXAMPLES = (
    "Examples: stillgrasp calibrate motor-load --config robot.toml; stillgrasp calibrate motor-load --motor right "
    "--weight 0.5 --weight 1 --weight 2 --weight 4; stillgrasp calibrate motor-load --scale --unit N --dry-run; "
    "stillgrasp calibrate motor-load --readings motors.load.csv -o motors.toml"
)
GOAL_PERIOD_S = 0.010
_STANDARD_INPUT = 0
PATIENT_WATCHDOG_S = 1.0
"""A busy machine may pause; a motor that trips holds, and the run would be lost."""


class Which(StrEnum):
    """Which motor is calibrated."""

    both = "both"
    right = "right"
    left = "left"

    @property
    def sides(self) -> tuple[str, ...]:
        """Right first."""
        return SIDES if self is Which.both else (self.value,)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What the command line says of the plan."""

    scale: bool
    tensions_N: tuple[float, ...]
    start_m: float | None
    stroke_m: float | None
    speeds_m_s: tuple[float, ...]
    up_only: bool

    def plan(self, motor: MotorSettings, model: MotorModel, stands_m: float) -> LoadPlan:
        """For a motor that stands there; the stroke begins there too, if there is room. Raises InputError."""
        lower_m, upper_m = motor.travel_m
        room_m = 0.010 if self.stroke_m is None else self.stroke_m
        start_m = max(lower_m, min(upper_m - room_m, stands_m)) if self.start_m is None else self.start_m
        return plan_load(
            model,
            published_law(model, motor.spool_radius_m),
            travel_m=motor.travel_m,
            start_m=start_m,
            scale=self.scale,
            tensions_N=self.tensions_N,
            stroke_m=self.stroke_m,
            speeds_m_s=self.speeds_m_s,
            up_only=self.up_only,
        )


def motor_load(
    config: Config = None,
    motor: Annotated[Which, typer.Option(help="Which motor.")] = Which.both,
    weight: Annotated[
        list[float] | None,
        typer.Option(help="A weight that you have, in --unit; repeat it for each. Else 0.5, 1, 2, 4 and 6 kg."),
    ] = None,
    unit: Annotated[Unit, typer.Option(help="Of weights and of what a scale says.")] = Unit.kg,
    scale: Annotated[
        bool, typer.Option("--scale", help="A spring scale is pulled instead of weights; --weight are its levels.")
    ] = False,
    start_mm: Annotated[
        float | None, typer.Option(help="Excursion at which strokes begin; else where the motor stands.")
    ] = None,
    stroke_mm: Annotated[
        float | None, typer.Option(help="Tendon wound in a stroke; else 10, a scale's travel.")
    ] = None,
    speed_mm_s: Annotated[
        list[float] | None, typer.Option(help="Tendon speed; repeat it. Else 3, and 8 too where load is told.")
    ] = None,
    up_only: Annotated[bool, typer.Option("--up-only", help="Each weight once, not down again.")] = False,
    readings: Annotated[
        Path | None, typer.Option(help="Fit these readings, .csv or .toml, and move nothing.", show_default=False)
    ] = None,
    port: Annotated[str | None, typer.Option(help="Serial device or pty; else tendons.port of robot.toml.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The motors' own file; else tendons.own_file of robot.toml.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Plot of the residuals, .png; else beside the own file.")] = None,
    accept_rms: Annotated[
        float, typer.Option(min=0.001, max=1, help="Mean residual to accept, as a part of the span of weights.")
    ] = ACCEPTED_RMS,
    accept_max: Annotated[
        float, typer.Option(min=0.001, max=1, help="Largest residual to accept, likewise.")
    ] = ACCEPTED_WORST,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan; move nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before a motor moves.")] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate what a tendon motor's current or load is worth: hang known weights on it, wound and unwound slowly.

    First `calibrate motors`. Stop the daemon, take the tendon off its finger, hang a cord with a hook from the spool,
    and follow the prompts: the motor winds and unwinds some millimetres under each weight, then goes on holding. The
    law and what it was measured on go into the motors' own file; the file before is kept as .bak. The readings are kept
    beside it. A residual that is too large writes nothing.
    """
    robot = load_config(config)
    acceptance = Acceptance(accept_rms, accept_max)
    wanted = _Wanted(
        scale,
        tuple(value * unit.in_N for value in weight or ()),
        None if start_mm is None else 1e-3 * start_mm,
        None if stroke_mm is None else 1e-3 * stroke_mm,
        tuple(1e-3 * value for value in speed_mm_s or ()),
        up_only,
    )
    if dry_run:
        _tell_plans(robot, motor.sides, wanted, unit, as_json)
        return
    file = output or (Path(robot.tendons.own_file) if robot.tendons.own_file else None)
    if file is None:
        raise InputError(
            "it is not said where the calibration shall be written.",
            help='Give --output FILE, or write own_file = "FILE" under [tendons] of robot.toml.',
        )
    _check_writable(file)
    if readings is None:
        measured: list[MotorReadings] = []
        kept = file.with_suffix(".load.csv")
        try:
            _measure(robot, motor.sides, wanted, unit, port, yes, measured)
        finally:  # what was measured until something went wrong is not lost
            if any(one.readings for one in measured):
                write_readings(kept, measured)
                say(f"{kept}: the readings; they can be fitted again with --readings")
    else:
        measured = [one for one in read_readings(readings) if one.side in motor.sides]
        if not measured:
            raise InputError(f"{readings}: no readings of the {motor.value} motor.")
    conclude(robot, measured, file, plot or file.with_suffix(".load.png"), acceptance, as_json)


def _measure(
    robot: RobotConfig,
    sides: Sequence[str],
    wanted: _Wanted,
    unit: Unit,
    path: str | None,
    yes: bool,
    measured: list[MotorReadings],
) -> None:
    """Every reading goes into `measured` as soon as it is taken."""
    clock, tendons = MonotonicClock(), robot.tendons
    prompts = Prompts(_STANDARD_INPUT, say)  # before anything else is opened, that could be taken for it
    model = _model(robot)
    motors = _as_published(tendon_motors(robot), model)
    with opened_port(path or tendons.port, tendons.baud, clock) as port:
        pair = TendonPair(port, clock, motors)
        identities = pair.start()
        with held(pair):
            stands_m = pair.exchange().excursion_m
            plans = {side: wanted.plan(motors[i], model, stands_m[i]) for i, side in enumerate(SIDES) if side in sides}
            for side, plan in plans.items():
                index = SIDES.index(side)
                for note in plan.notes:
                    say(note)
                if not yes:
                    _confirm(prompts, pair, side, plan)
                run = LoadRun(pair, clock, motors, index, plan, GOAL_PERIOD_S)
                run.go(plan.start_m)
                identity = identities[index]
                own = MotorReadings("right" if index == 0 else "left", identity.model_name, identity.firmware, ())
                measured.append(own)
                for found in LoadDialogue(run, plan, prompts, unit, side, say).measure():
                    own = replace(own, readings=(*own.readings, found))
                    measured[-1] = own


def _confirm(prompts: Prompts, pair: TendonPair, side: str, plan: LoadPlan) -> None:
    lower_mm, upper_mm = 1e3 * plan.start_m, 1e3 * (plan.start_m + plan.stroke_m)
    prompts.ask(
        f"the {side} motor will turn between {lower_mm:.1f} and {upper_mm:.1f} mm of tendon, pulling up to "
        f"{plan.cap_N:.0f} N: take the tendon off its finger, hang the cord from the spool, hands off, and press Enter",
        pair.exchange,
    )


def _model(robot: RobotConfig) -> MotorModel:
    return XM430_W350 if robot.tendons.model is None else model_by_name(robot.tendons.model)


def _as_published(
    motors: tuple[MotorSettings, MotorSettings], model: MotorModel
) -> tuple[MotorSettings, MotorSettings]:
    """As if nothing had been calibrated: neither a wrong law nor other firmware may be in the way of a new one."""
    right, left = (
        replace(
            motor,
            load_law=published_law(model, motor.spool_radius_m),
            calibrated=None,
            watchdog_s=max(motor.watchdog_s, PATIENT_WATCHDOG_S) if motor.watchdog_s else 0.0,
        )
        for motor in motors
    )
    return right, left


def _check_writable(file: Path) -> None:
    """Minutes of measuring must not end at a file that cannot take them. Raises ConfigurationError, InputError."""
    if file.exists():
        read_motor_file(file)
    place = file.absolute().parent
    while not place.exists() and place != place.parent:
        place = place.parent
    if not (place.is_dir() and os.access(place, os.W_OK)):
        raise InputError(
            f"{file}: the motors' own file cannot be written there.", help="Name a file in a directory that is yours."
        )


def _tell_plans(robot: RobotConfig, sides: Sequence[str], wanted: _Wanted, unit: Unit, as_json: bool) -> None:
    """For motors of the configured model that stand at their zero."""
    model = _model(robot)
    told = {}
    for side in sides:
        plan = wanted.plan(_as_published(tendon_motors(robot), model)[SIDES.index(side)], model, 0.0)
        told[side] = {
            "scale": plan.scale,
            "steps_N": [round(step_N, 3) for step_N in plan.steps_N],
            "start_mm": 1e3 * plan.start_m,
            "stroke_mm": 1e3 * plan.stroke_m,
            "speeds_mm_s": [1e3 * speed_m_s for speed_m_s in plan.speeds_m_s],
            "cap_N": round(plan.cap_N, 1),
            "notes": list(plan.notes),
        }
        if as_json:
            continue
        steps = ", ".join(unit.told(step_N) for step_N in plan.steps_N)
        speeds = " and ".join(f"{1e3 * speed_m_s:g}" for speed_m_s in plan.speeds_m_s)
        what = "the scale pulled to" if plan.scale else "on the cord"
        typer.echo(f"{side} motor, a {model.name}: {what} {steps}")
        typer.echo(
            f"wound and unwound between {1e3 * plan.start_m:.1f} and {1e3 * (plan.start_m + plan.stroke_m):.1f} mm of "
            f"tendon at {speeds} mm/s, pulling up to {plan.cap_N:.0f} N"
        )
        for note in plan.notes:
            say(note)
    if as_json:
        typer.echo(json.dumps({"model": model.name, **told}))
