"""Whether spools are where they were told to be, played without motors."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.following import ALLOWED_M, FollowingWatch

PERIOD_NS = 2_000_000
LEAD_M = 4e-4


def watch_of(rate_m_s: float, measured: tuple[float, float], cycles: int = 100) -> FollowingWatch:
    """Wound at a rate for so long; spool `i` is measured at `measured[i]` of where it is wanted."""
    watch = FollowingWatch()
    for cycle in range(cycles):
        wanted_m = 0.010 + rate_m_s * cycle * PERIOD_NS * 1e-9
        watch.want((wanted_m, wanted_m), (LEAD_M, LEAD_M), cycle * PERIOD_NS)
        watch.take((wanted_m + measured[0], wanted_m + measured[1]))
    return watch


@given(rate_m_s=st.floats(-0.05, 0.05), delay=st.floats(0.0, 0.02), error=st.floats(-ALLOWED_M, ALLOWED_M))
def test_a_spool_that_follows_is_never_astray(rate_m_s: float, delay: float, error: float) -> None:
    """At any speed, with a sample up to 20 ms old, and with a load that is not the table's."""
    assert not watch_of(rate_m_s, (error - rate_m_s * delay, 0.0)).astray


@pytest.mark.parametrize("finger", [0, 1])
@pytest.mark.parametrize("off_m", [-1e-3, 1e-3])
def test_a_spool_elsewhere_is_astray(finger: int, off_m: float) -> None:
    """Either finger, too far in or out, by a millimetre."""
    assert watch_of(0.0015, (off_m, 0.0) if finger == 0 else (0.0, off_m)).astray


@given(rate_m_s=st.floats(-0.05, 0.05), right=st.floats(-1e-3, 1e-3), left=st.floats(-1e-3, 1e-3))
def test_how_much_is_missing_is_known(rate_m_s: float, right: float, left: float) -> None:
    """The mean of both spools behind where they are wanted; of spools that nobody wants anywhere, nothing."""
    watch = watch_of(rate_m_s, (right, left))
    assert watch.short_m == pytest.approx(-0.5 * (right + left), abs=1e-12)
    watch.forget()
    assert watch.short_m == 0.0


def test_a_glitch_is_not() -> None:
    """One sample elsewhere is not yet a spool elsewhere; nor is any while nobody says where it shall be."""
    watch = watch_of(0.0, (0.0, 0.0))
    for spool_m in (0.02, 0.010, 0.02, 0.010):
        watch.take((spool_m, 0.010))
        assert not watch.astray
    watch.forget()
    for _ in range(10):
        watch.take((0.02, 0.010))
    assert not watch.astray
