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

from calibration.build import NODES, build_or_load, is_current
from calibration.catalogue import PAPER, Case, Outcome, Result, build_all, counted, load_catalogue
from calibration.cluster import cluster as cluster_of
from calibration.cluster import process_pool
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.force import contact_force_levels
from calibration.grasp.preposition import first_contact
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import Hand, load_hand
from calibration.motion_table import MotionTable, Status
from calibration.objects import GraspObject, load_object
from calibration.table_inputs import table_inputs
from drivers.errors import InputError, MechanicsError, StillgraspError, TableError

app = typer.Typer(
    no_args_is_help=True,
    help="Build and inspect motion tables: where a squeezed object goes in the hand.",
    epilog="Example: stillgrasp table build --hand t42pp --object cylinder40 -o mug.npz",
)
FAILED, REFUSED = 1, 2
ONE_TABLE = {
    *("hand", "object_", "output", "preset", "onset_split", "object_offset_m", "object_angle_deg"),
    *("contact_friction", "load_cap_N", "supported", "compensated", "branch"),
}
MANY_TABLES = {"catalogue", "directory", "workers", "cluster"}
"""Options of `build` that only go without --all, and only with it."""

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
    epilog="Examples: stillgrasp table build --hand t42pp --object cylinder40 --onset-split 0.1 -o build/split.npz; "
    "stillgrasp table build --all --directory build/tables --workers 4"
)
def build(
    context: typer.Context,
    catalogue: Annotated[
        Path | None, typer.Argument(help="With --all: the catalogue, a TOML file; else the paper's.")
    ] = None,
    hand: Annotated[str | None, typer.Option(help="Packaged hand (t42pp) or a TOML file.")] = None,
    object_: Annotated[
        str | None, typer.Option("--object", help="Packaged object (cylinder40) or a TOML file.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Table file to write, .npz.")] = None,
    preset: Annotated[str, typer.Option(help="Parameter set of the hand file: nominal, fitted, …")] = "fitted",
    onset_split: Annotated[
        float, typer.Option(help="First-touch loads T(1 + x) right, T(1 − x) left; 0 is symmetric.")
    ] = 0.0,
    object_offset_m: Annotated[
        float, typer.Option(help="The object's centre off the line of the fingertips, positive away from the palm.")
    ] = 0.0,
    object_angle_deg: Annotated[float, typer.Option(help="Counter-clockwise turn of the object's outline.")] = 0.0,
    contact_friction: Annotated[float, typer.Option(help="Friction coefficient at the fingertips.")] = 0.3,
    load_cap_N: Annotated[
        float | None, typer.Option("--load-cap-N", help="Tendon load at which winding stops; else the hand's.")
    ] = None,
    supported: Annotated[
        bool | None,
        typer.Option("--supported/--lifted", help="Whether it drags on its support; else as the object's file says."),
    ] = None,
    compensated: Annotated[
        bool,
        typer.Option(
            "--compensated/--standing-hand", help="For the daemon: it keeps the object still, so nothing drags."
        ),
    ] = False,
    branch: Annotated[str, typer.Option(help="Tendons wound in, or let out again: winding, unwinding.")] = "winding",
    nodes: Annotated[int, typer.Option(help="Grid nodes per axis, 9 to 401.")] = NODES,
    all_: Annotated[bool, typer.Option("--all", help="Every case of a catalogue, on all cores.")] = False,
    directory: Annotated[Path | None, typer.Option(help="With --all: folder of the tables.")] = None,
    workers: Annotated[int | None, typer.Option(help="With --all: processes; else one a core.")] = None,
    cluster: Annotated[
        str | None, typer.Option(help="With --all: a dask scheduler (tcp://host:8786), or local.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Build the table of a hand and an object, or with --all every table of a catalogue.

    A table that is there, of the same inputs and version, is left as it is; so an interrupted --all goes on.
    """
    with refusals():
        _refuse_wrong_company(context, all_)
        if all_:
            assert directory is not None  # checked above, as are the others below
            _check_nodes(nodes)
            _build_catalogue(load_catalogue(catalogue or PAPER), directory, workers, cluster, nodes, as_json)
            return
        assert hand is not None
        assert object_ is not None
        assert output is not None
        taken = load_object(object_)
        options: dict[str, Any] = {  # the grasp itself refuses what it cannot be
            "onset_split": onset_split,
            "contact_friction": contact_friction,
            "load_cap_N": load_cap_N,
            "supported": taken.support is not None if supported is None else supported,
            "compensated": compensated,
            "object_offset_m": object_offset_m,
            "object_angle_deg": object_angle_deg,
            "branch": branch,
        }
        with _progress() as bar:
            task = bar.add_task("equilibria", total=1.0)
            table, current = build_or_load(
                output,
                load_hand(hand, preset),
                taken,
                GraspSpec(**options),
                nodes=nodes,
                progress=lambda done: bar.update(task, completed=done),
            )
        end_mm, end_N = table.mean_excursion_end_m(0.0) * 1e3, table.mean_load_end_N(0.0)
    if as_json:
        done = {
            "file": str(output),
            "result": Result.CURRENT if current else Result.BUILT,
            "inputs_sha256": table.inputs_sha256,
            "equal_winding_end_m": end_mm / 1e3,
            "load_end_N": end_N,
        }
        typer.echo(json.dumps(done))
        return
    was = "already current, " if current else ""
    typer.echo(f"{output}: {was}{nodes} nodes, equal winding up to {end_mm:.2f} mm, {end_N:.1f} N")


@app.command(epilog="Example: stillgrasp table show build/split.npz --json")
def show(file: TableFile, as_json: AsJson = False) -> None:
    """Print what a table is for, the object's path while both tendons wind in equally, and the grasping forces.

    f_min holds the object's weight, f_e is reached when the hand stops to reconfigure, f_max at the load cap: sums of
    both contacts' normal forces.
    """
    with refusals():
        table = MotionTable.load(file)
        path = equal_path(table)
        hand, taken, grasp = table_inputs(table)
        outline_rad = first_contact(hand, taken, grasp).outline_angle_rad
        forces = grasping_forces(hand, taken, grasp)
    header = table.header
    if as_json:
        told = {"file": str(file), "header": msgspec.to_builtins(header), "path": path, **forces}
        typer.echo(json.dumps(told | {"outline_angle_rad": outline_rad}))
        return
    ends = header.column_end[len(header.column_end) // 2]
    support = "lifted"
    if grasp.supported and taken.support:
        rubs = "kept still on it" if grasp.compensated else f"friction {taken.support.friction:g}"
        support = f"on its support ({rubs})"
    rows = (
        ("hand", f"{hand.name}, preset {hand.preset}"),
        ("object", f"{taken.name}, {taken.mass_kg * 1e3:.0f} g, {support}"),
        (
            "grasp",
            f"onset split {grasp.onset_split:g}, offset {grasp.object_offset_m * 1e3:g} mm, turned "
            f"{grasp.object_angle_deg:g}° (outline {outline_rad:+.4f} rad), fingertip friction "
            f"{grasp.contact_friction:g}, {grasp.branch}",
        ),
        (
            "domain",
            f"equal winding up to {table.mean_excursion_end_m(0.0) * 1e3:.2f} mm, {table.mean_load_end_N(0.0):.1f} N; "
            f"ended by: {ends}",
        ),
        ("forces", forces["statement"]),
        ("inputs", f"{header.inputs_sha256}, format {header.format_version}, stillgrasp {header.package_version}"),
    )
    typer.echo(str(file))
    for name, text in rows:
        typer.echo(f"  {name:<8}{text}")
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
        texts = [*(f"{round(number, 2) + 0.0:.2f}" for number in numbers), f"{row['required_friction']:.3f}"]
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


def _refuse_wrong_company(context: typer.Context, all_: bool) -> None:
    """InputError for options that belong to the other way of building, and for those that are missing."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    given = {name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"}
    foreign = (ONE_TABLE if all_ else MANY_TABLES) & given
    missing = ({"directory"} if all_ else {"hand", "object_", "output"}) - given
    if foreign:
        why = "only for one table; a catalogue says them itself" if all_ else "only with --all"
        raise InputError(f"{_options(foreign)}: {why}.", help="Leave out either.")
    if missing:
        raise InputError(f"{_options(missing)}: missing.", help="See `stillgrasp table build --help`.")


def _options(names: set[str]) -> str:
    """As they are typed."""
    typed = {"catalogue": "CATALOGUE", "load_cap_N": "--load-cap-N"}
    return ", ".join(sorted(typed.get(name, "--" + name.rstrip("_").replace("_", "-")) for name in names))


def _check_nodes(nodes: int) -> None:
    if not 9 <= nodes <= 401:
        raise InputError(f"nodes: {nodes} nodes per axis are not between 9 and 401.")


def _progress() -> Progress:
    """A bar for a terminal, on standard error alone: rich would otherwise send there what standard output gets."""
    console = Console(stderr=True)
    return Progress(
        console=console,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
        disable=not console.is_terminal,
    )


def _told(outcome: Outcome) -> str:
    return f"{outcome.result:<11} {outcome.case.name}" + (f": {outcome.reason}" if outcome.reason else "")


def _build_catalogue(
    cases: list[Case], directory: Path, workers: int | None, address: str | None, nodes: int, as_json: bool
) -> None:
    """Build all, tell each as it comes, and leave with exit code 1 if any failed."""
    executor = process_pool(workers) if address is None else cluster_of(address, workers)
    with executor as pool, _progress() as bar:
        task = bar.add_task("tables", total=len(cases))

        def tell(outcome: Outcome) -> None:
            bar.advance(task)
            bar.console.print(_told(outcome), markup=False, highlight=False, soft_wrap=True)

        outcomes = build_all(cases, directory, pool, nodes=nodes, on_result=tell)
    counts = counted(outcomes)
    if as_json:
        rows = [
            {
                "name": outcome.case.name,
                "file": str(outcome.case.file(directory)),
                "result": outcome.result,
                "reason": outcome.reason,
                "seconds": outcome.seconds,
            }
            for outcome in outcomes
        ]
        typer.echo(json.dumps({"directory": str(directory), **counts, "cases": rows}))
    else:
        for outcome in outcomes:
            if outcome.reason:
                typer.echo(_told(outcome))
        typer.echo(f"{directory}: " + ", ".join(f"{count} {result}" for result, count in counts.items()))
    failed = [outcome.case.name for outcome in outcomes if outcome.result is Result.FAILED]
    if failed:
        typer.echo(f"stillgrasp: {len(failed)} of {len(outcomes)} cases failed: {', '.join(failed)}", err=True)
        raise typer.Exit(FAILED)


def grasping_forces(hand: Hand, taken: GraspObject, grasp: GraspSpec) -> dict[str, Any]:
    """f_min_N, f_e_N, f_max_N (None where there is none) of squeezing, and a sentence that says what they mean."""
    winding = msgspec.structs.replace(grasp, branch="winding")
    try:
        levels = contact_force_levels(
            grasp_system(hand, taken, winding), taken.mass_kg, grasp.contact_friction, not grasp.supported
        )
    except MechanicsError as error:
        return {"f_min_N": None, "f_e_N": None, "f_max_N": None, "statement": str(error)}
    return {
        "f_min_N": levels.f_min_N,
        "f_e_N": levels.f_e_N,
        "f_max_N": levels.f_max_N,
        "statement": levels.statement,
    }


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
