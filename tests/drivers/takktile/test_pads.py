"""Frames to newtons: zero, sum, dead and saturated cells, temperature and drift, on a simulated strip whose force is
known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.errors import InputError, ProtocolError
from drivers.simulated.faults import Fault
from drivers.simulated.takktile import SimulatedCell, two_fingers
from drivers.simulated.takktile_fault_actions import Repeat
from drivers.takktile.calibration import PadCalibration, check_cells, nominal
from drivers.takktile.frames import Cell, Firmware

MakeStrip = Callable[..., Any]
ROUNDING_N = 0.01


@pytest.mark.parametrize("firmware", Firmware)
@pytest.mark.parametrize("force_N", [(0.0, 0.0), (0.5, 3.0), (8.0, 2.0)])
def test_the_force_comes_back(make_strip: MakeStrip, firmware: Firmware, force_N: tuple[float, float]) -> None:
    """Through quantised, noisy raw words of either firmware: each finger's force, and the paper's sum of both."""
    strip = make_strip(firmware=firmware).tared()
    strip.force_N[:] = force_N
    samples = strip.run(0.5)
    mean_N = np.mean([sample.force_N for sample in samples], axis=0)
    assert mean_N == pytest.approx(force_N, abs=0.03)
    assert np.mean([sample.total_N for sample in samples]) == pytest.approx(sum(force_N), abs=0.05)
    assert samples[-1].valid_cells == (8, 8)


def test_the_stated_noise_is_the_noise(make_strip: MakeStrip) -> None:
    """`deviation_N` of the sum, from the tare alone, is what later samples scatter by."""
    strip = make_strip(seed=3).tared()
    samples = strip.run(4.0)
    scatter_N = np.std([sample.force_N for sample in samples], axis=0)
    assert samples[0].deviation_N == pytest.approx(scatter_N, rel=0.3)


def test_noise_is_not_rectified(make_strip: MakeStrip) -> None:
    """Negative cells are not clipped: the unloaded sum has no bias (reference 6)."""
    strip = make_strip(noise_counts=1.0).tared()
    samples = strip.run(4.0)
    assert np.mean([sample.force_N[0] for sample in samples]) == pytest.approx(0.0, abs=0.03)
    assert min(sample.force_N[0] for sample in samples) < 0.0


def test_a_dead_cell_is_left_out_and_told(make_strip: MakeStrip) -> None:
    """Seven of eight cells: the sum lacks one share, nothing is rescaled, and the count says so."""
    cells = [cell for cell in two_fingers() if cell.cell != Cell(0, 3)]
    pads = tuple(nominal([c.cell for c in two_fingers() if c.finger == i]) for i in (0, 1))
    strip = make_strip(pads=pads, cells=cells).tared()
    assert check_cells(pads, strip.bridge.cells, strip.bridge.coefficient_bytes) == (Cell(0, 3),)
    strip.force_N[:] = (4.0, 4.0)
    sample = strip.run(0.1)[-1]
    assert sample.valid_cells == (7, 8)
    assert sample.force_N == pytest.approx((3.5, 4.0), abs=0.15)


def test_a_saturated_cell_does_not_count(make_strip: MakeStrip) -> None:
    """One cell at its converter's end under a finger nail: the others go on."""
    cells = list(two_fingers())
    cells[2] = SimulatedCell(cells[2].cell, 0, counts_per_N=16000.0)
    strip = make_strip(cells=cells).tared()
    strip.force_N[0] = 2.0
    sample = strip.run(0.1)[-1]
    assert sample.valid_cells == (7, 8)
    assert sample.force_N[0] == pytest.approx(7 / 8 * 2.0, abs=0.15)


def test_warming_is_no_force(make_strip: MakeStrip) -> None:
    """Reference 5: 3 °C make uncompensated counts look like force; compensated and drift-corrected ones do not. Half of
    a count a kelvin and cell, which rubber and gas add, is what the warm-up run's coefficient takes away."""
    cells = tuple(SimulatedCell(c.cell, c.finger, counts_per_K=0.5) for c in two_fingers())
    fitted = tuple(
        PadCalibration(plain.cells, plain.gain_N_per_count, (0.5 / -5.35,) * 8)
        for plain in (nominal([c.cell for c in cells if c.finger == i]) for i in (0, 1))
    )
    errors_N = []
    for pads in (None, fitted):
        strip = make_strip(pads=pads, cells=cells, temperature_C=lambda t: 25.0 + min(t, 60.0) / 20.0, period_s=0.2)
        strip.tared().run(120.0)
        errors_N.append(abs(np.mean([sample.force_N[0] for sample in strip.run(3.0)])))
    assert errors_N[0] > 0.08
    assert errors_N[1] < 0.03


