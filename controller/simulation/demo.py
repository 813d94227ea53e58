"""`stillgrasp demo`: the main job on simulated hardware, with its figures.

Three grasps, each without compensation and with it by each index, on virtual time: the same figures on any machine.
Then one of them in real time, as a user would run it, for the timing figures, which describe the machine.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.console import Console
from rich.table import Table

from controller.config import RobotConfig, load_config
from controller.service.assembly import configured_hand, index_name
from controller.simulation.demo_cases import GraspCase, approach_joints, case_table, demo_cases, run_case
from controller.simulation.demo_realtime import real_time_figures
from controller.simulation.demo_report import CaseResult, Trace, Track, draw, trace
from drivers.errors import InputError

INDICES = ("excursion", "load")
Say = Callable[[str], None]


@dataclass(frozen=True)
class DemoPlan:
    """What the demo runs."""

    config: RobotConfig
    cases: list[GraspCase]
    table: dict[str, Any]


@dataclass(frozen=True)
class _Job:
    directory: str
    case: GraspCase
    index: str
    compensated: bool


def demo_config(directory: Path) -> RobotConfig:
    """The default installation, with the demo's own tables."""
    return load_config(overrides={"tables": {"directory": str(directory / "tables")}})


def prepare(directory: Path, seed: int, say: Say) -> DemoPlan:
    """Draw the cases and build their tables, or reuse them."""
    config = demo_config(directory)
    tables = directory / "tables"
    began_s = time.perf_counter()
    reused = 0
    for attempt in range(50):
        cases = demo_cases(seed, attempt)
        try:
            built = []
            for case in cases:
                table, again = case_table(config, case, tables)
                approach_joints(config, table, case)
                built.append(again)
                say(f"table for {case.name}: {'reused' if again else 'built'}")
            reused = sum(built)
            break
        except InputError:
            say("the drawn place is out of the arm's good reach; drawing another")
    else:
        raise InputError(f"seed {seed} gives no place within the arm's reach; choose another seed.")
    return DemoPlan(config, cases, {"build_s": time.perf_counter() - began_s, "tables": len(cases), "reused": reused})


def run_virtual(plan: DemoPlan, directory: Path, say: Say, *, workers: int = 2) -> list[CaseResult]:
    """All grasps on virtual time, side by side over processes; the figures do not depend on how many."""
    jobs = [
        _Job(str(directory), case, index, compensated)
        for case in plan.cases
        for index, compensated in (("excursion", False), *((index, True) for index in INDICES))
    ]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        traces = _run(pool, jobs, say)
    results = []
    for case in plan.cases:
        without = traces[_Job(str(directory), case, "excursion", False)]
        for index in INDICES:
            grasp = {
                "hand": "t42pp",
                "preset": plan.config.hand.preset,
                "object": case.scene.object,
                "onset_split": case.onset_split,
                "object_xyz_m": list(case.object_xyz_m),
                "object_yaw_rad": case.object_yaw_rad,
            }
            default = index == index_name(plan.config)
            compensated = traces[_Job(str(directory), case, index, True)]
            results.append(CaseResult(case.name, grasp, index, default, without, compensated))
    return results


def report(results: list[CaseResult], cycle: dict[str, Any], table: dict[str, Any], seed: int) -> dict[str, Any]:
    """The demo's outcome in the form that programs rely on."""
    return {
        "seed": seed,
        "cases": [result.as_json() for result in results],
        "accepted": all(result.accepted for result in results if result.default),
        "cycle": cycle,
        "table": table,
    }


def write(results: list[CaseResult], outcome: dict[str, Any], directory: Path) -> None:
    """Write report.json and motion.png."""
    (directory / "report.json").write_bytes(msgspec.json.format(msgspec.json.encode(outcome), indent=2) + b"\n")
    draw(results, directory / "motion.png")


def _run(pool: Executor, jobs: list[_Job], say: Say) -> dict[_Job, Trace]:
    futures: dict[_Job, Future[Trace]] = {job: pool.submit(_run_job, job) for job in jobs}
    traces = {}
    for job, future in futures.items():
        traces[job] = future.result()
        how = f"with compensation by {job.index}" if job.compensated else "without compensation"
        motion = traces[job].motion
        say(f"{job.case.name}, {how}: object moved {motion.peak_mm:.2f} mm, {motion.peak_deg:.2f}°")
    return traces


