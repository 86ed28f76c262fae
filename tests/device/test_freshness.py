from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from suta_calib.device import Reading, Statistics
from suta_calib.device.clock import Freshness

RATE = 768.0
NONE = np.zeros(1, dtype=bool)


def reading(sequence: int, time: float, arrival: float) -> Reading:
    return Reading(sequence, time, np.zeros(1), NONE, NONE, arrival)


class Run:
    """Readings through a `Freshness`, counted as a decoder would."""

    def __init__(self, window: float = 0.1) -> None:
        self.statistics = Statistics(("joint_1",))
        self.leaps: list[float] = []
        self.fresh = Freshness(window, self.statistics, self.leaps.append)
        self.taken: list[Reading] = []

    def feed_singly(self, readings: Iterable[Reading]) -> None:
        for each in readings:
            self.feed([each])

    def feed(self, readings: list[Reading]) -> bool:
        self.statistics.frames += len(readings)
        taken, leapt = self.fresh.take(readings)
        self.taken += taken
        return leapt


def live(first: int, count: int, at: float, lateness: float = 0.0) -> list[Reading]:
    random = np.random.default_rng(first)
    late = random.uniform(0, lateness, count)
    return [
        reading(n, n / RATE, at + (n - first) / RATE + late[n - first])
        for n in range(first, first + count)
    ]


@pytest.fixture
def run() -> Run:
    return Run()


def test_live_readings_pass_after_the_window(run: Run) -> None:
    run.statistics.interruptions = 3
    for each in live(1000, 200, 50.0):
        run.statistics.garbage_bytes += 1
        run.feed([each])
    assert run.statistics.interruptions == 3
    assert run.statistics.garbage_bytes == len(run.taken) - 1
    assert run.taken[0].arrival - 50.0 == pytest.approx(0.1, abs=0.01)
    assert len(run.taken) + run.statistics.stale_readings == 200
    assert run.statistics.frames == len(run.taken)
    assert run.leaps == []


def test_a_driver_that_hands_over_late_is_no_reason_to_wait_for_long(run: Run) -> None:
    run.feed_singly(sorted(live(0, 400, 5.0, lateness=0.016), key=lambda r: r.sequence))
    assert run.taken[0].time < 0.2


def test_a_cache_that_is_emptied_in_a_burst_is_left_out(run: Run) -> None:
    run.feed([reading(n, n / RATE, 70.0) for n in range(2000)])  # 2.6 s in no time
    assert run.taken == []
    run.feed_singly(live(2000, 200, 70.0))
    assert run.taken[0].sequence > 2000 + 0.09 * RATE


def test_an_old_clock_before_the_right_one_is_left_out(run: Run) -> None:
    run.feed_singly(live(0, 10, 20.0))
    assert run.feed(live(90_000, 1, 20.02))
    run.feed_singly(live(90_001, 200, 20.03))
    assert run.taken[0].sequence > 90_000
    assert run.leaps == []  # nothing had been let through: nobody is told


def test_a_leap_takes_back_what_it_was_counted_as(run: Run) -> None:
    run.feed_singly(live(1000, 300, 10.0))
    good, counted = len(run.taken), run.statistics.stale_readings
    run.statistics.lost_frames += 60_000
    run.statistics.gaps += 1
    assert run.feed(live(61_300, 5, 10.4))
    assert (run.statistics.frames, len(run.taken)) == (good, good)
    assert (run.statistics.lost_frames, run.statistics.gaps) == (0, 0)
    assert run.leaps == [pytest.approx(78.1, abs=0.1)]
    run.feed_singly(live(80_000, 300, 10.5))
    assert run.taken[-1].sequence == 80_299
    assert run.statistics.frames == len(run.taken)
    assert run.statistics.stale_readings > counted + 5


@pytest.mark.parametrize("pause", [0.5, 30.0])
def test_a_pause_is_no_leap(run: Run, pause: float) -> None:
    run.feed_singly(live(0, 200, 0.0))
    skipped = int(pause * RATE)
    after = live(200 + skipped, 5, (200 + skipped) / RATE)
    assert not run.feed(after)
    assert run.taken[-5:] == after


def test_frames_held_back_and_sent_at_once_are_not_lost(run: Run) -> None:
    run.feed_singly(live(0, 200, 0.0))
    held = [reading(n, n / RATE, 3.0) for n in range(200, 2300)]
    assert not run.feed(held)
    assert run.taken[-1] is held[-1]


def test_slow_devices_settle_too(run: Run) -> None:
    run.feed_singly(reading(n, n / 2, 9.0 + n / 2) for n in range(6))
    assert len(run.taken) == 4


def test_no_window_lets_everything_through() -> None:
    run = Run(0.0)
    assert not run.feed(live(5, 3, 1.0) + live(90_000, 3, 1.1))
    run.fresh.restart()
    assert len(run.taken) == 6


def test_a_clock_that_is_slow_is_believed(run: Run) -> None:
    run.feed_singly(reading(n, n / RATE, 1.2 * n / RATE) for n in range(300))
    assert run.taken[0].arrival < 0.15
    assert run.leaps == []


def test_a_clock_that_is_fast_is_believed_after_a_while(run: Run) -> None:
    run.feed_singly(reading(n, 1.5 * n / RATE, n / RATE) for n in range(round(3 * RATE)))
    assert run.taken[0].arrival == pytest.approx(2.0, abs=0.05)


def test_readings_that_were_read_late_are_no_leap(run: Run) -> None:
    """A computer that stood still: some were read late, the next were lost, then all is well."""
    run.feed_singly(live(0, 200, 0.0))
    run.feed([reading(n, n / RATE, 6.0) for n in range(200, 230)])
    following = live(4700, 50, 4700 / RATE)
    assert not run.feed(following)
    assert run.taken[-50:] == following
    assert run.leaps == []
