"""`stillgrasp calibrate gravity`: measure the arm's gravity on a running daemon and write it into the arm's own file.

The daemon moves the arm through the plan of `calibration/gravity_plan.py`; what it commanded there, less what the hand
weighs by its file, is fitted by `calibration/gravity.py`. Results go to standard output, all else to standard error.
Source: WAM reference 6.6; docs/calibration-gravity.md.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from calibration.gravity import ACCEPTED_RMS_NM, GravityFit, fit_gravity
from calibration.gravity_plan import GravityPlan, HeldPose, balanced, plan_gravity
from controller.calibration_options import AsJson, Config, OwnFile, await_enter, own_file, say
from controller.client import Client
from controller.config import RobotConfig, load_config
from controller.cycle.arm_model import GRAVITY_M_S2, ArmModel
from controller.service.assembly import arm_model, arm_parameters, configured_hand, joint_limits, torque_limits
from controller.service.calibrate import CalibrationRun
from controller.service.state_stream import StateSubscriber
from drivers.errors import InputError
from drivers.wam.own_file import write_own_file
from drivers.wam.parameters import load_wam_parameters

GRAVITY_EXAMPLES = (
    "Examples: stillgrasp calibrate gravity --dry-run; stillgrasp calibrate gravity --config robot.toml; "
    "stillgrasp calibrate gravity -o arm.toml --yes --json"
)


def gravity(
    config: Config = None,
    output: OwnFile = None,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1.0, help="Part of the joint speed limits, on the way between poses.")
    ] = 0.3,
    sampling_s: Annotated[
        float, typer.Option("--sampling-s", min=0.2, max=60.0, help="How long torques are averaged, s.")
    ] = 4.0,
    without_hand: Annotated[
        bool, typer.Option("--without-hand", help="No hand is mounted: the torques are the bare arm's.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the poses; move nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before the arm moves.")] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate the arm's gravity: hold it in nine poses, each approached from both sides, and fit what holds it.

    Needs a running daemon with an active arm, an empty hand, and the arm's whole reach free of people and things: it
    goes through nine far apart poses, for three to five minutes. gravity_mu_kg_m is written into the arm's own file,
    other keys of which stay; the file before is kept as .bak. It holds for the bare arm: the hand is added by its own
    file. The daemon uses it from its next start. A residual that is too large writes nothing.
    """
    robot = load_config(config)
    limits = joint_limits(robot, arm_parameters(robot))
    plan = plan_gravity(limits.lower_rad, limits.upper_rad, sampling_s=sampling_s)
    for note in plan.notes:
        say(note)
    if dry_run:
        _tell_plan(plan, as_json)
        return
    file = own_file(robot, output)
    _check_writable(file)
    if not yes:
        await_enter("the arm will go through all of its reach: clear it of people and things, have E-stop at hand")
    with (
        Client(robot.front.command_endpoint, reply_timeout_s=5.0) as client,
        contextlib.closing(StateSubscriber(robot.front.state_endpoint)) as states,
    ):
        slowest_rad_s = float(limits.velocity_rad_s.min())
        run = CalibrationRun(client, states, robot.cycle.period_s, slowest_rad_s, travel_speed=speed, say=say)
        held = run.measure_gravity(plan)
    fit = identified(robot, plan, held, with_hand=not without_hand)
    refused = fit.refused_joints()
    if not refused:
        write_own_file(file, {"gravity_mu_kg_m": [[round(float(x), 9) for x in row] for row in fit.mu_kg_m]})
    _tell(fit, file, held, as_json)
    if refused:
        joints = ", ".join(str(joint + 1) for joint in refused)
        raise InputError(
            f"too large a residual is left in joint {joints}; nothing was written.",
            help="See that nothing touches the arm or hangs on it, that the hand's file holds its mass, and robot.toml "
            "how the base is mounted; then measure again.",
        )


