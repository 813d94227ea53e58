"""The index of a grasp, observed on a hand that does exactly what the motion table says, with lag, age and friction."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import Status
from calibration.objects import load_object
from controller.cycle.motion_index import IndexReading, IndexSettings, MotionIndex
from controller.cycle.planar_table import PlanarTable
from controller.cycle.winding import WindingLimits, WindingProfile
from controller.messages import CompensationIndex, HandState, Pair

TABLE = PlanarTable(build_table(load_hand("t42pp"), load_object("cylinder40"), GraspSpec(), nodes=13))
PERIOD_S = 0.002
CONTACT_ZONE_M = 1.2e-3
SETTINGS = IndexSettings(tension_lag_s=0.0)  # these tensions are not filtered
LAG_S = SETTINGS.excursion.lag_s
SAMPLE_EVERY, SAMPLE_AGE_NS = 3, 2_000_000
END_M = 0.0030


@dataclass
class Grip:
    """A hand from 0.5 mm before contact on; what it measures, and where it truly is.

    `contact_shift_m`: how much later than the table expects each finger truly touches. Friction adds to the load while
    winding in, and is gone when the motors stand.
    """

    kind: CompensationIndex
    contact_shift_m: Pair = (0.0, 0.0)
    friction_N: float = 0.0
    index: MotionIndex = field(init=False)
    profile: WindingProfile = field(init=False)

    def __post_init__(self) -> None:
        self.index = MotionIndex(TABLE, PERIOD_S, SETTINGS, CONTACT_ZONE_M)
        self.profile = WindingProfile(PERIOD_S, WindingLimits())
        self.profile.place(-5e-4)
        self.true_w_m, self.true_rate_m_s = -5e-4, 0.0
        self.step = 0
        self.index.start(self.measured(0.0))

    @property
    def true_mean_m(self) -> float:
        """Mean excursion since true contact."""
        return self.true_w_m - 0.5 * sum(self.contact_shift_m)

    @property
    def true_difference_m(self) -> float:
        return self.contact_shift_m[1] - self.contact_shift_m[0]

    @property
    def true_pose(self) -> tuple[float, float, float]:
        return TABLE.at_excursion(self.true_mean_m, self.true_difference_m).pose

    def measured(self, friction_N: float) -> HandState:
        right, left = TABLE.contact_excursion_m
        w, rate = self.true_w_m, self.true_rate_m_s
        tension = TABLE.at_excursion(self.true_mean_m, self.true_difference_m).tension_N
        free = [min(self.true_mean_m, 0.0) * slope for slope in TABLE.free_slope_N_per_m]
        loads = (tension[0] + free[0] + friction_N, tension[1] + free[1] + friction_N)
        return HandState((right + w, left + w), (rate, rate), loads, (0.0, 0.0))

    def run(self, target_m: float, duration_s: float, stand_s: float = 0.0) -> Iterator[IndexReading]:
        """Wind to `target_m` of the winding coordinate, then stand."""
        self.profile.move(target_m, duration_s=duration_s)
        keep = math.exp(-PERIOD_S / LAG_S)
        standing = round(stand_s / PERIOD_S)
        while not self.profile.finished or standing > 0:
            standing -= self.profile.finished
            state = self.profile.step(1.0)
            before_m = self.true_w_m
            self.true_w_m = keep * self.true_w_m + (1 - keep) * state.position_m
            self.true_rate_m_s = (self.true_w_m - before_m) / PERIOD_S
            self.step += 1
            now_ns = self.step * 2_000_000
            winding = state.rate_m_s > 1e-6
            if self.step % SAMPLE_EVERY == 0:
                friction_N = self.friction_N if winding else -self.friction_N
                self.index.take(self.measured(friction_N), now_ns, now_ns, winding=winding)
            yield self.index.advance(state, self.kind)

    def touch(self) -> None:
        """Wind to contact, and let it be found."""
        for _ in self.run(max(self.contact_shift_m) + 1e-4, 0.3):
            pass
        right, left = TABLE.contact_excursion_m
        tension = TABLE.contact_tension_N
        found = (right + self.contact_shift_m[0], left + self.contact_shift_m[1])
        self.index.set_contact(found, (tension[0] + self.friction_N, tension[1] + self.friction_N))


@pytest.mark.parametrize("kind", CompensationIndex)
@pytest.mark.parametrize("shift_m", [(0.0, 0.0), (2e-4, 2e-4)])
def test_every_index_says_where_the_object_is(kind: CompensationIndex, shift_m: Pair) -> None:
    """Through a whole squeeze the pose agrees with the table at the true excursion, and its rate with its change."""
    grip = Grip(kind, shift_m, friction_N=6.0)
    grip.touch()
    assert grip.index.mean_shift_m == pytest.approx(0.5 * sum(shift_m))
    seen, true, rates = [], [], []
    for reading in grip.run(END_M, 1.2):
        assert reading.usable
        seen.append(reading.motion.pose)
        true.append(grip.true_pose)
        rates.append(reading.motion.rate)
    tolerance_m = 5e-5 if kind is CompensationIndex.EXCURSION else 2e-4
    moved_m = math.dist(true[0][:2], true[-1][:2])
    assert moved_m > 0.010
    error = np.array(seen) - true
    assert np.max(np.hypot(error[:, 0], error[:, 1])) < tolerance_m
    change = np.gradient(np.array(seen), PERIOD_S, axis=0)
    np.testing.assert_allclose(np.array(rates)[5:-5, 1], change[5:-5, 1], atol=3e-3)


def test_friction_that_turns_does_not_move_the_load_index() -> None:
    """When the motors stand their friction lets go of 12 N of measured load; the object has not moved by it."""
    grip = Grip(CompensationIndex.LOAD, friction_N=6.0)
    grip.touch()
    *_, last = grip.run(END_M, 1.2)
    for reading in grip.run(END_M, 0.0, stand_s=0.5):
        assert math.dist(reading.motion.pose[:2], grip.true_pose[:2]) < 2.5e-4
    assert reading.load_N == pytest.approx(last.load_N, abs=1.0)


@pytest.mark.parametrize("kind", CompensationIndex)
def test_unwinding_brings_the_object_back(kind: CompensationIndex) -> None:
    """Released in place, the index runs back to contact and before it, where nothing moves any more."""
    grip = Grip(kind, friction_N=6.0)
    grip.touch()
    for _ in grip.run(END_M, 1.2, stand_s=0.2):
        pass
    for reading in grip.run(-4e-4, 1.2, stand_s=0.3):
        assert math.dist(reading.motion.pose[:2], grip.true_pose[:2]) < 2.5e-4
    assert math.dist(reading.motion.pose[:2], TABLE.contact_pose[:2]) < 2.5e-4
    if kind is CompensationIndex.EXCURSION:
        assert reading.status is Status.BEFORE_CONTACT
        assert reading.motion.pose == pytest.approx(TABLE.contact_pose, abs=1e-12)


def test_fingers_that_touch_apart_make_an_off_centre_grasp() -> None:
    """The finger that touches later has wound less since its contact: the difference tells the table so."""
    grip = Grip(CompensationIndex.EXCURSION, contact_shift_m=(3e-4, 0.0))
    grip.touch()
    *_, reading = grip.run(END_M, 1.0)
    assert reading.difference_m == pytest.approx(-3e-4, abs=1e-5)
    assert reading.mean_m == pytest.approx(grip.true_mean_m, abs=1e-5)
    assert reading.motion.pose == pytest.approx(grip.true_pose, abs=1e-4)


def test_measured_load_is_free_of_the_friction_seen_at_contact() -> None:
    """What is reported as load does not hold the gear's constant friction."""
    grip = Grip(CompensationIndex.EXCURSION, friction_N=6.0)
    grip.touch()
    for _ in grip.run(END_M, 1.0):
        pass
    load_N = grip.index.measured_load_N(grip.measured(6.0))
    assert load_N == pytest.approx(TABLE.at_excursion(grip.true_mean_m, 0.0).mean_tension_N, abs=0.1)


