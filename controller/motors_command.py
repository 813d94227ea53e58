"""`stillgrasp calibrate motors`: which tendon motors there are, and how the two of the hand are mounted.

`--scan` only looks; `--reboot` clears one motor's hardware error; without either, the operator is led through
`calibration/motor_setup.py` and the result goes into the motors' own file. Stop the daemon first: the serial line has
one user. Results go to standard output, prompts and notes to standard error.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from calibration.motor_file import read_motor_file, write_motor_setup
from calibration.motor_setup import STEPS, MotorSetup, Ticks, work_out
from controller.calibration_options import AsJson, Config, await_enter, say
from controller.config import Tendons, load_config
from controller.motor_line import opened_port
from drivers.clock import MonotonicClock
from drivers.dynamixel import discovery
from drivers.dynamixel.bus import motor_name
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.motor import Inspection, TendonMotor
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import InputError

MOTORS_EXAMPLES = (
    "Examples: stillgrasp calibrate motors --scan; stillgrasp calibrate motors --config robot.toml -o motors.toml; "
    "stillgrasp calibrate motors --reboot 2"
)


def motors(
    config: Config = None,
    port: Annotated[str | None, typer.Option(help="Serial device or pty; else tendons.port of robot.toml.")] = None,
    baud: Annotated[
        int | None,
        typer.Option(min=9600, max=4_500_000, help="Else tendons.baud; with --scan all usual ones."),
    ] = None,
    ids: Annotated[
        tuple[int, int] | None, typer.Option(help="The hand's two motors, in any order; else the configured ids.")
    ] = None,
    scan: Annotated[bool, typer.Option("--scan", help="List the motors on the line; nothing is written.")] = False,
    highest_id: Annotated[int, typer.Option(min=0, max=253, help="With --scan: the last id to ask for.")] = 253,
    reboot: Annotated[
        int | None, typer.Option(min=0, max=253, help="Clear the hardware error of the motor with this id; it lets go.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The motors' own file; else tendons.own_file of robot.toml.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before a motor lets go.")] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate how the tendon motors are mounted: which is right and left, tightening sign, zero and travel.

    Stop the daemon, take everything out of the hand, and follow the prompts: with torque off, the spools are turned by
    hand. What was found is written into the motors' own file; the file before is kept as .bak. Name the file in
    robot.toml as tendons.own_file. With --scan motors of any id, protocol and baud rate are listed instead.
    """
    if scan and (reboot is not None or ids is not None or output is not None):
        raise InputError("--scan only looks; it takes no --reboot, --ids and --output.")
    tendons = load_config(config).tendons
    path = port or tendons.port
    if scan:
        _scan(path, None if baud is None else (baud,), highest_id, as_json)
        return
    rate = baud or tendons.baud
    if reboot is not None:
        _reboot(path, rate, reboot, yes, as_json)
        return
    file = output or (Path(tendons.own_file) if tendons.own_file else None)
    if file is None:
        raise InputError(
            "it is not said where the calibration shall be written.",
            help='Give --output FILE, or write own_file = "FILE" under [tendons] of robot.toml.',
        )
    if file.exists():
        read_motor_file(file)  # a damaged one is told before the operator begins
    _calibrate(path, rate, ids or (tendons.right.id, tendons.left.id), tendons, file, yes, as_json)


def _scan(path: str, bauds: tuple[int, ...] | None, highest_id: int, as_json: bool) -> None:
    found = discovery.scan(
        path,
        bauds=bauds or discovery.SCAN_BAUDS,
        motor_ids=range(highest_id + 1),
        progress=lambda baud, protocol: say(f"asking at {baud} bit/s, protocol {protocol}.0"),
    )
    latency_ms = _latency_ms(path)
    if as_json:
        told = {"port": path, "latency_timer_ms": latency_ms, "motors": [asdict(motor) for motor in found]}
        typer.echo(json.dumps(told))
    elif found:
        typer.echo(f"{'id':>4}  {'model':12} {'firmware':>8}  {'protocol':>8}  {'baud':>8}")
        for motor in found:
            firmware = "-" if motor.firmware is None else str(motor.firmware)
            remark = "  hardware error: --reboot this id" if motor.alert else ""
            remark += "  more than one motor has this id: connect one at a time" if motor.shared_id else ""
            name = f"{motor.motor_id:4d}  {motor.model_name:12}"
            typer.echo(f"{name} {firmware:>8}  {motor.protocol:>6}.0  {motor.baud:8d}{remark}")
    if not found:
        say(f"{path}: no motor answered. Check the supply, the cable, and the adapter's switch (TTL or RS-485).")
        raise typer.Exit(1)


