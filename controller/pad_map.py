"""The tactile pads for a human: forces, contact, and a map of the cells as they sit in their rows. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calibration.tactile_file import SIDES

LONGEST_AGE_S = 1.0
"""What is older is not shown: it would look like now."""
_WIDTH = 9


def pad_lines(tactile: Mapping[str, Any]) -> list[str]:
    """Lines of `stillgrasp status`, from `tactile` of the state: N in each cell, or why it does not count."""
    if not tactile["present"]:
        return ["pads          away; the motors' load finds contact"]
    if tactile["age_s"] > LONGEST_AGE_S:
        return [f"pads          silent for {tactile['age_s']:.0f} s; the motors' load finds contact"]
    right, left = tactile["force_N"]
    touching = [side for side, touches in zip(SIDES, tactile["touching"], strict=True) if touches]
    lines = [
        f"pads          {right:.2f} {left:.2f} N (right, left), sum {tactile['total_N']:.2f} N, "
        f"touching: {' '.join(touching) or 'none'}"
    ]
    for side in SIDES:
        cells = tactile["cells"][side]
        rows: dict[int, dict[int, str]] = {}
        for (row, column), force_N, quality in zip(cells["place"], cells["force_N"], cells["quality"], strict=True):
            rows.setdefault(row, {})[column] = quality.partition(" ")[0].replace("_", " ") or f"{force_N:.2f}"
        for row, shown in sorted(rows.items()):
            places = " ".join(f"{shown.get(column, ''):>{_WIDTH}}" for column in range(max(shown) + 1))
            lines.append(f"  {side + ' row':9} {row}:{places}")
    return lines
