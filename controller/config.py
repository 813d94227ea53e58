"""The installation: one `robot.toml` as frozen structs, SI units in the key names (design 6, 7).

`controller/robot.toml` is the default installation, complete and simulated, and holds every default; a user's file is
laid over it. A wrong key, unit or value is a ConfigurationError that names file, key, value and what is accepted.
Frames: world z up; arm base = DH frame 0; wrist W = the tool plate; hand H. Arrays of seven are in joint order.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from calibration.load_calibration import LoadCalibration, check_model_name
from calibration.motor_file import read_motor_file
from calibration.tactile_file import Cells
from calibration.toml_files import FieldError, from_document, load_document, merged
from controller.pose import Pose
from drivers.dynamixel.control_tables import model_by_name

DEFAULT_FILE = Path(__file__).with_name("robot.toml")
SIMULATED_FILE = Path(__file__).with_name("simulated.toml")
SLOWEST_CLOSING_M_S, FASTEST_CLOSING_M_S = 0.001, 0.05

Text = Annotated[str, Meta(min_length=1)]
_Angle = Annotated[float, Meta(ge=-6.3, le=6.3)]
_Rate = Annotated[float, Meta(gt=0, le=100)]
_Amount = Annotated[float, Meta(ge=0, le=10000)]
_Excursion = Annotated[float, Meta(ge=-0.1, le=0.5)]
Angles = tuple[_Angle, _Angle, _Angle, _Angle, _Angle, _Angle, _Angle]
Rates = tuple[_Rate, _Rate, _Rate, _Rate, _Rate, _Rate, _Rate]
_Torque = Annotated[float, Meta(gt=0, le=100)]
_TorqueRate = Annotated[float, Meta(gt=0, le=100000)]
Amounts = tuple[_Amount, _Amount, _Amount, _Amount, _Amount, _Amount, _Amount]

Torques = tuple[_Torque, _Torque, _Torque, _Torque, _Torque, _Torque, _Torque]
TorqueRates = tuple[_TorqueRate, _TorqueRate, _TorqueRate, _TorqueRate, _TorqueRate, _TorqueRate, _TorqueRate]


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file; unknown keys are refused."""


class ArmLimits(_Table, frozen=True):
    """Joint limits (7). Without `lower_rad` and `upper_rad` the arm's own position limits hold.

    `torque_Nm` lowers the arm's own torque limits. `torque_rate_Nm_per_s`: without it a torque takes 20 ms from zero to
    its limit at the least.
    """

    velocity_rad_s: Rates
    acceleration_rad_s2: Rates
    lower_rad: Angles | None = None
    upper_rad: Angles | None = None
    torque_Nm: Torques | None = None
    torque_rate_Nm_per_s: TorqueRates | None = None

    def __post_init__(self) -> None:
        if (self.lower_rad is None) != (self.upper_rad is None):
            raise FieldError("lower_rad" if self.lower_rad is None else "upper_rad", "both limits or neither")
        if self.lower_rad is not None and self.upper_rad is not None:
            for joint, (lower, upper) in enumerate(zip(self.lower_rad, self.upper_rad, strict=True)):
                if not lower < upper:
                    raise FieldError(f"lower_rad[{joint}]", f"a number below upper_rad[{joint}] = {upper}")


class ArmGains(_Table, frozen=True):
    """Joint position control: a preset, of which single rows can be replaced."""

    preset: Literal["stiff", "calm", "libbarrett"]
    kp_Nm_per_rad: Amounts | None = None
    kd_Nms_per_rad: Amounts | None = None
    ki_Nm_per_rad_s: Amounts | None = None


class ArmFriction(_Table, frozen=True):
    """Joint friction of the arm model (7). Without `viscous_Nms_per_rad` the arm's published one holds.

    `turnover_rad`: the way in which Coulomb friction turns over after a reversal.
    """

    coulomb_Nm: Amounts
    turnover_rad: Annotated[float, Meta(gt=0, le=0.1)]
    viscous_Nms_per_rad: Amounts | None = None


