"""The command language: what a client may ask, and how it is answered (design 6). Pure: bytes in, structs out.

    request  {"v": 1, "seq": int, "command": str, "args": {…}, "deadline_s": float?}

as a msgpack map. `seq` is the client's number, given back in the answers (`answers.py`). A *slow* command is answered
at once and ends with an event. `deadline_s`: how long the command may take, in seconds from its arrival.

A bad request is a `RequestError`. Its codes: too_large, not_msgpack, unsupported_version, unknown_command, missing_key,
extra_key, wrong_type, out_of_range, not_finite.
"""

from __future__ import annotations

import difflib
import math
import reprlib
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from calibration.toml_files import MISSING, FieldError, from_document
from controller.config import FASTEST_CLOSING_M_S, SLOWEST_CLOSING_M_S
from controller.pose import Component, Coordinate, Pose
from controller.service.answers import VERSION as VERSION
from controller.service.answers import plain
from drivers.errors import CommandError, ConfigurationError

MAXIMUM_REQUEST_BYTES = 65536
LARGEST_SEQUENCE = 2**53

T = TypeVar("T")

Fraction = Annotated[float, Meta(ge=0.01, le=1)]
"""Part of the configured joint velocity limits, 0.01 to 1."""
_Angle = Annotated[float, Meta(ge=-6.3, le=6.3)]
_Name = Annotated[str, Meta(min_length=1, max_length=1024)]


