"""Questions answered through a pipe, as a terminal's lines come: late, many at once, or never."""

from __future__ import annotations

import os
import pty
from collections.abc import Iterator

import pytest

from controller.prompts import Prompts
from controller.typed_lines import TypedLines
from drivers.errors import InputError


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    read, write = os.pipe()
    yield read, write
    for descriptor in (read, write):
        try:
            os.close(descriptor)
        except OSError:
            continue  # the test closed it


def test_what_is_held_goes_on_until_the_answer_comes(pipe: tuple[int, int]) -> None:
    """A motor with a weight is talked to while the operator thinks."""
    asked: list[str] = []
    turns = 0

    def meanwhile() -> None:
        nonlocal turns
        turns += 1
        if turns == 5:
            os.write(pipe[1], b" 2.5 \nnext\n")

    prompts = Prompts(pipe[0], asked.append)
    assert prompts.ask("hang it", meanwhile) == "2.5"
    assert turns >= 5
    assert prompts.ask("again", meanwhile) == "next"
    assert asked == ["hang it", "again"]


def test_at_a_terminal_a_second_enter_is_no_answer() -> None:
    """It was typed before the question: the next weight does not hang yet."""
    ours, theirs = pty.openpty()
    asked: list[str] = []

    def meanwhile() -> None:
        if len(asked) == 2:
            os.write(ours, b"2\n")

    os.write(ours, b"1\n\n\n")
    prompts = Prompts(theirs, asked.append)
    os.write(ours, b"early\n")
    asked.append("something")
    assert prompts.ask("now", meanwhile) == "2"
    os.close(ours)
    os.close(theirs)


def test_an_end_is_no_answer(pipe: tuple[int, int]) -> None:
    """Nobody is there any more: an error, not a wait for ever. A last line without its end still counts."""
    os.write(pipe[1], b"4")
    os.close(pipe[1])
    prompts = Prompts(pipe[0], lambda text: None)
    assert prompts.ask("?", lambda: None) == "4"
    with pytest.raises(InputError, match="nobody answered"):
        prompts.ask("?", lambda: None)


def test_lines_without_end_do_not_fill_the_memory(pipe: tuple[int, int]) -> None:
    """A stream that is no text is cut into lines that nobody will understand."""
    os.write(pipe[1], b"x" * 5000)
    assert max(map(len, TypedLines(pipe[0]).read())) <= 5000


def test_a_closed_descriptor_is_not_open() -> None:
    """A service has no standard input."""
    read, write = os.pipe()
    os.close(read)
    os.close(write)
    assert not TypedLines(read).open
