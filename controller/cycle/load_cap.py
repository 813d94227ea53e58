"""When a tendon motor has come to its load cap, N: then it stands, while the other would wind on and push the object
sideways, so both have to stop (design 4 "Drive")."""

from __future__ import annotations

from dataclasses import dataclass

from controller.messages import Pair


@dataclass(frozen=True)
class LoadCap:
    """The cap of both motors. Heat leaves a part of it (`derating` of their samples)."""

    load_N: float = 110.0
    margin_N: float = 2.0
    """A motor stalls up to this below its cap: a count of its ceiling, and some friction."""
    lasting_ns: int = 20_000_000
    """A single sample is noise."""


class LoadCapWatch:
    """Watches the samples of one grasp."""

    def __init__(self, cap: LoadCap) -> None:
        self._cap = cap
        self._since_ns: int | None = None

    def reached(self, tension_N: Pair, derating: Pair, sample_ns: int) -> bool:
        """Whether either motor has been at its cap for long enough, up to this sample."""
        cap = self._cap
        at_cap = any(
            tension >= cap.load_N * part - cap.margin_N for tension, part in zip(tension_N, derating, strict=True)
        )
        if not at_cap:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = sample_ns
        return self._since_ns is not None and sample_ns - self._since_ns >= cap.lasting_ns
