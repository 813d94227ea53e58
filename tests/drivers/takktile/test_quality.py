"""Cells that cannot be believed, on a simulated strip that a fault script spoils: what the driver does with each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.simulated.faults import Fault
from drivers.simulated.takktile_fault_actions import Dead, Garbage, Noise, Press, Stuck, Warmth
from drivers.takktile.pads import PadSample
from drivers.takktile.quality import BROKEN, CellQuality, QualityWatch

MakeStrip = Callable[..., Any]
HIT = ((0, 1),)
FULL, ONE_LESS, NONE = (8, 8), (7, 8), (0, 0)


def spoil(strip: Any, action: Any, **more: Any) -> None:
    strip.device.add_fault(Fault(action=action, **more), strip.clock.now_ns())


def quality(strip: Any) -> CellQuality:
    """Of the cell that was hit."""
    return CellQuality(int(strip.pads.readings().quality[1]))


@pytest.mark.parametrize(
    ("action", "flag", "after_s"),
    [
        (Dead(cells=HIT), CellQuality.DEAD, 0.05),
        (Stuck(cells=HIT), CellQuality.STUCK, 4.1),
        (Noise(cells=HIT, counts=20.0), CellQuality.NOISY, 1.0),
        (Warmth(cells=HIT, kelvin=20.0), CellQuality.IMPLAUSIBLE, 0.05),
        (Warmth(cells=HIT, kelvin=-90.0), CellQuality.IMPLAUSIBLE, 0.05),
        (Press(cells=HIT, newtons=100.0), CellQuality.SATURATED, 0.05),
    ],
)
def test_a_broken_cell_drops_out_and_comes_back(
    make_strip: MakeStrip, action: Any, flag: CellQuality, after_s: float
) -> None:
    """Under 4 N a finger: the sum lacks the cell's share and no more, says of how many cells it is, and is whole again
    when the cell is."""
    strip = make_strip().tared()
    strip.force_N[:] = (4.0, 4.0)
    spoil(strip, action, for_s=after_s + 1.0)
    strip.run(after_s)
    samples = strip.run(0.5)
    assert quality(strip) is flag
    assert {sample.valid_cells for sample in samples} == {ONE_LESS}
    assert np.mean([sample.force_N for sample in samples], axis=0) == pytest.approx((3.5, 4.0), abs=0.05)
    strip.run(2.5)
    assert strip.run(0.1)[-1].valid_cells == FULL


def test_a_warm_cell_is_no_force_while_it_is_judged(make_strip: MakeStrip) -> None:
    """From the first wrong word on, not after a while: a jump of 20 °C alone is more than half a newton."""
    strip = make_strip().tared()
    spoil(strip, Warmth(cells=HIT, kelvin=20.0), for_s=0.5)
    assert max(abs(sample.force_N[0]) for sample in strip.run(1.0)) < 0.15


def test_frames_of_garbage_are_no_force(make_strip: MakeStrip) -> None:
    """Any bytes of the right length: most cells are then implausible, so that none counts, until frames are frames."""
    strip = make_strip().tared()
    spoil(strip, Garbage(), for_s=0.5)
    samples: list[PadSample] = strip.run(0.5)
    assert {sample.valid_cells for sample in samples[1:-1]} == {NONE}
    strip.run(0.1)
    assert strip.run(0.5)[-1].valid_cells == FULL


def test_a_broken_cell_does_not_hinder_the_zero(make_strip: MakeStrip) -> None:
    """Dead while the hand rests: the others get their zero, it gets none, and has none when it is back."""
    strip = make_strip()
    spoil(strip, Dead(cells=HIT), for_s=2.0)
    strip.run(0.1)
    strip.tared()
    assert strip.run(0.1)[-1].valid_cells == ONE_LESS
    strip.run(2.0)
    assert quality(strip) is CellQuality.NO_ZERO
    assert strip.tared().run(0.1)[-1].valid_cells == FULL


def test_a_pressed_cell_hinders_the_zero(make_strip: MakeStrip) -> None:
    """At the end of its range: something leans on it."""
    strip = make_strip()
    spoil(strip, Press(cells=HIT, newtons=100.0))
    with pytest.raises(InputError, match="0:1 is at the end of its range"):
        strip.tared()


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    steps=st.lists(st.floats(-250.0, 250.0), min_size=1, max_size=20),
    slope=st.floats(-40.0, 40.0),
)
def test_load_is_not_taken_for_a_fault(seed: int, steps: list[float], slope: float) -> None:
    """Whatever the fingers do, in steps or at any rate: a sound cell stays a sound cell."""
    random = np.random.default_rng(seed)
    count = 25 * len(steps)
    load = np.repeat(np.cumsum(steps), 25) + slope * np.abs(np.arange(count) % 100 - 50)
    watch = QualityWatch(1)
    for index, counts in enumerate(load + 1.2 * random.standard_normal(count)):
        raw = np.array([[np.clip(400 - counts / 2, 3, 1020), 498 + random.integers(-1, 2)]], dtype=np.int64)
        flags = watch.take(index * 8_000_000, raw, np.array([counts]))
        assert not int(flags[0]) & BROKEN


def test_a_bridge_that_repeats_for_ever_is_stuck() -> None:
    """The same reading of all cells for more than four seconds tells nothing of now."""
    watch = QualityWatch(3)
    raw = np.array([[400, 498], [410, 500], [390, 490]])
    flags = [watch.take(n * 8_000_000, raw, np.zeros(3)) for n in range(520)]
    assert not flags[490].any()
    assert (flags[-1] == CellQuality.STUCK).all()
