"""What front and children say to each other, over real socket pairs."""

from __future__ import annotations

from controller.service.lifeline import Lifeline, Saying, Word
from controller.service.links import socket_links
from drivers.clock import VirtualClock


def test_last_words_are_heard_after_the_end() -> None:
    """A child that fails says why and dies; its parent must still learn it, and that nobody hears it any more."""
    here, there = socket_links()
    front, child = Lifeline(here, VirtualClock()), Lifeline(there, VirtualClock())
    assert front.say(Word.GO)
    assert child.hear() == Saying(Word.GO, "")
    assert child.hear() is None
    assert child.say(Word.FAILED, "μ" * 10_000)
    child.close()
    assert front.closed
    last = front.hear()
    assert last is not None
    assert last.word is Word.FAILED
    assert last.text.startswith("μμμ")
    assert not front.say(Word.GO)
    front.close()
