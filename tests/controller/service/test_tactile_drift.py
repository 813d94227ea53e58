"""Ten minutes of a warming hand, on virtual time: open, and gripping. Nothing of it is contact, and little is force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.tactile import fit_thermal
from controller.config import Tactile
from controller.pad_messages import PadState
from controller.tactile_command import PadMeter
from drivers.clock import VirtualClock, nanoseconds
from drivers.simulated.takktile import SimulatedCell, SimulatedTakktile, two_fingers
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge
from drivers.takktile.calibration import PadCalibration
from tests.controller.service.tactile_rig import PartRig, nominal_pads

WARMING_K, TEN_MINUTES_S = 6.0, 600.0
SLOW_S, METER_S = 0.25, 0.05
"""Frames of what follows slow things need not come as often as the robot's."""
CELLS = tuple(replace(cell, counts_per_K=0.4 + 0.1 * index) for index, cell in enumerate(two_fingers()))
"""What gas and rubber add to the chip, another for each cell: uncorrected, 0.05 N and more a finger and kelvin."""
HELD_N = (3.0, 2.0)


def warming(time_s: float) -> float:
    return 25.0 + WARMING_K * min(max(time_s - 30.0, 0.0) / TEN_MINUTES_S, 1.0)


def places(finger: int) -> tuple[SimulatedCell, ...]:
    return tuple(cell for cell in CELLS if cell.finger == finger)


def warm_up(finger: int, side: str) -> tuple[float, ...]:
    """Thermal coefficients as `calibrate tactile --warm-up` finds them: a free pad that warms by 2 °C."""
    clock = VirtualClock()
    device = SimulatedTakktile(lambda: (0.0, 0.0), CELLS, temperature_C=lambda t: 25.0 + t / 50.0)
    right, left = (tuple((cell.cell.row, cell.cell.column) for cell in places(i)) for i in (0, 1))
    tactile = Tactile(interface="socket", channel="x", right_cells=right, left_cells=left, period_s=METER_S)
    meter = PadMeter(Bridge(MemoryTransport(device, clock), clock), clock, tactile, side)
    meter.zero()
    return fit_thermal(*meter.warm_up(100.0))


def states(pads: tuple[PadCalibration, PadCalibration], *, gripping: bool) -> list[PadState]:
    """Every second's state of ten minutes, after a zero; `gripping`: under a constant force, the fingers not free."""
    force_N = [0.0, 0.0]
    rig = PartRig(SimulatedTakktile(lambda: force_N, CELLS, temperature_C=warming), pads, SLOW_S)
    rig.order(True, 1)
    told = []
    next_ns = nanoseconds(20.0)
    while rig.clock.now_ns() < nanoseconds(TEN_MINUTES_S + 60.0):
        if gripping and rig.clock.now_ns() > nanoseconds(19.0):
            rig.order(False, 1)
            force_N[:] = HELD_N
        rig.part.step()
        rig.reports.new_values()
        if rig.clock.now_ns() >= next_ns:
            next_ns += nanoseconds(1.0)
            newest = rig.states.newest()
            assert newest is not None
            told.append(PadState.unpack(newest[0]))
    return told


def test_an_open_hand_that_warms_touches_nothing() -> None:
    """Uncalibrated: the zero follows, so that ten minutes of warming are neither contact nor force."""
    told = states(nominal_pads(), gripping=False)
    assert not any(any(state.touching) for state in told)
    minutes = np.array([state.force_N for state in told])[: 60 * (len(told) // 60)].reshape(-1, 60, 2)
    assert np.abs(minutes.mean(axis=1)).max() < 0.05


def test_a_force_that_is_held_stays_what_it_is() -> None:
    """Gripping, with the thermal coefficients of a warm-up: within 0.15 N through 6 °C, of which rubber and gas alone
    would make more than 0.3 N of the right finger and more than 0.6 N of the left."""
    right, left = nominal_pads()
    right = replace(right, thermal_counts=warm_up(0, "right"))
    left = replace(left, thermal_counts=warm_up(1, "left"))
    told = np.array([state.force_N for state in states((right, left), gripping=True)])
    assert np.abs(told - HELD_N).max() < 0.15
    added_N = [WARMING_K * 0.01 * sum(cell.counts_per_K for cell in places(finger)) for finger in (0, 1)]
    assert added_N[0] > 0.3
    assert added_N[1] > 0.6
