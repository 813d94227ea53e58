"""Both fingers' search together: what the grasp goes by, what is off-centre, and what is no contact."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable
from calibration.objects import load_object
from controller.cycle.contact_search import ContactSearch, SearchSettings, expectation
from controller.cycle.pads import PadWatch
from controller.cycle.planar_table import PlanarTable
from controller.messages import HandState, Pair, Reason
from controller.pad_messages import PadState
from controller.service.links import LatestReader, LatestSender, VirtualLink
from drivers.clock import VirtualClock

TABLE = PlanarTable(build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(), nodes=9))
EXPECTED = TABLE.contact_excursion_m
TICK_M = 2 * np.pi / 4096 * 0.0105
RATE_M_S = 0.001
PERIOD_NS = 5_000_000
ALL_CELLS = (8, 8)


def wind(
    search: ContactSearch,
    contact_m: tuple[float | None, float | None],
    *,
    until_m: float = 1e-3,
    pads: Pads | None = None,
) -> Reason | None:
    """Wind both fingers slowly through the zone, right and left touching at these excursions; the first outcome."""
    lag_m = SearchSettings().load_lag_s * RATE_M_S  # as the filtered tension has it
    noise = np.random.default_rng(3)
    for step, along_m in enumerate(np.arange(-1.2e-3, until_m, RATE_M_S * PERIOD_NS * 1e-9).tolist()):
        now_ns = step * PERIOD_NS
        wound, tension = [], []
        for finger, touched_m in enumerate(contact_m):
            excursion_m = EXPECTED[finger] + along_m
            seen_m = excursion_m - lag_m
            wanted = expectation(TABLE, finger)
            load_N = wanted.free_slope_N_per_m * seen_m + 2.0 + noise.normal(0.0, 0.3)
            if touched_m is not None and seen_m > touched_m:
                rise = wanted.loaded_slope_N_per_m - wanted.free_slope_N_per_m
                load_N += wanted.contact_step_N + rise * (seen_m - touched_m)
            wound.append(round(excursion_m / TICK_M) * TICK_M)
            tension.append(load_N)
        if pads is not None:
            pads.step(now_ns, EXPECTED[0] + along_m)
        hand = HandState((wound[0], wound[1]), (RATE_M_S, RATE_M_S), (tension[0], tension[1]), (0.3, 0.3))
        if (outcome := search.take(hand, now_ns, now_ns, rate_m_s=RATE_M_S, slow=True)) is not None:
            return outcome
    return None


class Pads:
    """Both fingertips' pads; the right one begins to touch at an excursion."""

    def __init__(self, right_touches_m: float) -> None:
        clock = VirtualClock()
        states, orders = VirtualLink(clock, clock), VirtualLink(clock, clock)
        self._sender = LatestSender(states)
        self.watch = PadWatch(LatestReader(states), LatestSender(orders))
        self._touches_m = right_touches_m
        self._onset_ns: int | None = None

    def step(self, now_ns: int, right_m: float) -> None:
        if self._onset_ns is None and right_m >= self._touches_m:
            self._onset_ns = now_ns
        touching = self._onset_ns is not None
        state = PadState((0.3 * touching, 0.0), (0.03, 0.03), (self._onset_ns or 0, 0), (touching, False), ALL_CELLS)
        self._sender.send(state.pack(), now_ns)
        self.watch.step(free=False, take_zero=False, now_ns=now_ns)


def searching(pads: PadWatch | None = None) -> ContactSearch:
    return ContactSearch(SearchSettings(), TABLE, pads)


def late(right_m: float, left_m: float) -> Pair:
    return EXPECTED[0] + right_m, EXPECTED[1] + left_m


def test_the_expectation_is_the_tables() -> None:
    """The loaded line begins above the free one by the support's drag, and rises more steeply."""
    wanted = expectation(TABLE, 0)
    gripped_N = TABLE.at_excursion(2e-4, 0.0).tension_N[0]
    free_N = wanted.free_slope_N_per_m * wanted.contact_wound_m
    assert free_N + wanted.contact_step_N + 2e-4 * wanted.loaded_slope_N_per_m == pytest.approx(gripped_N)
    assert wanted.contact_step_N > 0.0
    assert wanted.loaded_slope_N_per_m > 3.0 * wanted.free_slope_N_per_m


@pytest.mark.parametrize("later_m", [-6e-4, -3e-4, 3e-4, 6e-4])
def test_an_object_of_another_size_is_found_where_it_is(later_m: float) -> None:
    """Both fingers, to 0.05 mm; the table does not pull it back, and nothing is off-centre."""
    search = searching()
    assert wind(search, late(later_m, later_m)) is Reason.NONE
    assert search.found_m == pytest.approx(late(later_m, later_m), abs=5e-5)
    assert not search.off_centre
    assert search.gripped_m == search.found_m
    assert search.object_offset_m == 0.0


