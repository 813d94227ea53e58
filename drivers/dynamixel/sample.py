"""What a tendon pair is told and what it tells, in SI units; right finger first, positive = pulling in."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

Pair = tuple[float, float]
Flags = tuple[bool, bool]


@dataclass(frozen=True, slots=True)
class TendonSetPoint:
    """Where the tendons shall be, m, and how much they may pull to get there, N."""

    excursion_m: Pair
    load_cap_N: Pair


class TendonSample(msgspec.Struct, frozen=True):
    """What both motors said at one request."""

    sample_ns: tuple[int, int]
    """Time of each motor's request; unchanged, like its measured values, when its answer was missed."""
    excursion_m: Pair
    rate_m_s: Pair
    effort: Pair
    """Current in A (XM430) or load as a fraction of full output (the others); not filtered."""
    tension_N: Pair
    """By the load law."""
    tension_uncertainty_N: Pair
    hardware_error: tuple[int, int]
    """Bits of `control_tables.HARDWARE_ERROR_NAMES`; a tripped motor has let go."""
    alert: Flags
    """The newest status says that something is wrong."""
    torque_on: Flags
    """False after a trip or an unnoticed restart of the motor: what it held may have been dropped."""
    restarted: Flags
    """The motor lost its settings: it was without supply for a moment."""
    jumped: Flags
    """Its position was all at once somewhere else, and stayed there: its excursion means nothing any more."""
    watchdog_tripped: Flags
    """The motor holds and takes no goals until `rearm`."""
    stalled: Flags
    """It stood at its ceiling for too long, gave up its goal and holds where it is."""
    outside_turn: Flags
    """The spool left the one turn in which its motor (MX-28, protocol 1.0) knows its place; it is led back."""
    derating: Pair
    """Part of the load cap that its temperature allows, 0…1."""
    voltage_V: Pair
    temperature_C: Pair
    missed: tuple[int, int]
    """Exchanges in a row without a good answer of this motor, 0 now."""
    read_rate_hz: float
    """Good samples of both motors a second, measured."""

    @property
    def oldest_ns(self) -> int:
        """Time of the older of the two."""
        return min(self.sample_ns)
