"""An arm that a hand holds: tremor is no motion, and averages out."""

from __future__ import annotations

import numpy as np
import pytest
from device_stand_in import RATE, Script, reading

from suta_calib.acquisition.rest import RestSettings
from suta_calib.acquisition.stops import Complete, Event, StopFinder
from suta_calib.device.reading import Reading
from suta_calib.geometry.numbers import wrap

HERE = np.array([0.5, -1.0, np.pi - 1e-6])
NEAR = HERE + np.radians([1.0, -2.0, 0.5])
JOINTS = ("a", "b", "c")
FREQUENCIES = np.array([8.1, 9.3, 10.1])


def held(amplitude_deg: float, rate: float = RATE, frequency: float = 1.0) -> list[Reading]:
    """Three rests with a small motion between, in a hand that trembles."""
    script = Script(HERE, rate=rate).rest(3.0).move(NEAR, 0.5).rest(3.0).move(HERE, 0.3).rest(3.0)
    return [
        reading(
            wrap(
                r.angles
                + np.radians(amplitude_deg)
                * np.sin(2 * np.pi * frequency * FREQUENCIES * r.time + np.arange(3))
            ),
            r.time,
            r.sequence,
        )
        for r in script.readings()
    ]


def completed(events: list[Event]) -> list[Complete]:
    return [event for event in events if isinstance(event, Complete)]


@pytest.mark.parametrize("rate", [100.0, RATE])
@pytest.mark.parametrize("amplitude_deg", [0.02, 0.05, 0.08])
def test_a_tremor_is_rest_and_averages_out(amplitude_deg: float, rate: float) -> None:
    found = completed(StopFinder(JOINTS, 2.0).feed(held(amplitude_deg, rate)))
    assert len(found) == 3
    for event, where in zip(found, (HERE, NEAR, HERE), strict=True):
        assert np.abs(wrap(event.average.angles - where)).max() < np.radians(0.04 * amplitude_deg)


def test_no_hand_that_is_seated_moves_so_much() -> None:
    assert completed(StopFinder(JOINTS, 2.0).feed(held(0.5))) == []


def test_what_is_rest_can_be_chosen() -> None:
    strict = RestSettings(tremble=np.radians(0.02))
    assert completed(StopFinder(JOINTS, 2.0, strict).feed(held(0.08))) == []
    lenient = RestSettings(tremble=np.radians(1.0), drift=np.radians(0.2))
    assert len(completed(StopFinder(JOINTS, 2.0, lenient).feed(held(0.5)))) == 3


def test_swaying_slower_than_a_tremor_is_motion() -> None:
    """A mean over two seconds would still have it."""
    assert completed(StopFinder(JOINTS, 2.0).feed(held(0.08, frequency=0.1))) == []
