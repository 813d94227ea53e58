"""What a copy of this process goes through, while this one stays as it is: so that many fates begin with the very same
robot, to the bit, which is brought to its beginning but once."""

from __future__ import annotations

import os
import pickle
import traceback
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def in_a_fork(act: Callable[[], T]) -> T:
    """What `act` returns in a fork of this process; it has to be picklable. AssertionError with the fork's traceback if
    something was raised there."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        try:
            answer: tuple[bool, T | str] = (True, act())
        except BaseException:
            answer = (False, traceback.format_exc())
        try:
            with os.fdopen(writer, "wb") as pipe:
                pickle.dump(answer, pipe)
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        told = pipe.read()
    os.waitpid(child, 0)
    well, result = pickle.loads(told)
    assert well, result
    outcome: T = result
    return outcome
