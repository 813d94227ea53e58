"""The state as clients see it, from a cycle record."""

from __future__ import annotations

import msgspec
import numpy as np
import pinocchio
import pytest

from controller.cycle.grasp_state import ArmState, GraspPhase, HandStatus
from controller.messages import CYCLE_RECORD, CompensationIndex, HandFault, Reason
from controller.reasons import EXPLANATIONS
from controller.service.state import Record, state_map
from controller.service.telemetry import encode_state


def record(**values: float) -> Record:
    filled = np.zeros(CYCLE_RECORD.length)
    filled[:] = np.arange(CYCLE_RECORD.length) * 1e-3
    for name in ("arm_state", "hand_state", "grasp_phase", "reason", "compensation_enabled", "compensation_index"):
        filled[CYCLE_RECORD.slices[name]] = 0
    for name, value in values.items():
        filled[CYCLE_RECORD.slices[name]] = value
    return CYCLE_RECORD.read(filled.tobytes())


def test_numbers_keep_their_places() -> None:
    """Joint 4 is joint 4, and right is right: each list is the record's own."""
    seen = record(cycle=123456)
    state = state_map(seen)
    assert state["arm"]["joint_rad"] == seen["joint_rad"]
    assert state["arm"]["wrist_target_xyz_m"] == seen["wrist_xyz_m"]
    assert state["arm"]["wrist_plan_xyz_m"] == seen["wrist_plan_xyz_m"]
    assert state["hand"]["tension_N"] == seen["hand_tension_N"]
    assert state["hand"]["temperature_C"] == seen["hand_temperature_C"]
    assert state["hand"]["read_rate_hz"] == seen["hand_read_rate_hz"]
    assert state["compensation"]["offset"] == seen["offset"]
    assert state["compensation"]["offset_target"] == seen["offset_target"]
    assert state["cycle"]["number"] == 123456


def test_the_planned_wrist_can_be_sent_back_as_it_is_told() -> None:
    """A planner that lifts an object sends the told pose, raised: a turn by 0.6 rad about y comes out as such."""
    filled = np.zeros(CYCLE_RECORD.length)
    turn = pinocchio.exp3(np.array([0.0, 0.6, 0.0]))
    filled[CYCLE_RECORD.slices["wrist_plan_rotation"]] = turn.ravel()
    told = state_map(CYCLE_RECORD.read(filled.tobytes()))["arm"]["wrist_plan_quaternion_wxyz"]
    assert told == pytest.approx([np.cos(0.3), 0.0, np.sin(0.3), 0.0])


@pytest.mark.parametrize("phase", GraspPhase)
def test_states_are_told_by_name(phase: GraspPhase) -> None:
    """Clients read words, not numbers of an enumeration."""
    for arm in ArmState:
        for index in CompensationIndex:
            state = state_map(
                record(arm_state=arm, hand_state=HandStatus.GRIPPING, grasp_phase=phase, compensation_index=index)
            )
            assert state["arm"]["state"] == arm.name.lower()
            assert state["hand"]["state"] == "gripping"
            assert state["grasp"]["phase"] == phase.name.lower()
            assert state["compensation"]["index"] == index.name.lower()


def test_what_is_wrong_with_the_hand_is_told_by_names() -> None:
    """Several things at once: each by its name, none where nothing is wrong."""
    faults = HandFault.TORQUE_LOST | HandFault.RESTARTED
    assert state_map(record(hand_fault=faults))["hand"]["faults"] == ["torque_lost", "restarted"]
    assert state_map(record(hand_fault=0))["hand"]["faults"] == []


@pytest.mark.parametrize("reason", Reason)
def test_the_fault_is_told_by_its_code(reason: Reason) -> None:
    """No fault is an empty text; any other has the code that its documentation is found by."""
    fault = state_map(record(reason=reason))["grasp"]["fault"]
    assert fault == ("" if reason is Reason.NONE else EXPLANATIONS[reason].code)


def test_the_state_stream_takes_it_as_it_is() -> None:
    """Nothing in the map needs a decoder of ours: any msgpack reader has it back."""
    state = state_map(record(compensation_enabled=1.0))
    assert msgspec.msgpack.decode(encode_state(state, 12.5)) == {"timestamp": 12.5, **state}
    assert state["compensation"]["enabled"] is True