def identified(
    robot: RobotConfig, plan: GravityPlan, held: Sequence[HeldPose], *, with_hand: bool = True
) -> GravityFit:
    """Gravity vectors of the bare arm of an installation, from what was measured on it. Raises InputError."""
    parameters = arm_parameters(robot)
    measured = balanced(plan, held, np.array(torque_limits(robot, parameters).torque_Nm))
    nominal = ArmModel(parameters=replace(parameters, gravity_mu_kg_m=None), T_world_base=robot.T_world_base)
    known = nominal.gravity_mu_kg_m
    carried = None
    if with_hand:
        loaded, bare = (
            arm_model(robot, configured_hand(robot)),
            ArmModel(parameters=parameters, T_world_base=robot.T_world_base),
        )
        carried = np.array([loaded.gravity(q) - bare.gravity(q) for q in measured.joint_rad])
    gravity_in_base = robot.T_world_base[:3, :3].T @ np.array([0.0, 0.0, -GRAVITY_M_S2])
    return fit_gravity(measured, gravity_in_base, known, carried)


def _check_writable(file: Path) -> None:
    """Minutes of measuring must not end at a file that cannot take them. Raises ConfigurationError, InputError."""
    load_wam_parameters(own=file if file.exists() else None)
    place = file.parent
    while not place.exists() and place != place.parent:
        place = place.parent
    if not (place.is_dir() and os.access(place, os.W_OK)):
        raise InputError(
            f"{file}: the arm's own file cannot be written there.", help="Name a file in a directory that is yours."
        )


def _tell_plan(plan: GravityPlan, as_json: bool) -> None:
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "poses_rad": plan.poses_rad,
                    "offset_rad": plan.offset_rad,
                    "speed_rad_s": plan.speed_rad_s,
                    "sampling_s": plan.sampling_s,
                    "notes": plan.notes,
                }
            )
        )
        return
    typer.echo(f"{'joint, rad':12}" + "".join(f"{number:>9}" for number in range(1, 8)))
    for number, pose in enumerate(plan.poses_rad, start=1):
        typer.echo(f"{f'pose {number}':12}" + "".join(f"{angle:9.4f}" for angle in pose))
    typer.echo(
        f"each from {plan.offset_rad:g} rad above and below on all joints at {plan.speed_rad_s:g} rad/s, "
        f"then {plan.sampling_s:g} s of torques"
    )


def _tell(fit: GravityFit, file: Path, held: Sequence[HeldPose], as_json: bool) -> None:
    refused = fit.refused_joints()
    samples = sum(one.samples for one in held)
    if as_json:
        told: dict[str, Any] = {
            "file": str(file.absolute()) if not refused else None,
            "accepted": not refused,
            "gravity_mu_kg_m": fit.mu_kg_m.tolist(),
            "rms_Nm": fit.rms_Nm.tolist(),
            "rms_nominal_Nm": fit.rms_before_Nm.tolist(),
            "accepted_rms_Nm": ACCEPTED_RMS_NM,
            "worst_pose": [pose + 1 for pose in fit.worst_pose],
            "worst_Nm": np.abs(fit.residual_Nm).max(axis=0).tolist(),
            "friction_Nm": fit.friction_Nm.tolist(),
            "samples": samples,
        }
        typer.echo(json.dumps(told))
        return
    typer.echo(f"{'joint, N·m':22}" + "".join(f"{number:>9}" for number in range(1, 8)))
    rows = (
        ("left by the masses", fit.rms_before_Nm, "9.4f"),
        ("left by the fit", fit.rms_Nm, "9.4f"),
        ("accepted", np.array(ACCEPTED_RMS_NM), "9.4f"),
        ("largest", np.abs(fit.residual_Nm).max(axis=0), "9.4f"),
        ("in pose", np.array(fit.worst_pose) + 1, "9d"),
        ("friction", fit.friction_Nm, "9.4f"),
    )
    for name, values, form in rows:
        typer.echo(f"{name:22}" + "".join(f"{value:{form}}" for value in values))
    typer.echo(f"root mean squares over the poses, from {samples} samples")
    if not refused:
        typer.echo(f"{file}: gravity_mu_kg_m written; the daemon uses it from its next start, by arm.own_file")
    friction = ", ".join(f"{max(value, 0.0):.3f}" for value in fit.friction_Nm)
    say(f"the friction is an estimate for [arm.friction] of robot.toml: coulomb_Nm = [{friction}]")
