"""`stillgrasp figures`: the counterparts of the paper's figures, drawn from the models.

Captions go to standard output (`--json`: one JSON value), progress and errors to standard error; exit code 2 for a
figure that does not exist or a folder that cannot be written. Source: design 6.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import Progress

from calibration.figures.atlas import DRAWN_BY, write
from drivers.errors import InputError, StillgraspError

FAILED, REFUSED = 1, 2
NUMBERS = ", ".join(map(str, DRAWN_BY))


def figures(
    numbers: Annotated[
        list[int] | None, typer.Argument(metavar="[NUMBER]...", help=f"With --only: {NUMBERS}.", show_default=False)
    ] = None,
    only: Annotated[bool, typer.Option("--only", help="Draw the figures of these numbers; else all.")] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for pictures, captions, numbers.")] = Path(
        "build/figures"
    ),
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """Draw the counterparts of the paper's figures from the models.

    Each becomes a picture (.png), its caption (.md) and its numbers (.json). Captions say what is predicted and what
    is fitted to the paper.
    """
    console = Console(stderr=True)
    rows: list[dict[str, Any]] = []
    try:
        if only != bool(numbers):
            raise InputError(
                "--only goes with the numbers of figures.",
                help=f"Example: stillgrasp figures --only 3 6; of {NUMBERS}.",
            )
        wanted = numbers or list(DRAWN_BY)
        with Progress(
            console=console,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
            disable=not console.is_terminal,
        ) as bar:
            task = bar.add_task("figures", total=len(set(wanted)))
            for figure, files in write(wanted, output):
                rows.append({"figure": figure.number, "files": list(map(str, files)), "caption": figure.caption})
                rows[-1]["values"] = dict(figure.values)
                bar.advance(task)
    except StillgraspError as error:
        typer.echo(f"stillgrasp: {error}", err=True)
        raise typer.Exit(REFUSED if isinstance(error, InputError) else FAILED) from error
    if as_json:
        typer.echo(json.dumps(rows))
        return
    for row in rows:
        typer.echo(f"{row['files'][0]}\n{row['caption']}\n")
