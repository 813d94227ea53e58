"""`stillgrasp calibrate …`: measure the hardware and write what was found into files of this installation.

What is measured on the arm goes into the arm's own file, which robot.toml names as `[arm] own_file` and which is laid
over the packaged `drivers/wam/wam7.toml`. Prompts and notes go to standard error, results to standard output.
Source: design 6; WAM reference 4.4. The other commands have files of their own, `*_command.py`.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from controller.calibration_options import AsJson, Config, OwnFile, await_enter, own_file, say
from controller.config import load_config
from controller.gravity_command import GRAVITY_EXAMPLES, gravity
from controller.motor_load_command import MOTOR_LOAD_EXAMPLES, motor_load
from controller.motors_command import MOTORS_EXAMPLES, motors
from controller.tactile_command import TACTILE_EXAMPLE, tactile
from drivers.clock import MonotonicClock
from drivers.errors import InputError
from drivers.wam.bus import open_can
from drivers.wam.own_file import write_own_file
from drivers.wam.parameters import WamParameters, load_wam_parameters
from drivers.wam.zero_calibration import CALIBRATION_FILTERS, ZeroCalibration, ZeroMeasurement

app = typer.Typer(
    no_args_is_help=True,
    help="Measure the hardware, and write what was found into files of this installation.",
    epilog="Example: stillgrasp calibrate zero --config robot.toml",
)

Interface = Annotated[str | None, typer.Option(help="CAN interface, socketcan or seqpacket; else the configured one.")]
Channel = Annotated[str | None, typer.Option(help="CAN channel, such as can0; else the configured one.")]
JointAngles = tuple[float, float, float, float, float, float, float]
_LARGEST_ANGLE_RAD = 6.3


@app.callback()
def calibrate() -> None:
    """Measure the hardware, and write what was found into files of this installation."""


@app.command(
    epilog="Examples: stillgrasp calibrate zero --config robot.toml; stillgrasp calibrate zero --interface socketcan "
    "--channel can0 -o arm.toml --home 0 -1.995 0.01 3.12 0 0 0"
)
def zero(
    config: Config = None,
    interface: Interface = None,
    channel: Channel = None,
    output: OwnFile = None,
    home: Annotated[
        JointAngles | None, typer.Option(help="Joint angles of the pose the arm stands in, rad; else the known home.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="The arm stands in that pose already: do not ask.")] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate the arm's zero: read its absolute encoders while it stands in its home pose.

    Stop the daemon, leave the arm idle (Shift+Idle), place it in its home pose by hand and press Enter. home_rad and
    zero_angle_rad are written into the arm's own file, other keys of which stay; the file before is kept as .bak. The
    arm is zeroed by them at once, and by every later start-up. Name the file in robot.toml as arm.own_file. An arm that
    is active, in E-stop, moving, or controlled by another program is refused.
    """
    robot = load_config(config)
    file = own_file(robot, output)
    parameters = load_wam_parameters(own=file if file.exists() else None)
    pose = parameters.home_rad if home is None else np.array(home)
    if not np.all(np.isfinite(pose)) or np.any(np.abs(pose) > _LARGEST_ANGLE_RAD):
        raise InputError(f"--home {pose.tolist()} is not a pose; expected angles within ±{_LARGEST_ANGLE_RAD} rad.")
    clock = MonotonicClock()
    bus = open_can(interface or robot.arm.interface, channel or robot.arm.channel, clock, filters=CALIBRATION_FILTERS)
    with contextlib.closing(bus):
        measurement = ZeroMeasurement(bus, clock, parameters)
        measurement.prepare()
        if not yes:
            angles = " ".join(f"{angle:.3f}" for angle in pose)
            await_enter(f"place the arm in the pose {angles} rad (base to tool), keep hands off")
        found = measurement.measure(pose)
        write_own_file(file, changes_of(found))
        measurement.zero(found)
    _tell(found, file, parameters, as_json)


app.command(epilog=GRAVITY_EXAMPLES)(gravity)
app.command(epilog=TACTILE_EXAMPLE)(tactile)
app.command(epilog=MOTORS_EXAMPLES)(motors)
app.command(epilog=MOTOR_LOAD_EXAMPLES)(motor_load)


def changes_of(found: ZeroCalibration) -> dict[str, object]:
    """The keys of the arm's own file that a zero calibration sets."""
    return {"home_rad": found.home_rad.tolist(), "zero_angle_rad": [round(float(a), 6) for a in found.zero_angle_rad]}


def _tell(found: ZeroCalibration, file: Path, before: WamParameters, as_json: bool) -> None:
    for note in found.notes:
        say(note)
    plain = sorted(set(range(1, 8)) - set(found.absolute_encoders))
    if plain:
        say(f"motors {plain} have no absolute encoder: they are zeroed by the home pose alone")
    if as_json:
        told = {"file": str(file.absolute()), **changes_of(found), "absolute_encoders": list(found.absolute_encoders)}
        typer.echo(json.dumps({**told, "notes": list(found.notes)}))
        return
    typer.echo(f"{file}: home_rad and zero_angle_rad written; the arm is zeroed")
    typer.echo(f"{'':12}" + "".join(f"{number:>9}" for number in range(1, 8)))
    rows = (("home rad", found.home_rad), ("zero rad", found.zero_angle_rad), ("zero before", before.zero_angle_rad))
    for name, values in rows:
        typer.echo(f"{name:12}" + "".join(f"{value:9.4f}" if value != -1.0 else f"{'-':>9}" for value in values))
