"""The recording: every cycle and event in one MCAP file, as JSON with a JSON schema (design 6).

Foxglove and PlotJuggler read it as it is. Topics `/cycle`, `/events` and, with tactile pads, `/tactile`;
the schema of each is that of its first message. Times are nanoseconds of the caller's clock plus `wall_offset_ns`, so
that a recording on the monotonic clock shows the time of day; NaN is written as null, for JSON has none.

The file is written in chunks of 0.2 s or so: after a crash all finished chunks can be read. A disk that is full or has
gone ends the recording, says so in `failure`, and leaves the daemon alone.
Source: real-time-python reference 5 (log files).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
from mcap.writer import CompressionType, Writer

from controller.service.answers import plain
from drivers.errors import InputError

_CHUNK_BYTES = 131072  # with LZ4, closing a chunk holds the front up for 0.5 ms, zstd for twice that
_FLUSH_EVERY = 100  # messages; chunks reach the kernel no later than this
_ENCODER = msgspec.json.Encoder(enc_hook=plain)


class Recorder:
    """Writes `path`, which must not exist; its directory is made if need be. Raises InputError."""

    def __init__(self, path: Path, *, wall_offset_ns: int = 0, metadata: Mapping[str, str] | None = None) -> None:
        self.path = path
        self.failure = ""
        self._wall_offset_ns = wall_offset_ns
        self._channels: dict[str, int] = {}
        self._count = 0
        self._closed = False
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("xb")
        except OSError as error:
            raise InputError(
                f"No recording can be written to {path}: {error.strerror}.",
                help="Change recorder.directory, or set recorder.enabled = false.",
            ) from error
        self._writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.LZ4)
        self._writer.start(profile="", library="stillgrasp")
        self._writer.add_metadata("stillgrasp", dict(metadata or {}))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def record_cycle(self, record: Mapping[str, Any], time_ns: int) -> None:
        """Keep one cycle's record: numbers, arrays, texts and maps by name, as of `time_ns`."""
        self._write("/cycle", record, time_ns)

    def record_pads(self, frame: Mapping[str, Any], time_ns: int) -> None:
        """Keep one frame of the tactile pads, as of `time_ns`."""
        self._write("/tactile", frame, time_ns)

    def event(self, event: Mapping[str, Any], time_ns: int) -> None:
        """Keep one event."""
        self._write("/events", event, time_ns)

    def close(self) -> None:
        """Finish the file: index and summary. May be called again."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self.failure:
                finish: Callable[[], None] = self._writer.finish  # untyped in mcap
                finish()
        except OSError as error:
            self._give_up(error)
        finally:
            self._close_file()

    def _write(self, topic: str, content: Mapping[str, Any], time_ns: int) -> None:
        if self._closed or self.failure:
            return
        data = _ENCODER.encode(content)
        try:
            channel = self._channels.get(topic)
            if channel is None:
                channel = self._channels[topic] = self._register(topic, data)
            log_time_ns = time_ns + self._wall_offset_ns
            self._writer.add_message(channel, log_time_ns, data, log_time_ns, self._count)
            self._count += 1
            if self._count % _FLUSH_EVERY == 0:
                self._file.flush()
        except OSError as error:
            self._give_up(error)

    def _register(self, topic: str, data: bytes) -> int:
        schema = msgspec.json.encode(_schema_of(msgspec.json.decode(data)))
        identity = self._writer.register_schema(f"stillgrasp{topic.replace('/', '.')}", "jsonschema", schema)
        return int(self._writer.register_channel(topic, "json", identity))

    def _give_up(self, error: OSError) -> None:
        self.failure = f"The recording {self.path} ended: {error.strerror}. What was written before can be read."

    def _close_file(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            self._give_up(error)


def _schema_of(value: Any) -> dict[str, Any]:
    """JSON schema of what a message holds; null is taken for a number that was not there yet."""
    if isinstance(value, dict):
        return {"type": "object", "properties": {key: _schema_of(item) for key, item in value.items()}}
    if isinstance(value, list):
        return {"type": "array", "items": _schema_of(value[0]) if value else {}}
    if isinstance(value, bool):
        return {"type": "boolean"}
    return {"type": "string"} if isinstance(value, str) else {"type": "number"}