def test_before_contact_nothing_moves() -> None:
    """While the fingers close the wrist stands still, whatever the load says."""
    grip = Grip(CompensationIndex.LOAD, friction_N=20.0)
    for reading in grip.run(-1e-4, 0.3, stand_s=0.1):
        assert reading.motion.pose == pytest.approx(TABLE.contact_pose, abs=1e-12)
        assert reading.motion.rate == (0.0, 0.0, 0.0)


def squeezed(kind: CompensationIndex) -> Grip:
    """Squeezed, and come to rest."""
    grip = Grip(kind, friction_N=6.0)
    grip.touch()
    for _ in grip.run(END_M, 1.2, stand_s=0.4):
        pass
    return grip


SQUEEZED = {kind: squeezed(kind) for kind in (CompensationIndex.LOAD, CompensationIndex.FUSED)}


@pytest.mark.parametrize("kind", SQUEEZED)
@given(st.lists(st.tuples(st.floats(0.0, 200.0), st.floats(-0.02, 0.0)), min_size=1, max_size=10))
def test_a_load_that_is_latched_stays_so(kind: CompensationIndex, shown: list[tuple[float, float]]) -> None:
    """Whatever a motor that stands or lets out says of its load, friction may have made it: only excursion moves the
    index."""
    grip = copy.deepcopy(SQUEEZED[kind])
    state = grip.profile.state
    before = grip.index.advance(state, kind)
    for tension_N, rate_m_s in shown:
        grip.step += 1
        now_ns = grip.step * 2_000_000
        hand = replace(grip.measured(0.0), tension_N=(tension_N, tension_N), rate_m_s=(rate_m_s, rate_m_s))
        grip.index.take(hand, now_ns, now_ns, winding=False)
        after = grip.index.advance(state, kind)
    assert after.mean_m == pytest.approx(before.mean_m, abs=1e-6)
    assert after.motion.pose == pytest.approx(before.motion.pose, abs=1e-5)


def test_a_new_kind_while_the_object_is_held_goes_by_excursion_first() -> None:
    """Its correction is unknown until the motors wind again: no jump to a load that was never taken in."""
    grip = squeezed(CompensationIndex.EXCURSION)
    state = grip.profile.state
    before = grip.index.advance(state, CompensationIndex.EXCURSION)
    assert grip.index.advance(state, CompensationIndex.FUSED).motion.pose == pytest.approx(before.motion.pose, abs=1e-6)


def test_only_steady_winding_is_believed() -> None:
    """While the rotors gather speed their inertia is in the load, and before friction has turned over that is too."""
    rough = Grip(CompensationIndex.LOAD)
    rough.touch()
    for _ in rough.run(END_M, 0.0):  # as fast as it can: it never winds steadily for long enough
        pass
    plain = Grip(CompensationIndex.EXCURSION)
    plain.touch()
    for _ in plain.run(END_M, 0.0):
        pass
    state = plain.profile.state
    by_load = rough.index.advance(state, CompensationIndex.LOAD)
    assert by_load.mean_m == pytest.approx(plain.index.advance(state, CompensationIndex.EXCURSION).mean_m, abs=2e-5)
