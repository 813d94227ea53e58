"""Torque frames: the reference's rows, and the laws of limit, floor and clip."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import InputError
from drivers.wam.torques import TorquePacking

UNITS_PER_NM = (2700, 2700, 2700, 2700, 6500, 6500, 17474)
LIMITS = (4860, 4860, 4860, 4320, 3900, 3900, 1600)


def unpacked(frames: tuple[bytes, bytes]) -> list[int]:
    """Seven values by the reference's layout 2.4: four 14-bit numbers behind the first byte, the last one unused."""
    values = []
    for frame in frames:
        bits = "".join(f"{byte:08b}" for byte in frame[1:])
        fields = [int(bits[start : start + 14], 2) for start in range(0, 56, 14)]
        values += [field - 2**14 if field >= 2**13 else field for field in fields]
    assert values[7] == 0
    return values[:7]


@pytest.mark.parametrize(
    ("torque_Nm", "lower", "upper"),
    [
        ((1, 0, 0, 0, 0, 0, 0), "AAFEFC0000000000", "AA00000000000000"),
        ((0, 10, 0, 0, 0, 0, 0), "AA00001DDF888000", "AA00000000000000"),
        ((0, 0, 5, 0, 0, 0, 0), "AA0003E6EF9B8000", "AA00000000000000"),
        ((2, -3, 4, 5, 0.5, -0.6, 0.1), "AAFDFFE2FFD3BD12", "AA05C3FDEFE28000"),
        ((0, 17.3353, 0.054964, -4.05599, -0.056463, -0.126301, 4.9e-05), "AA0000337F2FC260", "AA005FFC2FFFC000"),
        ((0, 0, 0, 0, 0, 0, 0), "AA00000000000000", "AA00000000000000"),
    ],
)
def test_frames_are_the_references(torque_Nm: tuple[float, ...], lower: str, upper: str) -> None:
    """Protects units, transforms and floor end to end: the worked rows of reference 5.2, zeros included."""
    frames = TorquePacking(UNITS_PER_NM, LIMITS, 42).frames(torque_Nm)
    assert [frame.hex().upper() for frame in frames] == [lower, upper]


numbers = st.floats(-1e4, 1e4)


@given(st.tuples(*[numbers] * 7), st.tuples(*[st.integers(1, 9000)] * 7))
def test_no_motor_gets_more_than_its_limit(torque_Nm: tuple[float, ...], limits: tuple[int, ...]) -> None:
    """Law: behind the differentials every motor has the floor of its torque, within its own limit and 8191 units."""
    packing = TorquePacking(UNITS_PER_NM, limits, 42)
    values = unpacked(packing.frames(torque_Nm))
    t1, t2, t3, t4, t5, t6, t7 = torque_Nm
    motor_Nm = np.array([-t1, (t2 - 1.68 * t3) / 2, (-t2 - 1.68 * t3) / 2, -t4, (t5 - t6) / 2, (t5 + t6) / 2, -t7])
    wanted = motor_Nm / [42, 28.25, 28.25, 18, 9.7, 9.7, 14.93] * UNITS_PER_NM
    bound = np.minimum(limits, 8191)
    assert np.all(np.abs(values) <= bound)
    # The vendor's ratio 28.25 / 1.68 is rounded to 16.8155 in its configuration.
    expected = np.clip(wanted, -bound, bound)
    np.testing.assert_allclose(values, expected, atol=1.01 + 2e-5 * float(np.abs(wanted).max()))


@pytest.mark.parametrize("bad", [1e308, float("nan"), float("inf"), -float("inf")])
def test_what_is_no_torque_is_refused(bad: float) -> None:
    """Protects the arm from numbers that no arithmetic survives, in one joint and in both of a differential."""
    packing = TorquePacking(UNITS_PER_NM, LIMITS, 42)
    for torque_Nm in ([0, bad, -bad, 0, 0, 0, 0], [bad, 0, 0, 0, 0, 0, 0]):
        try:
            values = unpacked(packing.frames(torque_Nm))
        except InputError:
            continue
        assert np.all(np.abs(values) <= np.array(LIMITS))
        assert np.isfinite(bad)
