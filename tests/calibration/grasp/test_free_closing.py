"""Free closing against trigonometry."""

import numpy as np
import pytest

from calibration.grasp.free_closing import closing_path
from calibration.hand.parameters import load_hand
from drivers.errors import MechanicsError


def test_pins_turn_in_proportion_to_the_load() -> None:
    """T42PP: joint angles T r / k, fingertips where two rods put them (hand-mechanics reference 4)."""
    loads = np.linspace(0, 4, 9)
    path = closing_path(load_hand("t42pp", "nominal"), loads, onset_split=0.1)
    for side, share in ((0, 1.1), (1, 0.9)):
        first = np.radians(15) + share * loads * 0.008 / 0.0290
        second = first + np.radians(15) + share * loads * 0.008 / 0.0726
        x = 0.030 + 0.062 * np.cos(first) + 0.047 * np.cos(second)
        y = 0.062 * np.sin(first) + 0.047 * np.sin(second)
        assert path.fingertip_m[side].real == pytest.approx(x if side == 0 else -x, abs=1e-15)
        assert path.fingertip_m[side].imag == pytest.approx(y, abs=1e-15)
        assert np.abs(path.fingertip_m[side] - path.arc_centre_m[side]) == pytest.approx(np.full(9, 0.0105))


@pytest.mark.parametrize("hand", ["t42pp", "t42pf", "t42ff"])
def test_fingers_close_as_mirror_images(hand: str) -> None:
    """Equal loads bring both fingertips to mirrored places."""
    path = closing_path(load_hand(hand), np.linspace(0, 30, 7))
    assert path.fingertip_m[0] == pytest.approx(-path.fingertip_m[1].conj(), abs=1e-15)


@pytest.mark.parametrize("loads", [[-1.0], [np.nan], [[1.0]]])
def test_loads_must_be_loads(loads: list[float]) -> None:
    """A tendon cannot push."""
    with pytest.raises(MechanicsError, match="load_N"):
        closing_path(load_hand("t42pp"), np.array(loads))
