"""`make bench`: processor time of a whole motion table, beside other ways to the same equilibria.

    python -m benchmarks.bench_tables [--json] [--repeats N]

Tables of 41 × 41 nodes with all fields: both grids with slopes and mixed derivatives, stability, header. Beside them
SLSQP with analytic Jacobians and slow winding in MuJoCo, each on a sub-grid (its size is printed) and reckoned up to as
many nodes as the excursion grid has. Processor time of one thread (`make bench` keeps BLAS to one); targets are for one
2.5 GHz core. Memory is the peak of a process that builds one table, libraries included. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.bench_tables_rivals import by_optimiser, by_physics
from calibration.build import NODES, build_table
from calibration.grasp.equilibrium import grasp_system
from calibration.grasp.specification import GraspSpec
from calibration.hand.parameters import load_hand
from calibration.motion_table import MotionTable
from calibration.objects import load_object

HANDS = {"t42pp": 0.5, "t42pf": None, "t42ff": 1.0}
"""Hands, and the target for a lifted object, s."""
OBJECT = "cylinder40"
OPTIMISER_NODES = (6, 3)
PHYSICS_NODES = 6
MEMORY_TARGET_MB, FILE_TARGET_MB = 300.0, 2.0
CHILD = (
    "import resource, sys; from calibration.build import build_table;"
    "from calibration.hand.parameters import load_hand;"
    "from calibration.objects import load_object; build_table(load_hand(sys.argv[1]), load_object(sys.argv[2]));"
    "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
)


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench_tables", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--repeats", type=int, default=5, help="builds of each table (default 5)")
    chosen = parser.parse_args(arguments)
    if chosen.repeats < 1:
        parser.error("--repeats must be at least 1")
    progress = Console(stderr=True)
    result = {"nodes": NODES, "object": OBJECT, "hands": [measured(name, chosen.repeats, progress) for name in HANDS]}
    if chosen.json:
        print(json.dumps(result))
    else:
        show(result, Console())


def measured(name: str, repeats: int, progress: Console) -> dict[str, Any]:
    """All figures of one hand, as plain values."""
    hand, thing = load_hand(name), load_object(OBJECT)
    lifted, standing = GraspSpec(supported=False), GraspSpec()
    progress.print(f"{name}: building {2 * repeats} tables")
    table = build_table(hand, thing, lifted)  # warm
    spent = {
        what: [_processor_s(lambda spec=spec: build_table(hand, thing, spec)) for _ in range(repeats)]
        for what, spec in (("lifted", lifted), ("supported", standing))
    }
    system = grasp_system(hand, thing, lifted)
    progress.print(f"{name}: SLSQP")
    optimiser = by_optimiser(system, table, *OPTIMISER_NODES)
    progress.print(f"{name}: MuJoCo")
    physics = by_physics(hand, thing, system, table, PHYSICS_NODES)
    solved = int(np.isfinite(table.arrays["excursion.value"]).all(2).sum())
    build_s = float(np.median(spent["lifted"]))
    return {
        "hand": name,
        "table_s": build_s,
        "target_s": HANDS[name],
        "supported_table_s": float(np.median(spent["supported"])),
        "solved_nodes": solved,
        "slsqp_s_per_node": optimiser.seconds_per_node,
        "slsqp_nodes": optimiser.nodes,
        "slsqp_ratio": optimiser.seconds_per_node * solved / build_s,
        "mujoco_s_per_node": physics.seconds_per_node,
        "mujoco_nodes": physics.nodes,
        "mujoco_ratio": physics.seconds_per_node * solved / build_s,
        "memory_MB": _memory_MB(name),
        "file_MB": _file_MB(table),
        "interpolation_um": 1e6 * table.header.solver["interpolation_error_m"],
        "interpolation_deg": math.degrees(table.header.solver["interpolation_error_rad"]),
        "load_interpolation_um": 1e6 * table.header.solver["load_interpolation_error_m"],
        "load_interpolation_deg": math.degrees(table.header.solver["load_interpolation_error_rad"]),
    }


def show(result: dict[str, Any], console: Console) -> None:
    """One column a hand."""
    hands = result["hands"]
    table = Table(title=f"A table of {NODES} × {NODES} nodes, {OBJECT}, one thread", title_justify="left")
    for heading in ("", *(hand["hand"] for hand in hands)):
        table.add_column(heading, justify="left" if not heading else "right")

    def row(text: str, *cells: str) -> None:
        table.add_row(text, *cells)

    row("whole table, lifted object", *(_beside(hand["table_s"], hand["target_s"], "s") for hand in hands))
    row("whole table, object drags on its support", *(f"{hand['supported_table_s']:.2f} s" for hand in hands))
    for key, text in (("slsqp", "SLSQP"), ("mujoco", "wound slowly in MuJoCo")):
        row(
            f"{text}, the excursion grid's nodes alone",
            *(f"{hand[f'{key}_s_per_node'] * hand['solved_nodes']:.1f} s" for hand in hands),
        )
        row(
            f"  reckoned from {hands[0][f'{key}_nodes']}; times the table",
            *(f"{hand[f'{key}_ratio']:.0f} ×" for hand in hands),
        )
    row("peak memory", *(_beside(hand["memory_MB"], MEMORY_TARGET_MB, "MB") for hand in hands))
    row("file", *(_beside(hand["file_MB"], FILE_TARGET_MB, "MB") for hand in hands))
    for key, text in (("", "by excursion"), ("load_", "by load")):
        row(
            f"interpolation error {text}",
            *(f"{hand[f'{key}interpolation_um']:.3f} µm {hand[f'{key}interpolation_deg']:.4f}°" for hand in hands),
        )
    console.print(table)


def _beside(value: float, target: float | None, unit: str) -> str:
    return f"{value:.2f} {unit}" if target is None else f"{value:.2f} (≤ {target:g}) {unit}"


def _processor_s(call: Any) -> float:
    began_s = time.process_time()
    call()
    return time.process_time() - began_s


def _memory_MB(hand: str) -> float:
    run = subprocess.run([sys.executable, "-c", CHILD, hand, OBJECT], capture_output=True, text=True, check=True)
    return int(run.stdout) / 1024


def _file_MB(table: MotionTable) -> float:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "table.npz"
        table.save(path)
        return path.stat().st_size / 1e6


if __name__ == "__main__":
    main()
