"""The state of the sources that a study's results depend on, so that old results are not taken for new ones."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def sources_sha256() -> str:
    """Of all that a result depends on but the study itself."""
    total = hashlib.sha256()
    for file in sorted(_sources()):
        total.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes() + b"\0")
    return total.hexdigest()


def _sources() -> Iterator[Path]:
    for package in ("drivers", "calibration", "controller"):
        for pattern in ("*.py", "*.toml", "*.urdf"):
            yield from (ROOT / package).rglob(pattern)
