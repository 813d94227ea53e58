"""A squeeze recorded on virtual time and replayed to a cycle alone, so that only the cycle's own work is measured.

Recording: a whole simulated robot grips and squeezes; every CAN frame that its cycle receives, every state of the hand
and every command are kept by period. Replay: a new cycle of the same installation gets them again, period by period,
over the same kinds of transport as on a robot: `struct can_frame` and links, both on sockets. The other ends of those
sockets are filled before and emptied after each stage, outside the measurement; no simulated device runs, and MuJoCo
does not evict the cycle's memory from the caches. The torque frames that the replayed cycle sends are compared with the
recorded ones: it did the same work.

What is measured is processor time of the thread, system calls included. Not measured: the wake-up itself before the
period, and what a real CAN adapter's driver costs beyond a UNIX socket.
"""

from __future__ import annotations

import gc
import os
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import patch

import can

from calibration.motion_table import MotionTable
from controller.config import RobotConfig
from controller.cycle.cycle import Cycle, CycleLinks, Parts
from controller.messages import CommandKind, CycleCommand
from controller.service.assembly import cycle_parts
from controller.service.links import LatestReader, LatestSender, OrderedReader, OrderedSender, SocketLink, socket_links
from controller.simulation import virtual_robot
from controller.simulation.demo_cases import GraspCase, approach_joints, preposition, table_name
from controller.simulation.virtual_robot import VirtualRobot
from drivers.clock import Clock, VirtualClock
from drivers.simulated.can_hub import MemoryCanBus
from drivers.simulated.can_wire import Frame
from drivers.simulated.seqpacket_can import SeqpacketBus, pack_frame, unpack_frame
from drivers.wam.bus import SocketCanBus
from drivers.wam.frames import RawFrame

STAGES = ("wake", "ask", "listen", "grasp", "smooth", "move", "feel", "act", "tell", "rest")
LOAD_N, SQUEEZE_S = 66.0, 1.2


@dataclass
class Period:
    """What reached the cycle in one period, and the torque frames it sent."""

    before_request: list[RawFrame] = field(default_factory=list)
    """Frames that waited when positions were asked for."""
    replies: list[RawFrame] = field(default_factory=list)
    hand: tuple[bytes, int] | None = None
    commands: list[bytes] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)


@dataclass
class Recording:
    """Start-up frames, all periods, and which of them squeeze."""

    config: RobotConfig
    table: MotionTable
    start_up: list[can.Message | None] = field(default_factory=list)
    start_ns: int = 0
    """When start-up was done."""
    periods: list[Period] = field(default_factory=list)
    squeeze: range = range(0)


class _RecordingBus:
    """The cycle's bus in the simulation, noting what passes."""

    def __init__(self, bus: MemoryCanBus) -> None:
        self._bus = bus
        self.answers: list[can.Message | None] = []
        """In start-up, with the times when there was none."""
        self.received: list[RawFrame] = []
        """In the cycle."""
        self.sent: list[bytes] = []

    def send(self, message: can.Message) -> None:
        self._bus.send(message)

    def receive(self, deadline_ns: int) -> can.Message | None:
        message = self._bus.receive(deadline_ns)
        self.answers.append(message)
        return message

    def send_frame(self, identifier: int, data: bytes) -> None:
        self.sent.append(pack_frame(Frame(identifier, data)))
        self._bus.send_frame(identifier, data)

    def receive_frame(self, deadline_ns: int) -> RawFrame | None:
        frame = self._bus.receive_frame(deadline_ns)
        if frame is not None:
            self.received.append(frame)
        return frame

    def close(self) -> None:
        self._bus.close()


def record(config: RobotConfig, case: GraspCase) -> Recording:
    """Grip and squeeze on virtual time; some seconds of processor time."""
    table = MotionTable.load(Path(config.tables.directory) / f"{table_name(case)}.npz")
    recording = Recording(config, table)
    buses: list[_RecordingBus] = []

    def recorded_parts(config: RobotConfig, bus: MemoryCanBus, clock: Clock) -> Parts:
        buses.append(_RecordingBus(bus))
        return cycle_parts(config, buses[0], clock)

    scene = replace(case.scene, joint_rad=tuple(approach_joints(config, table, case)))
    with patch.object(virtual_robot, "cycle_parts", recorded_parts):
        robot = VirtualRobot(config, scene)
    _watch(robot.cycle, buses[0], recording)
    robot.activate()
    robot.run_for(0.1)
    client = robot.client()
    preposition(client, case, approach_m=0.02)
    client.grasp_close().wait()
    first = robot.cycle.number
    client.grasp_squeeze(load_N=LOAD_N, duration_s=SQUEEZE_S).wait()
    recording.squeeze = range(first, robot.cycle.number)
    return recording


