from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.device.clock import DeviceClock


def feed(clock: DeviceClock, n: int, us: int, arrival: float) -> tuple[int, float, int]:
    return clock.unwrap(n % 65536, us % (1 << 32), arrival)


@given(
    st.integers(0, 65535),
    st.integers(0, (1 << 32) - 1),
    st.lists(st.tuples(st.integers(1, 65535), st.integers(0, 1 << 31)), max_size=20),
)
def test_both_counters_are_unwrapped(first: int, start: int, steps: list[tuple[int, int]]) -> None:
    clock = DeviceClock()
    assert feed(clock, first, start, 0.0) == (first, pytest.approx(start * 1e-6), 0)
    n, us = first, start
    for step, elapsed in steps:
        n, us = n + step, us + elapsed
        assert feed(clock, n, us, 0.0) == (n, pytest.approx(us * 1e-6), step - 1)


@pytest.mark.parametrize("pause", [3.0, 200.0, 5000.0, 20_000.0])
def test_a_pause_may_hide_whole_turns_of_the_counters(pause: float) -> None:
    clock, rate = DeviceClock(), 5000
    for n in range(300):
        feed(clock, n, n * 200, n / rate)
    missed = int(pause * rate)
    n, us = 299 + missed, (299 + missed) * 200
    assert feed(clock, n, us, n / rate + 0.004) == (n, pytest.approx(us * 1e-6), missed - 1)


def test_time_goes_on_by_arrival_after_an_interruption() -> None:
    clock = DeviceClock()
    feed(clock, 1000, 50_000_000, 10.0)
    clock.resume(1000, 50.0, 10.0)
    assert feed(clock, 0, 0, 12.5) == (1001, pytest.approx(52.5), 0)
    assert feed(clock, 1, 2000, 12.6) == (1002, pytest.approx(52.502), 0)