class Arm(_Table, frozen=True):
    """The WAM and its bus; `base` is T_world_base, pose of DH frame 0 in the world.

    `own_file`: what `stillgrasp calibrate` measured on this arm, laid over the packaged parameters.
    """

    interface: Literal["seqpacket", "socketcan"]
    channel: Text
    base: Pose
    limits: ArmLimits
    gains: ArmGains
    friction: ArmFriction
    own_file: Text | None = None


class HandChoice(_Table, frozen=True):
    """Which hand, and `mount`: T_wrist_hand, pose of the hand frame in the tool plate's."""

    name: Text
    preset: Text
    mount: Pose
    file: Text | None = None

    @property
    def source(self) -> str:
        """What `load_hand` takes: the file where there is one, else the name."""
        return self.file or self.name


class TendonMotor(_Table, frozen=True):
    """One tendon motor: address, direction, zero and calibrated load law (Dynamixel reference 1.3, 3).

    `travel_m`: excursions that may be commanded, lower and upper. `position_gain`: the position loop's stiffness in the
    model's own register, else the model's default. The load law is `torque_constant_Nm_per_A` and `friction_current_A`
    for a model that measures its current; for one that tells its load, `stall_torque_12V_Nm`, `friction_load` (part
    of full output at 12 V) and `back_emf_load_s_per_m` (the same per m/s of tendon); else what is published of them.
    `calibrated`: on which motor `stillgrasp calibrate motor-load` measured that; another model or firmware is refused.
    """

    id: Annotated[int, Meta(ge=0, le=253)]
    tightening_sign: Literal[-1, 1]
    zero_ticks: Annotated[int, Meta(ge=-1048575, le=1048575)]
    spool_radius_m: Annotated[float, Meta(gt=0, le=0.1)]
    travel_m: tuple[_Excursion, _Excursion] = (-0.005, 0.0495)
    position_gain: Annotated[int, Meta(ge=1, le=16383)] | None = None
    torque_constant_Nm_per_A: Annotated[float, Meta(gt=0, le=20)] | None = None
    friction_current_A: Annotated[float, Meta(ge=0, le=2)] | None = None
    stall_torque_12V_Nm: Annotated[float, Meta(gt=0, le=20)] | None = None
    friction_load: Annotated[float, Meta(ge=0, le=0.5)] | None = None
    back_emf_load_s_per_m: Annotated[float, Meta(ge=0, le=100)] | None = None
    calibrated: LoadCalibration | None = None

    def __post_init__(self) -> None:
        if not self.travel_m[0] < self.travel_m[1]:
            raise FieldError("travel_m", "a lower and then an upper excursion")


class Tendons(_Table, frozen=True):
    """The serial bus of the tendon motors, and what protects them.

    `model`: what was calibrated; another one is refused. Without it, whatever answers. `holding_cap_N`: load cap of a
    frozen or stalled motor, where it is lower than the commanded one. From `derating_start_C` on a motor's load cap
    loses `derating_per_K` of itself with each kelvin. Beyond `stall_timeout_s` at its load cap and at rest, a motor
    gives up its goal and holds. `watchdog_s`: bus silence after which a motor stops and holds, 0 = never; protocol 1.0
    has none. `compliance_m_per_N` and `lag_s`: how the position loop gives way under tension and at speed, where
    measured; else worked out from model and gain. `effort_filter_s`: time constant of the low-pass between effort and
    tension, 0 = none. `own_file`: what `stillgrasp calibrate motors` and `motor-load` measured, laid over this table.
    """

    port: Text
    baud: Annotated[int, Meta(ge=9600, le=4_500_000)]
    poll_period_s: Annotated[float, Meta(ge=0.001, le=0.1)]
    derating_start_C: Annotated[float, Meta(ge=30, le=100)]
    derating_per_K: Annotated[float, Meta(ge=0, le=1)]
    stall_timeout_s: Annotated[float, Meta(ge=0.1, le=3600)]
    watchdog_s: Annotated[float, Meta(ge=0, le=2.54)]
    effort_filter_s: Annotated[float, Meta(ge=0, le=0.1)]
    right: TendonMotor
    left: TendonMotor
    model: Text | None = None
    compliance_m_per_N: Annotated[float, Meta(ge=0, le=1e-3)] | None = None
    lag_s: Annotated[float, Meta(ge=0, le=0.5)] | None = None
    holding_cap_N: Annotated[float, Meta(gt=0, le=300)] | None = None
    own_file: Text | None = None

    def __post_init__(self) -> None:
        if self.right.id == self.left.id:
            raise FieldError("left.id", f"another id than right.id = {self.right.id}")
        if 0 < self.watchdog_s < 0.02:
            raise FieldError("watchdog_s", "0 (off) or 0.02 to 2.54")
        if self.model is None:
            return
        check_model_name("model", self.model)
        for side, motor in (("right", self.right), ("left", self.left)):
            if motor.calibrated is not None and model_by_name(motor.calibrated.model) is not model_by_name(self.model):
                raise FieldError(f"{side}.calibrated.model", f"{self.model}, as tendons.model says, or no calibration")


