"""Finding motors, and saying what is wrong with those that are found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.dynamixel.discovery import find_pair, reboot, reply_margin_s, scan
from drivers.dynamixel.settings import MotorSettings
from drivers.errors import DeviceError, InputError, NoReplyError, ProtocolError

PAIR = (MotorSettings(1, 1, 0), MotorSettings(2, 1, 0))
RigOf = Callable[..., Any]


@pytest.mark.parametrize(
    ("number", "protocol", "name"),
    [
        (28, 1, "RX-28"),
        (29, 1, "MX-28"),
        (30, 2, "MX-28(2.0)"),
        (1020, 2, "XM430-W350"),
        (1030, 2, "XM430-W210"),
        (1060, 2, "XL430-W250"),
    ],
)
def test_every_model_is_recognised_by_its_number(rig_of: RigOf, number: int, protocol: int, name: str) -> None:
    """Nobody has to say which hand it is."""
    found = find_pair(rig_of((1, number, protocol), (2, number, protocol)).port, PAIR)
    assert (found.model.name, found.bus.protocol) == (name, protocol)


@pytest.mark.parametrize(
    ("motors", "models", "reason"),
    [
        ([], (None, None), r"tendon motors 1 and 2: no reply at 1000000 bit/s, in either protocol.*motors --scan"),
        ([(1, 1020, 2)], (None, None), r"motor 2: no reply .* protocol 2.0; the other motor answers.*--scan"),
        ([(2, 28, 1)], (None, None), r"motor 1: no reply .* protocol 1.0; the other motor answers"),
        ([(1, 1020, 2), (2, 28, 1)], (None, None), r"motor 2: speaks protocol 1.0, and the other motor protocol 2.0"),
        ([(1, 28, 1), (2, 1020, 2)], ("RX-28", "RX-28"), "motor 2: speaks protocol 2.0"),
        ([(1, 1020, 2), (2, 1030, 2)], (None, None), "are a XM430-W350 and a XM430-W210; expected two of one model"),
        ([(1, 1030, 2), (2, 1030, 2)], ("XM430-W350", None), "motor 1: is a XM430-W210; expected a XM430-W350"),
        ([(1, 29, 1), (2, 29, 1)], ("XM430-W350",) * 2, "motor 1: is a MX-28; expected a XM430-W350"),
        ([(1, 310, 2), (2, 310, 2)], (None, None), "motor 1: motor model number 310 is not known; expected RX-28"),
    ],
)
def test_what_is_wrong_is_said(
    rig_of: RigOf, motors: list[tuple[int, int, int]], models: tuple[str | None, str | None], reason: str
) -> None:
    """Nothing there, one missing, mixed protocols, mixed models, another model than was calibrated."""
    settings = tuple(MotorSettings(m.motor_id, 1, 0, model=model) for m, model in zip(PAIR, models, strict=True))
    with pytest.raises(DeviceError, match=reason):
        find_pair(rig_of(*motors).port, settings)  # type: ignore[arg-type]  # two of them


def test_two_models_in_the_file_are_refused(rig_of: RigOf) -> None:
    """Before anything is asked on the bus."""
    rig = rig_of()
    with pytest.raises(InputError, match="a RX-28 and a MX-28; expected two of one model"):
        find_pair(rig.port, (MotorSettings(1, 1, 0, model="RX-28"), MotorSettings(2, 1, 0, model="MX-28")))
    assert rig.line.sent == []


def test_one_lost_or_damaged_answer_is_forgiven(rig_of: RigOf) -> None:
    """A start must not fail for one bad packet; but a motor that only ever answers damage is said to be damaged."""
    rig = rig_of((1, 1020, 2), (2, 1020, 2))
    spoilt = [b"\xff" * 5]
    rig.line.spoil = lambda answer: spoilt.pop() if spoilt else answer
    assert find_pair(rig.port, PAIR).model.number == 1020
    rig.line.spoil = lambda answer: answer[:-1] + bytes((answer[-1] ^ 1,))
    with pytest.raises(ProtocolError, match=r"motor 1: damaged reply.*Two motors may have this id"):
        find_pair(rig.port, PAIR)


def test_scan_finds_all_at_every_baud_rate(rig_of: RigOf) -> None:
    """Motors at 57 600 and at 4 M, of both protocols, one id twice: all are listed with what a user needs to know."""
    rigs = {
        57_600: rig_of((1, 29, 1), (7, 1060, 2)),
        4_000_000: rig_of((3, 1020, 2), (3, 1030, 2), (9, 310, 2)),
    }
    clock, asked = VirtualClock(), []

    def open_line(path: str, baud: int) -> Any:
        rig = rigs.get(baud) or rig_of()
        rig.line.clock = clock
        return rig.line

    found = scan(
        "/dev/somewhere",
        bauds=(57_600, 1_000_000, 4_000_000),
        motor_ids=range(12),
        clock=clock,
        open_line=open_line,
        progress=lambda baud, protocol: asked.append((baud, protocol)),
    )
    listed = [(motor.baud, motor.protocol, motor.motor_id, motor.model_name, motor.shared_id) for motor in found]
    assert listed == [
        (57_600, 2, 7, "XL430-W250", False),
        (57_600, 1, 1, "MX-28", False),
        (4_000_000, 2, 3, "damaged answers", True),
        (4_000_000, 2, 9, "model 310", False),
    ]
    assert asked == [(baud, protocol) for baud in (57_600, 1_000_000, 4_000_000) for protocol in (2, 1)]


def test_scan_writes_nothing(rig_of: RigOf) -> None:
    """Looking must not change, nor drop, anything."""
    rig = rig_of((1, 1020, 2), (2, 29, 1))
    scan("x", bauds=(1_000_000,), motor_ids=range(4), clock=rig.clock, open_line=lambda path, baud: rig.line)
    assert [motor.writes for motor in rig.motors] == [[], []]


def test_reboot_of_protocol_1_gives_the_torque_limit_back(rig_of: RigOf) -> None:
    """There the shutdown took Torque Limit away; torque stays off, so that the finger does not jump."""
    rig = rig_of((1, 29, 1))
    rig.motors[0]["torque"], rig.motors[0]["limit"] = 1, 0
    assert reboot(rig.port, rig.clock, 1).name == "MX-28"
    assert (rig.motors[0]["torque"], rig.motors[0]["limit"]) == (0, 1023)
    assert rig.motors[0].writes[0] == (24, b"\0")


def test_reboot_of_nobody_offers_the_scan(rig_of: RigOf) -> None:
    """The wrong id or baud rate is the likeliest reason."""
    with pytest.raises(NoReplyError, match="--scan"):
        reboot(rig_of().port, VirtualClock(), 4)


@pytest.mark.parametrize(("latency_ms", "margin_s"), [(None, 0.004), (0, 0.004), (1, 0.004), (16, 0.019)])
def test_the_margin_covers_the_adapter(latency_ms: int | None, margin_s: float) -> None:
    """With the default latency timer an answer comes 16 ms late: it must be slow, not silent."""
    assert reply_margin_s(latency_ms) == pytest.approx(margin_s)
