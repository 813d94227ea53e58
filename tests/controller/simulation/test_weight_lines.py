"""Weights on simulated motors, changed by lines."""

from __future__ import annotations

import os

import pytest

from controller.simulation.weight_lines import WeightLines
from drivers.simulated.hanging_weights import HangingWeights


def after(*lines: str) -> tuple[list[float], list[str]]:
    """Pulls of both cords, and what was told, after these lines."""
    weights, told = HangingWeights((0.0, 0.0), friction_Nm=0.1, inertia_kgm2=0.01), list[str]()
    read, write = os.pipe()
    os.write(write, "".join(f"{line}\n" for line in lines).encode())
    WeightLines(read, weights, told.append).obey()
    os.close(read)
    os.close(write)
    return [weights.tension_N(motor) for motor in (0, 1)], told


@pytest.mark.parametrize(
    ("lines", "pulls_N"),
    [
        (["hang 2"], [19.613, 19.613]),
        (["hang right 0.5kg", "", "HANG left 1"], [4.903, 9.807]),
        (["hang 2", "hang left 0"], [19.613, 0.0]),
    ],
)
def test_lines_hang_weights(lines: list[str], pulls_N: list[float]) -> None:
    """On one cord or both; the newest counts."""
    assert after(*lines)[0] == pytest.approx(pulls_N, abs=1e-3)


@pytest.mark.parametrize("line", ["hang", "hang two", "hang up 2", "drop 2", "hang right 2 now", "hang -1", "hang nan"])
def test_other_lines_are_told_and_change_nothing(line: str) -> None:
    """A slip of the fingers must not end a simulation."""
    pulls_N, told = after("hang 1", line)
    assert pulls_N == pytest.approx([9.807, 9.807], abs=1e-3)
    assert len(told) == 2
    assert "expected" in told[1]
