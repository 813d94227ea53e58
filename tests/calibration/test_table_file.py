"""Table files and memory files: what is written comes back, and nothing altered is accepted."""

import os
import pickle
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.table_file import MAGIC, read_file, read_memory, write_file, write_memory
from drivers.errors import TableError

HEADER = {"name": "θ", "list": [1, 2.5], "inner": {"a": None}}
ARRAYS = {"a.b": np.arange(6.0).reshape(2, 3), "c": np.array([1, 2], np.int8), "d": np.zeros((0, 3))}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("table") / "table.npz"
    write_file(path, HEADER, ARRAYS)
    return path.read_bytes()


def same(arrays: dict[str, np.ndarray], others: dict[str, np.ndarray]) -> bool:
    return arrays.keys() == others.keys() and all(
        arrays[k].dtype == others[k].dtype and np.array_equal(arrays[k], others[k]) for k in arrays
    )


def test_round_trip_and_plain_numpy_reads_it(tmp_path: Path) -> None:
    """The file is an ordinary npz without pickle, and comes back exactly; no neighbour is left behind."""
    path = tmp_path / "deep" / "table.npz"
    write_file(path, HEADER, ARRAYS)
    header, arrays = read_file(path)
    assert header == HEADER
    assert same(arrays, ARRAYS)
    with np.load(path, allow_pickle=False) as archive:
        assert np.array_equal(archive["a.b"], ARRAYS["a.b"])
    assert [item.name for item in path.parent.iterdir()] == ["table.npz"]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_change_is_refused(written: bytes, tmp_path: Path, data: st.DataObject) -> None:
    """One flipped bit anywhere, a lost end, an added end, a lost or doubled stretch: all refused, none crashes."""
    kind = data.draw(st.sampled_from(["flip", "cut", "add", "drop"]))
    at = data.draw(st.integers(0, len(written) - 1))
    content = bytearray(written)
    if kind == "flip":
        content[at] ^= 1 << data.draw(st.integers(0, 7))
    elif kind == "cut":
        del content[at:]
    elif kind == "add":
        content += data.draw(st.binary(min_size=1, max_size=200))
    else:
        del content[at : at + data.draw(st.integers(1, 50))]
    path = tmp_path / "altered.npz"
    path.write_bytes(content)
    with pytest.raises(TableError, match=r"altered\.npz"):
        read_file(path)


def test_foreign_files_are_refused_with_the_reason(tmp_path: Path) -> None:
    """A missing file, another npz, a pickle and a folder each say what they are not."""
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps(HEADER))
    for name, said in (
        ("none.npz", "cannot be read"),
        ("other.npz", "integrity mark is missing"),
        ("pickle.npz", "is not a motion table"),
        (".", "cannot be read"),
    ):
        with pytest.raises(TableError, match=said):
            read_file(tmp_path / name)


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A write that fails keeps the table that was there, and leaves nothing else."""
    path = tmp_path / "table.npz"
    write_file(path, HEADER, ARRAYS)
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(TableError, match="No space left"):
        write_file(path, {"other": 1}, ARRAYS)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_zip_tools_find_the_file_sound(tmp_path: Path) -> None:
    """The integrity mark does not make the archive improper."""
    path = tmp_path / "table.npz"
    write_file(path, HEADER, ARRAYS)
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.comment.startswith(b"stillgrasp-sha256:")


def test_memory_round_trip_is_sealed() -> None:
    """The other process gets the same arrays, and nobody can write them any more."""
    descriptor = write_memory(HEADER, ARRAYS)
    try:
        with pytest.raises(PermissionError):
            os.write(descriptor, b"x")
        with pytest.raises(PermissionError):
            os.ftruncate(descriptor, 1)
        header, arrays = read_memory(descriptor)
    finally:
        os.close(descriptor)
    assert header == HEADER
    assert same(arrays, ARRAYS)
    assert not any(array.flags.writeable for array in arrays.values() if array.size)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "too short"),
        (b"x" * 200, "starts with"),
        (MAGIC + struct.pack("<Q", 1 << 40) + b"{}" * 40, "claims a header"),
        (MAGIC + struct.pack("<Q", 3) + b"{{}" + b"\0" * 200, "cannot be decoded"),
        (MAGIC + struct.pack("<Q", 2) + b"{}" + b"\0" * 200, "cannot be decoded"),
        (MAGIC + struct.pack("<Q", 39) + b'{"header": {}, "layout": {}, "size": 9}' + b"\0" * 200, "expected"),
    ],
)
def test_a_wrong_memory_file_is_refused(content: bytes, said: str) -> None:
    """Magic, sizes and header are checked before anything is read."""
    import fcntl

    from calibration.table_file import SEALS

    descriptor = os.memfd_create("wrong", os.MFD_ALLOW_SEALING)
    try:
        os.write(descriptor, content)
        with pytest.raises(TableError, match="not sealed"):
            read_memory(descriptor)
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, SEALS)
        with pytest.raises(TableError, match=said):
            read_memory(descriptor)
    finally:
        os.close(descriptor)


def test_an_ordinary_file_is_no_memory_file(tmp_path: Path) -> None:
    """A descriptor of something else is refused, not mapped."""
    with (tmp_path / "x").open("wb") as file, pytest.raises(TableError):
        read_memory(file.fileno())
