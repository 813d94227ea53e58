"""The command language: every kind of bad request is named, and nothing gets through that should not."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import inspect

from controller.service.commands import (
    COMMANDS,
    MAXIMUM_REQUEST_BYTES,
    ArmMoveJoints,
    Command,
    GraspPreposition,
    GraspSqueeze,
    Request,
    RequestError,
    decode_request,
    encode_request,
)

GOOD: dict[str, Any] = {"v": 1, "seq": 7, "command": "grasp.squeeze", "args": {"load_N": 60}}
JOINTS = [0.1, -1.2, 0, 2.1, 0, 0.5, 0]


UPRIGHT = [1, 0, 0, 0]
PLACE: dict[str, Any] = {"table": "a", "object_xyz_m": [0, 0, 0]}


def packed(**changes: Any) -> bytes:
    return msgspec.msgpack.encode({key: value for key, value in {**GOOD, **changes}.items() if value is not ...})


def joints(joint_rad: list[Any]) -> bytes:
    return packed(command="arm.move_joints", args={"joint_rad": joint_rad})


def wrist(xyz_m: list[Any], quaternion_wxyz: list[Any]) -> bytes:
    pose = {"xyz_m": xyz_m, "quaternion_wxyz": quaternion_wxyz}
    return packed(command="arm.move_wrist", args={"T_world_wrist": pose})


def place(**args: Any) -> bytes:
    return packed(command="grasp.preposition", args={**PLACE, **args})


def refusal(data: bytes) -> RequestError:
    with pytest.raises(RequestError) as caught:
        decode_request(data)
    return caught.value


def test_a_good_request_is_decoded() -> None:
    """A whole number is a number; defaults are filled in; the deadline is kept."""
    request = decode_request(packed(deadline_s=2.5))
    assert request == Request(7, GraspSqueeze(load_N=60.0), 2.5)
    assert isinstance(request.command, GraspSqueeze)
    assert request.command.duration_s is None


def test_the_commands_of_the_design_are_all_there() -> None:
    """Other programs rely on these names."""
    expected = {"hello", "status", "stop", "fault.clear", "shutdown", "arm.hold", "arm.move_joints", "arm.move_wrist"}
    expected |= {"hand.open", "grasp.preposition", "grasp.close", "grasp.squeeze", "grasp.hold", "grasp.release"}
    assert set(COMMANDS) == expected | {"table.list", "table.load", "compensation.set"}


@pytest.mark.parametrize(
    ("data", "code", "key", "accepted"),
    [
        (b"", "not_msgpack", "", "one msgpack map"),
        (b"\xc1", "not_msgpack", "", "one msgpack map"),
        (b"\x91" * 60000 + b"\xc0", "not_msgpack", "", "one msgpack map"),
        (b"\xdd\xff\xff\xff\xff", "not_msgpack", "", "one msgpack map"),
        (packed() + b"\x00", "not_msgpack", "", "one msgpack map"),
        (bytes(MAXIMUM_REQUEST_BYTES + 1), "too_large", "", "at most 65536 bytes"),
        (msgspec.msgpack.encode([1, 2]), "wrong_type", "", "one map with v, seq, command"),
        (packed(v=2), "unsupported_version", "v", "v = 1"),
        (packed(v=True), "wrong_type", "v", "1"),
        (packed(v=...), "missing_key", "v", "1"),
        (packed(seq=...), "missing_key", "seq", "a whole number"),
        (packed(seq=-1), "out_of_range", "seq", "≥ 0"),
        (packed(seq="one"), "wrong_type", "seq", "a whole number"),
        (packed(seq=True), "wrong_type", "seq", "a whole number"),
        (packed(command="grasp.squeze"), "unknown_command", "command", "grasp.squeeze? One of hello, "),
        (packed(command=5), "wrong_type", "command", "a text"),
        (packed(args=...), "missing_key", "args", ""),
        (packed(args=[60]), "wrong_type", "args", ""),
        (packed(args={3: 60}), "wrong_type", "", ""),
        (packed(urgent=True), "extra_key", "urgent", "no such key, but one of v, seq, command, args, deadline_s"),
        (packed(deadline_s=0), "out_of_range", "deadline_s", "> 0"),
        (packed(deadline_s=math.nan), "not_finite", "deadline_s", "a finite number"),
        (packed(args={}), "missing_key", "load_N", "a finite number > 0 and ≤ 300"),
        (packed(args={"load_N": 60, "load": 1}), "extra_key", "load", "load_N, duration_s"),
        (packed(args={"load_N": "60"}), "wrong_type", "load_N", "a finite number > 0 and ≤ 300"),
        (packed(args={"load_N": True}), "wrong_type", "load_N", "a finite number > 0 and ≤ 300"),
        (packed(args={"load_N": None}), "wrong_type", "load_N", "a finite number"),
        (packed(args={"load_N": 301}), "out_of_range", "load_N", "a finite number > 0 and ≤ 300"),
        (packed(args={"load_N": math.inf}), "not_finite", "load_N", "a finite number > 0 and ≤ 300"),
        (packed(args={"load_N": math.nan}), "not_finite", "load_N", "a finite number > 0 and ≤ 300"),
        (packed(args={"load_N": [1] * 5000}), "wrong_type", "load_N", "a finite number"),
        (joints(JOINTS[:6]), "out_of_range", "joint_rad", "array of 7"),
        (joints([*JOINTS[:6], math.nan]), "not_finite", "joint_rad[6]", "≤ 6.3"),
        (joints([*JOINTS[:6], True]), "wrong_type", "joint_rad[6]", "≤ 6.3"),
        (packed(command="compensation.set", args={"enabled": 1}), "wrong_type", "enabled", "true or false"),
        (packed(command="compensation.set", args={"enabled": True, "index": "x"}), "out_of_range", "index", "'fused'"),
        (packed(command="status", args={"all": True}), "extra_key", "all", "no such key"),
        (packed(command="status", args={"command": "status"}), "extra_key", "command", "no such key"),
        (wrist([0, 0, -math.inf], UPRIGHT), "not_finite", "T_world_wrist.xyz_m[2]", "≥ -10"),
        (wrist([0, 0, 1], [1, 0, 0, 1]), "out_of_range", "T_world_wrist.quaternion_wxyz", "of length 1"),
        (place(object_yaw_rad=0, object_quaternion_wxyz=UPRIGHT), "out_of_range", "object_quaternion_wxyz", "either"),
        (place(object_quaternion_wxyz=[0.5, 0, 0, 0]), "out_of_range", "object_quaternion_wxyz", "of length 1"),
    ],
)
def test_a_bad_request_names_the_key_and_what_is_accepted(data: bytes, code: str, key: str, accepted: str) -> None:
    """A task planner's author learns from the reply what to change."""
    error = refusal(data)
    assert (error.code, error.key) == (code, key)
    assert accepted in error.accepted
    assert error.accepted in error.message
    assert key in error.message
    assert len(error.message) < 1000


