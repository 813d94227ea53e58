"""Which of the paper's figures have a counterpart here, and writing them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path

from calibration.figures.paper_figure import PaperFigure
from calibration.figures.style import styled
from drivers.errors import InputError

DRAWN_BY = {
    2: "closing",
    3: "reconfiguration",
    4: "reconfiguration",
    6: "stiffness_ratio",
    7: "compensation",
    10: "force_curves",
    13: "force_curves",
    15: "object_path",
    16: "weight",
    17: "effort",
}
"""Number of the figure, and the module whose `figure_NUMBER` draws it."""


def draw(number: int) -> PaperFigure:
    """Compute and draw the counterpart of a figure. Errors: InputError if there is none."""
    if number not in DRAWN_BY:
        known = ", ".join(map(str, DRAWN_BY))
        raise InputError(f"figure {number} has no counterpart here; there are {known}.")
    module = import_module(f"calibration.figures.{DRAWN_BY[number]}")
    function: Callable[[], PaperFigure] = getattr(module, f"figure_{number}")
    with styled():
        return function()


def write(numbers: Iterable[int], directory: str | Path) -> Iterator[tuple[PaperFigure, list[Path]]]:
    """Draw and save figure after figure; yields each with its files. Errors: InputError, before the first is drawn,
    for a number without a counterpart."""
    wanted = list(dict.fromkeys(numbers))
    for number in wanted:
        if number not in DRAWN_BY:
            draw(number)
    return _written(wanted, directory)


def _written(numbers: list[int], directory: str | Path) -> Iterator[tuple[PaperFigure, list[Path]]]:
    for number in numbers:
        figure = draw(number)
        with styled():
            files = figure.save(directory)
        yield figure, files
