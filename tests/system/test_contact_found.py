"""Whole closings on virtual time with every motor model, on an object that is not the table's, against the world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.closing_trial import Trial, run
from benchmarks.contact_study import MODELS, PAGE, WRONG

pytestmark = pytest.mark.slow
LIMIT_M = 1e-4


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For tables and objects, which the closings share."""
    return tmp_path_factory.mktemp("contact")


@pytest.mark.parametrize("model", MODELS)
def test_contact_is_found_to_a_tenth_of_a_millimetre(model: str, directory: Path) -> None:
    """At 20 mm/s, with noise and gear friction, on an object 6 mm wider than the table's: where the fingertips first
    felt a force, not where the table expects it."""
    closing = run(Trial(model, 0.020, wider_m=0.006), directory)
    assert closing.outcome == "contact"
    assert np.all(np.abs(closing.true_m - closing.expected_m) > 2.5 * LIMIT_M)
    assert closing.found_m == pytest.approx(closing.true_m, abs=LIMIT_M)


def test_one_finger_alone_is_recognised(directory: Path) -> None:
    """The coarsest motor, by nothing but the drag of the object that it pushes."""
    code, changes = WRONG["one finger only (16 mm object, 9 mm aside)"]
    closing = run(Trial("RX-28", 0.020, **changes), directory)
    assert closing.outcome == code
    assert closing.pushed_m < 0.012


def test_the_page_says_no_worse() -> None:
    """What docs/contact.md was written from holds the same limit: every error in its tables."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    largest = [
        float(line.rstrip(" |").rsplit("|", 1)[1]) for line in lines if " mm/s |" in line and line.count("|") == 9
    ]
    assert len(largest) == 3 * len(MODELS)
    assert max(largest) <= 1e3 * LIMIT_M
