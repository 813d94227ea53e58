"""`stillgrasp grasp …`: plan a grasp from the command line, before the robot moves.

Results go to standard output (`--json`: one JSON value), errors to standard error; a refused input ends with exit code
2. Hand frame; motion of the object since first contact, negative y towards the palm; mm and degrees in text, SI in
JSON; finger order right, left. Source: design 6, paper II-A to II-C.
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Any

import typer

from calibration.grasp.force import Effort
from calibration.grasp.plan import GraspPlan, plan_grasp
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.objects import load_object
from controller.table_commands import refusals

EXAMPLE = "stillgrasp grasp plan --hand t42pf --object mustard --mass 0.6"

app = typer.Typer(
    no_args_is_help=True,
    help="Plan a grasp: where the wrist goes, whether it holds, how hard to squeeze.",
    epilog=f"Example: {EXAMPLE}",
)


@app.callback()
def group() -> None:
    """Plan a grasp: where the wrist goes, whether it holds, how hard to squeeze."""


@app.command(epilog=f"Example: {EXAMPLE} --json")
def plan(
    hand: Annotated[str, typer.Option(help="Packaged hand (t42pf) or a TOML file.")],
    object_: Annotated[str, typer.Option("--object", help="Packaged object (mustard) or a TOML file.")],
    mass: Annotated[float | None, typer.Option(help="Mass of the object, kg; else that of its file.")] = None,
    preset: Annotated[str, typer.Option(help="Parameter set of the hand file: nominal, fitted, …")] = "fitted",
    onset_split: Annotated[
        float, typer.Option(help="First-touch loads T(1 + x) right, T(1 − x) left; 0 is symmetric.")
    ] = 0.0,
    object_offset_m: Annotated[
        float, typer.Option(help="The object's centre off the line of the fingertips, positive away from the palm.")
    ] = 0.0,
    object_angle_deg: Annotated[float, typer.Option(help="Counter-clockwise turn of the object's outline.")] = 0.0,
    contact_friction: Annotated[float, typer.Option(help="Friction coefficient at the fingertips.")] = 0.3,
    supported: Annotated[
        bool,
        typer.Option("--supported/--lifted", help="Whether the table carries it while it is squeezed, or the fingers."),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """Work out a grasp: preposition, contacts, force closure, minimal effort and its parasitic motion."""
    with refusals():
        grasp = GraspSpec(
            onset_split=onset_split,
            object_offset_m=object_offset_m,
            object_angle_deg=object_angle_deg,
            contact_friction=contact_friction,
            supported=supported,
        )
        found = plan_grasp(load_hand(hand, preset), load_object(object_), grasp, mass)
    typer.echo(json.dumps(summary(found)) if as_json else "\n".join(lines(found)))


def summary(plan: GraspPlan) -> dict[str, Any]:
    """The plan as a map of plain values, SI, hand frame."""
    start, path, levels = plan.start, plan.path, plan.levels
    x, y, _ = start.object_pose.tolist()
    end_x, end_y, end_angle = path.motion[-1].tolist()
    return {
        "hand": plan.hand.name,
        "preset": plan.hand.preset,
        "object": plan.object.name,
        "mass_kg": plan.mass_kg,
        "contact_friction": plan.grasp.contact_friction,
        "supported": plan.grasp.supported,
        "preposition": {
            "T_hand_object": plan.T_hand_object.tolist(),
            "object_in_hand_m": [x, y, 0.0],
            "hand_offset_from_object_m": [-x, -y, 0.0],
            "outline_angle_rad": start.outline_angle_rad,
            "load_N": start.tendon_load_N.tolist(),
            "excursion_m": start.tendon_excursion_m.tolist(),
            "joint_rad": [q.tolist() for q in start.finger_joint_rad],
        },
        "contacts": [
            {"point_m": [point.real, point.imag], "normal": [normal.real, normal.imag]}
            for point, normal in zip(start.contact_points_m.tolist(), start.normals.tolist(), strict=True)
        ],
        "q_dc_m": start.quality_m,
        "force_closure": {
            "holds": plan.closure.holds,
            "rank": plan.closure.rank,
            "spatial_rank": plan.closure.spatial_rank,
            "cone_margin_rad": list(plan.closure.cone_margin_rad),
        },
        "minimal_effort": None if plan.minimal is None else _effort(plan.minimal),
        "constraints_violated": [] if plan.constraints is None else plan.constraints.violated,
        "f_min_N": levels.f_min_N,
        "f_e_N": levels.f_e_N,
        "f_max_N": levels.f_max_N,
        "statement": levels.statement,
        "largest_required_friction": plan.largest_required_friction,
        "unstable_from_m": plan.unstable_from_m,
        "end": {
            "event": path.end,
            "load_N": path.load_N[-1].tolist(),
            "excursion_m": path.excursion_m[-1].tolist(),
            "motion": {"x_m": end_x, "y_m": end_y, "angle_rad": end_angle},
        },
    }


def lines(plan: GraspPlan) -> list[str]:
    """The plan in words, mm and degrees."""
    start, closure, path = plan.start, plan.closure, plan.path
    x, y, _ = start.object_pose
    carried = "the table carries it" if plan.grasp.supported else "the fingers carry it"
    right, left = (
        f"({_mm(point.real)}, {_mm(point.imag)}) pressing towards {_degrees(math.atan2(normal.imag, normal.real), 1)}"
        for point, normal in zip(start.contact_points_m.tolist(), start.normals.tolist(), strict=True)
    )
    margins = [_degrees(margin, 1) for margin in closure.cone_margin_rad]
    unstable = plan.unstable_from_m
    most, given = plan.largest_required_friction, plan.grasp.contact_friction
    slips = " (more than there is: the tips slip on the way)" if most > given else ""
    return [
        f"{plan.hand.name} ({plan.hand.preset}) takes {plan.object.name}, {plan.mass_kg * 1e3:.0f} g; {carried}",
        "(hand frame: x to the right, y out of the palm; mm)",
        _row(
            "preposition", f"object's centre at ({_mm(x)}, {_mm(y)}) in the hand, so the hand at ({_mm(-x)}, {_mm(-y)})"
        ),
        _row("", f"from the object; its outline turned by {_degrees(start.outline_angle_rad)}"),
        _row("first contact", f"tendon loads {_pair(start.tendon_load_N.tolist())} N, right and left"),
        _row("contacts", f"right {right}"),
        _row("", f"left  {left}"),
        _row("", f"Q_DC {_mm(start.quality_m)}: the object's centroid from the middle between them"),
        _row(
            "force closure",
            f"{'yes' if closure.holds else 'no'}: rank {closure.rank} of 3 in the plane, the contacts' line "
            f"{margins[0]} and {margins[1]} inside",
        ),
        _row(
            "",
            f"the friction cones of {given:g}; in space rank {closure.spatial_rank} of 6: it can turn about that line",
        ),
        *_minimal_lines(plan),
        _row("forces", plan.levels.statement),
        _row("friction", f"the path asks for |f_t|/N up to {most:.3f}{slips}"),
        _row("stability", "stable throughout" if unstable is None else f"unstable from {_mm(unstable)} of winding on"),
        _row(
            "ends at", f"{path.end}: loads {_pair(path.load_N[-1].tolist())} N, object moved {_motion(path.motion[-1])}"
        ),
    ]


def _minimal_lines(plan: GraspPlan) -> list[str]:
    if plan.minimal is None:
        return [_row("minimal effort", "none: see forces")]
    found = plan.minimal
    broken = [] if plan.constraints is None else plan.constraints.violated
    return [
        _row("minimal effort", f"tendon loads {_pair(found.load_N)} N, contacts press {_pair(found.normal_N)} N"),
        _row("", f"object moves {_motion(found.motion)} on the way there"),
        *[_row("", f"but: {name}") for name in broken],
    ]


def _effort(effort: Effort) -> dict[str, Any]:
    x, y, angle = effort.motion
    return {
        "load_N": list(effort.load_N),
        "contact_normal_N": list(effort.normal_N),
        "contact_tangential_N": list(effort.along_N),
        "sum_N": effort.sum_N,
        "motion": {"x_m": x, "y_m": y, "angle_rad": angle},
    }


def _row(name: str, text: str) -> str:
    return f"{name:<15}{text}"


def _mm(length_m: float) -> str:
    return f"{round(length_m * 1e3, 2) + 0.0:.2f}"


def _degrees(angle_rad: float, digits: int = 2) -> str:
    rounded = round(math.degrees(angle_rad), digits) + 0.0
    return f"{180.0 if rounded == -180.0 else rounded:.{digits}f}°"


def _pair(values: Any) -> str:
    right, left = values
    return f"{right:.2f} / {left:.2f}"


def _motion(motion: Any) -> str:
    x, y, angle = motion
    return f"x {_mm(x)}, y {_mm(y)} mm, {_degrees(angle)}"
