"""The hand process on virtual time, with the real driver and simulated motors that pull on springs."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from controller.messages import HandFault, HandMode, HandSetPoint, HandState, Pair
from controller.service.hand import HandPart, HandSettings
from controller.service.links import LatestReader, LatestSender, VirtualLink
from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.tendons import MotorSettings, TendonPair
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

PHYSICS_NS = 500_000
CAPS_N = (60.0, 60.0)
TICK_M = 2 * math.pi / 4096 * 0.0105
MOTORS = (MotorSettings(motor_id=1, tightening_sign=1, zero_ticks=600), MotorSettings(2, -1, 3500))
SETTINGS = HandSettings(period_s=0.005)


class Rig:
    """A hand process, its links, and the springs behind its motors, all on one clock."""

    def __init__(
        self,
        *,
        motors: SimulatedMotors | None = None,
        springs: SpringTendons | None = None,
        model: MotorModel = XM430_W350,
    ) -> None:
        self.clock = VirtualClock()
        self.springs = springs or SpringTendons((3000.0, 3000.0))
        right, left = SimulatedMotorSettings(1, 600, 1, model), SimulatedMotorSettings(2, 3500, -1, model)
        self.motors = motors or SimulatedMotors(self.springs, (right, left))
        self._physics_ns = 0
        self.set_point_link = VirtualLink(self.clock, self.clock, capacity=1000)
        states = VirtualLink(self.clock, self.clock, capacity=1000)
        self.set_points = LatestSender(self.set_point_link)
        self.states = LatestReader(states)
        line = MemoryLine(self.motors, self.clock)
        right_motor, left_motor = (replace(motor, model=model.name) for motor in MOTORS)
        self.pair = TendonPair(WaitingPort(line, self.clock), self.clock, (right_motor, left_motor))
        self.hand = HandPart(self.clock, self.pair, LatestReader(self.set_point_link), LatestSender(states), SETTINGS)

    def start(self) -> None:
        self.hand.start()

    def command(self, excursion_m: Pair, mode: HandMode = HandMode.TRACK, cap_N: Pair = CAPS_N) -> None:
        self.set_points.send(HandSetPoint(excursion_m, cap_N, mode).pack(), self.clock.now_ns())

    def run(
        self, duration_s: float, excursion_m: Pair | None = None, mode: HandMode = HandMode.TRACK, cap_N: Pair = CAPS_N
    ) -> HandState:
        """Step the hand and the springs; with an excursion the cycle sends its set-point before every step."""
        end_ns = self.clock.now_ns() + round(duration_s * 1e9)
        while self.clock.now_ns() < end_ns:
            if excursion_m is not None:
                self.command(excursion_m, mode, cap_N)
            self.hand.step()
            self.clock.sleep_until_ns(self.hand.pacer.deadline_ns)
            self.catch_up()
        return self.state()

    def catch_up(self) -> None:
        while self._physics_ns < self.clock.now_ns():
            self.motors.control(self._physics_ns, PHYSICS_NS * 1e-9)
            self.springs.step(PHYSICS_NS * 1e-9)
            self._physics_ns += PHYSICS_NS

    def state(self) -> HandState:
        newest = self.states.newest()
        assert newest is not None
        return HandState.unpack(newest[0])

    def age_ns(self) -> int:
        self.states.newest()
        age = self.states.age_ns(self.clock.now_ns())
        assert age is not None
        return age

    def true_excursion_m(self) -> Pair:
        right, left = (0.0105 * self.springs.shaft_angle_rad(motor) for motor in (0, 1))
        return right, left


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    rig.start()
    return rig


def test_follows_the_cycle_and_reports(rig: Rig) -> None:
    """Right goes where right is sent, left where left is: true spools, reported excursions and ages agree."""
    state = rig.run(1.0, (0.008, 0.005))
    assert state.mode is HandMode.TRACK
    assert state.fault is HandFault.NONE
    assert state.excursion_m == pytest.approx((0.008, 0.005), abs=4e-4)
    assert rig.true_excursion_m() == pytest.approx(state.excursion_m, abs=TICK_M)
    assert rig.springs.tension_N(0) > rig.springs.tension_N(1) > 5.0
    assert rig.age_ns() <= 5_000_000


def test_without_a_set_point_nothing_moves(rig: Rig) -> None:
    """A hand that starts before the cycle waits; it publishes what it sees."""
    before = rig.true_excursion_m()
    state = rig.run(0.5)
    assert rig.true_excursion_m() == pytest.approx(before, abs=1e-6)
    assert state.mode is HandMode.FREEZE
    assert state.fault is HandFault.NONE


def test_stale_set_points_freeze_the_excursions(rig: Rig) -> None:
    """The cycle falls silent in the midst of winding: within 0.1 s the tendons stand, and stay so, still pulling."""
    rig.run(1.0, (0.008, 0.008))
    for step in range(20):
        rig.run(0.005, (0.008 + step * 2e-5, 0.008 + step * 2e-5))
    rig.run(0.15)
    frozen, tension_N = rig.true_excursion_m(), rig.springs.tension_N(0)
    state = rig.run(1.0)
    assert state.mode is HandMode.FREEZE
    assert rig.true_excursion_m() == pytest.approx(frozen, abs=2 * TICK_M)
    assert rig.springs.tension_N(0) == pytest.approx(tension_N, rel=0.02)
    rig.run(0.3, (0.010, 0.010))
    assert rig.state().mode is HandMode.TRACK


def test_a_stalled_motor_does_not_go_on_pulling_when_frozen() -> None:
    """Frozen short of a goal that its cap kept it from, a motor holds where it is, even when the cap is raised."""
    rig = Rig(springs=SpringTendons((20_000.0, 20_000.0)))
    rig.start()
    rig.run(1.0, (0.010, 0.010), cap_N=(40.0, 40.0))
    stalled = rig.true_excursion_m()
    assert stalled[0] < 0.005
    rig.run(0.5, (0.010, 0.010), HandMode.FREEZE, cap_N=(120.0, 120.0))
    assert rig.true_excursion_m() == pytest.approx(stalled, abs=2e-4)


def test_a_closed_link_freezes_at_once(rig: Rig) -> None:
    """The cycle process is gone: no waiting for the set-point's age."""
    rig.run(1.0, (0.008, 0.008))
    rig.command((0.012, 0.012))
    rig.set_point_link.close()
    state = rig.run(0.5)
    assert state.mode is HandMode.FREEZE
    assert rig.true_excursion_m() == pytest.approx((0.008, 0.008), abs=4e-4)


