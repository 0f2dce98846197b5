"""Pacing with injected clocks: nothing here sleeps."""
from itertools import pairwise

import pytest

from hpv_twin.node.pacing import MILLISECOND, SECOND, Gap, Pacer

pytest.importorskip('rclpy')
START = 1_800_000_000 * SECOND


class Clocks:
    """A steady clock and a wall clock that go as told."""

    def __init__(self):
        self.steady, self.shift = 5 * SECOND, START - 5 * SECOND

    def monotonic(self):
        return self.steady

    def wall(self):
        return self.steady + self.shift

    def pass_by(self, duration):
        self.steady += duration


@pytest.fixture
def clocks():
    return Clocks()


@pytest.fixture
def pacer(clocks):
    return Pacer(MILLISECOND, clocks.monotonic, clocks.wall)


def test_nothing_is_due_before_its_deadline(pacer, clocks):
    assert pacer.delay() == pytest.approx(1e-3)
    clocks.pass_by(MILLISECOND - 1)
    assert pacer.due() == []
    clocks.pass_by(1)
    assert pacer.due() == [START + MILLISECOND]


def test_stamps_are_a_period_apart_however_late_the_ticks_run(pacer, clocks):
    stamps = []
    for k in range(2000):
        clocks.pass_by(300_000 + 1_000 * (k * 7919 % 1500))
        stamps += pacer.due()
    assert {b - a for a, b in pairwise(stamps)} == {MILLISECOND}
    assert not pacer.take_gaps()


def test_a_lag_of_20_ms_is_made_good_at_once(pacer, clocks):
    clocks.pass_by(21 * MILLISECOND)
    stamps = pacer.due()
    assert stamps == [START + k * MILLISECOND for k in range(1, 22)]
    assert pacer.dropped_ticks == 0 and pacer.due() == []


def test_a_longer_lag_is_dropped_counted_and_shown_in_the_stamps(pacer, clocks):
    clocks.pass_by(MILLISECOND)
    first = pacer.due()
    clocks.pass_by(5 * SECOND + 300_000)
    after = pacer.due()
    assert len(after) == 1
    [gap] = pacer.take_gaps()
    assert gap == Gap(4999, 4999 * MILLISECOND, 'fell behind', after[0])
    assert after[0] - first[-1] - MILLISECOND == gap.duration == pacer.dropped_time
    assert pacer.dropped_ticks == 4999
    assert not pacer.take_gaps()


def test_lateness_is_reported_per_tick_and_taken_once(pacer, clocks):
    clocks.pass_by(3 * MILLISECOND + 5)
    pacer.due()
    assert list(pacer.take_lateness()) == [2 * MILLISECOND + 5, MILLISECOND + 5, 5]
    assert pacer.late == 2 and not len(pacer.take_lateness())


@pytest.mark.parametrize('jump', [3600 * SECOND, -3600 * SECOND])
def test_a_wall_clock_that_is_set_moves_the_stamps_once_and_says_so(pacer, clocks, jump):
    stamps = []
    for k in range(3000):
        clocks.pass_by(MILLISECOND)
        if k == 1500:
            clocks.shift += jump
        stamps += pacer.due()
    steps = [b - a for a, b in pairwise(stamps)]
    assert sorted(set(steps)) == sorted({MILLISECOND, MILLISECOND + jump})
    assert steps.count(MILLISECOND + jump) == 1
    [behind] = [b for a, b in pairwise(stamps) if b - a == MILLISECOND + jump]
    assert pacer.take_gaps() == [Gap(0, jump, 'wall clock set', behind)]
    assert len(stamps) == 3000


def test_a_wall_clock_that_wanders_is_followed_gently(pacer, clocks):
    stamps = []
    for _ in range(60_000):
        clocks.pass_by(MILLISECOND)
        clocks.shift += 100  # 100 ppm
        stamps += pacer.due()
    steps = {b - a for a, b in pairwise(stamps)}
    assert steps <= set(range(MILLISECOND, MILLISECOND + 1001))
    assert abs(stamps[-1] - clocks.wall()) < MILLISECOND
    assert not pacer.take_gaps()


def test_restart_forgets_the_time_in_between(pacer, clocks):
    clocks.pass_by(10 * SECOND)
    pacer.restart()
    assert pacer.due() == [] and pacer.dropped_ticks == 0