class Cycle(_Table, frozen=True):
    """The cycle's pace and place: period, SCHED_FIFO priority (0 = ordinary scheduling), processor."""

    period_s: Annotated[float, Meta(ge=0.001, le=0.02)]
    priority: Annotated[int, Meta(ge=0, le=98)]
    cpu: Annotated[int, Meta(ge=0, le=1023)] | None = None


class Compensation(_Table, frozen=True):
    """Which index drives the compensation, and the limits of the wrist's offset. `index`: "auto" is fused, or excursion
    where the hand file has tendons that do not stretch, or with RX-28 motors. `tendon_stiffness_uncertainty`: relative
    standard deviation of the hand file's tendon stiffness; a braided line's is known to 30 %, unless measured.
    """

    enabled: bool
    index: Literal["auto", "load", "excursion", "fused"]
    max_offset_m: Annotated[float, Meta(gt=0, le=0.5)]
    max_offset_rad: Annotated[float, Meta(gt=0, le=3.2)]
    velocity_m_s: Annotated[float, Meta(gt=0, le=1)]
    acceleration_m_s2: Annotated[float, Meta(gt=0, le=20)]
    jerk_m_s3: Annotated[float, Meta(gt=0, le=10000)]
    velocity_rad_s: Annotated[float, Meta(gt=0, le=5)]
    acceleration_rad_s2: Annotated[float, Meta(gt=0, le=100)]
    jerk_rad_s3: Annotated[float, Meta(gt=0, le=100000)]
    tendon_stiffness_uncertainty: Annotated[float, Meta(ge=0, le=1)] = 0.3


class Tactile(_Table, frozen=True):
    """Tactile pads; without this table there are none, and no process for them.

    `channel`: with "usb" the bridge's serial number, which may be empty where there is one bridge only; with "socket"
    the path of a simulated one. Cells are [row, column]. `own_file`: what `stillgrasp calibrate tactile` wrote; without
    one newtons are rough.
    """

    interface: Literal["usb", "socket"]
    right_cells: Cells
    left_cells: Cells
    channel: str = ""
    period_s: Annotated[float, Meta(ge=0.004, le=0.05)] = 0.008
    touch_N: Annotated[float, Meta(gt=0, le=10)] = 0.15
    release_N: Annotated[float, Meta(gt=0, le=10)] = 0.07
    own_file: Text | None = None

    def __post_init__(self) -> None:
        if not self.release_N < self.touch_N:
            raise FieldError("release_N", f"less than touch_N = {self.touch_N}")
        if self.interface == "socket" and not self.channel:
            raise FieldError("channel", "the path of the simulated bridge's socket")
        cells = (*self.right_cells, *self.left_cells)
        if len(set(cells)) != len(cells):
            raise FieldError("left_cells", "cells that are named once, and not under right_cells")


class Squeeze(_Table, frozen=True):
    """Tendon load cap and the default winding profile (tendon excursion, m)."""

    load_cap_N: Annotated[float, Meta(gt=0, le=300)]
    closing_rate_m_s: Annotated[float, Meta(ge=SLOWEST_CLOSING_M_S, le=FASTEST_CLOSING_M_S)]
    squeeze_rate_m_s: Annotated[float, Meta(gt=0, le=0.05)]
    acceleration_m_s2: Annotated[float, Meta(gt=0, le=10)]
    jerk_m_s3: Annotated[float, Meta(gt=0, le=1000)]


