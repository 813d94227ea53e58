"""What a command came to, for the front to tell."""

from __future__ import annotations

from dataclasses import dataclass, field

from controller.messages import EventKind, Reason


@dataclass
class Outcome:
    """Something to tell the front about a command."""

    kind: EventKind
    token: int
    reason: Reason = Reason.NONE
    values: tuple[float, ...] = field(default_factory=tuple)
