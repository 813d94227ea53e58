"""The keyboard pendant, over a pipe."""

from __future__ import annotations

import os

from controller.simulation.pendant_lines import PendantLines


def test_words_come_a_line_and_others_are_told() -> None:
    """Pieces of a line wait for their end; unknown words are named and passed over; the end is only the end."""
    told: list[str] = []
    reading, writing = os.pipe()
    pendant = PendantLines(reading, told.append)
    os.write(writing, b"idle\nACTI")
    assert pendant.read() == ["idle"]
    os.write(writing, b"vate \njump\n\n")
    assert pendant.read() == ["activate"]
    assert len(told) == 1
    assert "'jump'" in told[0]
    os.write(writing, b"estop")
    os.close(writing)
    assert [*pendant.read(), *pendant.read()] == ["estop"]
    assert not pendant.open
    os.close(reading)


def test_a_fault_is_passed_on_as_it_is() -> None:
    """What goes wrong with arm, motors or pads is typed beside the buttons; whether it makes sense is theirs to say."""
    told: list[str] = []
    reading, writing = os.pipe()
    pendant = PendantLines(reading, told.append)
    os.write(writing, b' {"action": {"kind": "Unplug"}} \nidle\nmotors {"at_s": 1}\npads {}\n')
    assert pendant.read() == ['{"action": {"kind": "Unplug"}}', "idle", 'motors {"at_s": 1}', "pads {}"]
    assert told == []
    os.close(writing)
    os.close(reading)


def test_a_closed_input_is_no_pendant() -> None:
    """A daemon without standard input runs all the same."""
    reading, writing = os.pipe()
    os.close(reading)
    os.close(writing)
    assert not PendantLines(reading, lambda _: None).open
