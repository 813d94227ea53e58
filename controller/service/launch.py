"""From the command line's choices to a running daemon: configuration, directory, recording, pendant; then it runs."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from calibration.objects.parameters import load_object
from calibration.toml_files import from_document
from controller.config import RobotConfig, load_config, runtime_directory
from controller.service.assignment import SceneChoice
from controller.service.daemon import ButtonSource, Daemon, RunChoices
from controller.service.recorder import Recorder
from controller.service.run_directory import RunDirectory
from controller.service.stop_requests import StopRequests
from drivers.errors import InputError


@dataclass(frozen=True)
class Launch:
    """What the command line says. `scene` holds `SceneChoice`'s fields but the fault scripts, which are files;
    `recording` None leaves it to the config."""

    config: Path | None = None
    simulated: bool = False
    scene: Mapping[str, Any] = field(default_factory=dict)
    arm_faults: Path | None = None
    motor_faults: Path | None = None
    pad_faults: Path | None = None
    manual_pendant: bool = False
    tables: Path | None = None
    record: Path | None = None
    recording: bool | None = None


def launch(choices: Launch, *, say: Callable[[str], None], announce: Callable[[Mapping[str, Any]], None]) -> int:
    """Run the daemon until its end; the exit code. Raises StillgraspError if it cannot start."""
    overrides = {} if choices.tables is None else {"tables": {"directory": str(choices.tables.absolute())}}
    config = load_config(choices.config, overrides, simulated=choices.simulated)
    scene = from_document(dict(choices.scene), SceneChoice, "command line")
    if scene.object is not None:
        load_object(scene.object)  # a wrong name is told here, not by a child
    if choices.pad_faults is not None and config.tactile is None:
        raise InputError("pad_faults: no tactile pads are configured.", help="Fill in [tactile] of robot.toml.")
    scene = _with_faults(scene, choices)
    with StopRequests() as stop:  # from here on there is something to put in order at the end
        directory = RunDirectory(runtime_directory()) if choices.simulated else None
        try:
            if directory is not None:
                config = in_simulation(config, directory.path)
            run = RunChoices(
                simulated=choices.simulated,
                scene=scene,
                activate=choices.simulated and not choices.manual_pendant,
                directory_descriptor=directory.descriptor if directory is not None else None,
            )
            with _recorder(choices, config) or contextlib.nullcontext() as recorder:
                if recorder is not None:
                    say(f"recording to {recorder.path}")
                buttons = _buttons(say) if choices.manual_pendant else None
                daemon = Daemon(config, run, say=say, announce=announce, recorder=recorder, buttons=buttons)
                return daemon.run(stop)
        finally:
            if directory is not None:
                directory.remove()


def in_simulation(config: RobotConfig, directory: Path) -> RobotConfig:
    """The configuration with simulated buses in `directory`, except where it names places of its own for them."""
    default = load_config()
    arm, tendons, tactile = config.arm, config.tendons, config.tactile
    if arm.interface != "seqpacket" or arm.channel == default.arm.channel:
        arm = msgspec.structs.replace(arm, interface="seqpacket", channel=str(directory / "can"))
    if tendons.port == default.tendons.port or tendons.port.startswith("/dev/"):
        tendons = msgspec.structs.replace(tendons, port=str(directory / "tendons"))
    if tactile is not None and tactile.interface != "socket":
        tactile = msgspec.structs.replace(tactile, interface="socket", channel=str(directory / "pads"))
    return msgspec.structs.replace(config, arm=arm, tendons=tendons, tactile=tactile)


def _with_faults(scene: SceneChoice, choices: Launch) -> SceneChoice:
    """The scene with the scripts of the command line's files. ConfigurationError."""
    if choices.arm_faults is None and choices.motor_faults is None and choices.pad_faults is None:
        return scene
    from controller.simulation.fault_file import read_motor_faults, read_takktile_faults, read_wam_faults

    return msgspec.structs.replace(
        scene,
        arm_faults=None if choices.arm_faults is None else read_wam_faults(choices.arm_faults),
        motor_faults=None if choices.motor_faults is None else read_motor_faults(choices.motor_faults),
        pad_faults=None if choices.pad_faults is None else read_takktile_faults(choices.pad_faults),
    )


def _buttons(say: Callable[[str], None]) -> ButtonSource:
    from controller.simulation.pendant_lines import PendantLines

    say(
        'pendant: type idle, activate, estop or release; or a fault: {"action": {"kind": "supply", "volts": 28}}, '
        'motors {"action": {"kind": "unplug"}, "for_s": 1}'
    )
    return PendantLines(0, say)


def _recorder(choices: Launch, config: RobotConfig) -> Recorder | None:
    wanted = config.recorder.enabled if choices.recording is None else choices.recording
    if choices.record is None and not wanted:
        return None
    name = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{os.getpid()}.mcap"
    path = choices.record or Path(config.recorder.directory) / name
    metadata = {"version": version("stillgrasp"), "simulated": str(choices.simulated), "arm": config.arm.channel}
    return Recorder(path, wall_offset_ns=time.time_ns() - time.monotonic_ns(), metadata=metadata)
