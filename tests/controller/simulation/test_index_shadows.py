"""What another index would have left of an object's motion, worked out beside the one that compensated."""

from __future__ import annotations

import numpy as np
import pytest

from controller.simulation.index_shadows import INDICES, NO_INDEX, Array, Cell, Moment, cells

STEPS = 40
ENDS_NS = (20_000_000, 30_000_000)
WHAT = ("XM430-W350", "nominal", "symmetric", "excursion", 1.0)


def pose(x_m: float, y_m: float, turn_rad: float, z_m: float = 0.0) -> Array:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]]
    T[:3, 3] = x_m, y_m, z_m
    return T


START = pose(0.7, 0.1, -1.5, 0.5)
CONTACT = pose(0.0, 0.097, 0.0)


def run(seen_m: dict[str, float], arm_m: float = 0.0) -> dict[str, Cell]:
    """The object moves 10 mm in the hand; each index sees that part of it. The arm errs by `arm_m` sideways."""
    moments = []
    for step in range(STEPS):
        part = min(step / 20.0, 1.0)
        T_hand_object = pose(0.0, 0.097 - 0.010 * part, 0.02 * part)

        def offset(share: float, part: float = part) -> Array:
            return CONTACT @ np.linalg.inv(pose(0.0, 0.097 - 0.010 * part * share, 0.02 * part * share))

        offsets = {index: offset(share) for index, share in seen_m.items()}
        hand = START @ offsets["excursion"] @ pose(arm_m * part, 0.0, 0.0)
        touching = 2 if 0 < step < STEPS - 3 else 0
        moments.append(Moment(step * 1_000_000, hand, T_hand_object, touching, 66.0, offsets))
    return {cell.index: cell for cell in cells(moments, ENDS_NS, WHAT)}


def test_the_index_that_sees_all_leaves_nothing() -> None:
    """Exact compensation: whoever carries, the index that is right would have kept the object where it was."""
    found = run({"excursion": 0.8, "load": 1.0, "fused": 0.9})
    assert found["load"].winding.peak_mm == pytest.approx(0.0, abs=1e-3)
    assert found["excursion"].holding.peak_mm == pytest.approx(2.0, rel=0.02)
    assert found["fused"].holding.peak_mm == pytest.approx(1.0, rel=0.02)
    assert found[NO_INDEX].holding.peak_mm == pytest.approx(10.0, rel=0.02)
    assert found["excursion"].holding.peak_deg == pytest.approx(np.degrees(0.004), rel=0.02)


def test_the_arms_own_error_counts_for_every_index() -> None:
    """Half a millimetre that the arm is off stays, whichever index is right."""
    found = run(dict.fromkeys(INDICES, 1.0), arm_m=5e-4)
    assert [found[index].holding.peak_mm for index in INDICES] == pytest.approx([0.5] * 3, abs=2e-3)


def test_phases_end_where_the_grasp_does() -> None:
    """What the object does once a finger has let go is no longer the compensation's."""
    found = run(dict.fromkeys(INDICES, 1.0))
    assert found["load"].unwinding.peak_mm == pytest.approx(0.0, abs=1e-3)
    assert found["load"].winding.rms_mm <= found[NO_INDEX].winding.rms_mm < found[NO_INDEX].holding.rms_mm