class Safety(_Table, frozen=True):
    """Bands beyond which the cycle stops (joints: 7, base to tool)."""

    tracking_error_rad: Rates
    torque_residual_Nm: Amounts
    hand_age_s: Annotated[float, Meta(ge=0.01, le=10)]


class Front(_Table, frozen=True):
    """Where commands come in and the state goes out."""

    command_endpoint: Text
    state_endpoint: Text
    state_rate_hz: Annotated[float, Meta(ge=1, le=500)]

    def __post_init__(self) -> None:
        for key, endpoint, accepted in (
            ("command_endpoint", self.command_endpoint, COMMAND_ENDPOINTS),
            ("state_endpoint", self.state_endpoint, STATE_ENDPOINTS),
        ):
            local_tcp = key == "state_endpoint" and endpoint.startswith("tcp://127.0.0.1:")
            if not (endpoint.startswith("ipc:///") or local_tcp):
                raise FieldError(key, accepted)


COMMAND_ENDPOINTS = "ipc:// and an absolute path (commands over tcp need keys, which are not built yet)"
STATE_ENDPOINTS = "ipc:// and an absolute path, or tcp://127.0.0.1:PORT"


class Tables(_Table, frozen=True):
    """Where motion tables are looked for by name."""

    directory: Text


class Recording(_Table, frozen=True):
    """Whether and where every run is recorded."""

    enabled: bool
    directory: Text


class RobotConfig(_Table, frozen=True):
    """One installation."""

    arm: Arm
    hand: HandChoice
    tendons: Tendons
    cycle: Cycle
    compensation: Compensation
    squeeze: Squeeze
    safety: Safety
    front: Front
    tables: Tables
    recorder: Recording
    tactile: Tactile | None = None

    @property
    def T_world_base(self) -> NDArray[np.float64]:
        """Pose of the arm's DH frame 0 in the world, 4×4, m."""
        return self.arm.base.matrix()

    @property
    def T_wrist_hand(self) -> NDArray[np.float64]:
        """Pose of the hand frame in the tool plate's frame, 4×4, m."""
        return self.hand.mount.matrix()


def load_config(
    path: str | Path | None = None, overrides: Mapping[str, Any] | None = None, *, simulated: bool = False
) -> RobotConfig:
    """The installation in the file `path`, laid over the default one; without `path` the default one.

    `simulated`: below the file lies `simulated.toml` too, which a simulation in real time needs. `overrides`, nested
    like the file, are laid over it: what the command line decides. What was measured on the tendon motors, in
    `tendons.own_file`, lies over all; that file need not exist yet. Raises ConfigurationError.
    """
    file = DEFAULT_FILE if path is None else Path(path)
    document = load_document(DEFAULT_FILE)
    if simulated:
        document = merged(document, load_document(SIMULATED_FILE))
    if path is not None:
        document = merged(document, load_document(file))
    document = merged(document, overrides or {})
    places = {"{runtime}": str(runtime_directory()), "{data}": str(data_directory())}
    document = _placed(document, places)
    config = from_document(document, RobotConfig, file)
    own_file = config.tendons.own_file
    if own_file is None or not Path(own_file).exists():  # whoever starts the motors refuses to do without it
        return config
    measured = {"tendons": read_motor_file(Path(own_file)).laid_over_tendons()}
    return from_document(merged(document, measured), RobotConfig, own_file)


def runtime_directory() -> Path:
    """Directory of sockets that live as long as the daemon; not created here."""
    if systemd := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(systemd.split(":")[0])
    if session := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(session) / "stillgrasp"
    return Path(f"/tmp/stillgrasp-{os.getuid()}")


def data_directory() -> Path:
    """Directory of motion tables and recordings; not created here."""
    if systemd := os.environ.get("STATE_DIRECTORY"):
        return Path(systemd.split(":")[0])
    data_home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data_home) / "stillgrasp"


def _placed(value: Any, places: Mapping[str, str]) -> Any:
    if isinstance(value, Mapping):
        return {key: _placed(item, places) for key, item in value.items()}
    if isinstance(value, str):
        for placeholder, place in places.items():
            value = value.replace(placeholder, place)
    return value
