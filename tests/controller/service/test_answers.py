"""Replies and events: what the client reads is what the daemon said."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.service.answers import Event, Reply, decode_answer, encode_error, encode_event, encode_reply, error_told
from drivers.errors import CommandError, StillgraspError


def test_replies_and_errors_have_the_documented_keys() -> None:
    """A client in another language reads these maps without our code."""
    error = CommandError("wrong_phase", "Nothing is gripped.", help="Close first.")
    assert msgspec.msgpack.decode(encode_reply(3, {"pose": np.eye(2), "n": np.int64(4)})) == {
        "v": 1, "seq": 3, "ok": True, "result": {"pose": [[1.0, 0.0], [0.0, 1.0]], "n": 4},
    }  # fmt: skip
    assert msgspec.msgpack.decode(encode_error(None, error)) == {
        "v": 1, "seq": None, "ok": False,
        "error": {"code": "wrong_phase", "message": "Nothing is gripped.", "help": "Close first."},
    }  # fmt: skip
    assert msgspec.msgpack.decode(encode_event("progress", 3, fraction=0.5)) == {
        "v": 1, "event": "progress", "seq": 3, "fraction": 0.5,
    }  # fmt: skip


def test_a_failed_event_carries_its_error_to_the_client() -> None:
    """The reason of a failure arrives with code and help; errors without a code have `failed`."""
    told = error_told(StillgraspError("The arm is silent.", help="Look at the pendant."))
    event = decode_answer(encode_event("failed", 4, error=told))
    assert isinstance(event, Event)
    assert event.error is not None
    error = event.error.as_error()
    assert (error.code, error.message, error.help) == ("failed", "The arm is silent.", "Look at the pendant.")


@given(st.binary(max_size=100) | st.dictionaries(st.text(max_size=6), st.integers(0, 9)).map(msgspec.msgpack.encode))
def test_foreign_answers_are_refused_clearly(data: bytes) -> None:
    """A client connected to something else says so instead of crashing."""
    try:
        assert isinstance(decode_answer(data), Reply | Event)
    except CommandError as error:
        assert error.code == "bad_answer"  # noqa: PT017 - both outcomes are allowed, each with its law


def test_another_version_is_refused() -> None:
    """A newer daemon is not misread."""
    with pytest.raises(CommandError, match="version 2"):
        decode_answer(msgspec.msgpack.encode({"v": 2, "event": "completed", "seq": 1}))
