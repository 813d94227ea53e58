"""Property numbers against spot values of the WAM reference 3.1."""

from __future__ import annotations

import pytest

from drivers.errors import InputError
from drivers.wam.properties import PuckKind, property_id, property_numbers


@pytest.mark.parametrize(
    ("name", "firmware", "kind", "number"),
    [
        ("P", 200, "motor", 48),
        ("T", 61, "motor", 42),
        ("CTS", 200, "motor", 68),
        ("CTS", 62, "motor", 65),
        ("CTS", 64, "motor", 66),
        ("IPNM", 200, "motor", 86),
        ("IPNM", 63, "motor", 83),
        ("MECH", 67, "motor", 66),
        ("HALLS", 65, "motor", 89),
        ("HALLS", 68, "motor", 87),
        ("V", 116, "motor", 106),
        ("VCMD", 116, "motor", 44),
        ("V", 119, "motor", 44),
        ("JP", 125, "motor", 96),
        ("HOLD", 141, "motor", 77),
        ("LCVC", 175, "motor", 105),
        ("IHIT", 200, "motor", 108),
        ("MODE", 197, "safety", 8),
        ("ZERO", 197, "safety", 42),
        ("PEN", 197, "safety", 43),
        ("IFAULT", 197, "safety", 55),
        ("GRPC", 197, "safety", 28),
        ("STAT", 0, "monitor", 5),
        ("LOAD", 0, "monitor", 10),
    ],
)
def test_number_follows_firmware_and_kind(name: str, firmware: int, kind: PuckKind, number: int) -> None:
    """Protects against writing one property in the place of another."""
    assert property_id(name, firmware, kind) == number


@pytest.mark.parametrize(
    ("name", "firmware", "kind"),
    [("JP", 124, "motor"), ("HOLD", 64, "motor"), ("ZERO", 200, "motor"), ("P", 12, "monitor"), ("ITOR", 175, "motor")],
)
def test_missing_property_is_refused(name: str, firmware: int, kind: PuckKind) -> None:
    """Protects against asking a puck for what it does not have."""
    with pytest.raises(InputError, match=name):
        property_id(name, firmware, kind)


def test_old_firmware_is_refused() -> None:
    """Protects old arms, whose numbers mean other things."""
    with pytest.raises(InputError, match="60 is not supported"):
        property_id("P", 60, "motor")


@pytest.mark.parametrize("firmware", [61, 63, 64, 65, 68, 114, 119, 125, 132, 142, 168, 175, 200])
def test_numbers_are_unambiguous(firmware: int) -> None:
    """Law: within one firmware no two properties share a number."""
    numbers = list(property_numbers(firmware, "motor").values())
    assert len(numbers) == len(set(numbers))
