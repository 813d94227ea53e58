"""Whole readings out of replies, without any bus: what is taken, what is dropped, what stands in for what is not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.wam.joint_encoders import JointEncoders
from drivers.wam.positions import ArmSample, PositionReader

TURN = 4096
PERIOD_NS = 2_000_000


def data(counts: int, joint_counts: int | None = None) -> bytes:
    """A reply by the reference's words: 22 bits, big-endian, the two top bits free."""
    content = (counts % 2**22).to_bytes(3, "big")
    return content if joint_counts is None else content + (joint_counts % 2**22).to_bytes(3, "big")


class Reading:
    """A reader that has known the arm at rest at zero, and is fed cycle after cycle."""

    def __init__(self, longest: int = 5, encoders: JointEncoders | None = None) -> None:
        self.reader = PositionReader(longest)
        self.reader.know([0] * 7, [TURN] * 7, 0, encoders)
        self.now_ns = 0

    def cycle(self, replies: list[tuple[int, bytes]], *, stale: int = 0) -> ArmSample:
        self.now_ns += PERIOD_NS
        self.reader.begin(self.now_ns, stale=stale)
        for motor, content in replies:
            self.reader.take(motor, content)
        return self.reader.finish()

    def all(self, *counts: int) -> ArmSample:
        return self.cycle([(motor, data(count)) for motor, count in enumerate(counts)])


def test_joint_angles_are_the_references() -> None:
    """Protects the differentials: counts of the reference's table 5.2 give its joint angles."""
    reading = Reading()
    reading.reader.know([0, -36833, 36832, -36728, 0, 0, 0], [TURN] * 7, 0)
    sample = reading.all(0, -36833, 36832, -36728, 0, 0, 0)
    np.testing.assert_allclose(sample.joint_rad, [0, -2, 0, 3.13, 0, 0, 0], atol=2e-4)
    assert (sample.complete, sample.replies, sample.age_ns) == (True, 7, 0)


def test_velocity_follows_the_vendors_filter() -> None:
    """Protects the velocity: the discrete low-pass of reference 5.4 at 180 rad/s, over the true times of samples."""
    reading = Reading()
    expected, angle, last_ns = 0.0, 0.0, 0
    for period_ns in (2_000_000, 2_000_000, 2_300_000, 1_700_000, 2_000_000):
        reading.now_ns += period_ns - PERIOD_NS
        counts = round(angle * 18 * TURN / (2 * math.pi)) - 300
        sample = reading.all(0, 0, 0, counts, 0, 0, 0)
        step = sample.joint_rad[3] - (angle if last_ns else sample.joint_rad[3])
        elapsed_s = (sample.sample_ns - last_ns) * 1e-9
        expected = (expected + 180 * elapsed_s * (step / elapsed_s)) / (1 + 180 * elapsed_s) if last_ns else 0.0
        assert sample.joint_rad_s[3] == pytest.approx(expected, abs=1e-9)
        angle, last_ns = float(sample.joint_rad[3]), sample.sample_ns


def test_incomplete_readings_carry_all_joints_on_and_then_stop() -> None:
    """Protects the torques: motors of different moments never mix; after five cycles nothing is invented any more."""
    reading = Reading()
    for cycle in range(1, 200):
        moving = reading.all(0, 0, 0, 40 * cycle, 0, 0, 0)
    speed = float(moving.joint_rad_s[3])
    assert speed == pytest.approx(-40 * 2 * math.pi / TURN / 18 / 0.002, rel=1e-9)
    for missed in range(1, 9):
        sample = reading.cycle([(motor, data(77 if motor else 500)) for motor in range(7) if motor != 3])
        assert (sample.complete, sample.missing, sample.incomplete_cycles) == (False, (4,), missed)
        assert sample.age_ns == missed * PERIOD_NS
        assert sample.extrapolated == (missed <= 5)
        carried_s = missed * 0.002 if missed <= 5 else 0.0
        assert sample.joint_rad[3] == pytest.approx(float(moving.joint_rad[3]) + speed * carried_s, abs=1e-12)
        np.testing.assert_allclose(sample.joint_rad[[0, 1, 2, 4, 5, 6]], 0.0, atol=1e-12)
        assert sample.sample_ns == moving.sample_ns + (sample.age_ns if missed <= 5 else 0)


def test_no_extrapolation_gives_the_last_whole_reading_with_its_time() -> None:
    """Protects simulations that stall: nothing is invented, and the time of what is given is true."""
    reading = Reading(longest=0)
    whole = reading.all(*[20] * 7)
    sample = reading.cycle([])
    assert sample.joint_rad.tolist() == whole.joint_rad.tolist()
    assert (sample.sample_ns, sample.extrapolated) == (whole.sample_ns, False)


