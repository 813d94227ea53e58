"""`make bench`: processor time of the cycle, stage by stage, and of its parts beside rivals.

    python -m benchmarks.bench_cycle [--json] [--repeats N]

The cycle is measured in a squeeze, replayed to it over real sockets (see `cycle_replay.py`); what is measured is
processor time of one thread, so other programs disturb it only through shared caches and cores. Targets are for one
2.5 GHz core; `addition_ns`, the time of one addition in an interpreted loop, says how fast this one is at the moment.
Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.cycle_replay import STAGES, Recording, record, replayed
from benchmarks.rivals import Figure, inverse_kinematics, look_up, smoothing
from calibration.build import build_table
from calibration.grasp.specification import GraspSpec
from calibration.objects import load_object
from controller.config import load_config
from controller.service.assembly import configured_hand
from controller.simulation.demo_cases import OBJECT, demo_cases, table_name
from controller.simulation.scene import READY_RAD

CYCLE_TARGET_US = 500.0
STAGE_TEXTS = {
    "wake": "wake, statistics",
    "ask": "ask for positions (CAN)",
    "listen": "links: hand, commands",
    "grasp": "winding, index, motion table",
    "smooth": "smoothing of the offset (Ruckig)",
    "move": "inverse kinematics",
    "feel": "positions (CAN), checks",
    "act": "torques, CAN",
    "tell": "state record",
    "rest": "between the stages",
    "total": "whole cycle",
}


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench_cycle", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--repeats", type=int, default=3, help="replays of the squeeze (default 3)")
    chosen = parser.parse_args(arguments)
    if chosen.repeats < 1:
        parser.error("--repeats must be at least 1")
    result = measure(chosen.repeats, Console(stderr=True))
    if chosen.json:
        print(json.dumps(result))
    else:
        show(result, Console())


def measure(repeats: int, progress: Console) -> dict[str, Any]:
    """All figures, as plain values; progress is said on `progress`."""
    case = demo_cases(0)[1]
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        config = load_config(overrides={"tables": {"directory": name}})
        hand, thing = configured_hand(config), load_object(OBJECT)
        progress.print("building a motion table")
        table = build_table(hand, thing, GraspSpec(onset_split=case.onset_split, compensated=True))
        table.save(directory / f"{table_name(case)}.npz")
        progress.print("recording a squeeze on virtual time")
        recording = record(config, case)
        progress.print(f"replaying it {repeats} times, with and without instruments side by side")
        cycle = _cycle(recording, directory, repeats)
    progress.print("look-up, smoothing, inverse kinematics")
    figures = [
        *look_up(table),
        *smoothing(),
        *inverse_kinematics(config, READY_RAD),
    ]
    return {"machine": _machine(), "cycle": cycle, "parts": [_plain(figure) for figure in figures]}


def _cycle(recording: Recording, directory: Path, repeats: int) -> dict[str, Any]:
    """Stages from instrumented replays, the total from replays without instruments."""
    staged: list[dict[str, float]] = []
    bare: list[dict[str, float]] = []
    different = 0
    for _ in range(repeats):
        with_stages, total_only, others = replayed(recording, directory)
        staged += with_stages
        bare += total_only
        different += others
    by_stage = {stage: _spread([period[stage] for period in staged]) for stage in STAGES}
    by_stage["total"] = _spread([period["total"] for period in bare]) | {"target_us": CYCLE_TARGET_US}
    return {"periods": len(bare), "different_torque_frames": different, "stages": by_stage}


def _spread(values_us: list[float]) -> dict[str, float]:
    median, p99 = np.percentile(values_us, (50, 99))
    return {"median_us": round(float(median), 1), "p99_us": round(float(p99), 1)}


def _plain(figure: Figure) -> dict[str, Any]:
    p99_us = None if figure.p99_us is None else round(figure.p99_us, 1)
    median_us = round(figure.median_us, 1)
    return {"name": figure.name, "median_us": median_us, "p99_us": p99_us, "target_us": figure.target_us}


def _machine() -> dict[str, Any]:
    count, total = 300_000, 0
    began_ns = time.thread_time_ns()
    for number in range(count):
        total += number
    addition_ns = (time.thread_time_ns() - began_ns) / count
    return {
        "processors": os.cpu_count(),
        "python": platform.python_version(),
        "load_average": os.getloadavg()[0],
        "addition_ns": round(addition_ns, 1),
    }


def show(result: dict[str, Any], console: Console) -> None:
    """Two tables, the figures beside their targets."""
    machine, cycle = result["machine"], result["cycle"]
    stages = Table(
        title=f"The cycle in a squeeze, {cycle['periods']} periods: processor time, µs", title_justify="left"
    )
    for heading in ("stage", "median", "99 %", "target"):
        stages.add_column(heading, justify="left" if heading == "stage" else "right")
    for name, spread in cycle["stages"].items():
        if name == "total":
            stages.add_section()
        target = f"{spread['target_us']:.0f}" if "target_us" in spread else ""
        stages.add_row(STAGE_TEXTS[name], f"{spread['median_us']:.0f}", f"{spread['p99_us']:.0f}", target)
    console.print(stages)
    parts = Table(title="Parts and rivals: processor time of one call", title_justify="left")
    for heading in ("what", "median", "99 %", "target"):
        parts.add_column(heading, justify="left" if heading == "what" else "right")
    for part in result["parts"]:
        parts.add_row(part["name"], *(_time(part[key]) for key in ("median_us", "p99_us", "target_us")))
    console.print(parts)
    console.print(
        f"{machine['processors']} processors, load {machine['load_average']:.1f}, Python {machine['python']}; an "
        f"addition in an interpreted loop takes {machine['addition_ns']:.0f} ns.",
    )
    if cycle["different_torque_frames"]:
        console.print(f"[red]{cycle['different_torque_frames']} periods sent other torques than recorded[/red]")


def _time(value_us: float | None) -> str:
    if value_us is None:
        return ""
    return f"{value_us:.1f} µs" if value_us < 1e4 else f"{value_us * 1e-6:.2f} s"


if __name__ == "__main__":
    main()
