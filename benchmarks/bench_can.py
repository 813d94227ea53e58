"""Processor time of a virtual minute: the arm's driver at 500 Hz in front of the simulated arm, without MuJoCo.

    python -m benchmarks.bench_can [--json] [--seconds N]

Each cycle asks for positions, collects seven replies and writes torques (a spring to a moving pose and damping); behind
the pucks turns the simple arm. Printed is processor time of one thread per virtual minute; the target is 20 s, the goal
12 s, on one 2.5 GHz core. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from drivers.clock import VirtualClock, nanoseconds
from drivers.simulated.can_faults import CanFaults
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.faults import FaultScript
from drivers.simulated.simple_arm import SimpleArm
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm, ArmSample
from drivers.wam.parameters import load_wam_parameters

PERIOD_NS = nanoseconds(0.002)
TARGET_S, GOAL_S = 20.0, 12.0
_STIFFNESS_NM_PER_RAD = np.array([200.0, 200.0, 60.0, 60.0, 5.0, 5.0, 0.5])
_DAMPING_NMS_PER_RAD = np.array([20.0, 20.0, 4.0, 4.0, 0.2, 0.2, 0.02])
_START_RAD = np.array([0.0, -1.0, 0.0, 2.0, 0.0, 0.0, 0.0])


class ArmRig:
    """A driver, an active simulated arm and a law that keeps it moving slowly; with a fault script if there is one."""

    def __init__(self, script: FaultScript[Any] | None = None) -> None:
        parameters = load_wam_parameters()
        self.plant = SimpleArm(parameters, _START_RAD)
        self.wam = SimulatedWam(self.plant, parameters, zeroed=True)
        self.clock = VirtualClock()
        self.hub = MemoryCanHub([self.wam], None if script is None else CanFaults(script, self.wam))
        self.arm = Arm(MemoryCanBus(self.hub, self.clock), self.clock, parameters)
        self.arm.start()
        self.hub.transmit(self.wam.press("activate", self.clock.now_ns()), self.wam)

    def run(self, duration_s: float) -> Iterator[ArmSample]:
        """Cycle after cycle; what the driver read in each."""
        cycle_ns = self.clock.now_ns() // PERIOD_NS * PERIOD_NS
        last_rad = self.plant.joint_position_rad()
        velocity_rad_s = np.zeros(7)
        for cycle in range(round(duration_s * 1e9 / PERIOD_NS)):
            cycle_ns += PERIOD_NS
            self.clock.advance_to_ns(cycle_ns)
            self.plant.advance_to(cycle_ns)
            self.hub.step(cycle_ns)
            self.arm.request_positions()
            sample = self.arm.collect_positions(cycle_ns + 1_400_000)
            raw_rad_s = (sample.joint_rad - last_rad) / 0.002
            velocity_rad_s = (velocity_rad_s + 0.36 * raw_rad_s) / 1.36
            last_rad = sample.joint_rad
            wanted_rad = _START_RAD + 0.2 * np.sin(cycle * 0.002 * np.arange(0.5, 1.2, 0.1))
            self.arm.write_torques(
                _STIFFNESS_NM_PER_RAD * (wanted_rad - sample.joint_rad) - _DAMPING_NMS_PER_RAD * velocity_rad_s
            )
            yield sample


def virtual_minute_s(seconds: float = 60.0) -> float:
    """Processor time in s per virtual minute, measured over `seconds` of virtual time."""
    rig = ArmRig()
    begin_s = time.process_time()
    incomplete = sum(not sample.complete for sample in rig.run(seconds))
    elapsed_s = time.process_time() - begin_s
    if incomplete or rig.wam.mode != 2:
        raise SystemExit(f"bench_can: {incomplete} readings were incomplete and the arm's mode is {rig.wam.mode}.")
    return elapsed_s * 60.0 / seconds


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench_can", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seconds", type=float, default=60.0, help="virtual time to measure over (default 60)")
    chosen = parser.parse_args(arguments)
    if not 0.1 <= chosen.seconds <= 3600:
        parser.error("--seconds must be between 0.1 and 3600")
    figure_s = virtual_minute_s(chosen.seconds)
    if chosen.json:
        print(json.dumps({"virtual_minute_s": round(figure_s, 3), "target_s": TARGET_S, "goal_s": GOAL_S}))
    else:
        print(f"driver and simulated arm, 60 s at 500 Hz: {figure_s:.1f} s of processor time")
        print(f"target {TARGET_S:.0f} s, goal {GOAL_S:.0f} s")


if __name__ == "__main__":
    main()
