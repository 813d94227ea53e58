"""Private directories of simulations: made, kept while somebody lives there, and removed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from controller.service.run_directory import RunDirectory
from drivers.errors import InputError


def test_neighbours_are_left_alone_and_ruins_removed(tmp_path: Path) -> None:
    """Simulations share a runtime directory; only what nobody holds a lock on goes."""
    base = tmp_path / "runtime"
    ruin = base / "simulated-ruin"
    (ruin / "inner").mkdir(parents=True)
    first = RunDirectory(base)
    assert not ruin.exists()
    assert first.path.stat().st_mode & 0o777 == 0o700
    second = RunDirectory(base)
    assert first.path.exists()
    assert first.path != second.path
    inherited = os.dup(second.descriptor)  # as a child that outlives its parent
    os.close(second.descriptor)
    RunDirectory(base).remove()
    assert second.path.exists()
    os.close(inherited)
    RunDirectory(base).remove()
    assert not second.path.exists()
    first.remove()
    first.remove()
    assert list(base.iterdir()) == []


def test_a_place_that_is_none_is_refused(tmp_path: Path) -> None:
    """A file where the runtime directory should be."""
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="No directory for sockets"):
        RunDirectory(tmp_path / "file")