def test_a_restarted_process_adopts_what_is_held(rig: Rig) -> None:
    """Restarted under load, without a word from the cycle, it lets go of nothing."""
    rig.run(1.0, (0.009, 0.007))
    held, tension_N = rig.true_excursion_m(), rig.springs.tension_N(0)
    again = Rig(motors=rig.motors, springs=rig.springs)
    again.clock.advance_to_ns(rig.clock.now_ns())
    again._physics_ns = rig._physics_ns
    again.start()
    again.run(0.5)
    assert again.true_excursion_m() == pytest.approx(held, abs=2 * TICK_M)
    assert again.springs.tension_N(0) == pytest.approx(tension_N, rel=0.05)


def test_the_end_of_the_process_opens_nothing(rig: Rig) -> None:
    """Exit never opens the hand: the motors hold by themselves, for as long as nobody asks them."""
    rig.run(1.0, (0.008, 0.008))
    held = rig.true_excursion_m()
    rig.hand.stop()
    for _ in range(400):
        rig.clock.advance_to_ns(rig.clock.now_ns() + 5_000_000)
        rig.catch_up()
    assert rig.true_excursion_m() == pytest.approx(held, abs=2 * TICK_M)
    assert rig.springs.tension_N(0) > 15.0


def test_opens_at_its_own_rate_and_only_when_asked(rig: Rig) -> None:
    """Open pays out from where the tendons are, no faster than the opening rate, down to zero."""
    rig.run(1.0, (0.008, 0.008))
    before_m = rig.state().excursion_m[0]
    rates = []
    for _ in range(60):
        now_m = rig.run(0.02, (0.0, 0.0), HandMode.OPEN).excursion_m[0]
        rates.append((now_m - before_m) / 0.02)
        before_m = now_m
    assert min(rates) > -1.6 * SETTINGS.opening_rate_m_s
    assert max(rates) < 2e-3
    assert rig.state().excursion_m == pytest.approx((0.0, 0.0), abs=4e-4)


