"""The command line: `stillgrasp`. Here is the frame and what starts and talks to the daemon; the rest is mounted.

Results go to standard output, with --json as one line of JSON a result; everything else goes to standard error.
Exit code 0: done; 1: it failed; 2: the input was not acceptable. Libraries are loaded by the command that needs them,
so that `stillgrasp --help` answers at once.
Source: design 6.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from drivers.errors import CommandError, InputError, StillgraspError

if TYPE_CHECKING:
    from controller.client import Client

FAILED, REFUSED = 1, 2

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Config = Annotated[Path | None, typer.Option(help="Your robot.toml; without one, the default installation.")]
Endpoint = Annotated[str | None, typer.Option(help="The daemon's command endpoint; else the configured one.")]


class Mounted(NamedTuple):
    """A command that lives elsewhere: a typer.Typer (a group) or a function."""

    module: str
    attribute: str
    help: str
    example: str = ""
    """For a function; a group has its own."""


MOUNTED = {
    "demo": Mounted(
        "controller.simulation.demo", "demo", "Show it all: tables, grasps, figures (90 s).", "stillgrasp demo --json"
    ),
    "simulate": Mounted("controller.simulation.device_commands", "app", "Run one simulated device alone."),
    "table": Mounted(
        "controller.table_commands", "app", "Build and inspect motion tables: where a squeezed object goes in the hand."
    ),
    "grasp": Mounted(
        "controller.grasp_commands", "app", "Plan a grasp: where the wrist goes, whether it holds, how hard to squeeze."
    ),
    "figures": Mounted(
        "controller.figure_commands",
        "figures",
        "Draw the counterparts of the paper's figures from the models.",
        "stillgrasp figures --only 3 6 --output build/figures",
    ),
    "calibrate": Mounted("controller.calibrate_commands", "app", "Measure the hardware, and write what was found."),
    "bench": Mounted(
        "controller.bench", "bench", "Measure the cycle's processor time, stage by stage.", "stillgrasp bench"
    ),
}


class Pendant(StrEnum):
    """Who presses the simulated pendant's buttons."""

    auto = "auto"
    manual = "manual"


