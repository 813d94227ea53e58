"""A simulated pad calibrated as `stillgrasp calibrate tactile` does it, on virtual time: weights on cells.

The bridge is one like the scene's, with the same cells; nobody is asked for Enter.
"""

from __future__ import annotations

from pathlib import Path

from calibration.tactile import STANDARD_GRAVITY_M_S2, Press, TactileFit, fit, plan
from calibration.tactile_file import SIDES, write_pad
from controller.config import Tactile
from controller.service.tactile_assembly import configured_cells
from controller.tactile_command import DEFAULT_MASSES_KG, PadMeter
from drivers.clock import VirtualClock
from drivers.simulated.takktile import SimulatedTakktile
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge
from drivers.takktile.calibration import PadCalibration


def calibrated(tactile: Tactile, device: SimulatedTakktile, file: Path) -> list[TactileFit]:
    """Write `file` for both pads of `device`; what the fits are worth."""
    clock, fits = VirtualClock(), []
    for side in SIDES:
        bridge = Bridge(MemoryTransport(device, clock), clock)
        meter = PadMeter(bridge, clock, tactile, side)
        presses = []
        for place, mass_kg in plan(configured_cells(tactile, side), DEFAULT_MASSES_KG):
            device.pressed_N.clear()
            meter.zero()
            load_N = mass_kg * STANDARD_GRAVITY_M_S2
            device.pressed_N.update(dict.fromkeys(place.cells, load_N / len(place.cells)))
            presses.append(Press(place, load_N, meter.mean_counts(0.2)))
        device.pressed_N.clear()
        found = fit(presses)
        chips = tuple(bridge.coefficient_bytes[cell].hex() for cell in meter.cells)
        thermal = (0.0,) * len(meter.cells)
        write_pad(file, side, PadCalibration(meter.cells, found.gain_N_per_count, thermal, chips), found.residual_N)
        fits.append(found)
        bridge.close()
    return fits
