"""Errors: one message from their data, and whole after a journey between processes."""

from __future__ import annotations

import pickle

import pytest

from drivers.errors import (
    BusError,
    CommandError,
    ConfigurationError,
    MechanicsError,
    NoReplyError,
    StillgraspError,
    TableError,
)

ERRORS = [
    ConfigurationError("robot.toml", "cycle.period_s", -1, "0.001 to 0.02", help="Correct it."),
    CommandError("no_table", "No table.", key="table", accepted="a name"),
    TableError("grasp.npz", "is truncated"),
    MechanicsError("stiffness", "is negative"),
    NoReplyError("puck 3", "is silent"),
    BusError("can0", "is off"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_errors_survive_pickling(error: StillgraspError) -> None:
    """Protects worker processes: an error that cannot be sent back breaks the whole pool and hides what happened."""
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


def test_message_says_what_was_expected_and_what_to_do() -> None:
    """Protects users from an error that only complains."""
    text = str(ERRORS[0])
    assert "robot.toml" in text
    assert "cycle.period_s = -1" in text
    assert "0.001 to 0.02" in text
    assert text.endswith("Correct it.")
