"""A motion table as bytes: a file that notices every change, and a sealed memory file for another process.

File: NumPy `.npz` without pickle; member `header` is JSON, the others are arrays. The archive's comment is the
SHA-256 of all bytes before it, so one altered, missing or added byte is found. Written to a neighbour, synced and
renamed. Memory file: magic, length of the JSON, JSON, then the arrays at the offsets it names, sealed against change.
Source: design 2, 4.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import json
import mmap
import os
import struct
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import TableError

Arrays = dict[str, NDArray[Any]]

MARK = b"stillgrasp-sha256:"
COMMENT_SIZE = len(MARK) + 64
MAGIC = b"SGTABLE1"
ALIGNMENT = 64
SEALS = fcntl.F_SEAL_SEAL | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE
REBUILD = "Build it again with `stillgrasp table build`."


def write_file(path: str | Path, header: Mapping[str, Any], arrays: Arrays) -> None:
    """Write atomically: readers see the old file or the whole new one. Errors: TableError."""
    path = Path(path)
    text = np.frombuffer(json.dumps(header, sort_keys=True, allow_nan=False).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, header=text, **arrays)
    body = buffer.getvalue()[:-2] + struct.pack("<H", COMMENT_SIZE)  # a zip ends with the length of its comment
    content = body + MARK + hashlib.sha256(body).hexdigest().encode()
    neighbour = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with neighbour.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        neighbour.replace(path)
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        with contextlib.suppress(OSError):
            neighbour.unlink()
        raise TableError(path, f"cannot be written: {error.strerror}.") from error


def read_file(path: str | Path) -> tuple[dict[str, Any], Arrays]:
    """Header and arrays of an unaltered file. Errors: TableError with the reason."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise TableError(path, f"cannot be read: {error.strerror}.") from error
    body, comment = content[:-COMMENT_SIZE], content[-COMMENT_SIZE:]
    if not content.startswith(b"PK"):
        raise TableError(path, "is not a motion table.", help=REBUILD)
    if not comment.startswith(MARK):
        raise TableError(
            path, "is truncated, or was not written by stillgrasp: its integrity mark is missing.", help=REBUILD
        )
    if comment[len(MARK) :] != hashlib.sha256(body).hexdigest().encode():
        raise TableError(path, "was altered: its content does not match its SHA-256.", help=REBUILD)
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        header = json.loads(arrays.pop("header").tobytes())
    except (ValueError, KeyError, zipfile.BadZipFile, EOFError, OSError) as error:
        raise TableError(path, f"cannot be decoded: {error}.", help=REBUILD) from error
    if not isinstance(header, dict):
        raise TableError(path, "has a header that is not a JSON object.", help=REBUILD)
    return header, arrays


def write_memory(header: Mapping[str, Any], arrays: Arrays) -> int:
    """Descriptor of a sealed memory file with header and arrays; the caller closes it."""
    offset = 0
    layout: dict[str, dict[str, Any]] = {}
    for name, array in arrays.items():
        layout[name] = {"dtype": array.dtype.str, "shape": list(array.shape), "offset": offset}
        offset += -(-array.nbytes // ALIGNMENT) * ALIGNMENT
    text = json.dumps({"header": header, "layout": layout, "size": offset}, allow_nan=False).encode()
    start = _data_start(len(text))
    descriptor = os.memfd_create("stillgrasp-table", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        os.ftruncate(descriptor, start + offset)
        with mmap.mmap(descriptor, start + offset) as memory:
            memory[: len(MAGIC) + 8 + len(text)] = MAGIC + struct.pack("<Q", len(text)) + text
            for name, array in arrays.items():
                at = start + layout[name]["offset"]
                memory[at : at + array.nbytes] = np.ascontiguousarray(array).tobytes()
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, SEALS)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def read_memory(descriptor: int) -> tuple[dict[str, Any], Arrays]:
    """Header and read-only arrays that view the sealed memory file; pages are present. Errors: TableError."""
    source = f"memory file {descriptor}"
    try:
        seals = fcntl.fcntl(descriptor, fcntl.F_GET_SEALS)
        size = os.fstat(descriptor).st_size
        if seals & SEALS != SEALS:
            raise TableError(source, "is not sealed; its sender could still change it.")
        if size < len(MAGIC) + 8:
            raise TableError(source, f"is too short: {size} bytes.")
        memory = mmap.mmap(descriptor, size, mmap.MAP_SHARED | mmap.MAP_POPULATE, mmap.PROT_READ)
    except (OSError, ValueError) as error:
        raise error if isinstance(error, TableError) else TableError(source, f"cannot be mapped: {error}.") from error
    if memory[: len(MAGIC)] != MAGIC:
        raise TableError(source, f"starts with {memory[: len(MAGIC)]!r}, expected {MAGIC!r}.")
    (length,) = struct.unpack_from("<Q", memory, len(MAGIC))
    if length > size:
        raise TableError(source, f"claims a header of {length} bytes in a file of {size}.")
    try:
        content = json.loads(memory[len(MAGIC) + 8 : len(MAGIC) + 8 + length])
        start = _data_start(length)
        if start + content["size"] != size:
            raise TableError(source, f"has {size} bytes, expected {start + content['size']}.")
        arrays = {
            name: np.ndarray(tuple(item["shape"]), np.dtype(item["dtype"]), memory, start + item["offset"])
            for name, item in content["layout"].items()
        }
        return content["header"], arrays
    except (ValueError, KeyError, TypeError) as error:
        raise error if isinstance(error, TableError) else TableError(source, f"cannot be decoded: {error}.") from error


def _data_start(length: int) -> int:
    return -(-(len(MAGIC) + 8 + length) // ALIGNMENT) * ALIGNMENT