def _reboot(path: str, baud: int, motor_id: int, yes: bool, as_json: bool) -> None:
    clock = MonotonicClock()
    with opened_port(path, baud, clock) as port:
        if not yes:
            await_enter(f"motor {motor_id} will let go of its tendon: secure what the hand holds")
        model = discovery.reboot(port, clock, motor_id)
    if as_json:
        typer.echo(json.dumps({"motor_id": motor_id, "model": model.name, "torque": False}))
    else:
        typer.echo(
            f"motor {motor_id}, a {model.name}: no hardware error any more; it holds nothing until the next start"
        )


def _calibrate(
    path: str, baud: int, ids: tuple[int, int], tendons: Tendons, file: Path, yes: bool, as_json: bool
) -> None:
    clock = MonotonicClock()
    settings = (_bare(ids[0], tendons), _bare(ids[1], tendons))
    if ids[0] == ids[1]:
        raise InputError(f"--ids {ids[0]} {ids[1]} are one motor; expected two.")
    with opened_port(path, baud, clock) as port:
        pair = discovery.find_pair(port, settings)
        found = [TendonMotor(pair.bus, one, pair.model) for one in settings]
        inspections = [motor.inspect() for motor in found]
        for inspection in inspections:
            who = inspection.identity
            say(f"motor {who.motor_id} is a {who.model_name}, firmware {who.firmware}, protocol {who.protocol}.0")
        _let_go(found, inspections, yes)
        taken = [_asked(step, found) for step in STEPS]
    right, left = work_out(
        (taken[0], taken[1], taken[2], taken[3]),
        ids,
        pair.model,
        spool_radius_m=(tendons.right.spool_radius_m, tendons.left.spool_radius_m),
        slack_m=(max(0.0, -tendons.right.travel_m[0]), max(0.0, -tendons.left.travel_m[0])),
    )
    for side in write_motor_setup(file, right, left, pair.model.name):
        say(f"the {side} side's load law was another motor's and is taken out: `stillgrasp calibrate motor-load`")
    _tell(right, left, pair.model.name, file, as_json)


def _bare(motor_id: int, tendons: Tendons) -> MotorSettings:
    """A motor of which only the id is known: nothing is wound, so nothing else matters."""
    return MotorSettings(motor_id, tightening_sign=1, zero_ticks=0, watchdog_s=tendons.watchdog_s)


def _let_go(found: list[TendonMotor], inspections: list[Inspection], yes: bool) -> None:
    holding = [motor for motor, seen in zip(found, inspections, strict=True) if seen.identity.adopted]
    if holding and not yes:
        names = " and ".join(motor_name(motor.motor_id) for motor in holding)
        await_enter(f"{names} will let go: take what the hand holds out of it")
    for motor in holding:
        motor.write("torque_enable", 0)


def _asked(step: str, found: list[TendonMotor]) -> Ticks:
    """Where both motors stand once the operator has done this step."""
    await_enter(step.rstrip(","))
    first, second = (motor.inspect() for motor in found)
    for inspection in (first, second):
        if inspection.identity.adopted:
            raise InputError(
                f"motor {inspection.identity.motor_id} was switched on meanwhile; nothing was written.",
                help="See that no other program uses the motors, then start again.",
            )
    return first.position_ticks, second.position_ticks


def _latency_ms(path: str) -> int | None:
    """The adapter's latency timer, told if it is too long; None if it has none."""
    with contextlib.closing(SerialLine(path, discovery.SCAN_BAUDS[0])) as line:
        if line.advice:
            say(line.advice)
        return line.latency_timer_ms


def _tell(right: MotorSetup, left: MotorSetup, model: str, file: Path, as_json: bool) -> None:
    for note in (*right.notes, *left.notes):
        say(note)
    if as_json:
        told = {"file": str(file.absolute()), "model": model, "right": asdict(right), "left": asdict(left)}
        typer.echo(json.dumps(told))
        return
    typer.echo(f"{file}: written; name it in robot.toml as tendons.own_file")
    typer.echo(f"{'':6} {'id':>4} {'sign':>5} {'zero ticks':>11} {'travel mm':>14} {'zero repeats mm':>16}")
    for side, motor in (("right", right), ("left", left)):
        lower_mm, upper_mm = (1e3 * end_m for end_m in motor.travel_m)
        typer.echo(
            f"{side:6} {motor.motor_id:4d} {motor.tightening_sign:+5d} {motor.zero_ticks:11d} "
            f"{lower_mm:6.1f} … {upper_mm:5.1f} {1e3 * motor.repeat_m:16.2f}"
        )
