"""The search for first contact with both fingers: what each found, what the grasp goes by, whether it is off-centre.

Both fingers wind at equal rate through the contact zone. If the object stands off the hand's axis, one finger touches
first and pushes the object before it, against the support's drag, until the other touches too: only then it is gripped.
So the motion table begins at the later of both contacts where they lie far apart, and at each finger's own where they
do not. The table's own contacts count where what was found agrees with them: for mean and difference apart, as the
object's first load is shared by chance between the fingers and makes one early and the other late. Excursions are
finger-side where nothing else is said, m; order right, left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from controller.cycle.contact import ContactSettings, FingerContact, FingerExpectation, Touch
from controller.cycle.contact_fit import TableTrust, weighed_with_table
from controller.cycle.pads import PadWatch
from controller.cycle.planar_table import PlanarTable
from controller.messages import HandState, Pair, Reason

_LOADED_LINE_M = 2e-4
"""Of the table past contact, over which the loaded line's slope is taken."""


@dataclass(frozen=True)
class SearchSettings:
    """How contact is looked for, and when it is off-centre."""

    finger: ContactSettings = field(default_factory=ContactSettings)
    turning_rate_m_s: float = 3e-4  # of a spool that winds; slower, gear friction may hide its load
    load_lag_s: float = 0.01  # of the tension behind the excursion: the load law's filter
    off_centre_m: float = 2e-4  # of excursion between both contacts: some 2 mm of object
    sharing_deviation_m: float = 7e-5  # of the contacts' difference, where load found them
    trust: TableTrust = field(default_factory=TableTrust)


class ContactSearch:
    """Both fingers' search in one closing."""

    def __init__(self, settings: SearchSettings, table: PlanarTable, pads: PadWatch | None) -> None:
        self._settings = settings
        self._table = table
        self._pads = pads
        right, left = (expectation(table, finger) for finger in (0, 1))
        self._expected_wound_m = right.contact_wound_m, left.contact_wound_m
        self.fingers = (FingerContact(settings.finger, right), FingerContact(settings.finger, left))

    @property
    def found_m(self) -> Pair:
        """Each finger's own first contact, weighed with the table's; the table's while not both are known."""
        expected, settings = self._table.contact_excursion_m, self._settings
        if self.outcome() is not Reason.NONE:
            return expected
        right, left = self.fingers
        late_m = (
            right.contact_wound_m * (expected[0] / self._expected_wound_m[0]) - expected[0],
            left.contact_wound_m * (expected[1] / self._expected_wound_m[1]) - expected[1],
        )
        deviation_m = math.hypot(right.deviation_m, left.deviation_m)
        shared_m = 0.0 if right.by_pad and left.by_pad else settings.sharing_deviation_m
        mean_m = weighed_with_table(0.5 * (late_m[0] + late_m[1]), 0.5 * deviation_m, settings.trust)
        difference_m = weighed_with_table(late_m[0] - late_m[1], math.hypot(deviation_m, shared_m), settings.trust)
        return expected[0] + mean_m + 0.5 * difference_m, expected[1] + mean_m - 0.5 * difference_m

    @property
    def onset_load_N(self) -> Pair:
        """Measured load at contact, N, on the free lines."""
        return self.fingers[0].onset_load_N, self.fingers[1].onset_load_N

    @property
    def spread_m(self) -> float:
        """By how much the right finger touched later than the left, against the table."""
        found, expected = self.found_m, self._table.contact_excursion_m
        return (found[0] - expected[0]) - (found[1] - expected[1])

    @property
    def off_centre(self) -> bool:
        """Whether the fingers touched so far apart that the object stood off the hand's axis."""
        return abs(self.spread_m) > self._settings.off_centre_m

    @property
    def gripped_m(self) -> Pair:
        """The contact excursions that the grasp goes by."""
        if not self.off_centre:
            return self.found_m
        right, left = self._table.contact_excursion_m
        later_m = max(self.found_m[0] - right, self.found_m[1] - left)
        return right + later_m, left + later_m

    @property
    def object_offset_m(self) -> float:
        """About how far along the hand's x axis the object stood off where the table has it; 0 unless off-centre.

        The table tells how far both fingertips shift the object per metre of excursion difference; the first finger
        alone, which moves by half of that difference, pushed it all the way.
        """
        if not self.off_centre:
            return 0.0
        return 2.0 * self._table.at_excursion(0.0, 0.0).along_second[0] * self.spread_m

    def take(self, hand: HandState, sample_ns: int, now_ns: int, *, rate_m_s: float, slow: bool) -> Reason | None:
        """One sample of the hand, wound at the commanded `rate_m_s`; what it says (see `outcome`)."""
        for i, finger in enumerate(self.fingers):
            wound_m = hand.excursion_m[i]
            pad = None if self._pads is None else self._pads.finger(i, now_ns)
            if hand.rate_m_s[i] > self._settings.turning_rate_m_s:
                then_m = wound_m - self._settings.load_lag_s * hand.rate_m_s[i]
                finger.take(wound_m, then_m, hand.tension_N[i], slow=slow, padded=pad is not None)
            if pad is not None and pad.touching:
                finger.take_pad(wound_m - (sample_ns - pad.onset_ns) * 1e-9 * rate_m_s)
        return self.outcome()

    def conclude(self, now_ns: int) -> Reason:
        """Winding ends: NONE for contact, else why there is none."""
        for i, finger in enumerate(self.fingers):
            finger.conclude(padded=self._pads is not None and self._pads.finger(i, now_ns) is not None)
        outcome = self.outcome()
        if outcome is not None:
            return outcome
        touching = any(finger.touch is Touch.TOUCHING for finger in self.fingers)
        return Reason.ONE_SIDED_CONTACT if touching else Reason.NO_CONTACT

    def outcome(self) -> Reason | None:
        """NONE: both fingers touch; CONTACT_UNEXPECTED: one touched far too early; None while neither is known."""
        touches = [finger.touch for finger in self.fingers]
        if Touch.EARLY in touches:
            return Reason.CONTACT_UNEXPECTED
        return Reason.NONE if touches == [Touch.TOUCHING] * 2 else None


def expectation(table: PlanarTable, finger: int) -> FingerExpectation:
    """What the table expects of one finger (0 right, 1 left), on the spool's side of its tendon.

    Up to contact the tendon carries the free load, which is in proportion to excursion, and so is the stretch that the
    spool winds up besides: spool and finger side differ by a factor that no error of the motor's load law enters.
    """
    compliance, free = table.compliance_m_per_N[finger], table.free_slope_N_per_m[finger]
    near_N = table.at_excursion(0.0, 0.0).tension_N[finger]
    far_N = table.at_excursion(_LOADED_LINE_M, 0.0).tension_N[finger]
    loaded = (far_N - near_N) / _LOADED_LINE_M
    return FingerExpectation(
        table.contact_excursion_m[finger] * (1.0 + free * compliance),
        free / (1.0 + free * compliance),
        loaded / (1.0 + loaded * compliance),
        near_N - table.contact_tension_N[finger],
    )
