"""Numbers beside the joints at a rest: averaged, and refused where their sensor did not rest."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_stand_in import Script

from suta_calib.acquisition.averaging import mean_number
from suta_calib.acquisition.extra_columns import ExtraColumns
from suta_calib.acquisition.raw import RawRecorder
from suta_calib.acquisition.run import SamplesFile
from suta_calib.acquisition.stops import Complete, Event, Rejected, StopFinder
from suta_calib.arrays import FloatArray
from suta_calib.device.reading import Reading
from suta_calib.terms import KINDS

JOINTS, COLUMNS = ("a", "b", "c"), ("ax", "ay", "az")
GRAVITY = np.array([3.0, -4.0, 8.4])
PLACES = [np.array([0.3 * k, -0.1 * k, 0.2]) for k in range(6)]


def stream(numbers: FloatArray | None = None, rests: int = 1) -> tuple[list[Reading], FloatArray]:
    """Readings of rests of 1 s with such numbers beside them, and which rest each belongs to."""
    script = Script(PLACES[0]).rest(1.0)
    for place in PLACES[1:rests]:
        script.move(place, 0.5).rest(1.0)
    readings = script.readings()
    noise = 0.03 * np.random.default_rng(1).standard_normal((len(readings), 3))
    given = GRAVITY + noise if numbers is None else numbers + noise
    which = np.round(np.array([r.time for r in readings]) / 1.5)
    return [replace(r, extra=g) for r, g in zip(readings, given, strict=True)], which


def events(readings: list[Reading], *, known: int = 0, kinds: bool = True) -> list[Event]:
    """What a finder tells of them, after so many rests that are kept."""
    reading = [KINDS["gravity"]] if kinds else []
    kept = np.tile(GRAVITY, (known, 1))
    extra = ExtraColumns(COLUMNS, reading, lambda _: kept)
    finder = StopFinder(JOINTS, 0.5, extra=extra)
    return [e for e in finder.feed(readings) if isinstance(e, Complete | Rejected)]


def test_a_rest_has_the_mean_and_the_scatter_of_its_numbers() -> None:
    (found,) = events(stream()[0])
    assert isinstance(found, Complete)
    assert list(found.average.extra) == list(COLUMNS)
    for number, true in zip(found.average.extra.values(), GRAVITY, strict=True):
        assert number.mean == pytest.approx(true, abs=0.006)
        assert number.std == pytest.approx(0.03, rel=0.15)
        assert number.share > 0.95


def test_a_pause_of_the_stream_does_not_end_a_rest() -> None:
    readings, _ = stream()
    paused = [r if r.time < 0.3 else replace(r, time=r.time + 2.0) for r in readings]
    (complete,) = events(paused)
    assert isinstance(complete, Complete)
    assert list(complete.average.extra) == list(COLUMNS)


def test_single_readings_that_are_no_numbers_or_far_off_do_no_harm() -> None:
    values = 9.81 + 0.03 * np.random.default_rng(0).standard_normal(300)
    clean = mean_number(values).mean
    values[::30], values[7::40] = np.nan, 981.0
    found = mean_number(values)
    assert found.mean == pytest.approx(clean, abs=0.002)
    assert found.share == pytest.approx(1 - 18 / 300, abs=0.005)
    assert mean_number(np.full(5, np.nan)).share == 0.0


SHAKEN = "it was shaken. Let the arm and the sensor come to rest"
MISSING = "of the readings of ay are no numbers, or far from the others"


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (lambda x, t: x + 2.0 * np.sin(40.0 * t)[:, None], SHAKEN),
        (lambda x, _: np.where(np.arange(3) == 1, np.nan, x), MISSING),
        (lambda x, t: np.where((t > 0.4)[:, None], x / 9.81, x), "no numbers, or far|shaken"),
        (
            lambda x, _: x / 9.81,
            r"felt 0\.99\d*, at the rests before 9\.7\d*\. Are g and m/s² mixed",
        ),
        (lambda x, _: 1.2 * x, "The sensor moved or shook: let it rest"),
    ],
    ids=["shaken", "no number", "unit changed half-way", "other unit", "accelerated"],
)
def test_a_sensor_that_did_not_rest_costs_the_rest(spoilt, words: str) -> None:
    readings, _ = stream()
    time = np.array([r.time for r in readings])
    numbers = spoilt(np.array([r.extra for r in readings]), time)
    bad = [replace(r, extra=row) for r, row in zip(readings, numbers, strict=True)]
    found = events(bad, known=3)
    assert [type(event) for event in found] in ([Rejected], [Rejected, Complete])
    assert re.search(words, str(found[0])), str(found[0])


def test_a_sensor_of_no_known_kind_is_judged_by_its_other_rests() -> None:
    readings, which = stream(rests=5)
    shaken = [
        replace(r, extra=r.extra + 0.5 * np.sin(50.0 * r.time)) if rest == 4 else r
        for r, rest in zip(readings, which, strict=True)
    ]
    found = events(shaken, kinds=False)
    assert [type(event) for event in found] == [Complete] * 4 + [Rejected]
    assert str(found[-1]).startswith("rejected: ax scattered by 0.3")
    assert "at the other rests by 0.0" in str(found[-1])
    assert [type(event) for event in events(readings, kinds=False)] == [Complete] * 5


def test_a_coarse_sensor_on_a_step_is_not_taken_for_a_shaken_one() -> None:
    readings, which = stream(rests=5)
    step = 0.04
    coarse = []
    for k, (r, rest) in enumerate(zip(readings, which, strict=True)):
        value = step * (k % 2) if rest == 4 else 0.0
        coarse.append(replace(r, extra=np.array([value, 0.0, 9.8])))
    assert [type(event) for event in events(coarse)] == [Complete] * 5


def test_a_refused_rest_is_told_once_and_ends_when_the_sensor_rests() -> None:
    script = Script(PLACES[0]).rest(4.0).readings()
    rows = [
        replace(r, extra=GRAVITY + (2.0 * np.sin(40.0 * r.time) if r.time < 2.5 else 0.0))
        for r in script
    ]
    assert [type(event) for event in events(rows)] == [Rejected, Complete]


def test_the_numbers_are_columns_of_the_samples_and_stay_with_their_rows(tmp_path: Path) -> None:
    path, columns = tmp_path / "samples.csv", ("repeat", *COLUMNS)
    file = SamplesFile(path, JOINTS, columns, {"repeat": "1"})
    for place in PLACES[:2]:
        file.put({"repeat": "1", "ax": "0.5", "ay": "-1", "az": "9.7"}, place)
    assert path.read_text().splitlines()[0] == "a,b,c,repeat,ax,ay,az"
    again = SamplesFile(path, JOINTS, columns, {"repeat": "1"}, resume=True)
    assert again.numbers(COLUMNS).tolist() == [[0.5, -1.0, 9.7]] * 2
    again.relabel([{"repeat": "1"}] * 2)
    assert again.numbers(COLUMNS).tolist() == [[0.5, -1.0, 9.7]] * 2


def test_every_reading_is_recorded_with_its_numbers(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    readings, _ = stream()
    with RawRecorder(tmp_path / "raw.parquet", JOINTS, extra=COLUMNS) as recorder:
        recorder.write(readings)
    table = parquet.read_table(tmp_path / "raw.parquet")
    assert table.column_names[-3:] == list(COLUMNS)
    assert table["ay"].to_pylist() == [r.extra[1] for r in readings]
