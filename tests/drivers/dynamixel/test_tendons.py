"""The tendon pair and its motors against simulated motors on virtual time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.tendons import MotorSettings, TendonPair, TendonSample, TendonSetPoint
from drivers.errors import DeviceError, InputError, NoReplyError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

STEP_NS = 500_000
RADIUS_M = 0.0105
RIGHT = MotorSettings(motor_id=3, tightening_sign=1, zero_ticks=2048)
LEFT = MotorSettings(motor_id=1, tightening_sign=-1, zero_ticks=3000)
"""Mounted the other way round: what tightens it counts down."""


@dataclass
class Rig:
    """Springs, simulated motors and a driver, each on virtual time; `run` keeps them in step."""

    springs: SpringTendons = field(default_factory=lambda: SpringTendons((3000.0, 3000.0)))
    clock: VirtualClock = field(default_factory=VirtualClock)
    plant_ns: int = 0

    def __post_init__(self) -> None:
        right = SimulatedMotorSettings(3, ticks_at_zero_angle=2048)
        left = SimulatedMotorSettings(1, ticks_at_zero_angle=3000, direction=-1)
        self.motors = SimulatedMotors(self.springs, (right, left))
        self.line = MemoryLine(self.motors, self.clock)
        self.pair = self.new_pair()

    def new_pair(self) -> TendonPair:
        """A driver as after a restart of its process; the motors know nothing of it."""
        return TendonPair(WaitingPort(self.line, self.clock), self.clock, (RIGHT, LEFT))

    def catch_up(self) -> None:
        while self.plant_ns < self.clock.now_ns():
            self.motors.control(self.plant_ns, STEP_NS * 1e-9)
            self.springs.step(STEP_NS * 1e-9)
            self.plant_ns += STEP_NS

    def run(self, duration_s: float, set_point: TendonSetPoint | None) -> TendonSample:
        """Exchange every 5 ms; the last sample."""
        end_ns = self.clock.now_ns() + round(duration_s * 1e9)
        while True:
            sample = self.pair.exchange(set_point)
            self.clock.advance_to_ns(self.clock.now_ns() // 5_000_000 * 5_000_000 + 5_000_000)
            self.catch_up()
            if self.clock.now_ns() >= end_ns:
                return sample

    def heard_hex(self) -> list[str]:
        return [packet.hex() for packet in self.motors.heard]


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_start_identifies_and_does_not_move(rig: Rig) -> None:
    """Being switched on must not move a finger: present position as goal, small current, then torque."""
    identities = rig.pair.start()
    assert [(i.motor_id, i.model_name, i.adopted) for i in identities] == [
        (3, "XM430-W350", False),
        (1, "XM430-W350", False),
    ]
    for index, motor in enumerate(rig.motors.motors):
        assert motor.value("operating_mode") == 5
        assert motor.value("return_delay_time") == 0
        assert motor.value("torque_enable") == 1
        assert motor.value("goal_current") == 74
        assert motor.value("bus_watchdog") == 10
        assert motor.value("goal_position") == (2048, 3000)[index]
    addresses = [packet[8] for packet in rig.motors.heard if packet[4] == 3 and packet[7] == 0x03]
    order = [address for address in addresses if address in (11, 102, 116, 64, 98)]
    assert order == [11, 102, 116, 64, 98]  # mode, goal current, goal position, torque, watchdog


def test_excursion_follows_on_both_mountings(rig: Rig) -> None:
    """Excursion, rate and current are positive when tightening, whichever way round the motor is mounted."""
    rig.pair.start()
    for step in range(100):  # 20 mm/s
        sample = rig.run(0.005, TendonSetPoint((0.0001 * step, 0.0001 * step), (60.0, 60.0)))
    assert sample.rate_m_s == pytest.approx((0.02, 0.02), abs=0.004)
    assert min(sample.effort) > 0.13
    sample = rig.run(0.3, TendonSetPoint((0.0099, 0.0099), (60.0, 60.0)))
    truth_m = [RADIUS_M * rig.springs.shaft_angle_rad(m) for m in (0, 1)]
    assert sample.excursion_m == pytest.approx(truth_m, abs=2e-5)  # one tick is 16 µm
    assert sample.excursion_m == pytest.approx((0.0099, 0.0099), abs=4e-4)  # the position loop's stiffness
    # standing, the true tension lies in the band around the estimate
    for index in (0, 1):
        assert abs(rig.springs.tension_N(index) - sample.tension_N[index]) <= sample.tension_uncertainty_N[index]


def test_stall_at_the_load_cap_gives_the_cap_s_tension(rig: Rig) -> None:
    """The load cap is the tension at which a winding motor stops, far from its goal."""
    rig.pair.start()
    for step in range(500):  # slowly: the momentum of rotor and gear adds v·sqrt(k·J)/r, 1.2 N at 2 mm/s
        sample = rig.run(0.010, TendonSetPoint((2e-5 * step, 2e-5 * step), (20.0, 12.0)))
    sample = rig.run(0.5, TendonSetPoint((0.012, 0.012), (20.0, 12.0)))
    assert [rig.springs.tension_N(m) for m in (0, 1)] == pytest.approx([20.0, 12.0], abs=1.5)
    assert sample.effort == pytest.approx((20 * 0.0105 / 1.79 + 0.13, 12 * 0.0105 / 1.79 + 0.13), abs=0.003)


@pytest.mark.parametrize(
    ("excursion_m", "load_cap_N"),
    [
        ((math.nan, 0.0), (10.0, 10.0)),
        ((0.0, math.inf), (10.0, 10.0)),
        ((0.06, 0.0), (10.0, 10.0)),
        ((0.0, 0.0), (10.0, math.nan)),
        ((0.0, 0.0), (-1.0, 10.0)),
        ((0.0, 0.0), (10.0, 600.0)),
        ((0.001, 0.0), (10.0, 600.0)),
    ],
)
def test_bad_set_point_is_refused_and_nothing_is_sent(
    rig: Rig, excursion_m: tuple[float, float], load_cap_N: tuple[float, float]
) -> None:
    """NaN, out of travel or above the current limit: an error, no byte, and the old goals stay."""
    rig.pair.start()
    heard, goals = len(rig.motors.heard), [m.value("goal_position") for m in rig.motors.motors]
    with pytest.raises(InputError):
        rig.pair.exchange(TendonSetPoint(excursion_m, load_cap_N))
    assert len(rig.motors.heard) == heard
    rig.run(0.1, None)
    assert [m.value("goal_position") for m in rig.motors.motors] == goals


def test_adopting_keeps_torque_and_goals(rig: Rig) -> None:
    """A hand process that dies and comes back finds the object still in the hand, at the same tension."""
    rig.pair.start()
    rig.run(1.0, TendonSetPoint((0.008, 0.006), (50.0, 50.0)))
    goals = [(m.value("goal_position"), m.value("goal_current")) for m in rig.motors.motors]
    tension_N = [rig.springs.tension_N(m) for m in (0, 1)]
    rig.motors.heard.clear()
    rig.pair = rig.new_pair()
    assert [identity.adopted for identity in rig.pair.start()] == [True, True]
    rig.run(1.0, None)
    assert [(m.value("goal_position"), m.value("goal_current")) for m in rig.motors.motors] == goals
    assert [rig.springs.tension_N(m) for m in (0, 1)] == pytest.approx(tension_N, abs=0.1)
    torque_writes = [packet for packet in rig.motors.heard if packet[7] == 0x03 and packet[8:10] == b"\x40\x00"]
    assert torque_writes == []


def test_adopting_after_the_watchdog_tripped(rig: Rig) -> None:
    """While nobody talks to the motors they hold; whoever comes back takes over and can command again."""
    rig.pair.start()
    rig.run(1.0, TendonSetPoint((0.008, 0.008), (50.0, 50.0)))
    rig.clock.advance_to_ns(rig.clock.now_ns() + 1_000_000_000)
    rig.catch_up()
    assert [m.value("bus_watchdog") for m in rig.motors.motors] == [-1, -1]
    assert [RADIUS_M * rig.springs.shaft_angle_rad(m) for m in (0, 1)] == pytest.approx([0.008, 0.008], abs=4e-4)
    rig.pair = rig.new_pair()
    rig.pair.start()
    sample = rig.run(1.0, TendonSetPoint((0.004, 0.004), (50.0, 50.0)))
    assert sample.excursion_m == pytest.approx((0.004, 0.004), abs=4e-4)


def test_tripped_watchdog_is_seen_and_rearmed(rig: Rig) -> None:
    """A motor with a tripped watchdog swallows sync writes: it must show, and `rearm` must cure it in place."""
    rig.pair.start()
    rig.run(1.0, TendonSetPoint((0.008, 0.008), (50.0, 50.0)))
    rig.clock.advance_to_ns(rig.clock.now_ns() + 1_000_000_000)
    rig.catch_up()
    sample = rig.run(0.1, TendonSetPoint((0.003, 0.003), (50.0, 50.0)))
    assert sample.watchdog_tripped == (True, True)
    assert sample.excursion_m == pytest.approx((0.008, 0.008), abs=4e-4)
    rig.pair.rearm()
    sample = rig.run(0.3, None)
    assert sample.watchdog_tripped == (False, False)
    assert sample.excursion_m == pytest.approx((0.008, 0.008), abs=4e-4)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda m: m.write(7, b"\x05"), "tendon motor 1: no reply at 1000000 bit/s, protocol 2.0; the other"),
        (lambda m: m._values.update(model_number=1060), "are a XM430-W350 and a XL430-W250; expected two of one model"),
        (lambda m: m.trip(0x20), "hardware error: overload"),
        (lambda m: m._values.update(homing_offset=7), "Homing Offset 7"),
        (lambda m: m._values.update(firmware=37), "firmware 37"),
    ],
)
def test_start_refuses_before_it_writes(rig: Rig, spoil: Callable[[object], object], reason: str) -> None:
    """One unfit motor, and neither is touched: no write may have left."""
    spoil(rig.motors.motors[1])
    with pytest.raises(DeviceError, match=reason):
        rig.pair.start()
    assert {packet[7] for packet in rig.motors.heard} <= {0x01, 0x02}


def test_start_refuses_a_lost_zero() -> None:
    """A tendon wound by more than a turn loses its reference at power-off (reference 7.17): no goal may come of it."""
    rig = Rig(springs=SpringTendons((0.0, 0.0)))
    rig.springs._angle_rad[0] = -2.0
    rig.motors.control(0, 0.001)
    with pytest.raises(DeviceError, match=r"tendon motor 3: stands at -21.0 mm"):
        rig.pair.start()


def test_missed_exchange_repeats_the_last_values(rig: Rig) -> None:
    """A lost reply gives no value: the old ones with their old time, and a count that grows until it is cured."""
    rig.pair.start()
    good = rig.run(0.1, None)
    rig.motors.drop_answers(2)
    missed = [rig.pair.exchange() for _ in range(3)]
    assert [sample.missed for sample in missed] == [(1, 1), (2, 0), (0, 0)]
    assert missed[0].sample_ns == good.sample_ns
    assert missed[0].excursion_m == good.excursion_m
    assert missed[1].sample_ns[0] == good.sample_ns[0] < missed[1].sample_ns[1]
    assert isinstance(rig.pair.last_miss, NoReplyError)
    assert missed[2].oldest_ns > good.oldest_ns


def test_hardware_error_shows_in_the_same_exchange(rig: Rig) -> None:
    """A tripped motor is a slack tendon: the supervisor must know in the next sample, and why."""
    rig.pair.start()
    rig.run(0.05, None)
    rig.motors.trip(1, 0x20)
    sample = rig.pair.exchange()
    assert (sample.alert, sample.hardware_error) == ((False, True), (0, 0x20))
    assert rig.run(0.06, None).torque_on == (True, False)


def test_restarted_motor_shows(rig: Rig) -> None:
    """A motor that restarts unnoticed (a dip of the supply) has lost torque, without any alert bit."""
    rig.pair.start()
    rig.run(0.05, None)
    rig.motors.motors[0].reboot(rig.clock.now_ns())
    assert rig.run(0.2, None).missed[0] > 3
    sample = rig.run(0.5, None)
    assert (sample.missed, sample.torque_on) == ((0, 0), (False, True))


def test_freeze_keeps_tension_and_stops_winding(rig: Rig) -> None:
    """Frozen at rest the tension stays; frozen while stalled far from the goal, a lost object is not chased."""
    rig.pair.start()
    rig.run(1.0, TendonSetPoint((0.008, 0.008), (50.0, 50.0)))
    tension_N = [rig.springs.tension_N(m) for m in (0, 1)]
    rig.pair.freeze()
    rig.run(0.5, None)
    assert [rig.springs.tension_N(m) for m in (0, 1)] == pytest.approx(tension_N, abs=0.5)
    rig.run(0.5, TendonSetPoint((0.030, 0.030), (20.0, 20.0)))  # stalls at its cap
    rig.pair.freeze()
    before_m = rig.run(0.2, None).excursion_m
    rig.springs._stiffness_N_per_m = (0.0, 0.0)  # the object is gone
    after_m = rig.run(0.5, None).excursion_m
    assert max(b - a for a, b in zip(before_m, after_m, strict=True)) < 0.001


def test_stop_holds_and_open_opens(rig: Rig) -> None:
    """Exit never opens the hand, however long ago it was; opening is only ever asked for."""
    rig.pair.start()
    rig.run(1.0, TendonSetPoint((0.008, 0.008), (50.0, 50.0)))
    tension_N = [rig.springs.tension_N(m) for m in (0, 1)]
    rig.pair.stop()
    rig.clock.advance_to_ns(rig.clock.now_ns() + 2_000_000_000)
    rig.catch_up()
    assert [rig.springs.tension_N(m) for m in (0, 1)] == pytest.approx(tension_N, abs=0.1)
    assert [m.value("torque_enable") for m in rig.motors.motors] == [1, 1]
    rig.pair = rig.new_pair()
    rig.pair.start()
    rig.pair.open()
    assert rig.run(1.0, None).excursion_m == pytest.approx((0.0, 0.0), abs=2e-4)
    rig.pair.stop(release=True)
    assert [m.value("torque_enable") for m in rig.motors.motors] == [0, 0]


def test_stop_reaches_the_second_motor_when_the_first_is_dead(rig: Rig) -> None:
    """One dead motor must not leave the other with a watchdog that nobody feeds."""
    rig.pair.start()
    rig.motors.motors[0].silent_until_ns = 10**15
    with pytest.raises(NoReplyError, match="tendon motor 3"):
        rig.pair.stop()
    assert rig.motors.motors[1].value("bus_watchdog") == 0


def test_same_run_twice_gives_the_same_bytes() -> None:
    """Virtual time is deterministic: wire, motors, springs and driver together."""

    def run() -> tuple[list[str], list[TendonSample], int]:
        rig = Rig()
        rig.pair.start()
        samples = [rig.run(0.02, TendonSetPoint((1e-4 * i, 1.1e-4 * i), (30.0, 25.0))) for i in range(60)]
        return rig.heard_hex(), samples, rig.clock.now_ns()

    assert run() == run()


@pytest.mark.parametrize(
    "change",
    [
        {"tightening_sign": 0},
        {"motor_id": 254},
        {"travel_m": (0.02, 0.01)},
        {"spool_radius_m": 0.02},
        {"watchdog_s": 9.0},
    ],
)
def test_settings_refuse_what_no_hand_has(change: dict[str, object]) -> None:
    """Mounting data come from a file; a wrong sign or radius must not reach a motor."""
    settings: dict[str, object] = {"motor_id": 1, "tightening_sign": 1, "zero_ticks": 0, **change}
    with pytest.raises(InputError, match=next(iter(change))):
        MotorSettings(**settings)  # type: ignore[arg-type]  # wrong on purpose