class Command(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all commands; the fields of a command are its `args`."""

    name: ClassVar[str]
    slow: ClassVar[bool] = False
    """Answered at once, ended by an event."""


class Hello(Command, frozen=True):
    """Who is there: versions, arm, hand, tables. `client` is shown in the log."""

    name = "hello"
    client: Annotated[str, Meta(max_length=200)] = ""


class Status(Command, frozen=True):
    """States, faults and applied values, once."""

    name = "status"


class Stop(Command, frozen=True):
    """Stop arm and winding along their path and hold."""

    name = "stop"


class FaultClear(Command, frozen=True):
    """Leave the fault once its cause is gone."""

    name = "fault.clear"


class Shutdown(Command, frozen=True):
    """Stop, hold, idle the arm and end the daemon; the hand does not open."""

    name = "shutdown"


class ArmHold(Command, frozen=True):
    """Stop the arm along its path and hold there."""

    name = "arm.hold"


class ArmMoveJoints(Command, frozen=True):
    """Move to joint angles (7), rad, base to tool, DH convention."""

    name = "arm.move_joints"
    slow = True
    joint_rad: tuple[_Angle, _Angle, _Angle, _Angle, _Angle, _Angle, _Angle]
    speed: Fraction = 0.5


class ArmMoveWrist(Command, frozen=True):
    """Move the wrist (tool plate) to a pose in the world."""

    name = "arm.move_wrist"
    slow = True
    T_world_wrist: Pose
    speed: Fraction = 0.5


class HandOpen(Command, frozen=True):
    """Pay out both tendons to the open position; accepted in a fault too."""

    name = "hand.open"
    slow = True


class GraspPreposition(Command, frozen=True):
    """Bring the open hand to where the table's grasp starts, around an object whose pose in the world is given.

    The orientation is `object_yaw_rad` about the world's z, or `object_quaternion_wxyz`; not both. The hand comes in
    along its palm normal over the last `approach_m`.
    """

    name = "grasp.preposition"
    slow = True
    table: _Name
    object_xyz_m: tuple[Coordinate, Coordinate, Coordinate]
    object_yaw_rad: _Angle | None = None
    object_quaternion_wxyz: tuple[Component, Component, Component, Component] | None = None
    approach_m: Annotated[float, Meta(ge=0, le=0.3)] = 0.1
    speed: Fraction = 0.5

    def __post_init__(self) -> None:
        if self.object_yaw_rad is not None and self.object_quaternion_wxyz is not None:
            raise FieldError("object_quaternion_wxyz", "either object_yaw_rad or object_quaternion_wxyz")
        self.T_world_object()

    def T_world_object(self) -> NDArray[np.float64]:
        """Pose of the object's frame in the world, 4×4, m; its axes are the world's where no orientation is given."""
        half_yaw = 0.5 * (self.object_yaw_rad or 0.0)
        quaternion = self.object_quaternion_wxyz or (math.cos(half_yaw), 0.0, 0.0, math.sin(half_yaw))
        try:
            return Pose(self.object_xyz_m, quaternion).matrix()
        except FieldError as error:
            raise FieldError("object_quaternion_wxyz", error.accepted) from error


class GraspClose(Command, frozen=True):
    """Wind both tendons in until the fingers touch; `rate_m_s` of tendon, else the configured closing rate. Near the
    object they go on at 1 mm/s whatever the rate; slower, gear friction would hide the load."""

    name = "grasp.close"
    slow = True
    rate_m_s: Annotated[float, Meta(ge=SLOWEST_CLOSING_M_S, le=FASTEST_CLOSING_M_S)] | None = None


class GraspSqueeze(Command, frozen=True):
    """Wind in to a mean tendon load of `load_N`, within the cap, in `duration_s` or at the configured rate."""

    name = "grasp.squeeze"
    slow = True
    load_N: Annotated[float, Meta(gt=0, le=300)]
    duration_s: Annotated[float, Meta(ge=0.05, le=600)] | None = None


class GraspHold(Command, frozen=True):
    """Stop winding and hold both excursions."""

    name = "grasp.hold"


class GraspRelease(Command, frozen=True):
    """Pay out, compensating backwards, until the object is free; accepted in a fault too."""

    name = "grasp.release"
    slow = True


class TableList(Command, frozen=True):
    """Names and headers of the motion tables in the tables' directory."""

    name = "table.list"


class TableLoad(Command, frozen=True):
    """Hand a motion table, by name or path, to the cycle; only while nothing is gripped."""

    name = "table.load"
    table: _Name


class CompensationSet(Command, frozen=True):
    """Switch the compensation on or off and choose its index; only while nothing is gripped."""

    name = "compensation.set"
    enabled: bool
    index: Literal["load", "excursion", "fused"] | None = None


COMMANDS: dict[str, type[Command]] = {kind.name: kind for kind in Command.__subclasses__()}


class Request(Struct, frozen=True):
    """A request that passed every check."""

    seq: int
    command: Command
    deadline_s: float | None = None


class RequestError(CommandError):
    """A request that is not acceptable; `seq` is its number where that could be read."""

    def __init__(self, code: str, problem: str, *, accepted: str, key: str = "", seq: int | None = None) -> None:
        super().__init__(code, f"{problem}; expected {accepted}.", key=key, accepted=accepted)
        self.seq = seq


_WHOLE = "(file)"
"""The key that `from_document` gives to an error of the document itself."""


class _Envelope(Struct, frozen=True, forbid_unknown_fields=True):
    v: Literal[1]
    seq: Annotated[int, Meta(ge=0, le=LARGEST_SEQUENCE)]
    command: str
    args: dict[str, Any]
    deadline_s: Annotated[float, Meta(gt=0, le=3600)] | None = None


def decode_request(data: bytes) -> Request:
    """The request in `data`. Raises `RequestError`, which names the key and what is accepted."""
    if len(data) > MAXIMUM_REQUEST_BYTES:
        accepted = f"at most {MAXIMUM_REQUEST_BYTES} bytes"
        raise RequestError("too_large", f"The request has {len(data)} bytes", accepted=accepted)
    try:
        content = msgspec.msgpack.decode(data)
    except (ValueError, RecursionError, msgspec.MsgspecError) as error:
        accepted = "one msgpack map with v, seq, command and args"
        raise RequestError("not_msgpack", f"The request is not msgpack: {error}", accepted=accepted) from error
    if not isinstance(content, dict):
        accepted = "one map with v, seq, command, args and optionally deadline_s"
        raise RequestError("wrong_type", f"The request is a {type(content).__name__}", accepted=accepted)
    seq = _sequence(content)
    version = content.get("v")
    if isinstance(version, int) and not isinstance(version, bool) and version != VERSION:
        message = f"request: v = {version} is not spoken here"
        raise RequestError("unsupported_version", message, seq=seq, key="v", accepted=f"v = {VERSION}")
    envelope = _converted(content, _Envelope, "request", seq)
    kind = _kind(envelope.command, seq)
    return Request(envelope.seq, _converted(envelope.args, kind, kind.name, seq), envelope.deadline_s)


def make_command(name: str, args: Mapping[str, Any]) -> Command:
    """The command `name` with `args` as a request holds them; None and NumPy values are fine. Raises `RequestError`."""
    given = {key: value for key, value in args.items() if value is not None}
    return _converted(msgspec.to_builtins(given, enc_hook=plain), _kind(name, None), name, None)


def encode_request(request: Request) -> bytes:
    """The bytes of a request; fields that are None are left out, so that the daemon's defaults hold."""
    args = {key: value for key, value in msgspec.to_builtins(request.command).items() if value is not None}
    message = {"v": VERSION, "seq": request.seq, "command": request.command.name, "args": args}
    if request.deadline_s is not None:
        message["deadline_s"] = request.deadline_s
    return msgspec.msgpack.encode(message)


def _kind(name: str, seq: int | None) -> type[Command]:
    kind = COMMANDS.get(name)
    if kind is None:
        close = difflib.get_close_matches(name[:100], COMMANDS, n=1)
        accepted = (f"{close[0]}? One of " if close else "one of ") + ", ".join(COMMANDS)
        problem = f"There is no command {reprlib.repr(name)}"
        raise RequestError("unknown_command", problem, seq=seq, key="command", accepted=accepted)
    return kind


def _sequence(content: dict[Any, Any]) -> int | None:
    seq = content.get("seq")
    return seq if isinstance(seq, int) and not isinstance(seq, bool) and 0 <= seq <= LARGEST_SEQUENCE else None


def _converted(content: dict[str, Any], kind: type[T], name: str, seq: int | None) -> T:
    try:
        return msgspec.convert(content, kind)  # every float has a range, and ranges refuse NaN and infinity
    except msgspec.ValidationError as error:
        try:
            from_document(content, kind, name)  # slow, but knows key, value and what is accepted
        except ConfigurationError as told:
            code = _code(str(error), told.value)
            key = "" if told.key == _WHOLE else told.key
            if not key:
                problem = f"{name}: a key is not a text"
            elif told.value == MISSING:
                problem = f"{name}: {key} is missing"
            else:
                problem = f"{name}: {key} = {reprlib.repr(told.value)} is not accepted"
            raise RequestError(code, problem, seq=seq, key=key, accepted=told.accepted) from error
        raise


def _code(told_by_msgspec: str, value: object) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return "not_finite"
    if told_by_msgspec.startswith("Object missing required field"):
        return "missing_key"
    if told_by_msgspec.startswith("Object contains unknown field"):
        return "extra_key"
    if ", got `" in told_by_msgspec or " - at `key` in " in told_by_msgspec:
        return "wrong_type"
    return "out_of_range"
