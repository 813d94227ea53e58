"""Where in the motion table the grasp is now: by excursion, by motor load, or by both.

* *Excursion*: both spool excursions less tendon stretch, less the excursion of first contact.
* *Load*: the mean load's rise since contact *while winding*, because the motors' constant gear friction cancels in it;
  when winding stops it is latched and moves again only with measured excursion.
* *Fused*: the object motion of both, weighted by the inverse of their variances.

Either way the commanded profile, through the identified motor lag, carries the index; measured samples only correct it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from calibration.motion_table import Status
from controller.cycle.compensation import PlanarMotion, Vector3
from controller.cycle.planar_table import PlanarSample, PlanarTable, finger_excursion_m
from controller.cycle.winding import IndexObserver, ObserverSettings, WindingState
from controller.messages import CompensationIndex, HandState, Pair


@dataclass(frozen=True)
class IndexSettings:
    """How the index is observed, and how far each kind is trusted (standard deviations)."""

    excursion: ObserverSettings = field(default_factory=ObserverSettings)
    load: ObserverSettings = field(default_factory=lambda: ObserverSettings(bandwidth_rad_s=8.0))
    winding_rate_m_s: float = 6.5e-4  # just above what the load law calls holding
    resolution_m: float = 8.5e-6  # half a motor tick on the spool
    excursion_deviation_m: float = 5e-5
    load_deviation_N: float = 3.0


class IndexReading(NamedTuple):
    """The index now, and what the table says there; `motion` is the object's planar pose in the hand with its rates."""

    mean_m: float
    difference_m: float
    rate_m_s: float
    load_N: float
    table_tension_N: Pair
    status: Status
    usable: bool
    motion: PlanarMotion


