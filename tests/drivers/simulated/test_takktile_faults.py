"""Fault scripts of the simulated bridge: what is scripted happens, when it is scripted, and no other cell knows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from controller.simulation.fault_file import pad_fault, read_takktile_faults
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.errors import BusError, ConfigurationError, InputError, NoReplyError
from drivers.simulated.faults import Fault, FaultScript
from drivers.simulated.takktile import SimulatedTakktile, two_fingers, uneven
from drivers.simulated.takktile_fault_actions import (
    Dead,
    Lose,
    MoreCells,
    Noise,
    Press,
    Repeat,
    Silence,
    Stuck,
    TakktileAction,
    Unplug,
    Warmth,
)
from drivers.simulated.takktile_lines import MemoryTransport
from drivers.takktile.bridge import Bridge, BridgeFrame
from drivers.takktile.compensation import unpack_coefficients
from drivers.takktile.frames import Cell

PERIOD_S = 0.01


def sampled(*faults: Fault[TakktileAction], duration_s: float = 0.5, seed: int = 0) -> list[BridgeFrame]:
    """Frames of a bridge without noise of its own."""
    clock = VirtualClock()
    device = SimulatedTakktile(lambda: (0.0, 0.0), noise_counts=0.0, faults=FaultScript(seed=seed, faults=faults))
    bridge = Bridge(MemoryTransport(device, clock), clock)
    bridge.start(PERIOD_S)
    frames = []
    while clock.now_ns() < nanoseconds(duration_s):
        frame = bridge.read(nanoseconds(duration_s))
        if frame is not None:
            frames.append(frame)
    return frames


@pytest.mark.parametrize(
    "action",
    [
        Dead(cells=((0, 1),)),
        Noise(cells=((0, 1),), counts=30.0),
        Warmth(cells=((0, 1),), kelvin=9.0),
        Press(cells=((0, 1),), newtons=1.0),
    ],
)
def test_a_cells_fault_is_its_own(action: TakktileAction) -> None:
    """It begins and ends at its time, changes the words of that cell, and of no other."""
    plain, spoilt = sampled(), sampled(Fault(action=action, at_s=0.1, for_s=0.2))
    assert len(plain) == len(spoilt)
    changed = [
        (seconds(one.sample_ns), cell)
        for one, other in zip(spoilt, plain, strict=True)
        for cell in range(16)
        if one.cells[cell] != other.cells[cell]
    ]
    assert {cell for _, cell in changed} == {1}
    times = [time_s for time_s, _ in changed]
    assert 0.1 <= min(times) < 0.13
    assert 0.27 < max(times) < 0.3


def test_a_stuck_cell_and_a_repeated_frame_tell_the_past() -> None:
    """While something presses harder: the stuck cell, or all of them, give the words of before."""
    press = Fault[TakktileAction](action=Press(newtons=1.0), at_s=0.2)
    frames = sampled(Fault(action=Stuck(cells=((0, 0),)), at_s=0.1), press)
    assert frames[-1].cells[0] == frames[0].cells[0]
    assert frames[-1].cells[1] != frames[0].cells[1]
    frames = sampled(Fault(action=Repeat(), at_s=0.1, for_s=10.0), press)
    assert frames[-1].cells == frames[0].cells


def test_lost_and_wrong_frames_do_not_come() -> None:
    """One in three lost, by the script's seed; frames of another length are dropped by the driver."""
    whole = len(sampled(duration_s=2.0))
    lost = [len(sampled(Fault(action=Lose(), for_s=10.0, chance=0.33), duration_s=2.0, seed=7)) for _ in range(2)]
    assert lost[0] == lost[1]
    assert 0.5 * whole < lost[0] < 0.8 * whole
    assert sampled(Fault(action=MoreCells(cells=2), for_s=10.0)) == []


def test_an_unplugged_bridge_has_forgotten_its_host() -> None:
    """Gone for half a second: who had it open has it no more, even when it is back; opened anew it samples."""
    clock = VirtualClock()
    script = FaultScript[TakktileAction](faults=(Fault(action=Unplug(), at_s=0.1, for_s=0.5),))
    device = SimulatedTakktile(lambda: (0.0, 0.0), faults=script)
    bridge = Bridge(MemoryTransport(device, clock), clock)
    bridge.start(PERIOD_S)
    assert bridge.read(clock.now_ns() + nanoseconds(0.05)) is not None
    clock.sleep_until_ns(nanoseconds(0.2))
    with pytest.raises(BusError, match="unplugged"):
        bridge.read(clock.now_ns() + nanoseconds(0.05))
    with pytest.raises(BusError):
        MemoryTransport(device, clock)
    clock.sleep_until_ns(nanoseconds(1.0))
    with pytest.raises(BusError):
        bridge.read(clock.now_ns() + nanoseconds(0.05))
    again = Bridge(MemoryTransport(device, clock), clock)
    assert device.next_frame_ns() is None
    again.start(PERIOD_S)
    assert again.read(clock.now_ns() + nanoseconds(0.05)) is not None


def test_a_silent_bridge_answers_and_gives_no_frame() -> None:
    """From the first sampling on, as scripted: the read ends at its deadline."""
    silent = sampled(Fault(action=Silence(), on="sampling", at_s=0.1))
    assert silent == sampled()[: len(silent)]
    assert seconds(silent[-1].sample_ns) < 0.13


def test_no_two_cells_are_alike() -> None:
    """As they come out of the mould: other sensitivities, other chips, each a barometer, the same for a seed."""
    cells = uneven(two_fingers(), 3)
    assert len({cell.coefficients for cell in cells}) == 16
    assert all(0.79 < cell.counts_per_N / 100.0 < 1.21 for cell in cells)
    assert cells == uneven(two_fingers(), 3)
    for cell in cells:
        unpack_coefficients(cell.coefficients, cell.cell)


def test_scripts_are_read_and_their_mistakes_named(tmp_path: Path) -> None:
    """From a file and as typed; a place that is none, a cell that is not there, an action that is not known."""
    file = tmp_path / "faults.toml"
    file.write_text('[[fault]]\non = "sampling"\nat_s = 5\nfor_s = 2\naction = { kind = "unplug" }\n')
    assert read_takktile_faults(file).faults == (Fault(on="sampling", at_s=5.0, for_s=2.0, action=Unplug()),)
    assert pad_fault('{"action": {"kind": "dead", "cells": [[0, 1]]}}') == Fault(action=Dead(cells=((0, 1),)))
    for action, words in (({"kind": "dead", "cells": [[8, 0]]}, "≤ 7"), ({"kind": "melt"}, "melt")):
        with pytest.raises(ConfigurationError, match=words):
            pad_fault(json.dumps({"action": action}))
    with pytest.raises(InputError, match=r"\(7, 5\).*are not there"):
        sampled(Fault(action=Stuck(cells=((7, 5),))))
    with pytest.raises(InputError, match="is no event"):
        sampled(Fault(action=Unplug(), on="torque_on"))


def test_of_a_device_in_use_faults_are_timed_from_now() -> None:
    """As an operator types them while it runs."""
    clock = VirtualClock()
    device = SimulatedTakktile(lambda: (0.0, 0.0))
    clock.sleep_until_ns(nanoseconds(3.0))
    device.add_fault(Fault(action=Unplug(), at_s=0.5, for_s=1.0), clock.now_ns())
    transport: Any = MemoryTransport(device, clock)
    clock.sleep_until_ns(nanoseconds(3.6))
    with pytest.raises((BusError, NoReplyError)):
        transport.request(0, 0, 0, 8)
    assert Cell(0, 0) == device.cells[0].cell
