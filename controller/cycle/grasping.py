"""The grasp in the cycle: it winds the tendons, finds contact, and says where the object is going in the hand.

The winding coordinate w is the mean excursion since the contact that the motion table expects, negative before it.
Both fingers come into the contact zone together, each by its own share of its own way; in it and from contact on both
wind at equal rate. When either motor reaches its load cap, or the table its end, both stop and hold their excursions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from calibration.motion_table import MotionTable, Status
from controller.cycle.compensation import STILL, PlanarMotion, Vector3, after, hand_offset
from controller.cycle.contact_search import ContactSearch, SearchSettings
from controller.cycle.following import FollowingWatch
from controller.cycle.grasp_state import COMPENSATED, GRIPPING, GraspEvent, GraspPhase, HandStatus, next_phase
from controller.cycle.hand_opening import HandOpening
from controller.cycle.load_cap import LoadCap, LoadCapWatch
from controller.cycle.motion_index import IndexReading, IndexSettings, MotionIndex
from controller.cycle.motor_drive import MotorDrive, Supply, sign, towards
from controller.cycle.outcome import Outcome
from controller.cycle.pads import PadWatch
from controller.cycle.planar_table import PlanarTable, finger_excursion_m
from controller.cycle.winding import WindingLimits, WindingProfile
from controller.messages import CompensationIndex, EventKind, HandMode, HandSetPoint, HandState, Reason


@dataclass(frozen=True)
class GraspSettings:
    """Rates of winding and thresholds of contact."""

    closing_rate_m_s: float = 0.012
    squeezing_rate_m_s: float = 0.020  # at most, however short a time is asked for
    contact_rate_m_s: float = 0.001  # near the expected contact: found within few samples, and the arm starts gently
    contact_zone_m: float = 1.2e-3
    search_end_m: float = 1.1e-3  # contact is given up this far past the expected one
    short_m: float = 0.15e-3  # that the spools may be behind where a squeeze was to end; sound loops miss by hundredths
    overdue_m: float = 0.3e-3  # contact where it is expected is found by then
    release_rate_m_s: float = 0.010
    load_cap_N: float = 110.0
    free_load_cap_N: float = 60.0  # while closing nothing should resist; also the cap of an open hand
    empty_load_N: float = 30.0  # an open hand whose tendons pull harder may hold something: pads take no zero
    winding: WindingLimits = field(default_factory=WindingLimits)
    drives: tuple[MotorDrive, MotorDrive] = (MotorDrive(), MotorDrive())
    reversal_time_s: float = 0.1  # in which the lead that friction needs turns over, so that the goal does not jump
    search: SearchSettings = field(default_factory=SearchSettings)
    index: IndexSettings = field(default_factory=IndexSettings)


class Grasping:
    """Phase, winding and index of the grasp under way."""

    def __init__(self, period_s: float, settings: GraspSettings) -> None:
        self._period_s = period_s
        self._settings = settings
        self._profile = WindingProfile(period_s, settings.winding)
        self._index: MotionIndex | None = None
        self.make_index: Callable[[PlanarTable, float, IndexSettings, float], MotionIndex] = MotionIndex
        """What observes the index of a grasp; a study puts others beside it."""
        self._contact: ContactSearch | None = None
        self._token = 0
        self._searching = False
        self._gripped_at_fault = False
        self._freeing = False
        """Released in a fault: fingers may be trapped, and no arm that lags behind slows that down."""
        self.lost = False
        """A tendon let go or slipped: its excursion no longer tells where the object is, and the arm follows none."""
        self.following = FollowingWatch()
        self._load_watch = LoadCapWatch(LoadCap(settings.load_cap_N))
        self._friction_sign = 0.0
        self._supply = Supply(settings.drives)
        self._last_sample_ns = -1
        self._stop_reason: Reason | None = None
        self._set_point = HandSetPoint((0.0, 0.0), (settings.free_load_cap_N,) * 2)
        self.phase = GraspPhase.NONE
        self.pads: PadWatch | None = None
        """The tactile pads, where there are any."""
        self._was_prepositioned = False
        self.table: PlanarTable | None = None
        self.index_kind = CompensationIndex.EXCURSION
        self.reading: IndexReading | None = None
        self.offset_target: PlanarMotion = STILL
        self._offset_at_touch = STILL.pose
        self.winding = self._profile.state
        self.outcomes: list[Outcome] = []
        self._opening = HandOpening(self.outcomes)

    @property
    def index(self) -> MotionIndex | None:
        """What observes the index of this grasp, or did of the last one."""
        return self._index

    @property
    def compensated(self) -> bool:
        """Whether the table is in force: from the beginning of closing (contact may come any moment) to release."""
        return self.phase in COMPENSATED or self.phase is GraspPhase.FAULT

    @property
    def gripping(self) -> bool:
        """Whether the fingers are, or may be, on an object; in a fault: whether they were when it came."""
        return self.phase in GRIPPING or (self.phase is GraspPhase.FAULT and self._gripped_at_fault)

    @property
    def hand_status(self) -> HandStatus:
        """The hand's own state."""
        return HandStatus.GRIPPING if self.gripping else HandStatus.OPEN

    @property
    def full_rate_object_speed_m_s(self) -> float:
        """Speed of the object in the hand if the profile ran unthrottled, m/s."""
        throttled_to = self._profile.speed
        if self.reading is None or self.winding.rate_m_s == 0.0 or throttled_to == 0.0:
            return 0.0
        vx, vy, _ = self.reading.motion.rate
        return float((vx * vx + vy * vy) ** 0.5) / throttled_to

    def use_table(self, table: MotionTable) -> Reason:
        """Take a table, only while nothing is gripped; any preposition for another table is void."""
        if self.compensated:
            return Reason.WRONG_PHASE
        self.table = PlanarTable(table)
        self.phase = GraspPhase.NONE
        return Reason.NONE

    def enter(self, event: GraspEvent) -> Reason:
        """Change phase, or say that this cannot happen now."""
        following = next_phase(self.phase, event, gripping=self.gripping)
        if following is None:
            return Reason.WRONG_PHASE
        self.phase = following
        return Reason.NONE

    def close(self, token: int, hand: HandState, rate_m_s: float | None = None) -> Reason:
        """Begin to close on the object."""
        table = self.table
        if table is None:
            return Reason.NO_TABLE
        if (reason := self.enter(GraspEvent.CLOSE)) is not Reason.NONE:
            return reason
        settings = self._settings
        self._index = self.make_index(table, self._period_s, settings.index, settings.contact_zone_m)
        self._index.start(hand)
        self._offset_at_touch = STILL.pose
        self._contact = ContactSearch(settings.search, table, self.pads)
        self._supply.begin(hand.voltage_V)
        start_m = 0.5 * (hand.excursion_m[0] + hand.excursion_m[1]) - table.mean_contact_m
        self._profile.place(min(start_m, 0.0))
        rate = settings.closing_rate_m_s if rate_m_s is None else rate_m_s
        # No stop before the slow part: at rest, gear friction hides the load.
        self._profile.move(-settings.contact_zone_m, rate_m_s=rate, end_rate_m_s=settings.contact_rate_m_s)
        self._token, self._searching, self._stop_reason = token, False, None
        self._opening.end()
        self.lost = False
        return Reason.NONE

    def squeeze(self, token: int, mean_excursion_m: float, load_N: float, duration_s: float) -> Reason:
        """Wind on to the mean excursion since contact at which the table has the mean load `load_N`."""
        table, index = self.table, self._index
        if table is None or index is None:
            return Reason.NO_TABLE
        if load_N > self._settings.load_cap_N:
            return Reason.LOAD_ABOVE_CAP
        if not table.at_excursion(mean_excursion_m, 0.0).usable:
            return Reason.OUTSIDE_TABLE
        if not self._profile.finished:
            return Reason.BUSY
        if (reason := self.enter(GraspEvent.SQUEEZE)) is not Reason.NONE:
            return reason
        self._profile.move(
            mean_excursion_m + index.mean_shift_m, rate_m_s=self._settings.squeezing_rate_m_s, duration_s=duration_s
        )
        self._token, self._stop_reason = token, None
        return Reason.NONE

    def hold(self) -> Reason:
        """Stop winding where it is and hold the excursions."""
        if (reason := self.enter(GraspEvent.HOLD)) is not Reason.NONE:
            return reason
        self._halt(Reason.STOPPED_BY_COMMAND)
        return Reason.NONE

    def stop(self) -> None:
        """Stop winding in whatever phase; closing is given up with that, and the fingers stay where they are."""
        if self.phase is GraspPhase.CLOSING:
            self._end_token(EventKind.FAILED, Reason.STOPPED_BY_COMMAND)
            self.enter(GraspEvent.CLOSING_FAILED)
            self.winding = self._profile.state._replace(rate_m_s=0.0, acceleration_m_s2=0.0)
            self._profile.place(self.winding.position_m)
        else:
            self.hold()

    def release(self, token: int) -> Reason:
        """Unwind to open; the compensation runs backwards in place."""
        table = self.table
        if table is None:
            return Reason.NO_TABLE
        failed = self.phase is GraspPhase.FAULT
        if (reason := self.enter(GraspEvent.RELEASE)) is not Reason.NONE:
            return reason
        self._freeing = failed
        self._end_token(EventKind.FAILED, Reason.SUPERSEDED)
        self._profile.place(self._profile.state.position_m)
        self._profile.move(-table.mean_contact_m, rate_m_s=self._settings.release_rate_m_s)
        self._token, self._searching, self._stop_reason = token, False, None
        return Reason.NONE

    def open(self, token: int) -> None:
        """Let the hand process pay out whatever it holds; for when no grasp is under way."""
        self._opening.begin(token)

    def clear_fault(self) -> None:
        """The fault is over: what was held goes on being held where it now is."""
        self.enter(GraspEvent.FAULT_CLEARED)
        self.lost = False
        if self.phase is GraspPhase.HOLDING and self._index is not None:
            self._profile.place(self._index.winding_m)

    def fail(self, reason: Reason) -> None:
        """A fault: keep the object. Winding ends here and now; the hand process freezes both excursions."""
        self._end_token(EventKind.FAILED, reason)
        self._gripped_at_fault = self.gripping
        self.lost |= reason in (Reason.OFFSET_LAG, Reason.OFFSET_LIMIT)
        self.enter(GraspEvent.FAULT)
        if self.reading is not None and self._index is not None:
            self._profile.place(self._index.winding_m)

    def step(self, hand: HandState | None, sample_ns: int, now_ns: int, throttle: float) -> HandSetPoint:
        """One period: wind, observe, look up; returns what the hand shall do."""
        if self.pads is not None:
            self._watch_pads(self.pads, hand, now_ns)
        if not self.compensated or self.table is None or self._index is None or hand is None:
            self.offset_target = STILL
            self.reading = None
            self._opening.step(hand, now_ns)
            # Whatever the motors hold when the daemon starts, they go on holding: only release and open let go.
            mode = HandMode.OPEN if self._opening.wanted else HandMode.FREEZE
            self._set_point = HandSetPoint((0.0, 0.0), (self._settings.free_load_cap_N,) * 2, mode)
            return self._set_point
        if self._freeing and self.phase is GraspPhase.RELEASING:
            throttle = 1.0
        self.winding = self._profile.step(0.0 if self._stop_reason is not None else throttle)
        is_winding = self.winding.rate_m_s > 1e-6
        if sample_ns > self._last_sample_ns:
            self._last_sample_ns = sample_ns
            self._supply.follow(hand.voltage_V, sample_ns)
            self._index.take(hand, sample_ns, now_ns, winding=is_winding)
            self.following.take(hand.excursion_m)
            at_cap = self._load_watch.reached(hand.tension_N, hand.derating, sample_ns)
            if at_cap and self.phase is GraspPhase.SQUEEZING:
                self._halt(Reason.LOAD_CAP_REACHED)
            if self.phase is GraspPhase.CLOSING and is_winding:
                self._search(hand, now_ns)
        self.reading = self._index.advance(self.winding, self.index_kind)
        self._aim(self.table, self.reading)
        self._finish(now_ns)
        return self._drive(self.table, now_ns)

    def _aim(self, table: PlanarTable, reading: IndexReading) -> None:
        """The wanted hand offset; outside the table the last one stands: nothing is extrapolated. So it does while
        contact is overdue: the object stands later than the table has it, and nothing moves it yet."""
        overdue = self.phase is GraspPhase.CLOSING and reading.mean_m > self._settings.overdue_m
        if reading.usable and not overdue and not self.lost:
            self.offset_target = self.offset_of(table, reading.motion)
        else:
            self.offset_target = PlanarMotion(self.offset_target.pose, STILL.rate, STILL.acceleration)
            if reading.status is Status.OUTSIDE and self.phase is GraspPhase.SQUEEZING:
                self._halt(Reason.TABLE_END_REACHED)

    def offset_of(self, table: PlanarTable, motion: PlanarMotion) -> PlanarMotion:
        """The hand offset that keeps the object still in the room as it moves so in the hand.

        Where contact came later than the table expects it, the wrist had begun to move before the object did: to take
        that back would move the object, so its motion counts from there.
        """
        offset = hand_offset(table.contact_pose, motion.pose, motion.rate, motion.acceleration)
        return after(self._offset_at_touch, offset)

    def _drive(self, table: PlanarTable, now_ns: int) -> HandSetPoint:
        """Excursion set-points, spool-side, of the winding coordinate."""
        w, rate_m_s, _ = self.winding
        assert self.reading is not None
        tension = self.reading.table_tension_N
        share = 1.0 + min(w, 0.0) / table.mean_contact_m  # of the contact load, while the springs alone resist
        settings, stretch = self._settings, table.compliance_m_per_N
        reversal = self._period_s / settings.reversal_time_s
        self._friction_sign = towards(self._friction_sign, sign(rate_m_s), reversal)
        spool_right_m, spool_left_m = (
            finger_excursion_m(table, i, w, settings.contact_zone_m) + tension[i] * share * stretch[i] for i in (0, 1)
        )
        right_m, left_m = (
            settings.drives[i].lead_m(tension[i] * share, rate_m_s, self._friction_sign, self._supply.volts[i])
            for i in (0, 1)
        )
        if self.phase is GraspPhase.FAULT:
            mode = HandMode.FREEZE
            self.following.forget()
        else:
            mode = HandMode.TRACK
            self.following.want((spool_right_m, spool_left_m), (right_m, left_m), now_ns)
        excursion_m = (spool_right_m + right_m, spool_left_m + left_m)
        self._set_point = HandSetPoint(excursion_m, (settings.load_cap_N,) * 2, mode)
        return self._set_point

    def _watch_pads(self, pads: PadWatch, hand: HandState | None, now_ns: int) -> None:
        """Tell the pads when the fingers are free: open, or on their way and not yet near the object. A zero is taken
        once the wrist is where the grasp begins."""
        prepositioned = self.phase is GraspPhase.PREPOSITIONED
        empty = hand is not None and max(hand.tension_N) < self._settings.empty_load_N
        is_open = (prepositioned or (self._opening.wanted and not self.compensated)) and empty
        approaching = self.phase is GraspPhase.CLOSING and not self._searching
        arrived, self._was_prepositioned = prepositioned and not self._was_prepositioned, prepositioned
        pads.step(free=is_open or approaching, take_zero=arrived, now_ns=now_ns)

    def _search(self, hand: HandState, now_ns: int) -> None:
        """Feed both fingers' contact search; both touching is contact."""
        assert self._contact is not None
        outcome = self._contact.take(
            hand, self._last_sample_ns, now_ns, rate_m_s=self.winding.rate_m_s, slow=self._searching
        )
        if outcome is Reason.NONE:
            self._grip(self._contact)
        elif outcome is not None:
            self._give_up(outcome)

    def _grip(self, contact: ContactSearch) -> None:
        """Both fingers touch: the index goes by where, and the command is completed once the tendons stand."""
        assert self._index is not None
        self._index.set_contact(contact.gripped_m, contact.onset_load_N)
        self._offset_at_touch = self._offset_before_touch(self._index.mean_shift_m)
        self.enter(GraspEvent.CONTACT_FOUND)
        self._stop_reason = Reason.NONE

    def _offset_before_touch(self, late_m: float) -> Vector3:
        """Hand offset when the fingers touched, `late_m` of mean excursion after the contact that the table expects."""
        assert self.table is not None
        sample = self.table.at_excursion(min(max(late_m, 0.0), self._settings.overdue_m), 0.0)
        if not sample.usable:
            return self._offset_at_touch
        return hand_offset(self.table.contact_pose, sample.pose, STILL.rate, STILL.acceleration).pose

    def _give_up(self, reason: Reason) -> None:
        """Open again and stay before the object."""
        assert self.table is not None
        self._end_token(EventKind.FAILED, reason)
        self.enter(GraspEvent.CLOSING_FAILED)
        self._opening.begin()

    def _halt(self, reason: Reason) -> None:
        if self._stop_reason is None or self._stop_reason is Reason.NONE:
            self._stop_reason = reason

    def _finish(self, now_ns: int) -> None:
        """What comes when the profile has ended or a halt has come to rest."""
        ended = self._profile.end_if_standing() if self._stop_reason is not None else self._profile.finished
        if not ended:
            return
        reason, self._stop_reason = self._stop_reason or Reason.NONE, None
        self.winding = self._profile.state
        if self.phase is GraspPhase.CLOSING:
            if not self._searching:
                self._searching = True
                self._profile.move(self._settings.search_end_m, rate_m_s=self._settings.contact_rate_m_s)
            else:
                assert self._contact is not None
                outcome = self._contact.conclude(now_ns)
                if outcome is Reason.NONE:
                    self._grip(self._contact)
                else:
                    self._give_up(outcome)
        elif self.phase is GraspPhase.CONTACT and self._token:
            assert self._contact is not None
            assert self.table is not None
            contact = self._contact
            told = (*contact.found_m, *self.table.contact_excursion_m, contact.object_offset_m)
            self._end_token(EventKind.COMPLETED, Reason.OFF_CENTRE if contact.off_centre else Reason.NONE, told)
        elif self.phase is GraspPhase.SQUEEZING:
            self.enter(GraspEvent.SQUEEZED)
            assert self._index is not None
            assert self.reading is not None
            values = (self.reading.mean_m, self._index.last_winding_load_N, self.reading.load_N)
            short = self.following.short_m > self._settings.short_m
            self._end_token(EventKind.COMPLETED, reason or (Reason.WOUND_SHORT if short else reason), values)
        elif self.phase is GraspPhase.HOLDING and self._token:
            self._end_token(EventKind.FAILED, reason)
        elif self.phase is GraspPhase.RELEASING:
            self.enter(GraspEvent.RELEASED)
            self._opening.begin()
            self._end_token(EventKind.COMPLETED, Reason.NONE)

    def _end_token(self, kind: EventKind, reason: Reason, values: tuple[float, ...] = ()) -> None:
        if self._token:
            self.outcomes.append(Outcome(kind, self._token, reason, values))
            self._token = 0