@pytest.mark.parametrize("later_m", [-5e-4, 5e-4])
def test_stretch_is_the_tables_whatever_the_motor_tells(later_m: float) -> None:
    """Tendons that stretch, under a load law that is 20 % and 7 N off: the finger's excursion is still right, as the
    stretch follows from the springs that the fingers close against."""
    hand = {side: {**TABLE.table.header.hand[side], "tendon_stiffness_N_per_m": 4.5e4} for side in ("right", "left")}
    header = msgspec.structs.replace(TABLE.table.header, hand={**TABLE.table.header.hand, **hand})
    table = PlanarTable(MotionTable(header, TABLE.table.arrays))
    search = ContactSearch(SearchSettings(load_lag_s=0.0), table, None)
    contact_m, free = EXPECTED[0] + later_m, TABLE.free_slope_N_per_m[0]
    near_N, far_N = (TABLE.at_excursion(along_m, 0.0).tension_N[0] for along_m in (0.0, 2e-4))
    outcome = None
    for step, finger_m in enumerate(np.arange(EXPECTED[0] - 1.2e-3, EXPECTED[0] + 1.1e-3, 5e-6).tolist()):
        load_N = free * finger_m
        if finger_m > contact_m:
            step_N, rise = near_N - TABLE.contact_tension_N[0], (far_N - near_N) / 2e-4 - free
            load_N += step_N + rise * (finger_m - contact_m)
        wound_m = round((finger_m + load_N / 4.5e4) / TICK_M) * TICK_M
        told_N = 1.2 * load_N + 7.0
        state = HandState((wound_m, wound_m), (RATE_M_S, RATE_M_S), (told_N, told_N), (0.3, 0.3))
        outcome = search.take(state, step * PERIOD_NS, step * PERIOD_NS, rate_m_s=RATE_M_S, slow=True)
        if outcome is not None:
            break
    assert outcome is Reason.NONE
    assert search.found_m == pytest.approx((contact_m, contact_m), abs=4e-5)


def test_the_tables_own_contact_is_left_alone() -> None:
    """Where the object is the table's, noise moves its contact by next to nothing."""
    search = searching()
    assert wind(search, late(0.0, 0.0)) is Reason.NONE
    assert search.found_m == pytest.approx(EXPECTED, abs=1e-5)


def test_an_object_aside_is_gripped_when_the_second_finger_comes() -> None:
    """One finger pushes it before it until the other touches: there the table begins, and how far the object stood off
    follows from the first finger, towards which it stood."""
    search = searching()
    assert wind(search, late(-4e-4, 1e-4)) is Reason.NONE
    assert search.off_centre
    assert search.found_m == pytest.approx(late(-4e-4, 1e-4), abs=5e-5)
    later_m = search.found_m[1] - EXPECTED[1]
    assert search.gripped_m == pytest.approx(late(later_m, later_m))
    half_shift_m = TABLE.at_excursion(0.0, 1e-3).pose[0] - TABLE.contact_pose[0]
    assert search.object_offset_m == pytest.approx(2.0 * half_shift_m / 1e-3 * -5e-4, rel=0.15)
    assert search.object_offset_m > 0.0  # to the right, as the right finger came first


@pytest.mark.parametrize(
    ("contact_m", "reason"),
    [
        ((None, None), Reason.NO_CONTACT),
        ((EXPECTED[0] + 2e-4, None), Reason.ONE_SIDED_CONTACT),
        ((None, EXPECTED[1] - 2e-4), Reason.ONE_SIDED_CONTACT),
    ],
)
def test_what_is_no_grasp_says_why(contact_m: tuple[float | None, float | None], reason: Reason) -> None:
    """Nothing there, or one finger only: told apart, whichever finger it is."""
    search = searching()
    assert wind(search, contact_m) is None
    assert search.conclude(0) is reason
    assert search.found_m == EXPECTED


def test_contact_long_before_the_object_is_unexpected() -> None:
    """One finger is enough: the hand is in the wrong place."""
    assert wind(searching(), late(-1.1e-3, 0.0)) is Reason.CONTACT_UNEXPECTED


def test_contact_at_the_very_end_is_contact() -> None:
    """Less of the loaded line than otherwise is enough when there is no more to come."""
    search = searching()
    assert wind(search, late(8e-4, 8e-4), until_m=9.5e-4) is None
    assert search.conclude(0) is Reason.NONE
    assert search.found_m == pytest.approx(late(8e-4, 8e-4), abs=1e-4)


def test_the_pad_decides_for_its_finger() -> None:
    """The right pad touches where load would say nothing yet; the left one does not, and its finger is not believed to
    touch by a small rise: one-sided."""
    pads = Pads(EXPECTED[0] - 3e-4)
    search = searching(pads.watch)
    assert wind(search, late(0.0, 0.0), until_m=2e-4, pads=pads) is None
    assert search.fingers[0].contact_wound_m == pytest.approx(EXPECTED[0] - 3e-4, abs=2e-5)
    assert search.conclude(PERIOD_NS * 280) is Reason.ONE_SIDED_CONTACT
