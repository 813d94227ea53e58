"""How all figures look: sizes, type, and colours that colour-blind readers can tell apart (Okabe and Ito's).

Figures are drawn without pyplot: no global state, no window.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DPI = 150

BLACK, GREY, PALE = "#1a1a1a", "#8c8c8c", "#dddddd"
BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
SKY, PURPLE = "#56b4e9", "#cc79a7"
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK)

SETTINGS: Any = {  # matplotlib's own type for this is a list of every key there is
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": BLACK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=CYCLE),
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": BLACK,
    "ytick.labelcolor": BLACK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "grid.color": PALE,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.8,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def styled() -> contextlib.AbstractContextManager[None]:
    """Draw and save figures within this."""
    return mpl.rc_context(SETTINGS)


def new_figure(
    width_in: float,
    height_in: float,
    rows: int = 1,
    columns: int = 1,
    *,
    widths: Sequence[float] | None = None,
    share_x: bool = False,
) -> tuple[Figure, list[Axes]]:
    """An empty figure of `rows` × `columns` axes, row by row."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=share_x, width_ratios=widths)
    return figure, list(axes.ravel())


def as_curves(axes: Axes, x_label: str, y_label: str, title: str = "") -> None:
    """Make axes those of a diagram."""
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_title(title)
    axes.grid(True)
    axes.set_axisbelow(True)