def _watch(cycle: Cycle, bus: _RecordingBus, recording: Recording) -> None:
    """Note what each period of `cycle` receives and sends."""
    arm, links = cycle._parts.arm, cycle._links
    step, request, receive = cycle.step, arm.request_positions, links.commands.receive
    listen: Callable[[int], None] = cycle._listen

    def watched_step() -> None:
        if not recording.periods:
            recording.start_up = bus.answers[:]
            recording.start_ns = cycle.pacer.deadline_ns - cycle.pacer.period_ns
        bus.received.clear()
        bus.sent.clear()
        recording.periods.append(Period())
        step()
        period = recording.periods[-1]
        period.replies, period.sent = bus.received[len(period.before_request) :], bus.sent[:]

    def watched_request() -> None:
        request()
        if recording.periods:  # not in start-up
            recording.periods[-1].before_request = bus.received[:]

    def watched_receive() -> object:
        message = receive()
        if message is not None:
            recording.periods[-1].commands.append(message.payload)
        return message

    def watched_listen(now_ns: int) -> None:
        listen(now_ns)
        recording.periods[-1].hand = links.hand_state.newest()

    for owner, name, function in (
        (cycle, "step", watched_step),
        (cycle, "_listen", watched_listen),
        (arm, "request_positions", watched_request),
        (links.commands, "receive", watched_receive),
    ):
        setattr(owner, name, function)


class _Stopwatch:
    """Processor time by stage; stages inside another are taken out of it."""

    def __init__(self) -> None:
        self.stage_ns = dict.fromkeys(STAGES, 0)
        self._inner_ns = 0

    def timed(self, stage: str, function: Callable[..., object]) -> Callable[..., object]:
        """`function`, with its time booked on `stage`."""

        def run(*arguments: object) -> object:
            outer_ns, self._inner_ns = self._inner_ns, 0
            began_ns = time.thread_time_ns()
            try:
                return function(*arguments)
            finally:
                taken_ns = time.thread_time_ns() - began_ns
                self.stage_ns[stage] += taken_ns - self._inner_ns
                self._inner_ns = outer_ns + taken_ns

        return run

    def unmeasured(self, function: Callable[[], None]) -> None:
        """Run something that is not the cycle's."""
        began_ns = time.thread_time_ns()
        function()
        self._inner_ns += time.thread_time_ns() - began_ns

    def read(self, total_ns: int) -> dict[str, float]:
        """Microseconds by stage and their total, and back to zero."""
        outside_ns = total_ns - self._inner_ns
        self.stage_ns["rest"] = outside_ns
        taken = {stage: value * 1e-3 for stage, value in self.stage_ns.items()}
        taken["total"] = sum(taken.values())
        self.stage_ns, self._inner_ns = dict.fromkeys(STAGES, 0), 0
        return taken


def replayed(recording: Recording, directory: Path) -> tuple[list[dict[str, float]], list[dict[str, float]], int]:
    """Each period of the squeeze with its stages, and with the total alone; and how many sent other torques.

    The two replays go side by side, so that both see the machine at the same speed.
    """
    pair = (Replay(recording, directory, stages=True), Replay(recording, directory, stages=False))
    taken: tuple[list[dict[str, float]], list[dict[str, float]]] = ([], [])
    try:
        for replay in pair:
            replay.start()
        gc.collect()
        gc.disable()
        for number, period in enumerate(recording.periods[: recording.squeeze.stop]):
            for replay, measured in zip(pair, taken, strict=True):
                figures = replay.step(period)
                if number in recording.squeeze:
                    measured.append(figures)
    finally:
        gc.enable()
        for replay in pair:
            replay.close()
    return *taken, sum(replay.different_frames for replay in pair)


