"""`stillgrasp simulate wam|dynamixel|takktile`: one simulated device alone, for any other client of its bus."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from controller.config import load_config, runtime_directory
from controller.service.assignment import SceneChoice
from controller.service.realtime import RealtimeSettings, enter_realtime
from controller.service.run_directory import RunDirectory
from controller.service.stop_requests import StopRequests
from controller.simulation.device_loop import DeviceLoop, HasFileno
from controller.simulation.pendant_lines import PendantLines, is_fault
from controller.simulation.stepped_clock import SteppedClock
from controller.simulation.takktile_command import TAKKTILE_EXAMPLE, takktile
from controller.simulation.weight_lines import WEIGHT_LINES_HELP, WeightLines
from drivers.clock import nanoseconds
from drivers.dynamixel.control_tables import MODELS, XM430_W350, model_by_name
from drivers.errors import InputError
from drivers.simulated.dynamixel import SimulatedMotors, SimulatedMotorSettings, taut_ticks
from drivers.simulated.hanging_weights import HangingWeights
from drivers.simulated.serial_fault_actions import Unplug
from drivers.simulated.serial_lines import PtyServer
from drivers.simulated.spring_tendons import SpringTendons

app = typer.Typer(
    no_args_is_help=True,
    help="Run one simulated device alone, so that any client can talk to it.",
    epilog="Example: stillgrasp simulate wam --json",
)
AsJson = Annotated[bool, typer.Option("--json", help="Print the bus as one line of JSON when ready.")]
PATIENCE_S = 0.5
"""A heartbeat for machines that stall."""
_PLANT_STEP_NS = nanoseconds(0.0005)


@app.command(
    epilog="Example: stillgrasp simulate wam --firmware 200 --faults faults.toml --channel can.sock --json; then, in "
    'Python: can.Bus(interface="seqpacket", channel="can.sock"). A fault, in faults.toml: \\[\\[fault]] on = "active", '
    'at_s = 0.5, for_s = 0.1, action = { kind = "drop", node = 3 }, each on a line of its own.'
)
def wam(
    channel: Annotated[Path | None, typer.Option(help="Socket to serve; else one in a new private directory.")] = None,
    asleep: Annotated[bool, typer.Option("--asleep", help="Pucks in their boot monitor, as after power-up.")] = False,
    not_zeroed: Annotated[
        bool, typer.Option("--not-zeroed", help="Pucks without positions, the arm at home, as after power-up.")
    ] = False,
    firmware: Annotated[
        int, typer.Option(help="Of the motor pucks: 60, 118, 141 and 200 are known generations.")
    ] = 200,
    safety_firmware: Annotated[
        int | None, typer.Option(help="Of the safety puck; else of the same generation.", show_default=False)
    ] = None,
    joint_encoders: Annotated[bool, typer.Option("--joint-encoders", help="Encoders at joints 1 to 4 too.")] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Pucks lose settings that follow too closely: 0.3 ms, 10 ms for safety.")
    ] = False,
    heartbeat: Annotated[
        float, typer.Option(min=0.01, max=60, help="Seconds without positions until an active arm idles itself.")
    ] = PATIENCE_S,
    faults: Annotated[
        Path | None, typer.Option(help="Fault script: TOML, or JSON lines (.jsonl).", show_default=False)
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the arm's imperfections.")] = 0,
    as_json: AsJson = False,
) -> None:
    """A Barrett WAM on a CAN bus; it starts idle.

    The pendant's buttons come from standard input, a word a line: idle, activate, estop, release; and faults, a JSON
    object a line: {"action": {"kind": "supply", "volts": 28}}. Ctrl-C ends it.
    """
    from controller.simulation.fault_file import read_wam_faults, wam_fault
    from controller.simulation.world_process import PATIENT, simulated_devices
    from drivers.simulated.can_faults import CanFaults
    from drivers.simulated.faults import FaultScript
    from drivers.simulated.seqpacket_can import SeqpacketHub
    from drivers.wam.parameters import load_wam_parameters

    script = FaultScript() if faults is None else read_wam_faults(faults)
    arm = {
        "motor_firmware": firmware,
        "safety_firmware": safety_firmware,
        "joint_encoders": joint_encoders,
        "booted": not asleep,
        "zeroed": not not_zeroed,
        "set_gap_s": 0.0003 if strict else 0.0,
        "safety": replace(PATIENT, heartbeat_s=heartbeat, set_gap_s=0.01 if strict else 0.0),
    }
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(StopRequests())
        if channel is None:
            directory = RunDirectory(runtime_directory())
            stack.callback(directory.remove)
            channel = directory.path / "can"
        clock = SteppedClock()
        posture = {"joint_rad": tuple(load_wam_parameters().home_rad.tolist())} if not_zeroed else {}
        devices = simulated_devices(load_config(), SceneChoice(seed=seed), clock.now_ns(), arm, **posture)
        can_faults = CanFaults(script, devices.wam, clock.now_ns())
        hub = SeqpacketHub(channel.absolute(), [devices.wam], clock, can_faults)
        stack.callback(hub.close)

        buttons = PendantLines(0, _say)

        def press() -> None:
            for line in buttons.read():
                if not is_fault(line):
                    hub.transmit(devices.wam.press(line, clock.now_ns()), devices.wam)
                    continue
                try:
                    can_faults.add(wam_fault(line), clock.now_ns())
                except InputError as error:
                    _say(str(error))

        loop = DeviceLoop(clock, devices.world.advance_to, [hub], hub.filenos, _say)
        ready = partial(_tell, {"interface": "seqpacket", "channel": str(channel.absolute())}, as_json)
        _run(loop, clock, stop, ready, buttons, press)


@app.command(
    epilog="Example: stillgrasp simulate dynamixel --model MX-28 --ids 1 2 --json; then open its port with "
    'dynamixel-sdk at 1 Mbit/s. A fault, in faults.toml: \\[\\[fault]] on = "torque_on", at_s = 2, '
    'action = { kind = "hardware_error", motors = [1], error = "overload" }, each on a line of its own.'
)
def dynamixel(
    model: Annotated[
        str,
        typer.Option(help=f"Motor model, which decides the protocol: {', '.join(m.name for m in MODELS.values())}."),
    ] = XM430_W350.name,
    ids: Annotated[tuple[int, int], typer.Option(help="Bus ids of the two motors, right and left.")] = (1, 2),
    baud: Annotated[
        int, typer.Option(help="Baud rate that the motors are set to: a client at another is not understood.")
    ] = 1_000_000,
    faults: Annotated[
        Path | None, typer.Option(help="Fault script: TOML, or JSON lines (.jsonl).", show_default=False)
    ] = None,
    supply: Annotated[float, typer.Option(help="Supply voltage, V.")] = 12.0,
    noise: Annotated[float, typer.Option(help="Noise of current or load, standard deviation in counts.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    hanging_kg: Annotated[
        tuple[float, float] | None,
        typer.Option(help=f"Masses on cords instead of springs, kg, right and left; {WEIGHT_LINES_HELP}."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Two tendon motors, each pulling on a spring or a hanging weight, on a serial line (a pty). Ctrl-C ends it.

    With a scripted unplugging, the path that is printed leads to the new line when the adapter is plugged in again.
    """
    from controller.simulation.fault_file import read_motor_faults
    from drivers.simulated.dynamixel_electrics import electrics_of
    from drivers.simulated.faults import FaultScript

    script = FaultScript() if faults is None else read_motor_faults(faults)
    motor_model = model_by_name(model)
    electrics = electrics_of(motor_model)
    plant: SpringTendons | HangingWeights
    friction_Nm, inertia_kgm2 = electrics.gear_friction_Nm, electrics.inertia_kgm2
    weight_lines = None
    if hanging_kg is None:
        plant = SpringTendons(friction_Nm=friction_Nm, inertia_kgm2=inertia_kgm2)
    else:
        plant = HangingWeights(hanging_kg, friction_Nm=friction_Nm, inertia_kgm2=inertia_kgm2)
        weight_lines = WeightLines(0, plant, _say)
    clock = SteppedClock()
    plant_ns = clock.now_ns()
    motors = SimulatedMotors(
        plant,
        [SimulatedMotorSettings(motor_id, taut_ticks(motor_model), model=motor_model) for motor_id in ids],
        baud=baud,
        supply_V=supply,
        noise_counts=noise,
        seed=seed,
        faults=script,
        start_ns=plant_ns,
    )

    def advance(now_ns: int) -> None:
        nonlocal plant_ns
        while plant_ns + _PLANT_STEP_NS <= now_ns:
            motors.control(plant_ns, _PLANT_STEP_NS * 1e-9)
            plant.step(_PLANT_STEP_NS * 1e-9)
            plant_ns += _PLANT_STEP_NS

    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(StopRequests())
        if any(isinstance(fault.action, Unplug) for fault in script.faults):
            directory = RunDirectory(runtime_directory())
            stack.callback(directory.remove)
            pty = PtyServer(motors, clock, baud, link=directory.path / "tendons")
        else:
            pty = PtyServer(motors, clock, baud)
        stack.callback(pty.close)
        loop = DeviceLoop(clock, advance, [pty], pty.filenos, _say)
        ready = partial(_tell, {"port": str(pty.link or pty.port)}, as_json)
        if weight_lines is None:
            _run(loop, clock, stop, ready)
        else:
            _run(loop, clock, stop, ready, weight_lines, weight_lines.obey)


app.command(epilog=TAKKTILE_EXAMPLE)(takktile)


def _run(
    loop: DeviceLoop,
    clock: SteppedClock,
    stop: StopRequests,
    ready: Callable[[], None],
    buttons: PendantLines | WeightLines | None = None,
    press: Callable[[], None] = lambda: None,
) -> None:
    """Until a signal; the end of the buttons ends nothing."""
    enter_realtime(RealtimeSettings(freeze_garbage=True))
    clock.resume()
    ready()
    while stop.received is None:
        others: Sequence[HasFileno] = [stop, *([buttons] if buttons is not None and buttons.open else [])]
        if buttons in loop.turn(others):
            press()


def _tell(bus: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print(json.dumps(bus), flush=True)
    else:
        _say(", ".join(f"{key} {value}" for key, value in bus.items()) + "; stop with Ctrl-C")


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        print(f"stillgrasp: {text}", file=sys.stderr, flush=True)
