"""A private directory for the sockets of one simulation, below the runtime directory, mode 0700.

Its owner, and every process that inherits `descriptor`, holds a lock on it; a directory whose lock nobody holds was
left by processes that were killed, and the next start removes it.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from pathlib import Path

from drivers.errors import InputError

_PREFIX = "simulated-"


class RunDirectory:
    """A new directory `path` in `base`, which is made if need be. Raises InputError."""

    def __init__(self, base: Path) -> None:
        try:
            base.mkdir(mode=0o750, parents=True, exist_ok=True)
            guard = os.open(base, os.O_RDONLY | os.O_DIRECTORY)
            try:
                fcntl.flock(guard, fcntl.LOCK_EX)  # between making a directory and locking it, nobody tidies up
                _remove_abandoned(base)
                self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=base))
                self.descriptor = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
                fcntl.flock(self.descriptor, fcntl.LOCK_SH)
            finally:
                os.close(guard)
        except OSError as error:
            raise InputError(
                f"No directory for sockets can be made in {base}: {error.strerror}.",
                help="Set XDG_RUNTIME_DIR to a directory of yours.",
            ) from error

    def remove(self) -> None:
        """Remove it with all that is in it; may be called twice."""
        if self.descriptor >= 0:
            shutil.rmtree(self.path, ignore_errors=True)
            os.close(self.descriptor)
            self.descriptor = -1


def _remove_abandoned(base: Path) -> None:
    for path in base.glob(_PREFIX + "*"):
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(path, ignore_errors=True)
        except BlockingIOError:
            pass  # somebody lives there
        finally:
            os.close(descriptor)
