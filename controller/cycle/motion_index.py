"""Where in the motion table the grasp is now: by excursion, by motor load, or by both.

* *Excursion*: both spool excursions less tendon stretch, less the excursion of first contact.
* *Load*: the mean load's rise since contact *while winding*, because the motors' constant gear friction cancels in it;
  when winding stops it is latched and moves again only with measured excursion, as it does while unwinding.
* *Fused*: the excursion, corrected by the load as far as it is the better known of the two.

Load and fused are the excursion with what `load_correction.py` makes of the load; they differ in what it may doubt. How
strongly the load rises while the fingers close freely tells its scale first.

In any case the commanded profile, through the identified motor lag, carries the index; measured samples only correct
it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from calibration.motion_table import Status
from controller.cycle.compensation import PlanarMotion, Vector3
from controller.cycle.free_closing_scale import FreeClosingScale
from controller.cycle.load_correction import LoadCorrection, LoadTrust, SmoothConstant
from controller.cycle.planar_table import PlanarSample, PlanarTable, finger_excursion_m
from controller.cycle.winding import IndexObserver, ObserverSettings, WindingState
from controller.messages import CompensationIndex, HandState, Pair

_SQRT_6 = 6.0**0.5
"""A motor stands anywhere in its tick: the difference of two deviates by tick / √6, their mean by half of that."""
_ANY_CONTACT_M = 2e-4
_ANY_STRETCH_M_PER_N = 2e-5
"""What the load index does not believe of excursions: where contact was, how stiff a braided line is."""
_CORRECTION_RAD_S = 25.0
_STEADY_M_S2 = 0.01
"""Above, the rotors' inertia is in the load: 0.9 N at this acceleration [assumed: 0.01 kg·m² at the spool]."""
_STEADY_S = 0.08
"""For so long a motor must have been turning steadily until its load tells the tension: friction has turned over, and
what filters load and rate has settled."""
_CLOSING_RATE_M_S = 3e-3
"""Above, the fingers close freely, and show the load's scale."""


@dataclass(frozen=True)
class IndexSettings:
    """How the index is observed, and how far each of its sources is trusted (standard deviations)."""

    excursion: ObserverSettings = field(default_factory=ObserverSettings)
    difference: ObserverSettings = field(default_factory=lambda: ObserverSettings(bandwidth_rad_s=8.0))
    winding_rate_m_s: float = 6.5e-4  # just above what the load law calls holding
    tick_m: float = 1.61e-5  # of a motor's position, on the spool
    tension_lag_s: float = 0.01  # of the measured tension, by its filter
    contact_deviation_m: float = 5e-5
    stiffness_deviation: float = 0.3  # relative, of the tendons
    scale_deviation: float = 0.25  # relative, of load law and finger springs before free closing has shown it
    onset_deviation_N: float = 1.3
    noise_N: float = 2.8  # of one sample: a motor tick's worth of load


class IndexReading(NamedTuple):
    """The index now, and what the table says there; `motion` is the object's planar pose in the hand with its rates.
    `table_tension_N` goes by the excursions alone: what the motors' goals are led by."""

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


