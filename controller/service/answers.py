"""What the daemon answers: replies and events, as bytes and back (design 6). Pure.

    reply    {"v": 1, "seq": int, "ok": true, "result": {…}}
             {"v": 1, "seq": int | null, "ok": false, "error": {"code", "message", "help"}}
    event    {"v": 1, "event": "accepted" | "progress" | "completed" | "failed" | …, "seq": int | null, …}

All are msgpack maps. `seq` is that of the request; null where a request was too broken to have one, and in events that
no request caused. A slow command ends with exactly one event `completed` or `failed`; `failed` holds an `error` as a
reply does. Until then `progress` comes some ten times a second (`progress.py`). Events may hold any further keys. NumPy
arrays and scalars are written as lists and numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any, Literal

import msgspec
import numpy as np
from msgspec import Struct

from drivers.errors import CommandError, StillgraspError

VERSION = 1
ENDINGS = ("completed", "failed")


class ErrorTold(Struct, frozen=True):
    """An error as the other side sees it."""

    code: str
    message: str
    help: str = ""

    def as_error(self) -> CommandError:
        """The same as an exception."""
        return CommandError(self.code, self.message, help=self.help)


class Reply(Struct, frozen=True):
    """Answer to one request: `result`, or `error` where `ok` is false."""

    v: Literal[1]
    seq: int | None
    ok: bool
    result: dict[str, Any] = {}
    error: ErrorTold | None = None


class Event(Struct, frozen=True):
    """Something that happened; `fields` are the keys beside `v`, `event` and `seq`."""

    event: str
    seq: int | None
    fields: dict[str, Any] = {}

    @property
    def error(self) -> ErrorTold | None:
        """The error of a `failed` event."""
        told = self.fields.get("error")
        return msgspec.convert(told, ErrorTold) if isinstance(told, dict) else None


def plain(value: Any) -> Any:
    """`enc_hook` of every encoder of the service: NumPy and paths as plain values."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, PurePath):
        return str(value)
    raise NotImplementedError(f"{type(value).__name__} cannot be written to a message")


_ENCODER = msgspec.msgpack.Encoder(enc_hook=plain)


def encode_reply(seq: int, result: Mapping[str, Any]) -> bytes:
    """Bytes of a reply that says yes."""
    return _ENCODER.encode({"v": VERSION, "seq": seq, "ok": True, "result": result})


def encode_error(seq: int | None, error: StillgraspError) -> bytes:
    """Bytes of a reply that says no, and why."""
    return _ENCODER.encode({"v": VERSION, "seq": seq, "ok": False, "error": error_told(error)})


def encode_event(event: str, seq: int | None = None, /, **fields: Any) -> bytes:
    """Bytes of an event with any further keys; a `failed` one takes `error=error_told(…)`."""
    return _ENCODER.encode({**fields, "v": VERSION, "event": event, "seq": seq})


def error_told(error: StillgraspError) -> ErrorTold:
    """An exception as messages carry it. Errors without a code of their own have `failed`."""
    return ErrorTold(error.code if isinstance(error, CommandError) else "failed", error.message, error.help)


def decode_answer(data: bytes) -> Reply | Event:
    """A reply or an event. Raises `CommandError` with code `bad_answer` if it is neither."""
    try:
        content = msgspec.msgpack.decode(data)
        if isinstance(content, dict) and "event" in content:
            if content.get("v") != VERSION:
                raise ValueError(f"version {content.get('v')!r}")
            fields = {key: value for key, value in content.items() if key not in ("v", "event", "seq")}
            return msgspec.convert({"event": content["event"], "seq": content.get("seq"), "fields": fields}, Event)
        return msgspec.convert(content, Reply)
    except (ValueError, RecursionError, msgspec.MsgspecError) as error:
        raise CommandError(
            "bad_answer",
            f"The daemon's answer cannot be read: {error}.",
            help="Client and daemon must come from the same version of stillgrasp.",
        ) from error
