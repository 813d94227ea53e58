"""What a simulated motor says on the bus, and when."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.simulated.dynamixel_motor import SimulatedMotor

FIRMWARE_ANSWER_NS = 50_000
"""From the end of a request to the answer with Return Delay Time 0 (dynamixel reference 5.1)."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One packet of answer: it starts `delay_ns` after the bytes before it have left the wire."""

    delay_ns: int
    data: bytes
    motor_id: int
    """Who says it; the broadcast id for a packet of several motors."""
    held_ns: int = 0
    """How long the host's adapter keeps it back."""


def delay_ns(motor: SimulatedMotor) -> int:
    """A motor's answering time."""
    return FIRMWARE_ANSWER_NS + round(motor.value("return_delay_time") * motor.model.return_delay_unit_s * 1e9)


def collided(answers: list[Answer], byte_ns: float) -> list[Answer]:
    """What is on the wire when motors with one id answer the same request: a 0 bit of either wins.

    Answers that begin long enough one after the other stay whole.
    """
    clusters: list[tuple[int, bytearray, int]] = []
    for answer in sorted(answers, key=lambda one: one.delay_ns):
        if clusters:
            start_ns, data, _ = clusters[-1]
            offset = round((answer.delay_ns - start_ns) / byte_ns)
            if offset < len(data):
                overlap = min(len(data) - offset, len(answer.data))
                for index in range(overlap):
                    data[offset + index] &= answer.data[index]
                data += answer.data[overlap:]
                continue
        clusters.append((answer.delay_ns, bytearray(answer.data), answer.motor_id))
    merged: list[Answer] = []
    end_ns = 0.0
    for start_ns, data, motor_id in clusters:
        merged.append(Answer(max(0, round(start_ns - end_ns)), bytes(data), motor_id))
        end_ns = start_ns + len(data) * byte_ns
    return merged
