"""The recording, read back by mcap's own reader; also after a crash and on a full disk."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader

from controller.service.recorder import Recorder
from drivers.errors import InputError


def record(cycle: int) -> dict[str, Any]:
    return {"cycle": float(cycle), "joint_rad": np.arange(7.0) * cycle, "arm": {"mode": "active"}, "late_us": np.nan}


def test_every_cycle_and_event_is_read_back(tmp_path: Path) -> None:
    """Values, order and times survive; NaN is null; the schema names the fields for a plotting program."""
    with Recorder(tmp_path / "new" / "run.mcap", wall_offset_ns=10**18, metadata={"hand": "T42PP"}) as recorder:
        for cycle in range(1200):
            recorder.record_cycle(record(cycle), time_ns=cycle * 2_000_000)
        recorder.event({"event": "completed", "seq": 4}, time_ns=5)
    with recorder.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        cycles = list(reader.iter_messages(topics=["/cycle"]))
        (event,) = reader.iter_messages(topics=["/events"])
        (metadata,) = reader.iter_metadata()
    assert [message.log_time for _, _, message in cycles] == [10**18 + cycle * 2_000_000 for cycle in range(1200)]
    schema, channel, message = cycles[7]
    content = json.loads(message.data)
    assert content == {"cycle": 7, "joint_rad": [0, 7, 14, 21, 28, 35, 42], "arm": {"mode": "active"}, "late_us": None}
    assert channel.message_encoding == "json"
    assert schema is not None
    assert schema.encoding == "jsonschema"
    properties = json.loads(schema.data)["properties"]
    assert properties["joint_rad"] == {"type": "array", "items": {"type": "number"}}
    assert properties["arm"]["properties"]["mode"] == {"type": "string"}
    assert json.loads(event[2].data) == {"event": "completed", "seq": 4}
    assert metadata.metadata == {"hand": "T42PP"}


def test_a_killed_process_leaves_a_readable_recording(tmp_path: Path) -> None:
    """The flight recorder is wanted most when the daemon did not come to close it."""
    path = tmp_path / "run.mcap"
    program = (
        "import os, sys; from pathlib import Path; from controller.service.recorder import Recorder\n"
        "recorder = Recorder(Path(sys.argv[1]))\n"
        "for cycle in range(5000):\n"
        "    recorder.record_cycle({'cycle': cycle, 'x': [cycle * 1e-3] * 70}, cycle)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", program, str(path)], check=False, env={**os.environ, "OMP_NUM_THREADS": "1"})
    read = []
    try:
        for _, _, message in NonSeekingReader(io.BytesIO(path.read_bytes())).iter_messages(log_time_order=False):
            read.append(json.loads(message.data)["cycle"])
    except EndOfFile:
        pass
    assert len(read) > 4000
    assert read == list(range(len(read)))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
def test_a_full_disk_ends_the_recording_and_not_the_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The front goes on without a recording, and can say why there is none."""
    (tmp_path / "full").symlink_to("/dev/full")
    monkeypatch.setattr(Path, "open", lambda path, mode: open(path.with_name("full"), "wb"))  # noqa: SIM115 - closed by it
    recorder = Recorder(tmp_path / "run.mcap")
    for cycle in range(3000):
        recorder.record_cycle(record(cycle), cycle)
    recorder.close()
    assert "No space left" in recorder.failure


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    """The last run's file may be the one that is needed."""
    path = tmp_path / "run.mcap"
    path.write_text("precious")
    with pytest.raises(InputError, match=r"recorder\.directory"):
        Recorder(path)
    with pytest.raises(InputError, match="No recording can be written"):
        Recorder(path / "run.mcap")
    assert path.read_text() == "precious"


def test_a_closed_recorder_takes_no_more(tmp_path: Path) -> None:
    """Records that arrive while the daemon goes down do no harm."""
    recorder = Recorder(tmp_path / "run.mcap")
    recorder.close()
    recorder.record_cycle(record(1), 1)
    recorder.close()
    with recorder.path.open("rb") as file:
        assert list(make_reader(file).iter_messages()) == []
