"""Processor time of a virtual minute: the tendon driver at 200 Hz in front of simulated motors on springs.

    python -m benchmarks.bench_motors [--json] [--seconds N]

Both motors wind up and down slowly, each model in turn. Printed are processor time of one thread per virtual minute,
the simulated motors' part of it, and the median virtual time of an exchange. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from typing import Any

from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.dynamixel.control_tables import MODELS, MotorModel
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair, TendonSetPoint
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings, taut_ticks
from drivers.simulated.dynamixel_electrics import electrics_of
from drivers.simulated.serial_lines import MemoryLine
from drivers.simulated.spring_tendons import SpringTendons

PERIOD_NS = nanoseconds(0.005)
STEP_NS = nanoseconds(0.0005)


def virtual_minute(model: MotorModel, duration_s: float) -> dict[str, Any]:
    """Run it for `duration_s` of virtual time; figures for a minute."""
    electrics, zero_ticks = electrics_of(model), taut_ticks(model)
    springs = SpringTendons(friction_Nm=electrics.gear_friction_Nm, inertia_kgm2=electrics.inertia_kgm2)
    motors = SimulatedMotors(springs, [SimulatedMotorSettings(number, zero_ticks, model=model) for number in (1, 2)])
    clock, plant_ns, plant_s = VirtualClock(), 0, 0.0
    pair = TendonPair(
        WaitingPort(MemoryLine(motors, clock), clock),
        clock,
        (
            MotorSettings(motor_id=1, tightening_sign=1, zero_ticks=zero_ticks, model=model.name),
            MotorSettings(motor_id=2, tightening_sign=1, zero_ticks=zero_ticks, model=model.name),
        ),
    )
    pair.start()
    plant_ns = clock.now_ns()
    end_ns, ages_ms = clock.now_ns() + nanoseconds(duration_s), []
    begin_s = time.process_time()
    while clock.now_ns() < end_ns:
        start_ns = clock.now_ns()
        excursion_m = 0.003 - 0.003 * math.cos(seconds(start_ns))
        pair.exchange(TendonSetPoint((excursion_m, excursion_m), (40.0, 40.0)))
        ages_ms.append((clock.now_ns() - start_ns) * 1e-6)
        clock.advance_to_ns(max(clock.now_ns(), start_ns + PERIOD_NS))
        plant_begin_s = time.process_time()
        while plant_ns < clock.now_ns():
            motors.control(plant_ns, STEP_NS * 1e-9)
            springs.step(STEP_NS * 1e-9)
            plant_ns += STEP_NS
        plant_s += time.process_time() - plant_begin_s
    used_s = time.process_time() - begin_s
    return {
        "model": model.name,
        "processor_s_per_minute": round(used_s * 60.0 / duration_s, 2),
        "of_it_motors_s": round(plant_s * 60.0 / duration_s, 2),
        "median_exchange_ms": round(statistics.median(ages_ms), 3),
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one line of JSON")
    parser.add_argument("--seconds", type=float, default=5.0, help="virtual time per model, s")
    arguments = parser.parse_args()
    if not 0.1 <= arguments.seconds <= 600.0:
        parser.error(f"--seconds {arguments.seconds}: expected 0.1 to 600")
    figures = [virtual_minute(model, arguments.seconds) for model in MODELS.values()]
    if arguments.json:
        print(json.dumps(figures))
        return
    for one in figures:
        print(
            f"{one['model']:11} {one['processor_s_per_minute']:6.2f} s of processor time for a virtual minute, motors "
            f"{one['of_it_motors_s']:5.2f} s; exchange {one['median_exchange_ms']:.2f} ms"
        )


if __name__ == "__main__":
    main()
