"""The world's process of `stillgrasp run --simulate`: MuJoCo behind a CAN hub and a pty, on the machine's time.

The configuration names the hub's socket and the link to the pty. It ends once the front has gone and nobody is on the
CAN bus any more, so that a cycle whose front was killed still has an arm to bring to rest.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from controller.config import RobotConfig
from controller.service.assembly import configured_hand
from controller.service.assignment import Assignment, SceneChoice
from controller.service.lifeline import Lifeline, Word
from controller.service.realtime import RealtimeSettings, enter_realtime
from controller.service.stop_requests import StopRequests
from controller.simulation.device_loop import DeviceLoop, HasFileno
from controller.simulation.fault_file import motor_fault, pad_fault, wam_fault
from controller.simulation.pendant_lines import MOTORS, PADS
from controller.simulation.physics_pace import PhysicsPace
from controller.simulation.scene import Devices, Scene, build_devices
from controller.simulation.stepped_clock import SteppedClock
from drivers.clock import nanoseconds
from drivers.errors import InputError
from drivers.simulated.can_faults import CanFaults
from drivers.simulated.faults import FaultScript
from drivers.simulated.safety_watch import SafetySettings
from drivers.simulated.seqpacket_can import SeqpacketHub
from drivers.simulated.serial_lines import PtyServer
from drivers.simulated.takktile_lines import TakktileServer
from drivers.simulated.wam import SimulatedWam
from drivers.wam.parameters import load_wam_parameters

PATIENT = SafetySettings(heartbeat_s=0.5, velocity_samples=3)
"""The simulated safety puck's patience: shared machines stall, and an idle arm is no use to anybody."""
REACH_PERIODS = 1.5
"""Of the cycle, that the physics goes under the same torques before it waits."""
LONGEST_END_S = 6.0
_BELOW_CYCLE = 30
"""A device answers in time whatever else its machine does; below hand and cycle, which wait for it. An arm whose
encoders answer late half of the time is not one that a controller can hold."""


def run_world(assignment: Assignment, lifeline: Lifeline, stop: StopRequests) -> int:
    """Run the world until the front and the cycle have gone; the exit code."""
    config = assignment.config
    clock = SteppedClock()
    devices = simulated_devices(config, assignment.scene, clock.now_ns())
    script = assignment.scene.arm_faults
    faults = None if script is None else CanFaults(script, devices.wam, clock.now_ns())
    with contextlib.ExitStack() as stack:
        if "directory" in assignment.descriptors:
            stack.callback(_remove_directory, assignment.descriptors["directory"])
        hub = SeqpacketHub(config.arm.channel, [devices.wam], clock, faults)
        stack.callback(hub.close)
        link = _free_link(Path(config.tendons.port))
        pty = PtyServer(devices.motors, clock, config.tendons.baud, link)
        stack.callback(pty.close)
        stack.callback(link.unlink, missing_ok=True)
        priority = config.cycle.priority - _BELOW_CYCLE
        enter_realtime(RealtimeSettings(priority=priority if priority > 0 else None, freeze_garbage=True))
        clock.resume()
        pads = None
        if config.tactile is not None and devices.pads is not None:
            pads = TakktileServer(config.tactile.channel, devices.pads, clock)
            stack.callback(pads.close)
        reach_ns = nanoseconds(REACH_PERIODS * config.cycle.period_s)
        pace = PhysicsPace(devices.world, lambda: devices.wam.torque_ns, reach_ns)
        _loop(devices, pace, hub, pty, pads, clock, lifeline, stop)
    return 0


def _remove_directory(descriptor: int) -> None:
    """The run's directory is shared with the front, which may be dead."""
    with contextlib.suppress(OSError):
        os.rmdir(os.readlink(f"/proc/self/fd/{descriptor}"))


def simulated_devices(
    config: RobotConfig, choice: SceneChoice, start_ns: int, arm: Mapping[str, Any] | None = None, **scene: Any
) -> Devices:
    """The world of the configuration and scene, with devices patient enough for the machine's time.

    `arm`: what the arm is like, as `SimulatedWam` takes it; without it, awake and with its positions known.
    """
    chosen = {name: value for name, value in msgspec.structs.asdict(choice).items() if value is not None}
    chosen.pop("arm_faults", None)
    scripts = {name: chosen.pop(name, None) for name in ("motor_faults", "pad_faults")}
    devices = build_devices(config, configured_hand(config), Scene(**chosen, **scene), start_ns=start_ns, **scripts)
    options = {"zeroed": True, "safety": PATIENT, "start_ns": start_ns, **(arm or {})}
    wam = SimulatedWam(devices.world, load_wam_parameters(), **options)
    return replace(devices, wam=wam)


def _loop(
    devices: Devices,
    pace: PhysicsPace,
    hub: SeqpacketHub,
    pty: PtyServer,
    pads: TakktileServer | None,
    clock: SteppedClock,
    lifeline: Lifeline,
    stop: StopRequests,
) -> None:
    def say(text: str) -> None:
        lifeline.say(Word.SAID, text)

    served: list[SeqpacketHub | PtyServer | TakktileServer] = [hub, pty, *([] if pads is None else [pads])]
    loop = DeviceLoop(
        clock, pace.advance_to, served, lambda: [number for bus in served for number in bus.filenos()], say
    )
    lifeline.say(Word.READY)
    ending_ns = 0
    while True:
        watched: list[HasFileno] = [] if ending_ns else [lifeline, stop]
        loop.turn(watched)
        stop.drain()
        if not ending_ns:
            while (saying := lifeline.hear()) is not None:
                if saying.word is Word.PRESS:
                    hub.transmit(devices.wam.press(saying.text, clock.now_ns()), devices.wam)
                elif saying.word is Word.FAULT:
                    _begin_fault(saying.text, devices, hub, clock.now_ns(), say)
            if lifeline.closed or stop.received is not None:
                ending_ns = clock.now_ns() + nanoseconds(LONGEST_END_S)
        elif len(hub.filenos()) <= 1 or clock.now_ns() > ending_ns:  # the listener alone
            return


def _begin_fault(line: str, devices: Devices, hub: SeqpacketHub, now_ns: int, say: Callable[[str], None]) -> None:
    """Let something go wrong, from the first time on with what that costs; a wrong line is told and passed over."""
    try:
        if line.startswith(MOTORS):
            devices.motors.faults.add(motor_fault(line.removeprefix(MOTORS)), now_ns)
            return
        if line.startswith(PADS):
            if devices.pads is None:
                raise InputError("no tactile pads are configured.", help="Fill in [tactile] of robot.toml.")
            devices.pads.add_fault(pad_fault(line.removeprefix(PADS)), now_ns)
            return
        faults = hub.faults
        if faults is None:
            hub.faults = faults = CanFaults(FaultScript(), devices.wam, now_ns)
        faults.add(wam_fault(line), now_ns)
    except InputError as error:
        say(str(error))


def _free_link(path: Path) -> Path:
    """`path`, where a link to the pty can be made; one that a dead simulation left is taken away."""
    try:
        if path.is_symlink() and os.readlink(path).startswith("/dev/pts/"):
            path.unlink()
        path.symlink_to("/dev/null")
        path.unlink()
        return path
    except OSError as error:
        raise InputError(
            f"tendons.port: no link to the simulated motors can be made at {path}: {error.strerror}.",
            help="Name a path that does not exist yet, in a directory of yours.",
        ) from error
