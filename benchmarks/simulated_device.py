"""A simulated device in a process of its own, as `stillgrasp simulate` starts it."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def simulated_device(*words: str) -> Iterator[dict[str, Any]]:
    """What `stillgrasp simulate WORDS --json` says when ready; the device ends with the context.

    SystemExit if it does not start.
    """
    command = [str(Path(sys.executable).with_name("stillgrasp")), "simulate", *words, "--json"]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise SystemExit(f"`{' '.join(command)}` did not start.")
        yield json.loads(line)
    finally:
        process.terminate()
        process.wait()
