"""Strokes under weights and scales on real bytes and virtual time: the simulated motors' own law comes back."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from calibration.motor_load import Acceptance, LoadFit, Reading, fit_load_law
from calibration.motor_load_plan import LoadPlan, plan_load
from controller.motor_load_run import LoadRun, held
from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MX_28, XM430_W350, MotorModel
from drivers.dynamixel.load_law import published_law
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.errors import DeviceError, InputError, StillgraspError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.hanging_weights import HangingWeights
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

STEP_NS = 1_000_000
RADIUS_M = 0.0105
TAUT_TICKS = 600
GRAVITY_M_S2 = 9.80665
MASSES_KG = (0.5, 2.0, 5.0)


class PlantClock(VirtualClock):
    """Moves motors and plant on whenever somebody sleeps; `at` does things at their times."""

    def __init__(self, motors: SimulatedMotors, plant: HangingWeights | SpringTendons) -> None:
        super().__init__()
        self._motors, self._plant, self._plant_ns = motors, plant, 0
        self.at: dict[int, Callable[[], object]] = {}

    def sleep_until_ns(self, deadline_ns: int) -> None:
        super().sleep_until_ns(deadline_ns)
        while self._plant_ns < self.now_ns():
            self._motors.control(self._plant_ns, STEP_NS * 1e-9)
            self._plant.step(STEP_NS * 1e-9)
            self._plant_ns += STEP_NS
        for time_ns in [time_ns for time_ns in self.at if time_ns <= self._plant_ns]:
            self.at.pop(time_ns)()


class Rig:
    """Two motors on weights, or on springs of this stiffness; effort noise of a count."""

    def __init__(self, model: MotorModel, spring_N_per_m: float | None = None, supply_V: float = 12.0) -> None:
        self.model, self.electrics = model, electrics_of(model)
        spool = {"friction_Nm": self.electrics.gear_friction_Nm, "inertia_kgm2": self.electrics.inertia_kgm2}
        self.weights = HangingWeights((0.0, 0.0), **spool)
        self.springs = SpringTendons((spring_N_per_m or 0.0,) * 2, (0.0, 0.0), **spool)
        plant = self.weights if spring_N_per_m is None else self.springs
        mounted = [SimulatedMotorSettings(motor_id, TAUT_TICKS, 1, model) for motor_id in (1, 2)]
        self.motors = SimulatedMotors(plant, mounted, noise_counts=1.0, supply_V=supply_V)
        law = published_law(model, RADIUS_M)
        right, left = (MotorSettings(i, 1, TAUT_TICKS, load_law=law, model=model.name) for i in (1, 2))
        self.settings = right, left
        self.clock = PlantClock(self.motors, plant)
        line = MemoryLine(self.motors, self.clock)
        self.pair = TendonPair(WaitingPort(line, self.clock), self.clock, self.settings)
        self.pair.start()

    def run(self, scale: bool = False, masses_kg: tuple[float, ...] = MASSES_KG) -> tuple[LoadRun, LoadPlan]:
        plan = plan_load(
            self.model,
            self.settings[0].load_law,
            travel_m=self.settings[0].travel_m,
            start_m=0.0,
            scale=scale,
            tensions_N=() if scale else [GRAVITY_M_S2 * mass_kg for mass_kg in masses_kg],
            stroke_m=None if scale else 0.005,
            speeds_m_s=(0.006,) if scale else (0.005,) if self.model.effort == "current" else (0.004, 0.008),
            up_only=True,
        )
        run = LoadRun(self.pair, self.clock, self.settings, 0, plan, 0.010)
        run.go(plan.start_m)
        return run, plan

    def hang(self, run: LoadRun, mass_kg: float, drop_m: float = 0.0) -> None:
        self.weights.hang(0, mass_kg, drop_m)
        for _ in range(50):
            run.hold()

    def check(self, fit: LoadFit) -> None:
        """Against the numbers that the simulated motor is made of."""
        electrics = self.electrics
        slope_Nm, friction, back_emf = electrics.torque_constant_Nm_per_A, electrics.friction_current_A, 0.0
        if self.model.effort == "load":
            slope_Nm *= 12.0 / electrics.resistance_ohm
            friction *= electrics.resistance_ohm / 12.0
            back_emf = electrics.back_emf_V_s / RADIUS_M / 12.0
        assert fit.refusal(Acceptance()) == ""
        assert fit.law.torque_per_effort_Nm == pytest.approx(slope_Nm, rel=0.03)
        assert fit.law.friction_effort == pytest.approx(friction, rel=0.10)
        assert fit.law.back_emf_effort_s_per_m == pytest.approx(back_emf, rel=0.10)


@pytest.mark.parametrize(("model", "supply_V"), [(XM430_W350, 12.0), (MX_28, 13.5)], ids=["XM430-W350", "MX-28"])
def test_weights_give_the_motors_law(model: MotorModel, supply_V: float) -> None:
    """With noise, counts, and weights let go from 2 mm above, that bounce: K within 3 %, friction within 10 %."""
    rig = Rig(model, supply_V=supply_V)
    run, plan = rig.run()
    readings: list[Reading] = []
    for tension_N in plan.steps_N:
        rig.hang(run, tension_N / GRAVITY_M_S2, 0.002)
        readings += run.weigh(tension_N, f"{tension_N:.0f} N")
    rig.check(fit_load_law(readings, model, RADIUS_M))
    assert run.hold().torque_on == (True, True)


def test_a_spring_scale_gives_the_motors_law() -> None:
    """The operator reads it when the spool stands; the motor was read on the way there, in both directions."""
    rig = Rig(XM430_W350, spring_N_per_m=2500.0)
    run, plan = rig.run(scale=True)
    readings = []
    for step, level_N in enumerate(plan.steps_N):
        read = run.approach(level_N, plan.motion(step), plan.speed_m_s(step), f"step {step + 1}")
        said_N = rig.springs.tension_N(0)
        assert said_N == pytest.approx(level_N, abs=4.0)
        readings.append(read(round(said_N * 2.0) / 2.0))  # half a newton is what a scale shows
    rig.check(fit_load_law(readings, XM430_W350, RADIUS_M))


def test_a_rigid_scale_is_refused() -> None:
    """Wound by a tenth of a millimetre, a motor tells nothing that could be averaged."""
    rig = Rig(XM430_W350, spring_N_per_m=60_000.0)
    run, plan = rig.run(scale=True)
    with pytest.raises(InputError, match=r"step 1: only 0\.\d\d mm were wound evenly.*Tie a spring"):
        run.approach(plan.steps_N[0], plan.motion(0), plan.speed_m_s(0), "step 1")


def test_a_scale_that_gives_way_too_far_is_refused() -> None:
    """The travel ends before the level: nothing is wound beyond it."""
    rig = Rig(XM430_W350, spring_N_per_m=400.0)
    run, plan = rig.run(scale=True)
    with pytest.raises(InputError, match=r"40 N were not reached within 49\.5 mm"):
        run.approach(40.0, plan.motion(0), 0.02, "step 4")
    assert run.hold().excursion_m[0] <= rig.settings[0].travel_m[1] + 1e-4


def test_a_weight_that_comes_off_within_a_stroke_is_noticed() -> None:
    """The mean of something that changed belongs to no weight."""
    rig = Rig(XM430_W350)
    run, plan = rig.run()
    rig.hang(run, 5.0)
    rig.clock.at[rig.clock.now_ns() + 1_300_000_000] = lambda: rig.weights.hang(0, 0.0)
    with pytest.raises(InputError, match=r"the load changed by \d+\.\d N within the stroke"):
        run.weigh(plan.steps_N[-1], "step 3")


def test_a_weight_that_hangs_on_nothing_is_noticed() -> None:
    """Enter was pressed before it hung, or the cord was on the floor."""
    rig = Rig(XM430_W350)
    run, plan = rig.run()
    with pytest.raises(InputError, match=r"carries some 0 N; expected about 49"):
        run.weigh(plan.steps_N[-1], "step 3")


def _too_heavy(rig: Rig) -> None:
    rig.weights.hang(0, 20.0)


def _much_too_heavy(rig: Rig) -> None:
    rig.weights.hang(0, 45.0)


def _overload(rig: Rig) -> None:
    rig.motors.trip(0, 0x20)


def _restart(rig: Rig) -> None:
    rig.motors.motors[0].power_up()


def _silence(rig: Rig) -> None:
    rig.motors.motors[0].mute = True


def _heat(rig: Rig) -> None:
    rig.motors.motors[0].stress.held_at_C = 70.0


@pytest.mark.parametrize(
    ("trouble", "told"),
    [
        (_too_heavy, "mm from where it shall be"),
        (_much_too_heavy, r"mm from where it shall be|position jumped"),
        (_overload, "overload and may have let go"),
        (_restart, "let go: it restarted"),
        (_silence, "tendon motor 1"),
        (_heat, "is at 70 °C"),
    ],
)
def test_a_motor_in_trouble_ends_the_run(trouble: Callable[[Rig], None], told: str) -> None:
    """Told at once, with what to do; the other motor, and this one if it still can, go on holding."""
    rig = Rig(XM430_W350)
    run, _ = rig.run()
    trouble(rig)
    with pytest.raises(StillgraspError, match=told) as ended:
        run.go(0.010, 0.005)
    assert isinstance(ended.value, DeviceError)
    assert rig.motors.motors[1].value("torque_enable") == 1
    if trouble in (_too_heavy, _silence, _heat):
        assert rig.motors.motors[0].value("torque_enable") == 1


@pytest.mark.parametrize("silent", [False, True])
def test_whoever_interrupts_it_leaves_the_weight_hanging(silent: bool) -> None:
    """Ctrl-C in the middle of a stroke: the spool stops, torque stays on, and no watchdog ends it when all is quiet."""
    rig = Rig(XM430_W350)
    run, _ = rig.run()
    rig.hang(run, 5.0)

    def interrupt() -> None:
        rig.motors.motors[1].mute = silent
        raise KeyboardInterrupt

    rig.clock.at[rig.clock.now_ns() + 500_000_000] = interrupt
    with pytest.raises(KeyboardInterrupt), held(rig.pair):
        run.go(0.010, 0.005)
    rig.clock.sleep_until_ns(rig.clock.now_ns() + 3_000_000_000)
    motor = rig.motors.motors[0]
    assert (motor.value("torque_enable"), motor.value("bus_watchdog")) == (1, 0)
    assert 0.0015 < rig.weights.shaft_angle_rad(0) * RADIUS_M < 0.0035
    assert rig.weights.tension_N(0) == pytest.approx(5.0 * GRAVITY_M_S2, rel=0.01)


def test_the_other_motor_stays_where_it_is() -> None:
    """Calibrating one finger must not turn the other's spool."""
    rig = Rig(XM430_W350)
    run, _ = rig.run()
    before_m = run.hold().excursion_m[1]
    run.go(0.006)
    sample = run.hold()
    assert sample.excursion_m[0] == pytest.approx(0.006, abs=3e-4)
    assert math.isclose(sample.excursion_m[1], before_m, abs_tol=5e-5)