def test_of_two_answers_the_later_counts() -> None:
    """Protects against last cycle's late reply, which comes before the true one; and the reading then waits."""
    reading = Reading()
    for cycle in range(1, 30):
        reading.all(100 * cycle, 0, 0, 0, 0, 0, 0)
    answers = [(0, data(2900)), (0, data(3000))]
    others = [(motor, data(0)) for motor in range(1, 7)]
    sample = reading.cycle(answers + others)
    assert (sample.complete, sample.stale) == (True, 1)
    assert sample.joint_rad[0] == pytest.approx(-3000 * 2 * math.pi / TURN / 42)
    assert not reading.reader.orderly


def test_a_reading_in_the_order_of_nodes_needs_no_waiting() -> None:
    """Protects the cycle's time: only disorder makes it wait for more."""
    reading = Reading()
    reading.all(*[0] * 7)
    assert reading.reader.orderly
    reading.cycle([(6, data(0)), *((motor, data(0)) for motor in range(6))])
    assert not reading.reader.orderly


def test_asking_again_begins_the_reading_anew() -> None:
    """Protects the differentials: what answered the first request does not mix with answers to the second."""
    reading = Reading()
    reading.now_ns += PERIOD_NS
    reader = reading.reader
    reader.begin(reading.now_ns)
    for motor in (0, 1, 2, 4, 5, 6):
        reader.take(motor, data(10))
    assert reader.missing == (4,)
    reader.begin_again(reading.now_ns + 720_000)
    assert reader.replies == 0
    for motor in range(7):
        reader.take(motor, data(14))
    sample = reader.finish()
    assert (sample.complete, sample.repeated) == (True, True)
    assert sample.sample_ns == reading.now_ns + 720_000 + 75_000
    assert sample.joint_rad[0] == pytest.approx(-14 * 2 * math.pi / TURN / 42)


def test_a_counter_that_has_moved_is_told_apart_from_noise() -> None:
    """Protects against a lost zero: three implausible readings that agree name the motor; scattered ones do not."""
    reading = Reading()
    for counts in (30_000, -30_000, 90_000, -90_000):
        reading.cycle([(motor, data(counts if motor == 4 else 0)) for motor in range(7)])
        assert reading.reader.jumped == ()
    reading.all(*[0] * 7)
    for _ in range(3):
        sample = reading.cycle([(motor, data(30_000 if motor == 4 else 0)) for motor in range(7)])
        assert (sample.rejected, sample.missing) == (1, (5,))
    assert reading.reader.jumped == (5,)


@given(st.integers(-(2**21), 2**21 - 1))
def test_no_implausible_count_gets_into_a_reading(counts: int) -> None:
    """Law (reference 4.6): more than a quarter motor turn from the last position is never believed."""
    reading = Reading()
    reading.all(*[0] * 7)
    sample = reading.all(0, 0, 0, 0, 0, 0, counts)
    assert sample.complete == (abs(counts) <= TURN // 4)
    assert abs(sample.joint_rad[6]) <= 2 * math.pi / 4 / 14.93 + 1e-12


def test_the_first_reading_may_be_as_far_as_its_time_allows() -> None:
    """Protects starting in steps: an idle arm may have sunk since start-up read it; nonsense is still none."""
    for counts, believed in ((11 * 1024, True), (12 * 1024, False)):
        reading = Reading()
        reading.now_ns = 9 * PERIOD_NS
        assert reading.all(0, 0, 0, counts, 0, 0, 0).complete is believed
    reading = Reading()
    reading.now_ns = 10_000 * PERIOD_NS
    assert not reading.all(0, 0, 0, 33 * 1024, 0, 0, 0).complete


@given(st.integers(0, 6), st.binary(max_size=8))
def test_replies_of_other_lengths_are_counted_and_dropped(motor: int, content: bytes) -> None:
    """Law: three or six bytes are a position, nothing else is (reference 2.5)."""
    reading = Reading()
    sample = reading.cycle([(motor, content)])
    assert sample.malformed == (len(content) not in (3, 6))
    assert sample.replies + sample.rejected + sample.malformed == 1
    assert np.isfinite(sample.joint_rad).all()


def test_joint_encoders_tell_their_joints_where_they_agree_with_the_motors() -> None:
    """Protects arms with joint encoders: 327680 counts a turn of joint 4 (reference 5.1); nonsense is not believed."""
    reading = Reading(encoders=JointEncoders((3,), (327680,)))
    angle = 0.01
    motor_counts = round(-18 * angle * TURN / (2 * math.pi))
    stretched = round((angle + 0.004) * 327680 / (2 * math.pi))
    replies = [(motor, data(0)) for motor in range(7)]
    replies[3] = (3, data(motor_counts, stretched))
    sample = reading.cycle(replies)
    assert sample.joint_rad[3] == pytest.approx(angle + 0.004, abs=2e-5)
    assert sample.joint_rad_s[3] == 0.0  # the encoder's own place is no speed
    replies[3] = (3, data(motor_counts, stretched + 100_000))
    sample = reading.cycle(replies)
    assert (sample.complete, sample.rejected) == (True, 1)
    assert sample.joint_rad[3] == pytest.approx(angle, abs=1e-4)