@pytest.mark.parametrize(
    ("excursion_m", "cap_N"), [((0.5, 0.005), CAPS_N), ((math.nan, 0.005), CAPS_N), ((0.005, 0.005), (1e4, 60.0))]
)
def test_an_impossible_set_point_is_refused_and_told(rig: Rig, excursion_m: Pair, cap_N: Pair) -> None:
    """Out of travel, not a number, above the current limit: neither motor moves, and the cycle hears why."""
    rig.run(1.0, (0.006, 0.006))
    held = rig.true_excursion_m()
    state = rig.run(0.2, excursion_m, cap_N=cap_N)
    assert state.fault is HandFault.REFUSED
    assert rig.true_excursion_m() == pytest.approx(held, abs=2 * TICK_M)
    assert rig.run(0.2, (0.006, 0.006)).fault is HandFault.NONE


def test_missing_answers_are_a_fault_only_when_they_go_on(rig: Rig) -> None:
    """A few lost answers are told by the sample's age alone; ten in a row are a fault, which ends with them."""
    rig.run(0.5, (0.006, 0.006))
    rig.motors.drop_answers(5)
    assert rig.run(0.02, (0.006, 0.006)).fault is HandFault.NONE
    rig.motors.drop_answers(10**6)
    state = rig.run(0.5, (0.006, 0.006))
    assert state.fault is HandFault.NO_REPLY
    assert rig.age_ns() > 300_000_000
    rig.motors.drop_answers(0)
    assert rig.run(0.1, (0.006, 0.006)).fault is HandFault.NONE
    assert rig.age_ns() <= 6_000_000


def test_a_tripped_motor_is_told_as_lost_torque(rig: Rig) -> None:
    """Overload lets the tendon go: the object may have been dropped, and the cycle must know."""
    rig.run(1.0, (0.008, 0.008))
    rig.motors.trip(1, 0x20)
    state = rig.run(0.1, (0.008, 0.008))
    assert state.fault == HandFault.TORQUE_LOST | HandFault.HARDWARE | HandFault.OVERLOADED


def test_a_tripped_watchdog_is_cleared_and_the_hand_follows_again(rig: Rig) -> None:
    """A pause of the process makes the motors stop and hold; afterwards they are taken up where they stand."""
    rig.run(1.0, (0.008, 0.008))
    for _ in range(200):
        rig.clock.advance_to_ns(rig.clock.now_ns() + 5_000_000)
        rig.catch_up()
    held = rig.true_excursion_m()
    state = rig.run(0.1, held)
    assert state.fault is HandFault.NONE
    assert rig.true_excursion_m() == pytest.approx(held, abs=2e-4)
    assert rig.run(1.0, (0.010, 0.010)).excursion_m == pytest.approx((0.010, 0.010), abs=5e-4)