def main() -> None:
    """Entry point of the console script."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)
    with told():
        app = build_app(sys.argv[1:])
        app()


def _interrupted(number: int, frame: FrameType | None) -> None:
    """Ctrl-C in a command that has nothing to put in order first."""
    raise SystemExit(128 + number)


def build_app(arguments: Sequence[str]) -> typer.Typer:
    """The commands; of the mounted ones only that is loaded which `arguments` name, of the others just their help."""
    app = typer.Typer(
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        help="Keep a grasped object still: compensate the parasitic motion of adaptive hands with the arm.",
        epilog="Example: stillgrasp run --simulate, and in another terminal: stillgrasp status",
    )
    app.command(
        epilog="Example: stillgrasp run --simulate --object cylinder40 --json. Stop it with Ctrl-C or "
        "`stillgrasp send shutdown`: the arm comes to rest, the hand keeps what it holds; exit code 0."
    )(run)
    app.command(epilog="Example: stillgrasp status --json")(status)
    app.command(
        epilog="Examples: stillgrasp send grasp.squeeze load_N=60 duration_s=1.5 --wait; "
        "stillgrasp send arm.move_joints '{\"joint_rad\": [0, 0.1, 0, 2.3, 0, -0.8, 0]}' --wait"
    )(send)
    named = next((argument for argument in arguments if not argument.startswith("-")), "")
    for name, mounted in MOUNTED.items():
        if importlib.util.find_spec(mounted.module) is None:
            continue  # an installation without that part
        if name != named:
            app.command(name, help=mounted.help)(_elsewhere)
            continue
        found: Any = getattr(importlib.import_module(mounted.module), mounted.attribute)
        if isinstance(found, typer.Typer):
            app.add_typer(found, name=name)
        else:
            app.command(name, epilog=f"Example: {mounted.example}")(found)
    return app


def _elsewhere() -> None:
    """Stands for a command that was not named, in the list of commands."""


@contextlib.contextmanager
def told() -> Iterator[None]:
    """Print an error of ours as one message and leave with its exit code."""
    try:
        yield
    except StillgraspError as error:
        # A plain CommandError is the daemon's answer; what was refused here, before it was sent, is bad input.
        from_daemon = type(error) is CommandError and error.code != "bad_endpoint"
        refused = isinstance(error, InputError) and not from_daemon
        say(str(error))
        raise SystemExit(REFUSED if refused else FAILED) from error


def say(text: str) -> None:
    """A line for the operator; nobody need listen."""
    with contextlib.suppress(OSError):
        print(f"stillgrasp: {text}", file=sys.stderr, flush=True)


def run(
    config: Config = None,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Simulated arm, hand and object instead of hardware.")
    ] = False,
    pendant: Annotated[
        Pendant | None,
        typer.Option(
            help="With --simulate: who presses the pendant. auto (default) activates the arm; manual takes idle, "
            "activate, estop, release from standard input, a word a line."
        ),
    ] = None,
    object_: Annotated[
        str | None, typer.Option("--object", help="With --simulate: packaged object or TOML file.")
    ] = None,
    object_xyz: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="With --simulate: where its centre stands in the world, m."),
    ] = None,
    object_yaw: Annotated[float | None, typer.Option(help="With --simulate: its yaw in the world, rad.")] = None,
    outline_angle: Annotated[
        float | None,
        typer.Option(help="With --simulate: how far its outline is turned in the hand, rad; see `table show`."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="With --simulate: seed of the arm's imperfections.")] = None,
    arm_faults: Annotated[
        Path | None,
        typer.Option(help="With --simulate: script of what goes wrong with the arm; as of `simulate wam --faults`."),
    ] = None,
    motor_faults: Annotated[
        Path | None,
        typer.Option(help="With --simulate: the same of the tendon motors; as of `simulate dynamixel --faults`."),
    ] = None,
    pad_faults: Annotated[
        Path | None,
        typer.Option(help="With --simulate: the same of the tactile pads; as of `simulate takktile --faults`."),
    ] = None,
    tables: Annotated[Path | None, typer.Option(help="Directory of motion tables; else the configured one.")] = None,
    record: Annotated[
        Path | None, typer.Option(help="File to record to (.mcap); else a new one as configured.")
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Record nothing.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run the daemon: the arm's cycle, the hand, and the front that takes commands.

    With --json one line on standard output says when it runs: endpoints, buses, process ids. Ctrl-C, SIGTERM and
    `stillgrasp send shutdown` stop it in order.
    """
    from controller.service.launch import Launch, launch

    scene = {
        "object": object_,
        "object_xyz_m": object_xyz,
        "object_yaw_rad": object_yaw,
        "outline_angle_rad": outline_angle,
        "seed": seed,
    }
    given = {name: value for name, value in scene.items() if value is not None}
    more = {"pendant": pendant, "arm_faults": arm_faults, "motor_faults": motor_faults, "pad_faults": pad_faults}
    options = ", ".join([*given, *(name for name, value in more.items() if value is not None)])
    if not simulate and options:
        raise InputError(f"{options}: only a simulation has these.", help="Add --simulate, or leave them out.")
    if record is not None and no_record:
        raise InputError("--record and --no-record exclude each other.", help="Leave one out.")
    code = launch(
        Launch(
            config=config,
            simulated=simulate,
            scene=given,
            arm_faults=arm_faults,
            motor_faults=motor_faults,
            pad_faults=pad_faults,
            manual_pendant=pendant is Pendant.manual,
            tables=tables,
            record=record,
            recording=False if no_record else None,
        ),
        say=say,
        announce=lambda description: tell_running(description, as_json),
    )
    raise typer.Exit(code)


def tell_running(description: Mapping[str, Any], as_json: bool) -> None:
    """Say that the daemon runs, to the operator and, as JSON, to a program."""
    if as_json:
        with contextlib.suppress(OSError):
            print(json.dumps(description), flush=True)
    say(f"running; commands at {description['command_endpoint']}, state at {description['state_endpoint']}")
    say("stop with Ctrl-C, or: stillgrasp send shutdown")