class _Correction:
    """What one kind of index makes of the load, applied smoothly."""

    def __init__(self, trust: LoadTrust, scale: float, period_s: float) -> None:
        self._found = LoadCorrection(trust, scale)
        self._contact = SmoothConstant(period_s, _CORRECTION_RAD_S)
        self._stretch = SmoothConstant(period_s, _CORRECTION_RAD_S)

    def take(self, measured_rise_N: float, table_rise_N: float, slope_N_per_m: float) -> None:
        """One sample: the load's rise since contact, and the table's with its slope at the index as it was applied."""
        found = self._found
        ahead_m = found.contact_m - self._contact.value
        ahead_m += (found.stretch_m_per_N - self._stretch.value) * table_rise_N
        found.take(measured_rise_N, table_rise_N + slope_N_per_m * ahead_m, slope_N_per_m)

    def at(self, index: WindingState, rise_N: float, slope_N_per_m: float) -> WindingState:
        """The corrected index, where the table's load has risen by `rise_N` since contact."""
        contact, stretch = self._contact, self._stretch
        contact.step(self._found.contact_m)
        stretch.step(self._found.stretch_m_per_N)
        rise_rate = slope_N_per_m * index.rate_m_s
        rise_acceleration = slope_N_per_m * index.acceleration_m_s2
        return WindingState(
            index.position_m + contact.value + stretch.value * rise_N,
            index.rate_m_s + contact.rate + stretch.rate * rise_N + stretch.value * rise_rate,
            index.acceleration_m_s2
            + contact.acceleration
            + stretch.acceleration * rise_N
            + 2.0 * stretch.rate * rise_rate
            + stretch.value * rise_acceleration,
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
        self._difference = IndexObserver(period_s, settings.difference)
        self._closing_scale = FreeClosingScale(table.free_slope_N_per_m)
        self._corrections: dict[CompensationIndex, _Correction] = {}
        self._rates = _Rates(period_s)
        self._contact_shift_m: Pair = (0.0, 0.0)
        self._contact_N = 0.5 * (table.contact_tension_N[0] + table.contact_tension_N[1])
        self._onset_shift_N: float | None = None
        self._stretch_m: Pair = (0.0, 0.0)
        self._steady_s = 0.0
        self._stands = True
        self._at: tuple[_Correction, PlanarSample, float] | None = None
        """What corrects the index now, and the table's word there with the index's rate."""
        self.last_winding_load_N = 0.0

    def start(self, hand: HandState) -> None:
        """Begin to observe; nothing touches yet."""
        self._contact_shift_m = (0.0, 0.0)
        self._onset_shift_N = None
        self._corrections, self._at = {}, None
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
        self._onset_shift_N = 0.5 * (onset_load_N[0] + onset_load_N[1]) - self._contact_N
        settings = self._settings
        scale = self._closing_scale.scale(settings.scale_deviation)
        compliance_m_per_N = 0.5 * sum(self._table.compliance_m_per_N)
        # of the stretch that is not expected a part is taken off: by the load that the table has at the index so found
        taken_off = 1.0 + compliance_m_per_N * self._table.at_excursion(0.0, 0.0).mean_tension_slope
        stretch_m_per_N = settings.stiffness_deviation * compliance_m_per_N / taken_off
        link_N_per_m = -0.5 * sum(self._table.free_slope_N_per_m) * taken_off
        noise_N = settings.noise_N
        trusts = {
            CompensationIndex.LOAD: LoadTrust(_ANY_CONTACT_M, _ANY_STRETCH_M_PER_N, 0.0, 0.0, noise_N, link_N_per_m),
            CompensationIndex.FUSED: LoadTrust(
                settings.contact_deviation_m,
                stretch_m_per_N,
                scale.deviation,
                settings.onset_deviation_N,
                noise_N,
                link_N_per_m,
            ),
        }
        self._corrections = {kind: _Correction(trust, scale.value, self._period_s) for kind, trust in trusts.items()}

    @property
    def mean_shift_m(self) -> float:
        """Winding coordinate of the profile less mean index: how far contact came later than the table expected, m."""
        return 0.5 * (self._contact_shift_m[0] + self._contact_shift_m[1])

    def take(self, hand: HandState, sample_ns: int, now_ns: int, *, winding: bool) -> None:
        """Correct by a sample of the hand."""
        mean_m, difference_m = self._measured(hand)
        hidden_m = self._settings.tick_m / _SQRT_6 if self._stands else 0.0
        self._mean.correct(mean_m, sample_ns, now_ns, hidden_m=0.5 * hidden_m)
        self._difference.correct(difference_m, sample_ns, now_ns, hidden_m=hidden_m)
        # Where a motor has not begun to turn, friction hides its load (dynamixel reference 3.3).
        turning = min(hand.rate_m_s) > self._settings.winding_rate_m_s
        if not (winding and turning and self._steady_s > _STEADY_S + (now_ns - sample_ns) * 1e-9):
            return
        if self._onset_shift_N is None:
            self._take_closing(hand)
            return
        self.last_winding_load_N = self.measured_load_N(hand)
        age_s = (now_ns - sample_ns) * 1e-9 + self._settings.tension_lag_s
        if self._at is not None:
            correction, sample, rate_m_s = self._at
            slope = sample.mean_tension_slope
            if sample.status is Status.INSIDE and slope > 0.0:
                then_N = sample.mean_tension_N - slope * rate_m_s * age_s
                correction.take(self.last_winding_load_N - self._contact_N, then_N - self._contact_N, slope)

    def measured_load_N(self, hand: HandState) -> float:
        """Mean load, N, with the constant friction taken out by what was measured at contact."""
        return 0.5 * (hand.tension_N[0] + hand.tension_N[1]) - (self._onset_shift_N or 0.0)

    def advance(self, profile: WindingState, kind: CompensationIndex) -> IndexReading:
        """One period further along the commanded profile (in winding coordinates). A kind that is new while the object
        is held goes by excursion until the motors wind again."""
        steady = abs(profile.acceleration_m_s2) < _STEADY_M_S2 and profile.rate_m_s > 0.0
        self._steady_s = self._steady_s + self._period_s if steady else 0.0
        self._stands = abs(profile.rate_m_s) < 1e-9
        shifted = WindingState(profile.position_m - self.mean_shift_m, profile.rate_m_s, profile.acceleration_m_s2)
        index = self._mean.advance(shifted)
        difference = self._difference.advance(self._planned_difference(profile))
        sample = self._table.at_excursion(index.position_m, difference.position_m)
        compliance = self._table.compliance_m_per_N
        self._stretch_m = (sample.tension_N[0] * compliance[0], sample.tension_N[1] * compliance[1])
        tension_N = sample.tension_N
        correction, self._at = self._corrections.get(kind), None
        if correction is not None:
            rise_N = max(sample.mean_tension_N - self._contact_N, 0.0)
            slope = sample.mean_tension_slope if sample.status is Status.INSIDE else 0.0
            index = correction.at(index, rise_N, slope)
            sample = self._table.at_excursion(index.position_m, difference.position_m)
            self._at = correction, sample, index.rate_m_s
        return IndexReading(
            index.position_m,
            difference.position_m,
            index.rate_m_s,
            sample.mean_tension_N,
            tension_N,
            sample.status,
            sample.usable,
            self._rates.motion(sample, index, difference),
        )

    @property
    def winding_m(self) -> float:
        """Winding coordinate at which the motors are, as measured."""
        return self._mean.state.position_m + self.mean_shift_m

    def _take_closing(self, hand: HandState) -> None:
        """A sample of free closing, if both fingers are still on their way."""
        if min(hand.rate_m_s) < _CLOSING_RATE_M_S:
            return
        for finger in (0, 1):
            tension_N = hand.tension_N[finger]
            excursion_m = hand.excursion_m[finger] - tension_N * self._table.compliance_m_per_N[finger]
            self._closing_scale.take(finger, excursion_m, tension_N)

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