def _run_job(job: _Job) -> Trace:
    """One run in a worker process."""
    config = demo_config(Path(job.directory))
    track = Track(configured_hand(config))
    squeezed = run_case(config, job.case, track, index=job.index, compensated=job.compensated)
    return trace(track, squeezed, config.T_wrist_hand)


def demo(
    seed: Annotated[int, typer.Option(min=0, help="Draws the third grasp; printed, so that it can be repeated.")] = 1,
    output: Annotated[Path, typer.Option(help="Where tables, report and pictures go.")] = Path("build/demo"),
    workers: Annotated[int, typer.Option(min=1, max=64, help="Processes for the runs on virtual time.")] = 2,
    real_time: Annotated[bool, typer.Option(help="Also run one grasp in real time, for the timing figures.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as one JSON object.")] = False,
) -> None:
    """Grip an object and keep it still in the room, all on simulated hardware: tables, grasps, figures.

    Writes report.json, motion.png and run.mcap. Motion figures come from virtual time and are the same on any machine.
    """
    told = Console(stderr=True, soft_wrap=True)
    began_s = time.perf_counter()

    def say(text: str) -> None:
        told.print(f"[dim]{time.perf_counter() - began_s:5.1f} s[/dim]  {text}", highlight=False)

    say(f"seed {seed}")
    output.mkdir(parents=True, exist_ok=True)
    plan = prepare(output, seed, say)
    results = run_virtual(plan, output, say, workers=workers)
    cycle: dict[str, Any] = {}
    if real_time:
        cycle = real_time_figures(plan.config, plan.cases[0], output / "run.mcap", say)
    outcome = report(results, cycle, plan.table, seed)
    write(results, outcome, output)
    say(f"wrote {output / 'report.json'}, {output / 'motion.png'}" + (f", {output / 'run.mcap'}" if real_time else ""))
    if as_json:
        print(msgspec.json.encode(outcome).decode())
    else:
        Console().print(_motion_table(results))
        Console().print(_summary(outcome), highlight=False)
    if not outcome["accepted"]:
        raise typer.Exit(1)


def _motion_table(results: list[CaseResult]) -> Table:
    table = Table(
        title="Object motion in the room, without → with compensation",
        caption="* the default index   ok: at most 10 % of the peak is left, in mm and in degrees (from 1°; else 0.2°)",
        title_justify="left",
        caption_justify="left",
    )
    for column in ("grasp", "index", "", "mm", "left", "°", "ok"):
        table.add_column(column, justify="right" if column in ("mm", "left", "°") else "left", no_wrap=True)
    for result in results:
        without, left = result.without.motion, result.compensated.motion
        table.add_row(
            result.name,
            result.index + ("*" if result.default else ""),
            "peak\nRMS",
            f"{without.peak_mm:.2f} → {left.peak_mm:.2f}\n{without.rms_mm:.2f} → {left.rms_mm:.2f}",
            f"{result.left_percent:.1f} %",
            f"{without.peak_deg:.2f} → {left.peak_deg:.2f}\n{without.rms_deg:.2f} → {left.rms_deg:.2f}",
            "ok" if result.accepted else "no",
        )
    return table


def _summary(outcome: dict[str, Any]) -> str:
    table, cycle = outcome["table"], outcome["cycle"]
    lines = [f"{table['tables']} motion tables in {table['build_s']:.1f} s, {table['reused']} of them reused"]
    if cycle:
        cpu, late = cycle["cpu_us"], cycle["late_us"]
        lines.append(
            f"real time on this machine: {cycle['periods']} periods, {cycle['missed']} missed; processor time "
            f"{cpu['p50']:.0f} µs median, {cpu['p99']:.0f} µs p99; "
            f"late {late['p50']:.0f} µs median, {late['p99']:.0f} µs p99"
        )
    return "\n".join(lines)
