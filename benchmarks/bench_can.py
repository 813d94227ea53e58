"""Processor time of the arm's bus: one cycle's CAN work, and a virtual minute of driver and simulated arm.

    python -m benchmarks.bench_can [--json] [--seconds N]

One cycle's CAN work is the request, seven replies parsed to joint angles, and two torque frames, on a real socket whose
other end is in our hands: once as `struct can_frame` on the socket, as the daemon does it, and once through the message
objects of python-can, as interfaces without such a socket need it. The two take turns. The target is 150 µs.

Each cycle asks for positions, collects seven replies and writes torques (a spring to a moving pose and damping); behind
the pucks turns the simple arm. Printed is processor time of one thread per virtual minute; the target is 20 s, the goal
12 s, on one 2.5 GHz core. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import gc
import json
import socket
import tempfile
import time
from collections.abc import Iterator
from typing import Any

import can
import numpy as np

from drivers.clock import VirtualClock, nanoseconds
from drivers.simulated.can_faults import CanFaults
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.can_wire import Frame
from drivers.simulated.faults import FaultScript
from drivers.simulated.seqpacket_can import SeqpacketBus, pack_frame
from drivers.simulated.simple_arm import SimpleArm
from drivers.simulated.wam import SimulatedWam
from drivers.wam.arm import Arm, ArmSample
from drivers.wam.bus import ARM_FILTERS, PythonCanBus, SocketCanBus
from drivers.wam.parameters import load_wam_parameters

PERIOD_NS = nanoseconds(0.002)
TARGET_S, GOAL_S = 20.0, 12.0
CAN_TARGET_US = 150.0
CAN_CYCLES = 3000
CAN_STAGES = ("request", "replies to joint angles", "torque frames", "in all")
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


class _Bench:
    """A driver on a socket; its other end answers like seven pucks, outside the measurement."""

    def __init__(self, directory: str, kind: type[PythonCanBus]) -> None:
        path = f"{directory}/{kind.__name__}"
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(path)
            listener.listen(1)
            filters: can.typechecking.CanFilters = [
                {"can_id": number, "can_mask": mask, "extended": False} for number, mask in ARM_FILTERS
            ]
            opened = SeqpacketBus(path, can_filters=filters)
            self._wire, _ = listener.accept()
        self._wire.setblocking(False)
        self._clock = VirtualClock()
        self._bus = kind(opened, self._clock)
        self._arm = Arm(self._bus, self._clock, load_wam_parameters())
        self._replies = [pack_frame(Frame(0x403 | node << 5, bytes((0, 0, node)))) for node in range(1, 8)]
        self._torque_Nm = np.array([1.0, 2.0, 3.0, 4.0, 0.5, 0.2, 0.1])

    def cycle(self) -> tuple[float, float, float, float]:
        """Microseconds of each stage, and in all."""
        self._clock.advance_to_ns(self._clock.now_ns() + PERIOD_NS)
        begin_ns = time.thread_time_ns()
        self._arm.request_positions()
        asked_ns = time.thread_time_ns()
        for packet in self._replies:
            self._wire.send(packet)
        answered_ns = time.thread_time_ns()
        sample = self._arm.collect_positions(self._clock.now_ns() + 1_400_000)
        collected_ns = time.thread_time_ns()
        self._arm.write_torques(self._torque_Nm)
        end_ns = time.thread_time_ns()
        if not sample.complete:
            raise SystemExit("bench_can: a reading was incomplete.")
        for _ in range(3):
            self._wire.recv(32)
        stages = asked_ns - begin_ns, collected_ns - answered_ns, end_ns - collected_ns
        return stages[0] * 1e-3, stages[1] * 1e-3, stages[2] * 1e-3, sum(stages) * 1e-3

    def close(self) -> None:
        self._wire.close()
        self._bus.close()


def can_work_us(cycles: int = CAN_CYCLES) -> dict[str, dict[str, dict[str, float]]]:
    """Median and 99th percentile of each stage, µs, by the way over the bus."""
    ways = {"struct can_frame": SocketCanBus, "python-can messages": PythonCanBus}
    with tempfile.TemporaryDirectory(prefix="sg-") as directory:
        benches = {name: _Bench(directory, kind) for name, kind in ways.items()}
        taken: dict[str, list[tuple[float, ...]]] = {name: [] for name in ways}
        gc.collect()
        gc.disable()
        try:
            for _ in range(cycles):
                for name, bench in benches.items():
                    taken[name].append(bench.cycle())
        finally:
            gc.enable()
            for bench in benches.values():
                bench.close()
    result: dict[str, dict[str, dict[str, float]]] = {}
    for name, figures in taken.items():
        medians, p99 = np.percentile(np.array(figures[cycles // 10 :]), (50, 99), axis=0)
        result[name] = {
            stage: {"median_us": round(float(median), 1), "p99_us": round(float(high), 1)}
            for stage, median, high in zip(CAN_STAGES, medians, p99, strict=True)
        }
    return result


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench_can", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--seconds", type=float, default=60.0, help="virtual time to measure over (default 60)")
    chosen = parser.parse_args(arguments)
    if not 0.1 <= chosen.seconds <= 3600:
        parser.error("--seconds must be between 0.1 and 3600")
    work = can_work_us()
    figure_s = virtual_minute_s(chosen.seconds)
    if chosen.json:
        minute = {"virtual_minute_s": round(figure_s, 3), "target_s": TARGET_S, "goal_s": GOAL_S}
        print(json.dumps(minute | {"can_work": work, "can_target_us": CAN_TARGET_US}))
    else:
        print("one cycle's CAN work, processor time, µs: median (99 %)")
        for name, stages in work.items():
            figures = (
                f"{stage} {spread['median_us']:.0f} ({spread['p99_us']:.0f})" for stage, spread in stages.items()
            )
            print(f"    {name}: {', '.join(figures)}")
        print(f"    target {CAN_TARGET_US:.0f} in all")
        print(f"driver and simulated arm, 60 s at 500 Hz: {figure_s:.1f} s of processor time")
        print(f"target {TARGET_S:.0f} s, goal {GOAL_S:.0f} s")


if __name__ == "__main__":
    main()