def status(endpoint: Endpoint = None, config: Config = None, as_json: AsJson = False) -> None:
    """Print what the daemon says of arm, hand and grasp."""
    with connected(endpoint, config) as client:
        told_status = client.status()
    if as_json:
        print(json.dumps(told_status))
        return
    state = told_status["state"]
    for lost in ("cycle_lost", "hand_lost", "tactile_lost"):
        if told_status.get(lost):
            print(told_status[lost])
    for warning in told_status.get("warnings", ()):
        print(f"warning: {warning['message']}")
    if not state:
        print("starting: no cycle has run yet")
        return
    arm, hand, grasp, compensation, cycle = (state[name] for name in ("arm", "hand", "grasp", "compensation", "cycle"))
    if told_status["cycle_lost"]:
        print(f"what follows is {told_status['state_age_s']:.1f} s old")
    joints = " ".join(f"{angle:.3f}" for angle in arm["joint_rad"])
    switched = "on" if compensation["enabled"] else "off"
    print(f"arm           {arm['state']}, joints {joints} rad")
    amiss = f"; {', '.join(hand['faults'])}" if hand["faults"] else ""
    print(
        f"hand          {hand['state']}, tension {hand['tension_N'][0]:.1f} {hand['tension_N'][1]:.1f} N "
        f"(right, left){amiss}"
    )
    if "tactile" in state:
        from controller.pad_map import pad_lines

        print("\n".join(pad_lines(state["tactile"])))
    print(f"grasp         {grasp['phase']}{', fault ' + grasp['fault'] if grasp['fault'] else ''}")
    print(f"table         {told_status['table'] or 'none'}")
    print(f"compensation  {switched}, index {compensation['index']}")
    print(f"cycle         {cycle['number']}, missed periods {cycle['missed_periods']:.0f}, {cycle['cpu_us']:.0f} µs")


def send(
    command: Annotated[str, typer.Argument(help="Name of the command, such as arm.move_joints.")],
    arguments: Annotated[
        list[str] | None,
        typer.Argument(metavar="[KEY=VALUE ...|JSON]", help="Its arguments; values in JSON or as text."),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait for the end of a slow command.")] = False,
    timeout: Annotated[float, typer.Option(min=0.1, max=3600, help="How long to wait, s.")] = 60.0,
    endpoint: Endpoint = None,
    config: Config = None,
    as_json: AsJson = False,
) -> None:
    """Send one command to the daemon and print its answer."""
    from controller.service.commands import make_command

    given = arguments_of(command, arguments or [])
    slow = make_command(command, given).slow  # checked before anything is sent
    with connected(endpoint, config) as client:
        if slow:
            task = client.start(command, **given)
            answer = task.wait(timeout, on_progress=None if as_json else tell_progress) if wait else task.accepted
        else:
            answer = client.request(command, **given)
    if as_json:
        print(json.dumps(answer))
    else:
        print(f"{command}: {'completed' if wait and slow else 'accepted' if slow else 'done'}")
        for key, value in answer.items():
            print(f"  {key}: {json.dumps(value)}")


def tell_progress(progress: Mapping[str, Any]) -> None:
    """How far a slow command is, in place, for somebody who waits at a terminal."""
    if sys.stderr.isatty():
        part = f"{progress['done']:4.0%}" if "done" in progress else f"{progress['elapsed_s']:.1f} s"
        print(f"{progress['command']}: {part}", end="\r", file=sys.stderr, flush=True)


def arguments_of(command: str, words: Sequence[str]) -> dict[str, Any]:
    """The arguments of a command as the command line writes them. Raises InputError."""
    if len(words) == 1 and words[0].lstrip().startswith("{"):
        try:
            content: dict[str, Any] = json.loads(words[0])
        except (ValueError, RecursionError) as error:
            raise InputError(f"{command}: the arguments are not JSON ({error}).", help="Or write KEY=VALUE.") from error
        return content
    given: dict[str, Any] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or not key or key in given:
            problem = "comes twice" if key in given else "is not KEY=VALUE"
            raise InputError(f"{command}: {word!r} {problem}.", help="Write each argument once, as KEY=VALUE.")
        try:
            given[key] = json.loads(text)
        except (ValueError, RecursionError):
            given[key] = text
    return given


@contextlib.contextmanager
def connected(endpoint: str | None, config: Path | None) -> Iterator[Client]:
    """A client of the daemon at `endpoint`, else at the configured one."""
    from controller.client import Client
    from controller.config import load_config

    with Client(endpoint or load_config(config).front.command_endpoint) as client:
        yield client
