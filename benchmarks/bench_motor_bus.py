"""Processor time of the tendon motors' driver, as fast as the motors answer, on a pseudo terminal.

    python -m benchmarks.bench_motor_bus [--json] [--seconds N] [--model XM430-W350 …]

`stillgrasp simulate dynamixel` runs in a process of its own and keeps the wire's time. This process exchanges new goals
and readings with both motors, at first without a pause (*driver, full rate*), then as the hand process does, with its
links, at polling rates. The share is processor time of this process by wall time; on a real bus waiting is the same
select. Beside it, the unmodified dynamixel-sdk does the same group read. Target: 10 % of a 2.5 GHz core at the polling
rate. Nothing here passes or fails.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from collections.abc import Iterator
from typing import Any

import dynamixel_sdk
from rich.console import Console
from rich.table import Table

from benchmarks.simulated_device import simulated_device
from controller.messages import HandFault, HandSetPoint, HandState
from controller.service.hand import HandPart, HandSettings
from controller.service.links import LatestReader, LatestSender, socket_links
from drivers.clock import MonotonicClock
from drivers.dynamixel.byte_line import SerialLine
from drivers.dynamixel.control_tables import MotorModel, model_by_name
from drivers.dynamixel.discovery import reply_margin_s
from drivers.dynamixel.load_law import published_law
from drivers.dynamixel.port import WaitingPort
from drivers.dynamixel.settings import MotorSettings
from drivers.dynamixel.tendons import TendonPair
from drivers.simulated.dynamixel import taut_ticks

TARGET_PERCENT = 10.0
IDS = (1, 2)
RADIUS_M = 0.0105
POLL_HZ = (400, 200)
"""The second is the default of tendons.poll_period_s."""
_SIMULATED_MARGIN_S = 0.05


def main(arguments: list[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench_motor_bus", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement (default 2)")
    parser.add_argument("--model", nargs="+", default=["XM430-W350", "MX-28"], help="motors' models")
    parser.add_argument("--baud", type=int, default=1_000_000)
    chosen = parser.parse_args(arguments)
    results = [measure(model_by_name(name), chosen.baud, chosen.seconds) for name in chosen.model]
    if chosen.json:
        print(json.dumps(results))
    else:
        show(results, Console())


def measure(model: MotorModel, baud: int, duration_s: float) -> dict[str, Any]:
    """All figures of one model."""
    ids = ["--ids", *map(str, IDS)]
    with simulated_device("dynamixel", "--model", model.name, "--baud", str(baud), *ids) as told:
        path = told["port"]
        figures = {"model": model.name, "baud": baud, "driver": driver(path, model, baud, duration_s)}
        for rate_hz in POLL_HZ:
            figures[f"hand_at_{rate_hz}_hz"] = hand(path, model, baud, duration_s, rate_hz)
        figures["sdk"] = vendor_sdk(path, model, duration_s)
    return figures


@contextlib.contextmanager
def opened(path: str, model: MotorModel, baud: int) -> Iterator[TendonPair]:
    """This project's driver on the pseudo terminal, not started."""
    clock = MonotonicClock()
    line = SerialLine(path, baud)
    try:
        port = WaitingPort(line, clock, baud=baud, reply_margin_s=max(_SIMULATED_MARGIN_S, reply_margin_s(None)))
        law = published_law(model, RADIUS_M)
        right, left = (MotorSettings(number, 1, taut_ticks(model), RADIUS_M, law, model.name) for number in IDS)
        yield TendonPair(port, clock, (right, left))
    finally:
        line.close()


def driver(path: str, model: MotorModel, baud: int, duration_s: float) -> dict[str, float]:
    """New goals and ceilings out, everything in, without a pause."""
    with opened(path, model, baud) as pair:
        pair.start()
        exchanges = missed = 0
        start_s, start_cpu_s = time.monotonic(), time.process_time()
        while time.monotonic() - start_s < duration_s:
            excursion_m = 1e-5 * (exchanges % 200)
            pair.set_excursion(excursion_m, excursion_m, (20.0, 20.0))
            missed += max(pair.exchange().missed) > 0
            exchanges += 1
        return _share(exchanges, missed, time.monotonic() - start_s, time.process_time() - start_cpu_s)