def test_a_lost_answer_while_rearming_is_survived(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """One missing status packet after a tripped watchdog costs a round, not the hand process."""
    rig.run(1.0, (0.008, 0.008))
    for _ in range(200):
        rig.clock.advance_to_ns(rig.clock.now_ns() + 5_000_000)
        rig.catch_up()
    rearm, lost = rig.pair.rearm, [1]

    def lossy() -> None:
        if lost:
            rig.motors.drop_answers(lost.pop())
        rearm()

    monkeypatch.setattr(rig.pair, "rearm", lossy)
    rig.run(0.3, rig.true_excursion_m())
    assert rig.run(1.0, (0.010, 0.010)).excursion_m == pytest.approx((0.010, 0.010), abs=5e-4)


def test_the_state_carries_what_the_motors_say_of_themselves(rig: Rig) -> None:
    """Temperature, voltage, uncertainty and the read rate: for the record and for the operator."""
    state = rig.run(1.0, (0.006, 0.006))
    assert state.temperature_C == pytest.approx((30.0, 30.0), abs=1.0)
    assert state.voltage_V == pytest.approx((12.0, 12.0))
    assert min(state.tension_uncertainty_N) > 1.0
    assert state.derating == (1.0, 1.0)
    assert state.read_rate_hz == pytest.approx(200.0, rel=0.05)


def test_a_refused_set_point_does_not_stop_the_samples(rig: Rig) -> None:
    """Out of travel is the cycle's mistake; it must go on seeing its tendons."""
    rig.run(0.5, (0.006, 0.006))
    assert rig.run(0.3, (0.5, 0.005)).fault is HandFault.REFUSED
    assert rig.age_ns() <= 6_000_000


def test_a_freeze_under_an_impossible_cap_freezes_all_the_same() -> None:
    """The reaction to a fault may not depend on a number being right."""
    rig = Rig(springs=SpringTendons((20_000.0, 20_000.0)))
    rig.start()
    rig.run(1.0, (0.010, 0.010), cap_N=(40.0, 40.0))
    stalled = rig.true_excursion_m()
    rig.run(0.5, (0.010, 0.010), HandMode.FREEZE, cap_N=(1e4, math.nan))
    assert rig.state().mode is HandMode.FREEZE
    assert rig.true_excursion_m() == pytest.approx(stalled, abs=2e-4)


@pytest.mark.parametrize("model", [XM430_W350, MX_28], ids=lambda model: model.name)
def test_a_restarted_motor_is_switched_on_only_by_opening(model: MotorModel) -> None:
    """It dropped what it held; set-points must not clamp it shut again, but the hand can be opened and used again."""
    rig = Rig(model=model)
    rig.start()
    rig.run(1.0, (0.008, 0.008))
    rig.motors.motors[0].reboot(rig.clock.now_ns())
    state = rig.run(0.8, (0.008, 0.008))
    assert state.fault == HandFault.TORQUE_LOST | HandFault.RESTARTED
    assert rig.motors.motors[0].value("torque_enable") == 0
    state = rig.run(0.5, (0.0, 0.0), HandMode.OPEN)
    assert state.fault is HandFault.NONE
    assert rig.motors.motors[0].value("torque_enable") == 1


def test_one_dead_motor_is_told_within_100_ms_while_the_other_is_held(rig: Rig) -> None:
    """Its plug came off: no reply; and the sample's age is that of the dead one."""
    rig.run(0.5, (0.008, 0.008))
    held_N = rig.springs.tension_N(1)
    rig.motors.motors[0].silent_until_ns = 10**15
    state = rig.run(0.1, (0.008, 0.008), HandMode.FREEZE)
    assert state.fault == HandFault.NO_REPLY | HandFault.ONE_SILENT
    assert rig.age_ns() > 80_000_000
    assert rig.springs.tension_N(1) == pytest.approx(held_N, rel=0.05)


def test_a_motor_in_another_mode_is_told_and_kept(rig: Rig) -> None:
    """The hand process starts all the same: what is held is watched, not dropped."""
    rig.run(1.0, (0.008, 0.008))
    held_N = rig.springs.tension_N(0)
    rig.hand.stop()
    rig.motors.motors[0]._values["operating_mode"] = 3
    rig.motors.motors[0]._prepare()
    again = Rig(motors=rig.motors, springs=rig.springs)
    again.clock.advance_to_ns(rig.clock.now_ns())
    again._physics_ns = rig._physics_ns
    again.start()
    state = again.run(0.3, (0.012, 0.012))
    assert state.fault == HandFault.OTHER_MODE | HandFault.REFUSED
    assert again.springs.tension_N(0) == pytest.approx(held_N, rel=0.05)


def test_what_is_amiss_with_the_motors_is_told_once(rig: Rig) -> None:
    """Adopted motors that would have been refused, and ones that cannot be brought up again: the operator must know."""
    rig.run(1.0, (0.008, 0.008))
    rig.hand.stop()
    rig.motors.motors[0].put("shutdown", 0x20)
    rig.motors.motors[1].put("drive_mode", 1)
    again = Rig(motors=rig.motors, springs=rig.springs)
    again.clock.advance_to_ns(rig.clock.now_ns())
    again._physics_ns = rig._physics_ns
    again.start()
    right, left = again.hand.take_warnings()
    assert right.startswith("tendon motor 1 does not shut down on overheating, electrical shock (Shutdown 32).")
    assert left.startswith("tendon motor 2 has Drive Mode 1, reverse")
    assert again.hand.take_warnings() == []
    assert HandFault.OTHER_MODE in again.run(0.1).fault


def test_a_motor_that_cannot_be_brought_up_says_why(rig: Rig) -> None:
    """Asked to open after a restart, with its tendon off and its spool where no excursion is."""
    rig.run(1.0, (0.008, 0.008))
    rig.motors.motors[0].reboot(rig.clock.now_ns())
    rig.springs._stiffness_N_per_m = (0.0, 3000.0)
    rig.springs._angle_rad[0] = (4050 - 600) * TICK_M / 0.0105
    rig.run(0.8, (0.008, 0.008))
    rig.run(0.5, (0.0, 0.0), HandMode.OPEN)
    assert "lost its turn or its zero is wrong" in rig.hand.take_warnings()[-1]
