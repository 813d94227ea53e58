"""The front's side of the tactile pads: their reports recorded, shown, and their coming and going told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from controller.pad_messages import PadReport
from controller.service.links import LatestReader
from controller.service.tactile_state import pad_record, pad_recording, pad_state
from drivers.clock import seconds

LOST = "The tactile pads are lost; the motors' load finds contact until they are back."
FOUND = "The tactile pads are back."


class TactileWatch:
    """Reads the reports; `tell` is for clients and operator (event, code, message, help), `record` keeps a frame."""

    def __init__(
        self,
        reports: LatestReader,
        tell: Callable[[str, str, str, str], None],
        record: Callable[[dict[str, Any], int], None] | None = None,
    ) -> None:
        self._reports = reports
        self._tell = tell
        self._record = record
        self._newest: PadReport | None = None
        self._sample_ns = 0
        self.lost = ""
        """Why nothing is known of the pads, where their bridge is away."""

    def step(self) -> None:
        """Take what has come."""
        for payload, sample_ns in self._reports.new_values():
            report = PadReport.unpack(payload)
            self._newest, self._sample_ns = report, sample_ns
            if not report.present and not self.lost:
                self.lost = LOST
                self._tell("warning", "tactile_lost", LOST, "Check the plug of the TakkTile bridge.")
            elif report.present and self.lost:
                self.lost = ""
                self._tell("information", "tactile_found", FOUND, "")
            if report.present and self._record is not None:
                self._record(pad_recording(report), sample_ns)

    def record(self) -> dict[str, float | list[float]]:
        """What they add to a cycle's record; nothing before their first report."""
        return {} if self._newest is None else pad_record(self._newest)

    def state(self, now_ns: int) -> dict[str, Any]:
        """What they add to the state; nothing before their first report."""
        return {} if self._newest is None else {"tactile": pad_state(self._newest, seconds(now_ns - self._sample_ns))}
