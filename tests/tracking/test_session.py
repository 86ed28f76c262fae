"""A run: what is published, at what rate, and what is said of its latency."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tracking_scene import reading, suta_tracker

from suta_calib.device import Reading
from suta_calib.tracking.publisher import Publisher
from suta_calib.tracking.session import LatencyStatistics, Pace, TrackingSession
from suta_calib.tracking.tracker import TrackedPose


class Kept(Publisher):
    """Keeps poses; may take its time."""

    name = "kept"

    def __init__(self, takes: float = 0.0) -> None:
        super().__init__()
        self.poses: list[TrackedPose] = []
        self._takes = takes

    def publish(self, pose: TrackedPose) -> None:
        time.sleep(self._takes)
        self.poses.append(pose)
        self.published += 1

    def close(self) -> None:
        pass


class Source:
    """Hands out readings in bursts, then raises or falls silent."""

    def __init__(self, bursts: list[list[Reading]], end: BaseException | None = None) -> None:
        self._bursts, self._end = list(bursts), end

    @property
    def empty(self) -> bool:
        return not self._bursts

    def read(self, timeout: float = 0.1) -> list[Reading]:
        if self._bursts:
            return self._bursts.pop(0)
        if self._end is not None:
            raise self._end
        time.sleep(timeout)
        return []


@pytest.fixture(scope="module")
def tracker():
    return suta_tracker()


def burst(first: int, count: int, period: float = 1e-3, **flags: tuple[int, ...]) -> list[Reading]:
    return [reading(np.zeros(6), k, at=k * period, **flags) for k in range(first, first + count)]


def test_every_reading_is_published_once_and_in_order(tracker):
    kept = Kept()
    session = TrackingSession(tracker, [kept])
    bad = burst(10, 5, error=(0,))
    source = Source([burst(0, 10), bad, [], burst(15, 5)])
    before = time.perf_counter()
    session.run(source, stop=lambda: source.empty)
    after = time.perf_counter()
    assert [pose.sequence for pose in kept.poses] == list(range(20))
    assert (session.readings, session.valid, session.invalid) == (20, 15, 5)
    assert session.last_valid is kept.poses[-1]
    summary = session.summary()
    assert summary["poses"] == {"valid": 15, "invalid": 5}
    assert summary["latency"]["count"] == 20
    assert summary["publishers"] == {"kept": {"published": 20, "dropped": 0}}
    # The run and nothing but the run, however long a busy machine takes for it.
    assert before <= session.began < session.ended <= after
    assert summary["seconds"] == session.ended - session.began


def test_latency_ends_when_the_last_publisher_has_taken_the_pose(tracker):
    session = TrackingSession(tracker, [Kept(), Kept(takes=0.02)])
    before = time.perf_counter()
    session.take(reading(np.zeros(6)))
    assert 0.02 <= session.latency.maximum <= time.perf_counter() - before


@pytest.mark.parametrize(("rate", "expected"), [(100.0, 100), (768.0, 768), (5000.0, 768)])
def test_rate_limits_by_the_devices_clock(tracker, rate: float, expected: int):
    kept = Kept()
    session = TrackingSession(tracker, [kept], rate)
    for each in burst(0, 768, period=1 / 768):
        session.take(each)
    assert len(kept.poses) == pytest.approx(expected, abs=1)
    assert session.readings == 768


def test_rate_goes_on_when_the_devices_clock_starts_anew(tracker):
    kept = Kept()
    session = TrackingSession(tracker, [kept], 10.0)
    for at in (100.0, 100.05, 100.1, 0.0, 0.05, 0.1):
        session.take(reading(np.zeros(6), at=at))
    assert [pose.time for pose in kept.poses] == [100.0, 100.1, 0.0, 0.1]


def test_an_error_of_the_device_ends_the_run(tracker):
    session = TrackingSession(tracker, [])
    with pytest.raises(KeyboardInterrupt):
        session.run(Source([burst(0, 3)], KeyboardInterrupt()))
    assert session.valid == 3
    assert session.ended > session.began


def test_it_stops_when_told(tracker):
    session = TrackingSession(tracker, [])
    session.run(Source([burst(k, 1) for k in range(9)]), None, lambda: session.readings == 4)
    assert session.readings == 4


def test_the_time_runs_from_the_first_reading_on_and_by_arrival(tracker):
    """A computer that comes to them late tracks what came in time, and nothing that did not."""
    began = time.perf_counter() - 5.0
    late = [replace(r, arrival=began + r.time) for r in burst(0, 4000)]
    bursts = [late[k : k + 50] for k in range(0, len(late), 50)]
    session = TrackingSession(tracker, [])
    session.run(Source([[], *bursts]), seconds=1.0)
    assert session.readings == 1001
    assert session.last is not None
    assert session.last.sequence == 1000
    # One that has fallen silent is not waited for.
    session = TrackingSession(tracker, [])
    session.run(Source(bursts[:3]), seconds=1.0)
    assert session.readings == 150


@given(st.lists(st.floats(1e-6, 50.0), min_size=1, max_size=300))
def test_percentiles_are_right_to_one_percent(times: list[float]):
    found = LatencyStatistics()
    for each in times:
        found.add(each)
    for percent in (1, 50, 95, 99, 100):
        exact = np.percentile(times, percent, method="inverted_cdf")
        assert found.percentile(percent) == pytest.approx(exact, rel=0.0101)
    assert found.maximum == max(times)
    assert found.mean == pytest.approx(np.mean(times))
    assert found.jitter == pytest.approx(np.std(times), abs=1e-6 * max(times))


def test_a_histogram_counts_everything_once():
    found = LatencyStatistics()
    for each in (1e-9, 1e-4, 1e-4, 2e-3, 1e9):
        found.add(each)
    edges, counts = found.histogram()
    assert len(edges) == len(counts) + 1
    assert counts.sum() == 5
    at = int(np.searchsorted(edges, 1e-4)) - 1
    assert counts[at] == 2


def test_nothing_measured_is_nan_not_zero():
    found = LatencyStatistics()
    assert np.isnan(found.summary()["p99_ms"])
    assert found.histogram()[1].sum() == 0


def test_pace_is_growth_a_second():
    counted, times = iter([0, 30, 60, 60, 60]), iter([7.0, 7.1, 7.2, 7.9, 9.9])
    pace = Pace(lambda: next(counted), lambda: next(times))
    assert pace() == pytest.approx(300)
    assert pace() == pytest.approx(300)
    assert pace() == pytest.approx(60 / 0.9)
    # What was counted two seconds ago is past.
    assert pace() == 0
