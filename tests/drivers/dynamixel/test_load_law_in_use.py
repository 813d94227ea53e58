"""The data sheet's load law on simulated motors with gear friction: is the springs' own tension within its band?"""

from __future__ import annotations

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.control_tables import MX_28, MX_28_2, RX_28, XL430_W250, MotorModel
from drivers.dynamixel.load_law import nominal_law
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings, taut_ticks
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

STEP_NS = 1_000_000
EXCHANGE_NS = 10_000_000


class Rig:
    """Two motors of a model on springs of 3 N/mm."""

    def __init__(self, model: MotorModel, supply_V: float) -> None:
        electrics = electrics_of(model)
        law = nominal_law(model, 0.0105)
        first = MotorSettings(1, 1, taut_ticks(model), load_law=law, model=model.name)
        second = MotorSettings(2, 1, taut_ticks(model), load_law=law, model=model.name)
        self.springs = SpringTendons(friction_Nm=electrics.gear_friction_Nm, inertia_kgm2=electrics.inertia_kgm2)
        mounted = [SimulatedMotorSettings(motor_id, taut_ticks(model), 1, model) for motor_id in (1, 2)]
        self.motors = SimulatedMotors(self.springs, mounted, supply_V=supply_V)
        self.clock = VirtualClock()
        line = MemoryLine(self.motors, self.clock)
        self.pair = TendonPair(WaitingPort(line, self.clock), self.clock, (first, second))
        self._plant_ns = 0
        self.outside: list[tuple[float, float, float]] = []
        self.samples = 0

    def go(self, start_m: float, end_m: float, cap_N: float, steps: int) -> float:
        """Along a ramp; every estimate is compared with the spring as it is then. The largest true tension, N."""
        largest_N = 0.0
        for step in range(steps):
            goal_m = start_m + (end_m - start_m) * min(1.0, step / (0.6 * steps))
            self.pair.set_excursion(goal_m, goal_m, (cap_N, cap_N))
            sample = self.pair.exchange()
            self._compare(sample.tension_N[0], sample.tension_uncertainty_N[0])
            self.clock.advance_to_ns(self.clock.now_ns() // EXCHANGE_NS * EXCHANGE_NS + EXCHANGE_NS)
            while self._plant_ns < self.clock.now_ns():
                self.motors.control(self._plant_ns, STEP_NS * 1e-9)
                self.springs.step(STEP_NS * 1e-9)
                self._plant_ns += STEP_NS
            largest_N = max(largest_N, self.springs.tension_N(0))
        return largest_N

    def _compare(self, tension_N: float, uncertainty_N: float) -> None:
        true_N = self.springs.tension_N(0)
        self.samples += 1
        if abs(tension_N - true_N) > uncertainty_N:
            self.outside.append((true_N, tension_N, uncertainty_N))


@pytest.mark.parametrize("supply_V", [12.0, 14.8])
@pytest.mark.parametrize("model", [RX_28, MX_28, MX_28_2, XL430_W250], ids=lambda model: model.name)
def test_the_band_covers_the_truth_wound_held_and_unwound(model: MotorModel, supply_V: float) -> None:
    """At 10 mm/s, at rest and back: all but the samples of a reversal, in which the motor is neither here nor there."""
    rig = Rig(model, supply_V)
    rig.pair.start()
    largest_N = rig.go(0.0, 0.012, 60.0, 200)
    rig.go(0.012, 0.002, 60.0, 200)
    assert 25.0 < largest_N < 60.0
    assert len(rig.outside) <= 0.03 * rig.samples, rig.outside


@pytest.mark.parametrize("supply_V", [12.0, 14.8])
@pytest.mark.parametrize("model", [RX_28, MX_28, MX_28_2, XL430_W250], ids=lambda model: model.name)
def test_a_higher_supply_pulls_no_harder_than_the_cap(model: MotorModel, supply_V: float) -> None:
    """The ceiling is a part of the supply: at 14.8 V the same part would pull a fifth more."""
    rig = Rig(model, supply_V)
    rig.pair.start()
    assert 0.5 * 20.0 < rig.go(0.0, 0.020, 20.0, 300) < 20.0