class _SleepingClock(VirtualClock):
    """The recorded time, with the system call that a wait costs on a robot."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        time.sleep(1e-6)
        super().sleep_until_ns(deadline_ns)


class Replay:
    """A cycle behind sockets whose other ends are in our hands."""

    def __init__(self, recording: Recording, directory: Path, *, stages: bool) -> None:
        """`stages`: measure them one by one, which itself costs a microsecond each; otherwise only the total."""
        self._recording = recording
        self._stages = stages
        self._clock = _SleepingClock()
        channel = directory / f"can-{os.getpid()}-{id(self)}"
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.bind(str(channel))
            listener.listen(1)
            bus = SeqpacketBus(str(channel))
            self._wire, _ = listener.accept()
        channel.unlink()
        self._wire.setblocking(False)
        self._bus = SocketCanBus(bus, self._clock)
        parts = cycle_parts(recording.config, self._bus, self._clock)
        ours: list[SocketLink] = []
        theirs: list[SocketLink] = []
        for _ in range(5):
            mine, its = socket_links()
            ours.append(mine)
            theirs.append(its)
        self._commands, self._hand = OrderedSender(ours[0]), LatestSender(ours[1])
        self._outgoing = ours[2:]
        self._links = [*ours, *theirs]
        links = CycleLinks(
            OrderedReader(theirs[0]),
            OrderedSender(theirs[2]),
            LatestSender(theirs[3]),
            LatestReader(theirs[1]),
            LatestSender(theirs[4]),
        )
        self.cycle = Cycle(self._clock, links, parts, time.thread_time_ns)
        self._watch = _Stopwatch()
        self.different_frames = 0
        """Periods whose torque frames are not the recorded ones."""

    def close(self) -> None:
        """Close all sockets."""
        self._bus.close()
        self._wire.close()
        for link in self._links:
            link.close()

    def start(self) -> None:
        """Start-up, answered as in the recording: what the arm asks for is there before it asks."""
        answers = iter(self._recording.start_up)
        with patch.object(self._bus, "receive", lambda deadline_ns: next(answers)):
            self.cycle._parts.arm.start()
        self._clock.advance_to_ns(self._recording.start_ns)
        self.cycle.pacer.restart()
        self._drain()
        self._instrument()

    def step(self, period: Period) -> dict[str, float]:
        """One period; processor time by stage and in all, µs."""
        self._period = period
        self._feed(period.before_request)
        if period.hand is not None:
            self._hand.send(*period.hand)
        for payload in period.commands:
            if CycleCommand.unpack(payload).kind is CommandKind.LOAD_TABLE:
                descriptor = self._recording.table.to_memfd()
                self._commands.send_fds(payload, (descriptor,), self._clock.now_ns())
                os.close(descriptor)
            else:
                self._commands.send(payload, self._clock.now_ns())
        self._clock.advance_to_ns(self.cycle.pacer.deadline_ns)
        began_ns = time.thread_time_ns()
        self.cycle.step()
        taken = self._watch.read(time.thread_time_ns() - began_ns)
        self._check(self._drain(), period.sent)
        return taken

    def _check(self, sent: list[bytes], recorded: list[bytes]) -> None:
        def torques(frames: list[bytes]) -> list[bytes]:
            messages = [(frame, unpack_frame(frame)) for frame in frames]
            return [frame for frame, message in messages if message is not None and len(message.data) == 8]

        self.different_frames += torques(sent) != torques(recorded)

    def _instrument(self) -> None:
        cycle, parts, timed = self.cycle, self.cycle._parts, self._watch.timed
        request: Callable[[], None] = parts.arm.request_positions
        asked = timed("ask", request)

        def request_and_be_answered() -> None:
            asked()
            self._watch.unmeasured(lambda: self._feed(self._period.replies))

        stages: list[tuple[object, str, Callable[..., object]]] = [
            (parts.arm, "request_positions", request_and_be_answered),
            (cycle.pacer, "begin", timed("wake", cycle.pacer.begin)),
            (cycle, "_listen", timed("listen", cycle._listen)),
            (cycle, "_grasp", timed("grasp", cycle._grasp)),
            (parts.smoother, "step", timed("smooth", parts.smoother.step)),
            (cycle, "_move", timed("move", cycle._move)),
            (cycle, "_feel", timed("feel", cycle._feel)),
            (cycle, "_act", timed("act", cycle._act)),
            (cycle, "_tell", timed("tell", cycle._tell)),
        ]
        for owner, name, function in stages if self._stages else stages[:1]:
            setattr(owner, name, function)

    def _feed(self, frames: list[RawFrame]) -> None:
        for frame in frames:
            self._wire.send(pack_frame(Frame(*frame)))

    def _drain(self) -> list[bytes]:
        """Empty our ends; the CAN frames that were sent."""
        sent = []
        with suppress(BlockingIOError):
            while True:
                sent.append(self._wire.recv(32))
        for link in self._outgoing:
            while link.take() is not None:
                pass
        return sent
