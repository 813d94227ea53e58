"""The contact study's figure: error of first contact over how much later it came than the table has it, by motor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from calibration.figures.style import BLUE, DPI, GREY, ORANGE, PALE, RED, new_figure, styled

LIMIT_MM = 0.1
_COLOURS = (BLUE, ORANGE, RED)
_MARKERS = ("o", "s", "^")

Point = tuple[float, Sequence[float], Sequence[float]]
"""Closing rate m/s; of right and left finger how late contact was, and its error, mm."""


def draw(points: Mapping[str, Sequence[Point]], path: Path) -> None:
    """Draw a panel a motor into a PNG."""
    rates = sorted({rate for series in points.values() for rate, _, _ in series})
    columns = (len(points) + 1) // 2
    with styled():
        figure, axes = new_figure(8.0, 4.6, 2, columns)
        for axis, (model, series) in zip(axes, points.items(), strict=False):
            axis.axhspan(-LIMIT_MM, LIMIT_MM, color=PALE, alpha=0.5, linewidth=0.0)
            axis.axhline(0.0, color=GREY, linewidth=0.6)
            for rate, colour, marker in zip(rates, _COLOURS, _MARKERS, strict=True):
                chosen = [(late, error) for r, late, error in series if r == rate]
                late_mm = [value for late, _ in chosen for value in late]
                error_mm = [value for _, error in chosen for value in error]
                axis.plot(
                    late_mm, error_mm, marker, color=colour, markersize=4.0, alpha=0.8, label=f"{1e3 * rate:g} mm/s"
                )
            axis.set_title(model)
            axis.set_ylim(-0.15, 0.15)
            axis.set_xlim(-0.75, 0.75)
        for axis in axes[::columns]:
            axis.set_ylabel("error, mm")
        figure.supxlabel("true contact later than in the table, mm", fontsize="medium")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", title="closing at", ncols=3, handletextpad=0.1)
        figure.savefig(path, dpi=DPI)