class _Rates:
    """Pose, rate and acceleration along the index from successive samples: the Jacobian's change gives its rate."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._previous: tuple[Vector3, Vector3] | None = None

    def motion(self, sample: PlanarSample, first: WindingState, second: WindingState) -> PlanarMotion:
        """`first` and `second` are the two index axes with rate and acceleration."""
        columns = (sample.along_first, sample.along_second)
        previous = columns if self._previous is None else self._previous
        self._previous = columns
        rates = []
        accelerations = []
        for row in range(3):
            j0, j1 = columns[0][row], columns[1][row]
            rates.append(j0 * first.rate_m_s + j1 * second.rate_m_s)
            drift0 = (j0 - previous[0][row]) / self._period_s
            drift1 = (j1 - previous[1][row]) / self._period_s
            accelerations.append(
                j0 * first.acceleration_m_s2
                + j1 * second.acceleration_m_s2
                + drift0 * first.rate_m_s
                + drift1 * second.rate_m_s
            )
        return PlanarMotion(
            sample.pose, (rates[0], rates[1], rates[2]), (accelerations[0], accelerations[1], accelerations[2])
        )


class MotionIndex:
    """Observes the index of one grasp and looks the object's motion up.

    `contact_zone_m`: from how far before contact on both fingers wind at equal rate.
    """

    def __init__(self, table: PlanarTable, period_s: float, settings: IndexSettings, contact_zone_m: float) -> None:
        self._table = table
        self._contact_zone_m = contact_zone_m
        self._period_s = period_s
        self._settings = settings
        self._mean = IndexObserver(period_s, settings.excursion)
        # The difference has no commanded profile: equal rates leave it alone. Only samples move it, slowly.
        self._difference = IndexObserver(period_s, settings.load)
        self._load = IndexObserver(period_s, settings.load)
        self._load_rates = _Rates(period_s)
        self._excursion_rates = _Rates(period_s)
        self._contact_shift_m: Pair = (0.0, 0.0)
        self._onset_shift_N: float | None = None
        self._stretch_m: Pair = (0.0, 0.0)
        self._latch: tuple[float, float] | None = None
        self.last_winding_load_N = 0.0

    def start(self, hand: HandState) -> None:
        """Begin to observe; nothing touches yet."""
        self._contact_shift_m = (0.0, 0.0)
        self._onset_shift_N = None
        self._latch = None
        mean_m, difference_m = self._measured(hand)
        self._mean.reset(mean_m)
        self._difference.reset(difference_m)

    def set_contact(self, contact_excursion_m: Pair, onset_load_N: Pair) -> None:
        """Take in the contact that was found: finger-side excursions and the measured loads there."""
        expected = self._table.contact_excursion_m
        before_difference_m = self._contact_shift_m[0] - self._contact_shift_m[1]
        mean_shift_m = self.mean_shift_m
        self._contact_shift_m = (contact_excursion_m[0] - expected[0], contact_excursion_m[1] - expected[1])
        self._mean.shift(mean_shift_m - self.mean_shift_m)
        new = contact_excursion_m
        self._difference.shift((expected[0] - expected[1]) - (new[0] - new[1]) + before_difference_m)
        tension = self._table.contact_tension_N
        self._onset_shift_N = 0.5 * (onset_load_N[0] + onset_load_N[1]) - 0.5 * (tension[0] + tension[1])
        mean = self._mean.state.position_m
        self._load.reset(self._table.at_excursion(mean, 0.0).mean_tension_N)

    @property
    def mean_shift_m(self) -> float:
        """Winding coordinate of the profile less mean index: how far contact came later than the table expected, m."""
        return 0.5 * (self._contact_shift_m[0] + self._contact_shift_m[1])

    def take(self, hand: HandState, sample_ns: int, now_ns: int, *, winding: bool) -> None:
        """Correct by a sample of the hand."""
        mean_m, difference_m = self._measured(hand)
        resolution_m = 0.0 if winding else self._settings.resolution_m
        self._mean.correct(mean_m, sample_ns, now_ns, resolution_m=resolution_m)
        self._difference.correct(difference_m, sample_ns, now_ns, resolution_m=resolution_m)
        # Where a motor has not begun to turn, friction hides its load (dynamixel reference 3.3).
        turning = min(hand.rate_m_s) > self._settings.winding_rate_m_s
        if winding and turning and self._onset_shift_N is not None:
            self.last_winding_load_N = self.measured_load_N(hand)
            self._load.correct(self.measured_load_N(hand), sample_ns, now_ns)

    def measured_load_N(self, hand: HandState) -> float:
        """Mean load, N, with the constant friction taken out by what was measured at contact."""
        return 0.5 * (hand.tension_N[0] + hand.tension_N[1]) - (self._onset_shift_N or 0.0)

    def advance(self, profile: WindingState, kind: CompensationIndex, *, winding: bool) -> IndexReading:
        """One period further along the commanded profile (in winding coordinates)."""
        shifted = WindingState(profile.position_m - self.mean_shift_m, profile.rate_m_s, profile.acceleration_m_s2)
        mean = self._mean.advance(shifted)
        difference = self._difference.advance(self._planned_difference(profile))
        sample = self._table.at_excursion(mean.position_m, difference.position_m)
        motion = self._excursion_rates.motion(sample, mean, difference)
        compliance = self._table.compliance_m_per_N
        self._stretch_m = (sample.tension_N[0] * compliance[0], sample.tension_N[1] * compliance[1])
        load_N = sample.mean_tension_N
        decisive = sample
        # Before contact, as again after release, there is no load of the object to go by.
        touching = self._onset_shift_N is not None and sample.status is not Status.BEFORE_CONTACT
        if touching and kind is not CompensationIndex.EXCURSION:
            load = self._observed_load(shifted, difference.position_m, sample, mean, winding=winding)
            by_load = self._table.at_load(load.position_m, difference.position_m)
            if by_load.usable:
                load_motion = self._load_rates.motion(by_load, load, difference)
                weight = 1.0 if kind is CompensationIndex.LOAD else self._load_weight(sample, by_load)
                motion = _blend(motion, load_motion, weight)
                decisive = by_load
            load_N = load.position_m
        return IndexReading(
            mean.position_m,
            difference.position_m,
            mean.rate_m_s,
            load_N,
            sample.tension_N,
            decisive.status,
            decisive.usable,
            motion,
        )

    def _measured(self, hand: HandState) -> Pair:
        expected = self._table.contact_excursion_m
        right = hand.excursion_m[0] - self._stretch_m[0] - expected[0] - self._contact_shift_m[0]
        left = hand.excursion_m[1] - self._stretch_m[1] - expected[1] - self._contact_shift_m[1]
        return 0.5 * (right + left), right - left

    def _planned_difference(self, profile: WindingState) -> WindingState:
        """Difference of the two fingers' set-points since contact: none in the contact zone and beyond."""
        zone_m = self._contact_zone_m
        w = profile.position_m
        right, left = (finger_excursion_m(self._table, finger, w, zone_m) for finger in (0, 1))
        contact, shift = self._table.contact_excursion_m, self._contact_shift_m
        position_m = (right - contact[0] - shift[0]) - (left - contact[1] - shift[1])
        slope = 0.0 if w >= -zone_m else (contact[0] - contact[1]) / (self._table.mean_contact_m - zone_m)
        return WindingState(position_m, slope * profile.rate_m_s, slope * profile.acceleration_m_s2)

    def _observed_load(
        self, command: WindingState, difference_m: float, sample: PlanarSample, mean: WindingState, *, winding: bool
    ) -> WindingState:
        """Mean load with its rates: while winding observed, then latched and moved by the table's word on excursion."""
        if not winding:
            if self._latch is None:
                self._latch = (self._load.state.position_m, sample.mean_tension_N)
            latched_N, at_latch_N = self._latch
            return _load_state(latched_N + sample.mean_tension_N - at_latch_N, sample, mean)
        self._latch = None
        commanded = self._table.at_excursion(command.position_m, difference_m)
        return self._load.advance(_load_state(commanded.mean_tension_N, commanded, command))

    def _load_weight(self, by_excursion: PlanarSample, by_load: PlanarSample) -> float:
        """Weight of the load's motion: inverse variances, both as motion of the object."""
        excursion_m = _length(by_excursion.along_first) * self._settings.excursion_deviation_m
        load_m = _length(by_load.along_first) * self._settings.load_deviation_N
        return excursion_m**2 / max(excursion_m**2 + load_m**2, 1e-18)


def _load_state(load_N: float, sample: PlanarSample, index: WindingState) -> WindingState:
    """A load that moves with an excursion index, by the table's slope there."""
    slope = sample.mean_tension_slope
    return WindingState(load_N, slope * index.rate_m_s, slope * index.acceleration_m_s2)


def _length(column: Vector3) -> float:
    return float((column[0] ** 2 + column[1] ** 2) ** 0.5)


def _blend(first: PlanarMotion, second: PlanarMotion, weight: float) -> PlanarMotion:
    def mix(a: Vector3, b: Vector3) -> Vector3:
        return (a[0] + weight * (b[0] - a[0]), a[1] + weight * (b[1] - a[1]), a[2] + weight * (b[2] - a[2]))

    return PlanarMotion(
        mix(first.pose, second.pose), mix(first.rate, second.rate), mix(first.acceleration, second.acceleration)
    )
