"""The front's children: started with their assignment, listened to, ended by closing their lifeline.

A child runs in a process group of its own, so that Ctrl-C in a terminal reaches the front alone, which then ends the
others in order. It inherits its own ends of its links and nothing else; the front closes its copies, so that a dead
process shows as end-of-file at once.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence

from controller.config import RobotConfig
from controller.service.assignment import Assignment, Role, SceneChoice
from controller.service.lifeline import Lifeline, Word
from controller.service.links import SocketLink, socket_links
from drivers.clock import Clock, seconds

_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class Child:
    """One child process. `ready`, `failure` and `motor_firmware` are what it said."""

    def __init__(self, role: Role, process: subprocess.Popen[bytes], lifeline: Lifeline) -> None:
        self.role = role
        self.lifeline = lifeline
        self.ready = False
        self.failure = ""
        self.motor_firmware: int | None = None
        self.prompts: list[tuple[str, str]] = []
        """Code and words of what it asked the operator for; for the front to take."""
        self.warnings: list[tuple[str, str]] = []
        """The same of what it warned of."""
        self._process = process
        self._ended = False

    @classmethod
    def start(
        cls,
        role: Role,
        config: RobotConfig,
        clock: Clock,
        *,
        links: Mapping[str, SocketLink] | None = None,
        descriptors: Mapping[str, int] | None = None,
        simulated: bool,
        scene: SceneChoice | None = None,
    ) -> Child:
        """Start one. `links` are its ends, closed here once it has them; `descriptors` it inherits, and we keep."""
        here, there = socket_links()
        given = {"front": there, **(links or {})}
        numbers = {name: link.fileno() for name, link in given.items()} | dict(descriptors or {})
        assignment = Assignment(
            role=role,
            config=config,
            descriptors=numbers,
            parent=os.getpid(),
            simulated=simulated,
            scene=scene or SceneChoice(),
        )
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "controller.service.process", role],
            stdin=subprocess.PIPE,
            stdout=2,  # what a library prints must not mix with our JSON
            pass_fds=tuple(numbers.values()),
            process_group=0,
            env={**os.environ, **_ONE_THREAD},
        )
        for link in given.values():
            link.close()
        assert process.stdin is not None
        with contextlib.suppress(OSError), process.stdin as line:  # one that died at once is seen by its end-of-file
            line.write(assignment.encode())
        return cls(role, process, Lifeline(here, clock))

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def gone(self) -> bool:
        """True once it has ended, or has closed its lifeline, which it does only when it ends."""
        return self._ended or self.lifeline.closed or self._process.poll() is not None

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while it runs, negative for a signal."""
        return self._process.poll()

    def begin(self) -> None:
        """Tell it that what it needs is there."""
        self.lifeline.say(Word.GO)

    def listen(self) -> list[str]:
        """Take in what it has said; the lines for the operator."""
        lines: list[str] = []
        while not self._ended and (saying := self.lifeline.hear()) is not None:
            if saying.word is Word.READY:
                self.ready = True
            elif saying.word is Word.FAILED:
                self.failure = saying.text
            elif saying.word is Word.PROMPT:
                code, _, text = saying.text.partition("\n")
                self.prompts.append((code, text))
            elif saying.word is Word.WARNING:
                code, _, text = saying.text.partition("\n")
                self.warnings.append((code, text))
            elif saying.word is Word.MOTORS:
                self.motor_firmware = int(saying.text)
            else:
                lines.append(saying.text)
        return lines

    def fate(self) -> str:
        """How it ended, in words."""
        code = self.exit_code
        if self.failure:
            return self.failure
        if code is None:
            return "it has closed its links"
        return f"ended by signal {-code}" if code < 0 else f"ended with exit code {code}"

    def let_go(self) -> None:
        """Close the lifeline: a child that runs ends in its own time; one that still loads its libraries, at once."""
        if not self._ended:
            self._ended = True
            self.lifeline.close()
            if not self.ready:
                self._process.terminate()

    def kill(self) -> None:
        """End it now, whatever it does."""
        self._process.kill()

    def wait(self, duration_s: float) -> bool:
        """Wait for its end; True if it has ended."""
        try:
            self._process.wait(duration_s)
        except subprocess.TimeoutExpired:
            return False
        return True


def end_children(children: Sequence[Child], clock: Clock, deadline_ns: int) -> list[str]:
    """Let all go, wait for them until `deadline_ns`, then kill who is left; the roles of those."""
    for child in children:
        child.let_go()
    killed: list[str] = []
    for child in children:
        if not child.wait(max(0.0, seconds(deadline_ns - clock.now_ns()))):
            child.kill()
            child.wait(1.0)
            killed.append(child.role)
    return killed
