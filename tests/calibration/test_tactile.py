"""Counts to newtons of one finger: fitted on synthetic pads whose gains are known, judged at places left out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.tactile import LEAST_PRESSES, Place, Press, fit, fit_thermal, plan
from calibration.tactile_file import read_tactile_file, write_pad
from drivers.errors import ConfigurationError, InputError
from drivers.takktile.calibration import PadCalibration
from drivers.takktile.frames import Cell

CELLS = tuple(Cell(row, column) for row, columns in ((0, 5), (1, 3)) for column in range(columns))
MASSES_KG = (0.05, 0.1, 0.2)


def presses(
    counts_per_N: np.ndarray, noise_counts: float = 0.0, loss: Callable[[Place], float] = lambda _: 0.0, seed: int = 0
) -> list[Press]:
    """A pad: each cell says what of the weight stands on it."""
    generator = np.random.default_rng(seed)
    made = []
    for place, mass_kg in plan(CELLS, MASSES_KG):
        load_N = mass_kg * 9.80665
        share = np.array([(cell in place.cells) / len(place.cells) for cell in CELLS]) * (1.0 - loss(place))
        counts = counts_per_N * share * load_N + noise_counts * generator.standard_normal(len(CELLS))
        made.append(Press(place, load_N, tuple(counts.tolist())))
    return made


def test_the_plan_covers_cells_and_the_places_between() -> None:
    """Eight cells in two rows: eight places and six between, three masses each, more than the reference's forty."""
    steps = plan(CELLS, MASSES_KG)
    assert len(steps) == 14 * 3 >= LEAST_PRESSES
    between = {place.cells for place, _ in steps if len(place.cells) == 2}
    assert (Cell(0, 1), Cell(0, 2)) in between
    assert (Cell(0, 4), Cell(1, 0)) not in between


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(50.0, 200.0), min_size=8, max_size=8))
def test_known_gains_come_back(counts_per_N: list[float]) -> None:
    """Without noise or loss each gain is one over its cell's sensitivity, to what the pull to a common gain costs."""
    found = fit(presses(np.array(counts_per_N)))
    assert np.array(found.gain_N_per_count) == pytest.approx(1.0 / np.array(counts_per_N), rel=0.01)
    assert found.accepted()


def test_the_residual_does_not_flatter() -> None:
    """The residual from left-out places is no less than what the calibration errs by on weights that it never saw, and
    not far above it."""
    sensitivity = np.random.default_rng(1).uniform(60.0, 160.0, 8)
    found = fit(presses(sensitivity, noise_counts=3.0))
    errors_N = [
        np.array(press.counts) @ np.array(found.gain_N_per_count) - press.load_N
        for seed in range(20)
        for press in presses(sensitivity, noise_counts=3.0, seed=100 + seed)
    ]
    true_N = float(np.sqrt(np.mean(np.square(errors_N))))
    assert true_N < found.residual_N < 2.5 * true_N


def test_a_place_that_loses_force_is_named_and_refused() -> None:
    """A pad that loses half of what stands at one place: named as the worst, and the whole is not accepted."""
    lossy = Place((Cell(1, 2),))
    found = fit(presses(np.full(8, 100.0), loss=lambda place: 0.6 if lossy.cells[0] in place.cells else 0.0))
    assert lossy.cells[0] in found.worst_place.cells
    assert abs(found.worst_error) > 0.2
    assert not found.accepted()


def test_gains_are_never_negative_and_silent_cells_told() -> None:
    """A dead cell of pure noise does not get a gain that makes others' noise look like force."""
    sensitivity = np.full(8, 100.0)
    sensitivity[4] = 0.0
    found = fit(presses(sensitivity, noise_counts=0.1))
    assert min(found.gain_N_per_count) >= 0.0
    assert found.silent_cells == (4,)


def test_drift_with_temperature_is_fitted_from_a_warm_up() -> None:
    """A known slope under noise; too little warming is refused with a reason."""
    generator = np.random.default_rng(0)
    temperature = np.linspace(498.0, 482.0, 200)[:, np.newaxis] + np.zeros((1, 8))
    slope = np.linspace(-0.3, 0.3, 8)
    counts = slope * (temperature - 498.0) + 0.3 * generator.standard_normal(temperature.shape)
    assert fit_thermal(counts, temperature) == pytest.approx(slope, abs=0.02)
    with pytest.raises(InputError, match="at least 1 °C"):
        fit_thermal(counts, 498.0 + 0.1 * (temperature - 498.0))


def test_presses_that_say_nothing_are_refused() -> None:
    """Too few, no answer, too few masses, masses that are none."""
    good = presses(np.full(8, 100.0))
    with pytest.raises(InputError, match="too few"):
        fit(good[:39])
    with pytest.raises(InputError, match="does not answer"):
        fit([Press(press.place, press.load_N, (0.0,) * 8) for press in good])
    with pytest.raises(InputError, match="finite"):
        fit([Press(press.place, press.load_N, (float("nan"),) * 8) for press in good])
    with pytest.raises(InputError, match="at least 3 different masses"):
        plan(CELLS, (0.1,))
    with pytest.raises(InputError, match="not accepted"):
        plan(CELLS, (0.1, -1.0, 0.3))


def test_the_file_keeps_both_sides(tmp_path: Path) -> None:
    """One side after the other, each as it was written; a damaged file is refused, and not written over."""
    file = tmp_path / "tactile.toml"
    pads = [
        PadCalibration(cells, (0.01,) * 4, (0.1,) * 4, ("42a8b5c0bb603a10",) * 4) for cells in (CELLS[:4], CELLS[4:])
    ]
    for side, pad in zip(("right", "left"), pads, strict=True):
        write_pad(file, side, pad, 0.02)
    known = read_tactile_file(file)
    assert [known.pad("right"), known.pad("left")] == pads
    text = file.read_text().replace("[0.01, 0.01, 0.01, 0.01]", "[0.01]", 1)
    file.write_text(text)
    with pytest.raises(ConfigurationError, match="as many values as right_cells"):
        write_pad(file, "left", pads[1], 0.02)
    assert file.read_text() == text
