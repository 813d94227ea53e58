"""Whether a finger touches, with hysteresis, and since when: the rising force is followed back to where it began.

While the finger winds in at constant rate its force rises along a line, once it touches. A threshold above the noise is
crossed late; where that line leaves the level before it, the finger met the object (TakkTile reference 5, 6).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.errors import InputError

_WINDOW_FRAMES = 64
"""That a rise is followed back over: half a second."""


@dataclass(frozen=True)
class TouchSettings:
    """Thresholds of a finger's force, N."""

    touch_N: float = 0.15
    release_N: float = 0.07
    deviations: float = 4.0
    """A noisier pad gets higher thresholds: at least so many standard deviations, and half as many for the release."""
    frames: int = 2
    """Above the threshold in a row; a single one is a disturbed frame."""

    def __post_init__(self) -> None:
        if not 0.0 < self.release_N < self.touch_N:
            raise InputError(
                f"touch_N = {self.touch_N}, release_N = {self.release_N}; expected 0 < release_N < touch_N."
            )


class PadTouch:
    """One finger."""

    def __init__(self, settings: TouchSettings) -> None:
        self._settings = settings
        self._rise: deque[tuple[int, float]] = deque(maxlen=_WINDOW_FRAMES)
        self._above = 0
        self.touching = False
        self.onset_ns = 0
        """Monotonic time of first contact, of the contact under way or else of the last one."""

    def take(self, sample_ns: int, force_N: float, deviation_N: float) -> bool:
        """One sample of the finger; whether it touches."""
        settings = self._settings
        touch_N = max(settings.touch_N, settings.deviations * deviation_N)
        release_N = max(settings.release_N, 0.5 * settings.deviations * deviation_N)
        if self.touching:
            self.touching = force_N > release_N
            if not self.touching:
                self.forget_rise()
            return self.touching
        self._rise.append((sample_ns, force_N))
        self._above = self._above + 1 if force_N >= touch_N else 0
        if self._above >= settings.frames:
            self.touching = True
            self.onset_ns = onset_ns(self._rise)
        return self.touching

    def forget_rise(self) -> None:
        """What is rising is no more followed back: samples are missing. A contact under way goes on."""
        self._rise.clear()
        self._above = 0


def onset_ns(rise: Sequence[tuple[int, float]]) -> int:
    """When a force began to rise: the corner of the level-then-straight line that fits (time ns, force N) best.

    For a given corner level and slope follow in closed form; the corner is searched over the window in quarters of a
    frame. The level is fitted too, so that what little the zero is off does not move the corner.
    """
    first_ns, last_ns = rise[0][0], rise[-1][0]
    times = np.array([time_ns - first_ns for time_ns, _ in rise], dtype=np.float64)
    force_N = np.array([force for _, force in rise])
    corners = np.linspace(0.0, float(last_ns - first_ns), 4 * len(rise), endpoint=False)
    ramps = np.maximum(times - corners[:, np.newaxis], 0.0)
    ramps -= ramps.mean(axis=1, keepdims=True)
    slope = ramps @ (force_N - force_N.mean())
    explained = np.where(slope > 0.0, slope, 0.0) ** 2 / np.maximum((ramps**2).sum(axis=1), 1.0)
    return first_ns + round(float(corners[explained.argmax()]))
