"""Averages on the circle, rest, stops: the stream's side of acquisition."""

from __future__ import annotations

import numpy as np
import pytest
from device_stand_in import NOISE, RATE, Script, reading
from hypothesis import given
from hypothesis import strategies as st

from suta_calib.acquisition.averaging import average, steps
from suta_calib.acquisition.rest import RestDetector, noise_level
from suta_calib.acquisition.stops import Began, Complete, Ended, Interrupted, Rejected, StopFinder
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import wrap

HERE = np.array([0.5, -1.0, np.pi - 1e-6])
THERE = np.array([0.9, -0.7, -2.5])
JOINTS = ("a", "b", "c")


@given(st.floats(-10, 10), st.integers(0, 2**32 - 1))
def test_the_average_does_not_depend_on_where_the_circle_is_cut(centre: float, seed: int) -> None:
    noise = 1e-3 * np.random.default_rng(seed).standard_normal((200, 1))
    found = average(wrap(centre + noise))
    assert abs(wrap(found.angles[0] - centre - noise.mean())) < 2e-4
    assert found.std[0] == pytest.approx(noise.std(ddof=1), rel=0.05)
    assert -np.pi < found.angles[0] <= np.pi


def test_gross_errors_are_left_out_of_the_average() -> None:
    random = np.random.default_rng(0)
    angles = np.pi + NOISE * random.standard_normal((1000, 2))
    clean = average(wrap(angles))
    angles[::20, 0] += random.uniform(0.01, 6, 50)
    found = average(wrap(angles))
    assert np.abs(wrap(found.angles - clean.angles)).max() < 0.2 * NOISE
    assert found.left_out[0] == 50
    assert found.std[0] < 1.2 * NOISE


def test_the_steps_of_a_coarse_encoder_are_averaged_and_not_left_out() -> None:
    step = 2 * np.pi / 4096
    angles = step * np.array([0] * 800 + [1] * 200)[:, None]
    found = average(angles)
    assert found.angles[0] == pytest.approx(0.2 * step)
    assert found.left_out[0] == 0
    assert steps(angles)[0] == pytest.approx(step)


def test_a_single_wrong_value_is_no_step() -> None:
    angles = np.zeros((500, 1))
    angles[77] = 1.0
    found = average(angles)
    assert found.angles[0] == 0.0
    assert found.left_out[0] == 1


def test_nothing_cannot_be_averaged() -> None:
    with pytest.raises(SamplesError, match="no readings"):
        average(np.empty((0, 6)))


@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_the_noise_is_told_from_motion(lost: float) -> None:
    readings = Script(HERE).move(THERE, 1.0).readings()
    kept = [r for r in readings if np.random.default_rng(r.sequence).random() >= lost]
    times = np.array([r.time for r in kept])
    level = noise_level(np.array([r.angles for r in kept]), times)
    assert level == pytest.approx([NOISE] * 3, rel=0.2)


def looks_of(script: Script) -> list[tuple[float, bool | None]]:
    looks = RestDetector().feed(script.readings())
    return [(look.readings[-1].time, look.resting) for look in looks if look.readings]


@pytest.mark.parametrize("noise", [0.0, NOISE, 1e-3])
def test_rest_begins_and_ends_when_the_arm_does(noise: float) -> None:
    script = Script(HERE, noise=noise).rest(1.0).move(THERE).rest(1.0).move(HERE)
    looks = looks_of(script)
    assert all(resting for time, resting in looks if 0.3 < time < 1.0)
    assert not any(resting for time, resting in looks if 1.2 < time < 1.6)
    assert all(resting for time, resting in looks if 2.1 < time < 2.8)
    assert not any(resting for time, resting in looks if 3.0 < time < 3.4)


def test_a_slow_creep_is_no_rest() -> None:
    script = Script(HERE).rest(0.5).move(HERE + np.array([0, 0.1, 0]), 4.0)
    assert not any(resting for time, resting in looks_of(script) if 1.5 < time < 3.5)


def test_a_slow_stream_of_a_coarse_encoder_rests_too() -> None:
    step = 2 * np.pi / 4096
    script = Script(HERE, rate=30.0, noise=0.3 * step).rest(3.0).move(THERE).rest(3.0)
    coarse = [
        reading(step * np.round(r.angles / step), r.time, r.sequence) for r in script.readings()
    ]
    found = [event for event in StopFinder(JOINTS, 1.0).feed(coarse) if type(event) is Complete]
    assert len(found) == 2
    assert np.abs(wrap(found[1].average.angles - THERE)).max() < 0.3 * step


def test_lines_that_arrive_in_bunches_rest_and_move_alike() -> None:
    script = Script(HERE).rest(1.5).move(THERE).rest(1.5)
    # What USB does: the time of a line is that of the parcel it came in.
    parcels = [
        reading(r.angles, np.ceil(r.time / 0.016) * 0.016, r.sequence) for r in script.readings()
    ]
    events = StopFinder(JOINTS, 1.0, even=True).feed(parcels)
    assert [type(event) for event in events] == [Began, Complete, Began, Complete]
    for event, where in zip(events[1::2], (HERE, THERE), strict=True):
        assert isinstance(event, Complete)
        assert np.abs(wrap(event.average.angles - where)).max() < 5 * NOISE / 768**0.5


