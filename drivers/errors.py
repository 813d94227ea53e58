"""The one error tree of stillgrasp.

    StillgraspError                     what happened, what was expected, what to do
    ├── InputError (ValueError)         a file, command or value from outside is not acceptable
    │   ├── ConfigurationError          in a TOML file: file, key, value, accepted
    │   ├── CommandError                in a command: code, key, accepted
    │   └── TableError                  a motion table is damaged, altered or for something else
    ├── MechanicsError                  the hand, object and grasp have no solution
    └── DeviceError                     a device or its bus
        ├── BusError                    nothing can be sent or received
        ├── NoReplyError (TimeoutError) a device kept silent
        └── ProtocolError               a device said something that its protocol does not allow

Data are kept as attributes; the message is made once, here, so that every error reads alike.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any


class StillgraspError(Exception):
    """Base of all errors. `message` says what happened and what was expected, `help` what to do."""

    def __init__(self, message: str, *, help: str = "") -> None:
        super().__init__(message if not help else f"{message} {help}")
        self.message = message
        self.help = help

    def __reduce__(self) -> tuple[Any, ...]:
        """Errors travel between processes: made anew from what they hold, not from their constructor's arguments."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(kind: type[StillgraspError], args: tuple[Any, ...], attributes: dict[str, Any]) -> StillgraspError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error


class InputError(StillgraspError, ValueError):
    """Something that came from outside is not acceptable; nothing was changed."""


class ConfigurationError(InputError):
    """A TOML file has a wrong key, unit or value."""

    def __init__(self, file: str | Path, key: str, value: object, accepted: str, *, help: str = "") -> None:
        super().__init__(f"{file}: {key} = {value!r} is not accepted; expected {accepted}.", help=help)
        self.file = str(file)
        self.key = key
        self.value = value
        self.accepted = accepted


class CommandError(InputError):
    """A command is malformed or not possible now. `code` is stable, for programs."""

    def __init__(self, code: str, message: str, *, key: str = "", accepted: str = "", help: str = "") -> None:
        super().__init__(message, help=help)
        self.code = code
        self.key = key
        self.accepted = accepted


class TableError(InputError):
    """A motion table is damaged, altered, or belongs to another hand, object or grasp."""

    def __init__(self, source: str | Path, reason: str, *, help: str = "") -> None:
        super().__init__(f"{source}: {reason}", help=help)
        self.source = str(source)
        self.reason = reason


class MechanicsError(StillgraspError):
    """Hand, object and grasp have no solution; `parameter` names what makes it so."""

    def __init__(self, parameter: str, message: str, *, help: str = "") -> None:
        super().__init__(f"{parameter}: {message}", help=help)
        self.parameter = parameter


class DeviceError(StillgraspError):
    """A device or its bus failed; `device` names it."""

    def __init__(self, device: str, message: str, *, help: str = "") -> None:
        super().__init__(f"{device}: {message}", help=help)
        self.device = device


class BusError(DeviceError):
    """Nothing can be sent or received on the bus."""


class NoReplyError(DeviceError, TimeoutError):
    """A device kept silent beyond its time."""


class ProtocolError(DeviceError):
    """A device said something that its protocol does not allow."""
