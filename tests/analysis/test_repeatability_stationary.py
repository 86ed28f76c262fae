"""Encoders at rest: noise, steps, drift, Allan deviation against published and known values."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies import of_size

from suta_calib.analysis.repeatability import (
    JointNoise,
    Stream,
    allan_deviation,
    read_stream,
    stationary,
)
from suta_calib.analysis.repeatability.at_rest import Stationary, overlapping
from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError

STEP = 2 * math.pi / 2**22
RATE = 100.0


def rest(*columns: FloatArray) -> Stationary:
    time = np.arange(len(columns[0])) / RATE
    names = tuple(f"joint_{k + 1}" for k in range(len(columns)))
    return stationary(Stream(Path("s.csv"), names, time, np.stack(columns, axis=1), 0))


def one(readings: FloatArray) -> JointNoise:
    return rest(readings).joints[0]


def white(seed: int, n: int = 4000, std: float = 1e-5) -> FloatArray:
    return std * np.random.default_rng(seed).standard_normal(n)


def test_allan_deviation_is_that_of_the_handbooks_test_suite() -> None:
    # NIST SP 1065, section 12.4: 1,000 numbers of a congruential generator, and their deviations.
    number, numbers = 1234567890, []
    for _ in range(1000):
        numbers.append(number / 2147483647)
        number = 16807 * number % 2147483647
    readings = np.array(numbers)
    sums = np.concatenate([[0.0], np.cumsum(readings - readings.mean())])
    found = [overlapping(sums, size) for size in (1, 10, 100)]
    assert found == pytest.approx([2.922319e-01, 9.159953e-02, 3.241343e-02], rel=1e-6)


def test_allan_deviation_of_white_noise_falls_with_the_root_of_time() -> None:
    found = allan_deviation(white(0, 100_000), 1 / RATE)
    assert found.tau[0] == 1 / RATE
    expected = 1e-5 / np.sqrt(RATE * found.tau)
    assert found.deviation[found.tau < 10] == pytest.approx(expected[found.tau < 10], rel=0.1)
    inside = (found.low < expected) & (expected < found.high)
    assert inside.mean() > 0.8
    assert not found.bottomed


def test_intervals_of_the_allan_deviation_hold_white_noise() -> None:
    held = []
    for seed in range(150):
        found = allan_deviation(white(seed, 1000), 1.0)
        expected = 1e-5 / np.sqrt(found.tau)
        held.append((found.low < expected) & (expected < found.high))
    share = np.mean(held, axis=0)
    assert ((share > 0.88) & (share <= 1)).all()


def test_drift_makes_it_rise_again_and_tells_how_long_averaging_helps() -> None:
    # White noise σ and a slope s: σ²/(2nτ)… the minimum is where σ²/m = s²(mτ0)²/2.
    slope = 1e-5
    readings = white(1, 40_000) + slope * np.arange(40_000) / RATE
    found = allan_deviation(readings, 1 / RATE)
    best = (2 * 1e-10 / (slope / RATE) ** 2 / 2) ** (1 / 3) / RATE
    assert found.bottomed
    assert found.tau[found.best] == pytest.approx(best, rel=0.5)


def test_noise_and_drift_are_told_apart() -> None:
    time = np.arange(4000) / RATE
    slope = 2e-6
    found = one(white(2) + 1.0 + slope * time)
    assert found.std_detrended == pytest.approx(1e-5, rel=0.05)
    assert found.std_short == pytest.approx(1e-5, rel=0.05)
    assert found.std > 1.5 * found.std_detrended
    assert abs(found.drift - slope) < 2 * found.drift_half
    assert found.drifts
    assert found.mean == pytest.approx(1.0 + slope * 20, abs=1e-5)


def correlated(seed: int, n: int = 4000, rho: float = 0.95) -> FloatArray:
    steps = np.random.default_rng(seed).standard_normal(n)
    values = np.zeros(n)
    for k in range(1, n):
        values[k] = rho * values[k - 1] + steps[k]
    return 1e-5 * values


@pytest.mark.parametrize("seeds", of_size(60, 150))
@pytest.mark.parametrize("noise", [white, correlated], ids=["white", "correlated"])
def test_the_interval_of_the_drift_holds_no_drift_as_often_as_it_says(noise, seeds: int) -> None:
    found = [one(noise(seed)) for seed in range(seeds)]
    inside = np.mean([abs(each.drift) <= each.drift_half for each in found])
    assert 0.89 <= inside <= 1.0
    assert sum(each.drifts for each in found) <= seeds // 150


def test_steps_of_the_encoder_show_where_noise_is_small() -> None:
    fine = one(STEP * np.round((0.7 + white(3, std=2e-6)) / STEP))
    assert fine.step == pytest.approx(STEP, rel=1e-6)
    assert fine.levels < 15
    assert one(white(3)).step is None
    # Nine decimals, as recordings are written, are no steps.
    assert one(np.round(0.7 + white(3, std=1e-6), 9)).step is None


def test_readings_across_plus_minus_pi_are_as_quiet_as_elsewhere() -> None:
    readings = np.angle(np.exp(1j * (math.pi + white(4))))
    assert np.ptp(readings) > 6
    found = one(readings)
    assert found.std == pytest.approx(1e-5, rel=0.05)
    assert abs(found.mean) == pytest.approx(math.pi, abs=1e-6)
    assert not found.moved
    assert found.allan.deviation[0] == pytest.approx(1e-5, rel=0.05)


def test_gross_errors_are_left_out_and_said() -> None:
    readings = white(5) + 0.3
    readings[[100, 2000]] = [1.3, -2.0]
    found = rest(readings)
    assert found.joints[0].left_out == 2
    assert found.joints[0].std == pytest.approx(1e-5, rel=0.05)
    assert any("joint_1 (2)" in note for note in found.assessment.notes)


def test_an_encoder_that_hangs_and_a_joint_that_moves_are_named() -> None:
    stuck = rest(np.full(1000, 0.5), white(6, 1000))
    assert any("joint_1 never changed" in note for note in stuck.assessment.notes)
    moving = rest(white(7), np.radians(3) * np.sin(np.arange(4000) / 500))
    assert moving.assessment.level == "bad"
    assert "joint_2 moved" in moving.assessment.notes[0]


def test_a_quiet_arm_is_good_and_its_noise_reaches_the_tip() -> None:
    time = np.arange(4000) / RATE
    stream = Stream(Path("s.csv"), ("a", "b"), time, np.stack([white(8), white(9)], axis=1), 0)
    found = stationary(stream, levers=np.array([0.3, 0.4]))
    assert found.assessment.level == "good"
    assert found.tip_std == pytest.approx(0.5e-5, rel=0.05)


def write(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_a_recording_of_track_is_read_without_its_invalid_rows(tmp_path: Path) -> None:
    rows = [f"{k},{k / 100:.6f},{1 if k % 50 else 0},,{1e-4 * (k % 3):.9f}" for k in range(300)]
    file = write(tmp_path / "s.csv", "sequence,time,valid,flags,joint_1", rows)
    found = read_stream(file)
    assert found.joints == ("joint_1",)
    assert found.dropped == 6
    assert len(found.time) == 294
    assert found.gaps == 5


def test_a_raw_recording_in_parquet_is_read_without_flagged_rows(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    table = arrow.table(
        {
            "sequence": list(range(200)),
            "time": [k / 100 for k in range(200)],
            "arrival": [k / 100 for k in range(200)],
            "joint_1": [1e-5 * (k % 7) for k in range(200)],
            "errors": ["joint_1" if k == 10 else "" for k in range(200)],
        }
    )
    parquet.write_table(table, tmp_path / "raw.parquet")
    found = read_stream(tmp_path / "raw.parquet")
    assert (found.joints, found.dropped, len(found.time)) == (("joint_1",), 1, 199)
    whole = (tmp_path / "raw.parquet").read_bytes()
    (tmp_path / "half.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(SamplesError, match="damaged or incomplete Parquet"):
        read_stream(tmp_path / "half.parquet")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda k: "nan" if k == 50 else "0.1", "finite number"),
        (lambda k: f"{57.3 + 0 * k}", "looks like degrees"),
        (lambda k: "" if k == 70 else "0.1", "finite number"),
    ],
)
def test_unusable_readings_are_refused_with_their_line(tmp_path: Path, change, said: str) -> None:
    file = write(tmp_path / "s.csv", "time,joint_1", [f"{k / 100},{change(k)}" for k in range(200)])
    with pytest.raises(SamplesError, match=said):
        read_stream(file)


def test_short_streams_and_clocks_that_go_back_are_refused(tmp_path: Path) -> None:
    short = write(tmp_path / "a.csv", "time,joint_1", [f"{k},0.1" for k in range(20)])
    with pytest.raises(SamplesError, match="20 valid rows"):
        read_stream(short)
    back = write(tmp_path / "b.csv", "time,joint_1", [f"{k % 150},0.1" for k in range(200)])
    with pytest.raises(SamplesError, match="time that increases"):
        read_stream(back)
    none = write(tmp_path / "c.csv", "time,x,y", [f"{k},0,0" for k in range(200)])
    with pytest.raises(SamplesError, match="one column per joint"):
        read_stream(none)


CELLS = st.sampled_from(["0.1", "1e400", "nan", "", "x", "-0.2", "1_0", "2"]) | st.text(max_size=4)


@given(st.lists(st.lists(CELLS, min_size=2, max_size=3), max_size=8), st.integers(0, 130))
def test_any_stream_is_read_or_refused_in_one_line(scratch: Path, rows, more: int) -> None:
    lines = [f"{k},0.5" for k in range(more)] + [",".join(row) for row in rows]
    scratch.write_text("\n".join(["time,joint_1", *lines]), encoding="utf-8")
    # Whatever else it raised would be no message for a user.
    with contextlib.suppress(SamplesError):
        found = read_stream(scratch)
        assert np.isfinite(found.readings).all()
        assert np.isfinite(stationary(found).joints[0].std)