def events_of(script: Script, seconds: float = 1.0) -> list[object]:
    return list(StopFinder(JOINTS, seconds).feed(script.readings()))


def test_each_stop_is_recorded_once() -> None:
    events = events_of(Script(HERE).rest(2.0).move(THERE).rest(3.0))
    assert [type(event) for event in events] == [Began, Complete, Began, Complete]
    for event, where in zip(events[1::2], (HERE, THERE), strict=True):
        assert isinstance(event, Complete)
        assert event.average.seconds == pytest.approx(1.0, abs=0.05)
        assert event.average.count == pytest.approx(RATE, rel=0.05)
        # The mean of 768 readings, each within its noise; and nothing of the motion in it.
        assert np.abs(wrap(event.average.angles - where)).max() < 5 * NOISE / 768**0.5
        assert event.average.std == pytest.approx([NOISE] * 3, rel=0.15)


def test_a_window_in_which_the_arm_moved_is_rejected_by_name() -> None:
    events = events_of(Script(HERE).rest(0.8).move(HERE + np.array([0, 0.05, 0]), 0.3).rest(1.5))
    assert [type(event) for event in events] == [Began, Ended, Began, Complete]
    ended, complete = events[1], events[3]
    assert isinstance(ended, Ended)
    assert isinstance(complete, Complete)
    assert ended.joints == ("b",)
    # What it did while it moved is not in the part that rested either.
    assert np.abs(wrap(ended.average.angles - HERE)).max() < 1e-5
    assert complete.average.angles[1] == pytest.approx(-0.95, abs=1e-5)


def test_a_crawl_below_what_the_short_window_sees_is_rejected() -> None:
    # Within 0.02 deg in a quarter of a second, but 0.2 deg in four.
    script = Script(HERE).rest(0.5)
    way = np.array([9e-4, 0, 0])
    script.angles += [HERE + k / RATE * way for k in range(round(4 * RATE))]
    rejected = [e for e in events_of(script, 3.0) if isinstance(e, Rejected)]
    assert rejected
    assert rejected[0] == Rejected("crept", ("a",))


def test_an_error_flag_rejects_the_window_and_names_the_joint() -> None:
    readings = Script(HERE).rest(2.5).readings()
    at = round(0.8 * RATE)
    for k in range(at, at + 5):
        readings[k] = reading([0.0, 0.0, 0.0], readings[k].time, k, flags=[2])
    events = StopFinder(JOINTS, 1.0).feed(readings)
    assert [type(event) for event in events] == [Began, Rejected, Complete]
    assert events[1] == Rejected("error flag", ("c",))
    complete = events[2]
    assert isinstance(complete, Complete)
    assert complete.average.count < 1.05 * RATE
    assert np.abs(wrap(complete.average.angles - HERE)).max() < 1e-5


def test_a_pause_of_the_stream_does_not_end_a_rest_that_goes_on() -> None:
    readings = Script(HERE).rest(4.0).readings()
    kept = [r for r in readings if not 0.8 < r.time < 2.8]
    events = StopFinder(JOINTS, 1.0).feed(kept)
    assert [type(event) for event in events] == [Began, Interrupted, Complete]
    assert events[1] == Interrupted(pytest.approx(2.0, abs=0.01))


def test_a_motion_hidden_by_a_pause_ends_the_rest() -> None:
    readings = Script(HERE).rest(0.8).move(THERE).rest(3.0).readings()
    kept = [r for r in readings if not 0.7 < r.time < 2.0]
    events = StopFinder(JOINTS, 1.0).feed(kept)
    assert [type(event) for event in events] == [Began, Interrupted, Ended, Began, Complete]
    assert events[2].joints == ()  # type: ignore[attr-defined]
    complete = events[4]
    assert isinstance(complete, Complete)
    assert np.abs(wrap(complete.average.angles - THERE)).max() < 1e-5


def test_a_clock_that_runs_backwards_is_a_pause() -> None:
    first = Script(HERE).rest(0.6).readings()
    second = Script(HERE, seed=1).rest(1.0).readings()
    events = StopFinder(JOINTS, 1.0).feed(first + second)
    assert [type(event) for event in events] == [Began, Interrupted, Complete]


def test_the_excursion_is_the_farthest_the_arm_has_been() -> None:
    finder = StopFinder(JOINTS, 1.0)
    finder.feed(Script(HERE).rest(1.5).readings())
    finder.measure_excursion_from(HERE)
    there_and_back = Script(HERE).rest(0.1).move(THERE).move(HERE).rest(0.5).readings()
    finder.feed(reading(r.angles, r.time + 1.5) for r in there_and_back)
    assert finder.excursion == pytest.approx(np.abs(wrap(THERE - HERE)).max(), rel=0.01)