def test_the_zero_follows_drift_outside_contact_only(make_strip: MakeStrip) -> None:
    """A weather front of 0.2 N in two minutes vanishes while the hand is open and stays a signal while it grips."""
    cells = tuple(SimulatedCell(c.cell, c.finger, counts_per_K=1.0) for c in two_fingers())
    found_N = {}
    for free in (True, False):
        strip = make_strip(cells=cells, temperature_C=lambda t: 25.0 + min(t / 120.0, 1.0) * 2.5, period_s=0.2)
        strip.tared()
        strip.run(240.0, free=free)
        found_N[free] = abs(np.mean([sample.force_N[0] for sample in strip.run(3.0, free=free)]))
    assert found_N[True] < 0.02
    assert found_N[False] > 0.15


def test_no_zero_under_load(make_strip: MakeStrip) -> None:
    """A finger that something leans on while taring is refused with a reason, and the old zero holds."""
    strip = make_strip().tared()
    strip.pads.tare()
    strip.run(0.2)
    strip.force_N[0] = 5.0
    with pytest.raises(InputError, match=r"cannot be zeroed: cell .* moves by"):
        strip.run(1.0)
    assert strip.run(0.1)[-1].force_N[0] == pytest.approx(5.0, abs=0.15)


def test_no_force_without_a_zero(make_strip: MakeStrip) -> None:
    """Before the first tare nothing is known; a tare that is given up leaves it so."""
    strip = make_strip()
    strip.pads.tare()
    assert {sample.valid_cells for sample in strip.run(0.3)} == {(0, 0)}
    strip.pads.stop_taring()
    assert {sample.valid_cells for sample in strip.run(1.0)} == {(0, 0)}
    assert not strip.pads.tared


def test_repeated_readings_are_readings(make_strip: MakeStrip) -> None:
    """A bridge run fast gives the conversion before (reference 2): no proof of a dead cell, and no fault."""
    strip = make_strip().tared()
    strip.force_N[0] = 2.0
    strip.run(0.05)
    strip.device.add_fault(Fault(action=Repeat(), for_frames=30), strip.clock.now_ns())
    assert strip.run(0.2)[-1].force_N[0] == pytest.approx(2.0, abs=0.15)


def test_the_map_is_held_against_the_scan(make_strip: MakeStrip) -> None:
    """A cell of both fingers, a pad without any cell, a cell that is not the calibrated chip: each refused."""
    strip = make_strip()
    alive, chips = strip.bridge.cells, strip.bridge.coefficient_bytes
    with pytest.raises(InputError, match="0:0 belong to both"):
        check_cells((nominal([Cell(0, 0)]), nominal([Cell(0, 0)])), alive, chips)
    with pytest.raises(ProtocolError, match="none of the left"):
        check_cells((nominal([Cell(0, 0)]), nominal([Cell(7, 0)])), alive, chips)
    other = PadCalibration((Cell(0, 0),), (0.01,), (0.0,), ("3eceb3f9c51733c8",))
    with pytest.raises(InputError, match="not the one that was calibrated"):
        check_cells((other, nominal([Cell(2, 0)])), alive, chips)


@pytest.mark.parametrize(
    ("gains", "thermal"),
    [((0.01,), (0.0,)), ((-0.01, 0.01), (0.0, 0.0)), ((0.0, 0.0), (0.0, 0.0)), ((0.01, float("nan")), (0.0, 0.0))],
)
def test_a_bad_calibration_is_refused(gains: tuple[float, ...], thermal: tuple[float, ...]) -> None:
    """Wrong counts, negative or no gains, not a number."""
    with pytest.raises(InputError):
        PadCalibration((Cell(0, 0), Cell(0, 1)), gains, thermal)
