"""How far a slow command is: from cycle records that the tests make up, against the way that is left."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cycle.grasp_state import GraspPhase
from controller.messages import CYCLE_RECORD
from controller.service.commands import make_command
from controller.service.progress import PERIOD_S, Progress
from drivers.clock import nanoseconds


def record(**values: Any) -> dict[str, Any]:
    filled = np.zeros(CYCLE_RECORD.length)
    for name, value in values.items():
        filled[CYCLE_RECORD.slices[name]] = value
    return CYCLE_RECORD.read(filled.tobytes())


def after(progress: Progress, duration_s: float, **values: Any) -> dict[str, Any]:
    told = progress.take(record(**values), nanoseconds(duration_s))
    assert told is not None
    return told


def test_a_joint_move_is_as_far_as_its_longest_joint() -> None:
    """Half of the largest way is half done, whatever the small ones have left."""
    target = [1.0, 0.1, 0.0, 0.0, 0.0, 0.0, -2.0]
    progress = Progress(make_command("arm.move_joints", {"joint_rad": target}), {}, 0)
    assert progress.take(record(), 0) is None
    assert after(progress, 0.1, joint_command_rad=[0.9, 0.0, 0, 0, 0, 0, -1.0])["done"] == pytest.approx(0.5)
    told = after(progress, 0.2, joint_command_rad=target)
    assert told["done"] == 1.0
    assert told["joint_rad"] == target
    assert told["elapsed_s"] == pytest.approx(0.2)


def test_a_squeeze_is_as_far_as_its_excursion() -> None:
    """Past its end it is done, not more than done; load and excursion are those of the record."""
    command = make_command("grasp.squeeze", {"load_N": 60.0})
    progress = Progress(command, {"mean_excursion_m": 0.004, "load_N": 60.0}, 0)
    progress.take(record(), 0)
    phase = GraspPhase.SQUEEZING
    told = after(progress, 0.1, index_mean_m=0.001, hand_tension_N=[20.0, 22.0], grasp_phase=phase)
    assert (told["done"], told["measured_load_N"], told["phase"]) == (pytest.approx(0.25), 21.0, "squeezing")
    assert after(progress, 0.3, index_mean_m=0.0041)["done"] == 1.0


@pytest.mark.parametrize(
    ("command", "args", "desired", "key"),
    [
        ("grasp.close", {}, {}, "excursion_m"),
        ("grasp.release", {}, {}, "tension_N"),
        ("hand.open", {}, {}, "excursion_m"),
        (
            "grasp.preposition",
            {"table": "t", "object_xyz_m": [1, 0, 0]},
            {"wrist_xyz_m": [0.0, 0.0, 0.0]},
            "wrist_xyz_m",
        ),
    ],
)
def test_a_way_that_is_not_known_has_no_part(command: str, args: Any, desired: Any, key: str) -> None:
    """No invented number: only what was measured. (The wrist here stands where it shall go.)"""
    progress = Progress(make_command(command, args), desired, 0)
    progress.take(record(), 0)
    told = after(progress, 0.1)
    assert "done" not in told
    assert key in told
    assert told["command"] == command


@given(st.lists(st.integers(1, 400), min_size=1, max_size=60))
def test_ten_times_a_second_at_most(steps_ms: list[int]) -> None:
    """However often or seldom the front looks: never two within a period, and never a burst after a pause."""
    progress = Progress(make_command("hand.open", {}), {}, 0)
    now_ms, last_ms = 0, 0
    for step_ms in steps_ms:
        now_ms += step_ms
        if progress.take(record(), now_ms * 1_000_000) is not None:
            assert now_ms - last_ms >= PERIOD_S * 1e3
            last_ms = now_ms
    assert now_ms - last_ms < PERIOD_S * 1e3