def test_the_sequence_number_of_a_bad_request_is_kept() -> None:
    """The client can tell which of its requests was refused."""
    assert refusal(packed(command="dance")).seq == 7
    assert refusal(packed(args={"load_N": math.nan})).seq == 7
    assert refusal(packed(seq=2.5)).seq is None
    assert refusal(b"\xc1").seq is None


def test_every_number_of_every_command_has_a_range() -> None:
    """A float without a range would let NaN and infinity through."""
    pending: list[inspect.Type] = [inspect.type_info(kind) for kind in [*COMMANDS.values(), Request]]
    numbers = 0
    while pending:
        found = pending.pop()
        if isinstance(found, inspect.FloatType):
            numbers += 1
            lower = found.ge if found.ge is not None else found.gt
            upper = found.le if found.le is not None else found.lt
            assert (lower is not None and upper is not None) or found == inspect.FloatType()
        elif isinstance(found, inspect.StructType) and found.cls is not Request:
            pending += [field.type for field in found.fields]
        elif isinstance(found, inspect.TupleType):
            pending += found.item_types
        elif isinstance(found, inspect.UnionType):
            pending += found.types
    assert numbers > 20


@given(st.binary(max_size=300))
def test_noise_gives_an_error_and_never_a_crash(data: bytes) -> None:
    """Whatever bytes arrive, the answer is a request or a RequestError."""
    try:
        assert isinstance(decode_request(data).command, Command)
    except RequestError as error:
        assert error.accepted  # noqa: PT017 - both outcomes are allowed, each with its law


scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=4)
)
keys = st.text(max_size=6) | st.sampled_from([field for kind in COMMANDS.values() for field in kind.__struct_fields__])
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=8) | st.dictionaries(keys | st.integers(-9, 9), inner, max_size=4)
)


@given(
    name=st.sampled_from(sorted(COMMANDS)) | st.text(max_size=12),
    args=values,
    extra=st.dictionaries(keys, values, max_size=1),
)
def test_malformed_requests_never_get_through_with_nan(name: str, args: Any, extra: dict[str, Any]) -> None:
    """Well-formed msgpack of any content: refused by name, or a request without a non-finite number."""
    data = msgspec.msgpack.encode({"v": 1, "seq": 1, "command": name, "args": args, **extra})
    try:
        request = decode_request(data)
    except RequestError as error:
        assert error.seq == 1 or "seq" in extra  # noqa: PT017 - both outcomes are allowed, each with its law
    else:
        assert "nan" not in repr(request)
        assert "inf" not in repr(request)


@given(joints=st.tuples(*[st.floats(-6.3, 6.3)] * 7), speed=st.floats(0.01, 1), seq=st.integers(0, 2**53))
def test_encoding_and_decoding_are_inverse(joints: Any, speed: float, seq: int) -> None:
    """What a client says is what the daemon understands, to the last bit."""
    request = Request(seq, ArmMoveJoints(joint_rad=joints, speed=speed), deadline_s=9.0)
    assert decode_request(encode_request(request)) == request


def test_the_object_pose_of_a_preposition() -> None:
    """Yaw about the world's z, the same as a quaternion, or the world's own axes."""
    xyz = (0.5, -0.1, 0.9)
    by_yaw = GraspPreposition(table="a", object_xyz_m=xyz, object_yaw_rad=math.pi / 2).T_world_object()
    by_quaternion = GraspPreposition(
        table="a", object_xyz_m=xyz, object_quaternion_wxyz=(math.sqrt(0.5), 0, 0, math.sqrt(0.5))
    ).T_world_object()
    expected = np.array([[0.0, -1, 0, 0.5], [1, 0, 0, -0.1], [0, 0, 1, 0.9], [0, 0, 0, 1]])
    np.testing.assert_allclose(by_yaw, expected, atol=1e-15)
    np.testing.assert_allclose(by_quaternion, by_yaw, atol=1e-15)
    plain = GraspPreposition(table="a", object_xyz_m=xyz).T_world_object()
    np.testing.assert_array_equal(plain[:3, :3], np.eye(3))
