"""The arm's own file: TOML with what was measured on one arm, key = value without tables, as `wam7.toml`.

Written whole and atomically by calibrations; the file as it was stays beside it as `.bak`. Which keys there are, and
what they may hold, is `parameters.py`'s business.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import tomllib
from collections.abc import Collection, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from drivers.errors import ConfigurationError, InputError

_HEADER = (
    "# What was measured on this arm, laid over the packaged wam7.toml. Written by `stillgrasp calibrate`, which\n"
    "# keeps all keys but no comments; the file before the last calibration is beside this one, ending in .bak.\n"
)


def read_flat_toml(file: Path) -> dict[str, Any]:
    """The keys of `file`. ConfigurationError if it cannot be read or is not TOML."""
    try:
        return tomllib.loads(file.read_bytes().decode("utf-8"))
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(file, "file", str(error), "a readable TOML file") from error


def write_own_file(
    file: Path, changes: Mapping[str, object], *, without: Collection[str] = (), header: str = _HEADER
) -> None:
    """Lay `changes` over the keys of `file`, which need not exist yet, `without` some that it had; all or nothing.

    Values are numbers, strings, or lists and inline tables of them, nested at will; `header` is the comment at its top.
    Raises ConfigurationError if an existing file is not TOML, and InputError if the new one cannot be written: the old
    one then stands as it was.
    """
    before = read_flat_toml(file) if file.exists() else {}
    kept = {key: value for key, value in before.items() if key not in without}
    lines = [f"{key} = {_written(key, value)}\n" for key, value in {**kept, **changes}.items()]
    text = f"{header}\n{''.join(lines)}"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if before:
            _replace(file.with_name(f"{file.name}.bak"), file.read_bytes())
        _replace(file, text.encode())
    except OSError as error:
        raise InputError(
            f"{file}: this file cannot be written ({error.strerror or error}).",
            help="Name a file in a directory that is yours.",
        ) from error


def _written(key: str, value: object) -> str:
    if isinstance(value, bool | str):
        # A JSON string is a TOML basic string, but for one character.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float) and isfinite(value):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_written(key, item) for item in value)}]"
    if isinstance(value, Mapping):
        items = (f"{name} = {_written(f'{key}.{name}', item)}" for name, item in value.items())
        return f"{{ {', '.join(items)} }}"
    raise InputError(
        f"{key} = {value!r} cannot be written; expected finite numbers, strings, or lists and tables of them."
    )


def _replace(file: Path, content: bytes) -> None:
    """Write `content` so that whoever opens `file` finds either all of it or what was there before."""
    descriptor, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o644)
        os.replace(name, file)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise
