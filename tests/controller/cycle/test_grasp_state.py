"""The life of a grasp, held to the diagram of the design, phase by phase and event by event."""

from __future__ import annotations

import itertools

import pytest

from controller.cycle.grasp_state import GraspEvent, GraspPhase, next_phase

# The diagram, an arrow a line; what is not here must be refused. Faults are laws of their own below.
DIAGRAM = """
none          prepositioned  prepositioned
prepositioned prepositioned  prepositioned
prepositioned withdrawn      none
prepositioned close          closing
closing       contact_found  contact
closing       closing_failed prepositioned
contact       squeeze        squeezing
contact       hold           holding
squeezing     squeezed       holding
squeezing     hold           holding
holding       squeeze        squeezing
holding       hold           holding
holding       carry          carrying
carrying      carried        holding
carrying      hold           holding
closing       release        releasing
contact       release        releasing
squeezing     release        releasing
holding       release        releasing
carrying      release        releasing
fault         release        releasing
releasing     hold           holding
releasing     hold           holding
releasing     released       none
"""
ARROWS = {
    (GraspPhase[phase], GraspEvent[event]): GraspPhase[following]
    for phase, event, following in (line.upper().split() for line in DIAGRAM.strip().splitlines())
}
HELD = {
    GraspPhase.CONTACT,
    GraspPhase.SQUEEZING,
    GraspPhase.HOLDING,
    GraspPhase.CARRYING,
    GraspPhase.RELEASING,
    GraspPhase.FAULT,
}
ALL = list(itertools.product(GraspPhase, GraspEvent, (False, True)))


@pytest.mark.parametrize("phase", GraspPhase)
def test_every_phase_answers_every_event_as_the_diagram_says(phase: GraspPhase) -> None:
    """Nothing may happen in a phase that the design does not draw."""
    for event, gripping in itertools.product(GraspEvent, (False, True)):
        following = next_phase(phase, event, gripping=gripping)
        if event is GraspEvent.FAULT:
            keeps = phase in HELD or phase is GraspPhase.CLOSING
            assert following is (GraspPhase.FAULT if keeps else GraspPhase.NONE)
        elif event is GraspEvent.FAULT_CLEARED:
            cleared = GraspPhase.HOLDING if gripping else GraspPhase.NONE
            assert following is (cleared if phase is GraspPhase.FAULT else None)
        else:
            assert following is ARROWS.get((phase, event))


def test_only_a_finished_release_lets_go() -> None:
    """The object is kept through every event but release: no fault, stop or command drops it."""
    ways_out = {
        (phase, event)
        for phase, event, gripping in ALL
        if phase in HELD and gripping and next_phase(phase, event, gripping=gripping) not in (*HELD, None)
    }
    assert ways_out == {(GraspPhase.RELEASING, GraspEvent.RELEASED)}


def test_release_is_open_from_wherever_something_may_be_held() -> None:
    """Trapped fingers must come free, in a fault too; a release under way need not be asked for again."""
    for phase in (HELD | {GraspPhase.CLOSING}) - {GraspPhase.RELEASING}:
        assert next_phase(phase, GraspEvent.RELEASE) is GraspPhase.RELEASING


def test_no_phase_is_a_dead_end() -> None:
    """From everywhere a new grasp can begin."""
    for start in GraspPhase:
        reached = {start}
        while True:
            further = {next_phase(p, e, gripping=g) for p in reached for e in GraspEvent for g in (False, True)}
            further = further - {None} - reached
            if not further:
                break
            reached |= {phase for phase in further if phase is not None}
        assert GraspPhase.CONTACT in reached
