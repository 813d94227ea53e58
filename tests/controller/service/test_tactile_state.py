"""The tactile pads as clients see them, record them and hear of them: from reports over a link."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.pad_map import pad_lines
from controller.pad_messages import NOTHING_KNOWN, CellState, PadReport, PadState
from controller.service.links import LatestReader, LatestSender, VirtualLink
from controller.service.tactile_cells import CellFaults
from controller.service.tactile_state import pad_record, pad_recording, pad_state
from controller.service.tactile_watch import TactileWatch
from drivers.clock import VirtualClock, nanoseconds
from drivers.errors import ProtocolError
from drivers.takktile.quality import CellQuality

CHIP = bytes.fromhex("42A8B5C0BB603A10")
STATE = PadState((1.25, 0.5), (0.03, 0.02), (7, 8), (True, False), (2, 0))


def cell(finger: int, row: int, column: int, quality: int = 0, force_N: float = 0.5) -> CellState:
    return CellState(finger, row, column, quality, 400, 498, 50.0, 807.0, 498.25, 498.5, force_N, CHIP)


REPORT = PadReport(
    True,
    STATE,
    (cell(0, 0, 0, force_N=1.0), cell(0, 0, 2, force_N=0.25), cell(1, 3, 1, CellQuality.STUCK | CellQuality.NO_ZERO)),
)


@given(st.binary(max_size=300))
def test_only_reports_are_reports(data: bytes) -> None:
    """Any bytes over the link: refused, unless they are one."""
    try:
        report = PadReport.unpack(data)
    except ProtocolError:
        return
    assert len(report.pack()) == len(data)


def test_a_report_comes_back() -> None:
    """Every number as it was, to the precision of the wire."""
    assert PadReport.unpack(REPORT.pack()) == REPORT
    with pytest.raises(ProtocolError):
        PadReport.unpack(REPORT.pack()[:-1])


def test_the_state_is_what_programs_can_read() -> None:
    """Both fingers, both maps, and no NaN: it goes out as JSON too."""
    state = json.loads(json.dumps(pad_state(REPORT, 0.004), allow_nan=False))
    assert state["total_N"] == 1.75
    assert state["touching"] == [True, False]
    assert state["cells"]["right"]["place"] == [[0, 0], [0, 2]]
    assert state["cells"]["right"]["force_N"] == [1.0, 0.25]
    assert state["cells"]["left"]["quality"] == ["stuck no_zero"]
    assert pad_record(REPORT)["tactile_total_N"] == 1.75
    recorded = json.loads(json.dumps(pad_recording(REPORT), allow_nan=False))
    assert recorded["coefficients"] == [CHIP.hex()] * 3


def test_an_operator_sees_the_cells_in_their_rows() -> None:
    """A gap where no cell is mapped, and the reason in the place of a force that does not count."""
    lines = pad_lines(pad_state(REPORT, 0.004))
    assert " ".join(lines[0].split()) == "pads 1.25 0.50 N (right, left), sum 1.75 N, touching: right"
    assert lines[1].split() == ["right", "row", "0:", "1.00", "0.25"]
    assert lines[1].index("0.25") - lines[1].index("1.00") == 20
    assert lines[2].split() == ["left", "row", "3:", "stuck"]
    assert pad_lines(pad_state(REPORT, 12.0)) == ["pads          silent for 12 s; the motors' load finds contact"]
    assert "away" in pad_lines(pad_state(PadReport(False, NOTHING_KNOWN), 1.0))[0]


def test_going_and_coming_is_told_once() -> None:
    """However often it is reported; and frames are recorded as of their own time, but only those that there are."""
    clock = VirtualClock()
    link = VirtualLink(clock, clock)
    told: list[tuple[str, str]] = []
    kept: list[int] = []

    def tell(event: str, code: str, message: str, help: str) -> None:
        told.append((event, code))

    def keep(frame: dict[str, Any], time_ns: int) -> None:
        kept.append(time_ns)

    watch, sender = TactileWatch(LatestReader(link), tell, keep), LatestSender(link)
    assert watch.state(0) == {}
    assert watch.record() == {}
    away = PadReport(False, NOTHING_KNOWN)
    for time_ns, report in enumerate((REPORT, away, away, away, REPORT, REPORT)):
        sender.send(report.pack(), time_ns)
        watch.step()
        assert bool(watch.lost) is not report.present
    assert told == [("warning", "tactile_lost"), ("information", "tactile_found")]
    assert kept == [0, 4, 5]
    assert watch.state(nanoseconds(1.0))["tactile"]["age_s"] == pytest.approx(1.0)


def test_broken_cells_are_told_when_it_lasts() -> None:
    """Not each flicker; once when two cells stick for a second, and once when they are sound again."""
    said: list[str] = []
    faults = CellFaults(said.append)
    sound, stuck = (cell(0, 0, 0), cell(0, 0, 1)), (cell(0, 0, 0, CellQuality.STUCK), cell(0, 0, 1, CellQuality.STUCK))
    for step in range(1000):
        flicker = step < 300 and step % 20 == 0
        faults.take(stuck if flicker or 300 <= step < 600 else sound, step * nanoseconds(0.008))
    assert said == [
        "tactile cells 0:0, 0:1: stuck, so not counted",
        "tactile cells 0:0, 0:1: sound again; counted from the next zero on, or at once if there is one",
    ]
