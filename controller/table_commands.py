"""`stillgrasp table …`: build, show, check and list motion tables from the command line.

Results go to standard output (`--json`: one JSON value), progress and errors to standard error; a refused input ends
with exit code 2. Poses are of the object in the hand frame since first contact, mm and degrees in text, SI in JSON.
Source: design 4, 6.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console
from rich.progress import Progress

from calibration.build import NODES, build_table, is_current
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable, Status
from calibration.objects import load_object
from drivers.errors import StillgraspError, TableError

app = typer.Typer(
    no_args_is_help=True,
    help="Build and inspect motion tables: where a squeezed object goes in the hand.",
    epilog="Example: stillgrasp table build --hand t42pp --object cylinder40 -o mug.npz",
)
REFUSED = 2

TableFile = Annotated[Path, typer.Argument(help="A motion table, .npz.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Print an error of ours as one message and leave with exit code 2."""
    try:
        yield
    except StillgraspError as error:
        typer.echo(f"stillgrasp: {error}", err=True)
        raise typer.Exit(REFUSED) from error


@app.command(
    epilog="Example: stillgrasp table build --hand t42pp --object cylinder40 --onset-split 0.1 -o build/split.npz"
)
def build(
    hand: Annotated[str, typer.Option(help="Packaged hand (t42pp) or a TOML file.")],
    object_: Annotated[str, typer.Option("--object", help="Packaged object (cylinder40) or a TOML file.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Table file to write, .npz.")],
    onset_split: Annotated[
        float, typer.Option(help="First-touch loads T(1 + x) right, T(1 − x) left; 0 is symmetric.")
    ] = 0.0,
    nodes: Annotated[int, typer.Option(help="Grid nodes per axis, 9 to 401.")] = NODES,
    preset: Annotated[str, typer.Option(help="Parameter set of the hand file: nominal, fitted, …")] = "fitted",
) -> None:
    """Build the table of a hand and an object."""
    with refusals():
        taken = load_object(object_)
        grasp = GraspSpec(onset_split=onset_split, supported=taken.support is not None)
        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("equilibria", total=1.0)
            table = build_table(
                load_hand(hand, preset),
                taken,
                grasp,
                nodes=nodes,
                progress=lambda done: bar.update(task, completed=done),
            )
        table.save(output)
        end_mm = table.mean_excursion_end_m(0.0) * 1e3
        typer.echo(f"{output}: {nodes} nodes, equal winding up to {end_mm:.2f} mm, {table.mean_load_end_N(0.0):.1f} N")


@app.command(epilog="Example: stillgrasp table show build/split.npz --json")
def show(file: TableFile, as_json: AsJson = False) -> None:
    """Print what a table is for, and the object's path while both tendons wind in equally."""
    with refusals():
        table = MotionTable.load(file)
        path = equal_path(table)
    if as_json:
        typer.echo(json.dumps({"file": str(file), "header": msgspec.to_builtins(table.header), "path": path}))
        return
    header = table.header
    typer.echo(
        f"{file}: {header.hand['name']} ({header.hand['preset']}) on {header.object['name']}, grasp {header.grasp}"
    )
    typer.echo(f"inputs {header.inputs_sha256}, format {header.format_version}, stillgrasp {header.package_version}")
    names = ("wound mm", "load N", "x mm", "y mm", "θ deg", "N right", "N left", "|f_t|/N", "stable")
    typer.echo("".join(f"{name:>9}" for name in names))
    for row in path:
        x, y, angle = row["pose"][0], row["pose"][1], row["pose"][5]
        numbers = (
            row["excursion_m"] * 1e3,
            row["load_N"],
            x * 1e3,
            y * 1e3,
            math.degrees(angle),
            *row["contact_force_N"],
        )
        texts = [*(f"{number:.2f}" for number in numbers), f"{row['required_friction']:.3f}"]
        typer.echo("".join(f"{text:>9}" for text in [*texts, "yes" if row["stable"] else "no"]))


@app.command(epilog="Example: stillgrasp table check build/split.npz")
def check(file: TableFile, as_json: AsJson = False) -> None:
    """Say whether a table is intact, and whether this version would build the same one."""
    with refusals():
        table = MotionTable.load(file)
        current = is_current(table)
    if as_json:
        verdict = {"file": str(file), "intact": True, "current": current, "inputs_sha256": table.inputs_sha256}
        typer.echo(json.dumps(verdict))
    elif current:
        typer.echo(f"{file}: intact and current")
    else:
        typer.echo(f"{file}: intact, but built by another version; build it again")


@app.command("list", epilog="Example: stillgrasp table list build --json")
def list_(directory: Annotated[Path, typer.Argument(help="Folder to look in.")], as_json: AsJson = False) -> None:
    """List the tables of a folder, damaged ones with the reason."""
    with refusals():
        if not directory.is_dir():
            raise TableError(directory, "is not a folder.", help="Give the folder that holds the tables.")
        rows = [_summary(file) for file in sorted(directory.glob("*.npz"))]
    if as_json:
        typer.echo(json.dumps(rows))
        return
    for row in rows:
        what = (
            row.get("error")
            or f"{row['hand']} ({row['preset']}) on {row['object']}, onset split {row['onset_split']:g}"
        )
        typer.echo(f"{row['file']}: {what}")


def equal_path(table: MotionTable) -> list[dict[str, Any]]:
    """The path of equal excursions, node by node: SI, hand frame, pose as motion since first contact (6)."""
    means, stability = table.arrays["excursion.axis_0"], table.arrays["excursion.stability"]
    middle = stability.shape[1] // 2
    path = []
    for mean, eigenvalue in zip(means.tolist(), stability[:, middle].tolist(), strict=True):
        sample = table.at_excursion(mean, 0.0)
        if sample.status not in (Status.INSIDE, Status.BEFORE_CONTACT):
            break
        path.append(
            {
                "excursion_m": mean,
                "load_N": float(sample.tension.mean()),
                "pose": sample.motion.tolist(),
                "contact_force_N": sample.contact_force.tolist(),
                "required_friction": sample.required_friction,
                "stable": eigenvalue > 0,
            }
        )
    return path


def _summary(file: Path) -> dict[str, Any]:
    try:
        header = MotionTable.load(file).header
    except TableError as error:
        return {"file": str(file), "error": error.reason}
    return {
        "file": str(file),
        "hand": header.hand["name"],
        "preset": header.hand["preset"],
        "object": header.object["name"],
        "onset_split": header.grasp["onset_split"],
        "inputs_sha256": header.inputs_sha256,
    }
