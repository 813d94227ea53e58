"""Every reason in words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from controller.messages import Reason
from controller.reasons import EXPLANATIONS, as_error


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_says_what_happened(reason: Reason) -> None:
    """No fault reaches the operator as a bare number, and its code is good for programs."""
    explanation = EXPLANATIONS[reason]
    assert re.fullmatch(r"[a-z]+(_[a-z]+)*", explanation.code)
    assert explanation.message.endswith(".")
    error = as_error(reason)
    assert (error.code, error.message, error.help) == explanation


def test_codes_are_distinct() -> None:
    """A program that waits for one reason does not get another."""
    codes = [explanation.code for explanation in EXPLANATIONS.values()]
    assert len(set(codes)) == len(codes)


@pytest.mark.parametrize("reason", [reason for reason in Reason if reason >= Reason.ARM_SILENT])
def test_every_fault_says_what_to_do(reason: Reason) -> None:
    """Who stands before a robot that stopped is told the next step."""
    assert EXPLANATIONS[reason].help


def test_every_reason_has_its_line_in_the_docs() -> None:
    """Protects the operator who looks a code up: each stands in docs/faults.md with its message and its cure."""
    page = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
    for reason in set(Reason) - {Reason.NONE}:
        explanation = EXPLANATIONS[reason]
        assert f"| `{explanation.code}` | {explanation.message} | {explanation.help} |" in page