def hand(path: str, model: MotorModel, baud: int, duration_s: float, rate_hz: int) -> dict[str, float]:
    """The hand process's loop: new set-points from a link, states to it. The other ends' work counts too."""
    clock = MonotonicClock()
    ends = cycle_end, hand_end = socket_links()
    try:
        with opened(path, model, baud) as pair:
            settings = HandSettings(period_s=1.0 / rate_hz)
            part = HandPart(clock, pair, LatestReader(hand_end), LatestSender(hand_end), settings)
            part.start()
            cycle, states = LatestSender(cycle_end), LatestReader(cycle_end)
            exchanges = missed = 0
            start_s, start_cpu_s = time.monotonic(), time.process_time()
            while time.monotonic() - start_s < duration_s:
                excursion_m = 1e-5 * (exchanges % 200)
                set_point = HandSetPoint((excursion_m, excursion_m), (20.0, 20.0))
                cycle.send(set_point.pack(), clock.now_ns())
                part.step()
                newest = states.newest()
                assert newest is not None
                missed += HandState.unpack(newest[0]).fault is not HandFault.NONE
                exchanges += 1
                clock.sleep_until_ns(part.pacer.deadline_ns)
            return _share(exchanges, missed, time.monotonic() - start_s, time.process_time() - start_cpu_s)
    finally:
        for end in ends:
            end.close()


def vendor_sdk(path: str, model: MotorModel, duration_s: float) -> dict[str, float]:
    """The unmodified SDK: a group read of effort, velocity and position; protocol 1.0 has none, so one read each."""
    port = dynamixel_sdk.PortHandler(path)
    port.openPort()
    handler = dynamixel_sdk.PacketHandler(float(model.protocol))
    group = dynamixel_sdk.GroupSyncRead(port, handler, 126, 10) if model.protocol == 2 else None
    if group is not None:
        for motor_id in IDS:
            group.addParam(motor_id)
    exchanges = missed = 0
    start_s, start_cpu_s = time.monotonic(), time.process_time()
    while time.monotonic() - start_s < duration_s:
        if group is not None:
            missed += group.txRxPacket() != 0
        else:
            missed += any(handler.readTxRx(port, motor_id, 36, 8)[1] != 0 for motor_id in IDS)
        exchanges += 1
    figures = _share(exchanges, missed, time.monotonic() - start_s, time.process_time() - start_cpu_s)
    port.closePort()
    return figures


def show(results: list[dict[str, Any]], console: Console) -> None:
    """A table, a line a measurement."""
    table = Table(title=f"tendon motors; target {TARGET_PERCENT:.0f} % of a core")
    for heading in ("model", "what", "exchanges/s", "processor µs each", "share of a core", "missed"):
        table.add_column(heading, justify="left" if heading in ("model", "what") else "right")
    texts = {"driver": "driver, full rate", **{f"hand_at_{rate}_hz": f"hand process, {rate} Hz" for rate in POLL_HZ}}
    texts["sdk"] = "dynamixel-sdk, read only"
    for result in results:
        for key, text in texts.items():
            row = result[key]
            values = (
                f"{row['rate_hz']:.0f}",
                f"{row['cpu_us']:.0f}",
                f"{row['share_percent']:.1f} %",
                str(row["missed"]),
            )
            table.add_row(result["model"], text, *values)
    console.print(table)


def _share(exchanges: int, missed: int, wall_s: float, cpu_s: float) -> dict[str, float]:
    return {
        "rate_hz": exchanges / wall_s,
        "cpu_us": cpu_s / exchanges * 1e6,
        "share_percent": 100.0 * cpu_s / wall_s,
        "missed": missed,
    }


if __name__ == "__main__":
    main()
