"""Two recordings of one motion with clocks of their own become one file."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, printed, refused
from recorded_motions import (
    DRIFT,
    SHIFT,
    Recording,
    X,
    Z,
    after,
    recorded,
    repeated_motion,
    seen,
    smooth_motion,
    steady_motion,
    two_recordings,
)
from scipy.interpolate import CubicSpline, PchipInterpolator
from studies import first_of

from suta_calib.arrays import FloatArray
from suta_calib.exchange import read_foreign
from suta_calib.exchange.aligned_rows import AlignedRows, aligned
from suta_calib.exchange.clock import Between, Clock
from suta_calib.exchange.clock_alignment import ClockAlignment, Recorded, align_clocks
from suta_calib.exchange.tracked_bodies import Body
from suta_calib.geometry.numbers import random_rotations, rotation_from_vector
from suta_calib.measurements import read_csv_table
from suta_calib.measurements.csv_table import positions, rotations
from suta_calib.model.arm import ArmModel


def joined(tmp_path: Path, hand: Recording, target: Recording) -> AlignedRows:
    paths = hand.write(tmp_path / "hand.csv"), target.write(tmp_path / "target.csv")
    return aligned(read_foreign(paths[0]), read_foreign(paths[1]))


def worst(rows: AlignedRows, target: Recording) -> float:
    """Largest error of a time, s."""
    return float(np.abs(rows.alignment.first_times(target.stamps) - target.true).max())


def closure(path: Path) -> FloatArray:
    """(n,) m by which ``a X = Z⁻¹ … b`` is missed in a file of pairs."""
    table = read_csv_table(path)
    hand, target = (Body(positions(table, p), rotations(table, p)) for p in ("a_", "b_"))
    apart = after(after(Z.inverse(), hand), X).position - target.position
    return np.asarray(np.linalg.norm(apart, axis=1))


def test_three_thousand_rows_are_aligned_within_2_ms_in_5_s(tmp_path: Path) -> None:
    hand, target = two_recordings(0, 3000)
    a, b = hand.write(tmp_path / "hand.csv"), target.write(tmp_path / "target.csv")
    out, begin = tmp_path / "pairs.csv", time.process_time()
    told = answer("import", a, "--align", b, "--out", out)
    assert time.process_time() - begin < 5.0
    found = told["alignment"]
    at = found["at_s"]
    assert at * (1.0 + DRIFT) + SHIFT == pytest.approx(at + found["shift_s"], abs=1e-3)
    assert found["drift_ppm"] == pytest.approx(1e6 * DRIFT, abs=20.0)
    assert found["worst_std_s"] < 5e-4
    ends = target.stamps[[0, -1]]
    times = ends + found["shift_s"] + 1e-6 * found["drift_ppm"] * (ends - at)
    assert np.abs(times - target.true[[0, -1]]).max() < 2e-3
    assert told["verdict"]["level"] == "good"
    said = " ".join(printed("import", a, "--align", b, "--out", out).split())
    assert f"Next: suta-calib hand-eye {out}" in said
    # Noise of 0.2 mm and 0.03° of the target, and of the times.
    assert np.quantile(closure(out), 0.95) < 1e-3


@pytest.mark.parametrize("rates", [(0.033, 0.033), (0.01, 0.05), (0.05, 0.01)])
@pytest.mark.parametrize("inverse", [False, True], ids=["target", "inverse"])
def test_whichever_is_faster_and_however_poses_are_told(
    tmp_path: Path, rates: tuple[float, float], inverse: bool
) -> None:
    motion, seconds = smooth_motion(3, 30.0), 28.0
    true = [np.arange(0.5 * k, seconds, rate) for k, rate in enumerate(rates)]
    rows = joined(tmp_path, recorded(motion, true[0], 1), seen(motion, true[1], 2, inverse=inverse))
    assert worst(rows, seen(motion, true[1], 2)) < 2e-3
    assert rows.interpolated.name == ("hand.csv" if rates[1] > rates[0] else "target.csv")
    # The rows are those of the slower recording.
    assert np.median(np.diff(rows.columns["time"])) == pytest.approx(max(rates), rel=0.01)


def clocks(hand: Recording, target: Recording) -> ClockAlignment:
    """How their clocks belong together, without the files."""
    both = [
        Recorded(Path(f"{k}.csv"), Clock.of(Path(f"{k}.csv"), recording.stamps), recording.body)
        for k, recording in enumerate((hand, target))
    ]
    return align_clocks(*both)


def test_the_standard_deviations_are_honest() -> None:
    ratios = []
    for seed in range(10):
        hand, target = two_recordings(40 + seed, 500)
        found = clocks(hand, target)
        middle = found.at * (1.0 + DRIFT) + SHIFT - found.at
        ratios += [
            (found.shift - middle) / found.shift_std,
            (found.drift - DRIFT) / found.drift_std,
        ]
    assert np.abs(ratios).max() < 4.0
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_an_arm_that_stops_and_goes_before_a_camera_that_loses_its_target() -> None:
    """Most rows are at rest and tell nothing; the ± are those of the others."""
    ratios = []
    for seed in range(6):
        rng, knots, values = np.random.default_rng(seed), [-5.0], [np.zeros(6)]
        while knots[-1] < 45.0:
            pause, way = rng.uniform(0.5, 3.0), rng.uniform(0.8, 2.5)
            knots += [max(knots[-1], 0.0) + pause, max(knots[-1], 0.0) + pause + way]
            values += [values[-1], rng.normal(size=6) * np.repeat([0.4, 0.1], 3)]
        path = PchipInterpolator(knots, np.array(values))

        def motion(t: FloatArray, path: PchipInterpolator = path) -> Body:
            return Body(path(t)[:, 3:], rotation_from_vector(path(t)[:, :3]))

        lost = rng.uniform(0.0, 40.0, 5)
        true = np.arange(0.0, 40.0, 1 / 30)
        true = true[(np.abs(true[:, None] - lost) > 1.0).all(axis=1)]
        hand = recorded(motion, np.arange(0.0, 43.0, 0.02), seed, (1e-5, 1e-5))
        found = clocks(hand, seen(motion, true, seed + 1))
        ratios.append((found.shift - found.at * DRIFT - SHIFT) / found.shift_std)
        assert found.worst_std < 1e-3
    assert np.abs(ratios).max() < 4.0
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 1.8


@pytest.mark.parametrize("seed", first_of([0, 1]))
def test_an_arm_need_not_be_calibrated(seed: int, suta_urdf: Path) -> None:
    """Offsets of 3° that the URDF does not know: some ms, which the ± include."""
    arm, rng = ArmModel.from_urdf(suta_urdf, "tip"), np.random.default_rng(seed)
    truth = {f"{name}.offset": np.deg2rad(3.0) * rng.normal() for name in arm.joints}
    knots = rng.normal(size=(60, len(arm.joints))) * 0.4
    path = CubicSpline(np.arange(60.0) - 5.0, knots)

    def tip(at: FloatArray, values: dict[str, float]) -> Body:
        rotation, position = arm.forward(path(at), values)
        return Body(position, rotation)

    hand = recorded(lambda t: tip(t, {}), np.arange(0.0, 40.0, 0.02), seed)
    target = seen(lambda t: tip(t, truth), np.arange(1.0, 38.0, 0.033), seed)
    found = clocks(hand, target)
    off = found.shift - found.at * DRIFT - SHIFT
    assert abs(off) < min(4.0 * found.shift_std, 4e-3)
    assert found.shift_std < 3e-3


def test_readings_of_joints_become_samples(tmp_path: Path, suta_urdf: Path) -> None:
    arm = ArmModel.from_urdf(suta_urdf, "tip")
    rng, t = np.random.default_rng(5), np.arange(0.0, 40.0, 0.01)
    speed, phase = rng.uniform(0.2, 1.2, (2, len(arm.joints), 1, 3)), rng.uniform(0, 6, (1, 1, 3))

    def readings(at: FloatArray) -> FloatArray:
        return np.asarray((0.3 * np.sin(speed[0] * at[:, None] + phase)).sum(axis=2).T)

    def tip(at: FloatArray) -> Body:
        rotation, position = arm.forward(readings(at))
        return Body(position, rotation)

    table = np.column_stack([t, readings(t)])
    path = tmp_path / "joints.csv"
    lines = [",".join(map(repr, row)) for row in table.tolist()]
    path.write_text("\n".join([",".join(["time", *arm.joints]), *lines]) + "\n")
    target = seen(tip, np.arange(2.0, 36.0, 0.04), 3)
    other = target.write(tmp_path / "target.csv")
    out = tmp_path / "samples.csv"
    answer("import", path, "--align", other, "--urdf", suta_urdf, "--tip", "tip", "--out", out)
    samples = read_csv_table(out)
    assert [*samples.columns][: len(arm.joints) + 2] == ["time", *arm.joints, "x"]
    q = np.column_stack([samples.numbers(name) for name in arm.joints])
    assert np.abs(q - readings(samples.numbers("time"))).max() < 1e-3
    rotation, position = arm.forward(q)
    expected = after(after(Z.inverse(), Body(position, rotation)), X).position
    assert np.abs(expected - positions(samples)).max() < 2e-3


def test_a_reading_that_wraps_is_interpolated_across(tmp_path: Path) -> None:
    """At half a turn, the mean of 179° and -179° is 180°."""
    clock = Clock.of(tmp_path, np.arange(6.0) / 10.0)
    between = Between.of(clock, np.array([0.25]))
    assert between.weights.sum() == pytest.approx(1.0)
    assert between.weights[0] == pytest.approx(np.array([-1.0, 9.0, 9.0, -1.0]) / 16.0)


def test_between_rows_a_cubic_is_exact_and_gaps_are_not_crossed() -> None:
    t = np.sort(np.random.default_rng(0).uniform(0.0, 10.0, 200))
    t = t[(t < 4.0) | (t > 6.0)]
    clock = Clock.of(Path("a.csv"), t)
    at = np.linspace(-1.0, 11.0, 400)
    between = Between.of(clock, at)
    inside = (at > t[0]) & (at < t[-1])
    assert not between.known[~inside].any()
    assert not between.known[(at > 4.0) & (at < 6.0)].any()
    values = 1.0 + t - 0.3 * t**2 + 0.05 * t**3
    found = (between.weights * values[between.rows]).sum(axis=1)
    whole = between.known & (between.weights[:, 0] != 0) & (between.weights[:, 3] != 0)
    assert whole.sum() > 100
    expected = 1.0 + at - 0.3 * at**2 + 0.05 * at**3
    assert found[whole] == pytest.approx(expected[whole], abs=1e-9)


def _later(recording: Recording, rows: slice, by: float) -> Recording:
    stamps = recording.stamps.copy()
    stamps[rows] += by
    return replace(recording, stamps=stamps)


def _some(recording: Recording, rows: object) -> Recording:
    chosen = np.arange(len(recording.stamps))[rows]  # type: ignore[call-overload]
    return Recording(recording.stamps[chosen], recording.body.take(chosen), recording.true[chosen])


def _turned(recording: Recording) -> Recording:
    assert recording.body.rotation is not None
    back = np.swapaxes(recording.body.rotation, 1, 2)
    return replace(recording, body=Body(recording.body.position, back))


def _larger(recording: Recording, by: float) -> Recording:
    return replace(recording, body=Body(by * recording.body.position, recording.body.rotation))


def _flipped(recording: Recording) -> Recording:
    assert recording.body.rotation is not None
    rotation = recording.body.rotation.copy()
    rotation[10::50] = random_rotations(np.random.default_rng(3), len(rotation[10::50]))
    return replace(recording, body=Body(recording.body.position, rotation))


# What is done to the target's recording, and what is then told of it.
TOLD: dict[str, tuple[Callable[[Recording], Recording], str]] = {
    "a clock that jumps": (
        lambda r: _later(r, slice(700, None), 0.05),
        r"jump.* by about \+[345]\d ms",
    ),
    "a gap": (lambda r: _some(r, np.r_[0:400, 600:1500]), r"1 gap of up to 6\.\d+ s"),
    "repeated stamps": (lambda r: _some(r, np.repeat(np.arange(1500), 2)), "1500 of 3000 rows"),
    "a board of another size": (lambda r: _larger(r, 1.3), r"are 1\.3 times those"),
    "an inverted rotation": (_turned, "do not travel alike"),
    "a tag that flips": (_flipped, r"\d\d poses in target.csv are far from"),
}


@pytest.mark.parametrize("what", TOLD)
def test_told(what: str, tmp_path: Path) -> None:
    spoil, says = TOLD[what]
    hand, target = two_recordings(1)
    rows = joined(tmp_path, hand, spoil(target))
    assert rows.assessment.level == "care"
    assert len(rows.notes) == 1
    assert re.search(says, rows.notes[0]), rows.notes
    if what != "a clock that jumps":
        assert worst(rows, target) < 2e-3


def test_a_clock_that_counts_ns_since_1970(tmp_path: Path) -> None:
    hand, target = two_recordings(1)
    since = replace(target, stamps=target.stamps + 1.7e9)
    a = hand.write(tmp_path / "hand.csv")
    b = since.write(tmp_path / "target.csv", clock=1e9)
    rows = aligned(read_foreign(a), read_foreign(b))
    assert worst(rows, since) < 2e-3
    assert "read as ns since 1970" in " ".join(rows.remarks)


def _backwards(recording: Recording) -> Recording:
    return replace(recording, body=recording.body.take(np.arange(len(recording.true))[::-1]))


HAND, TARGET = two_recordings(2, 700)
TIMES: FloatArray = 0.033 * np.arange(700.0)
REFUSED: dict[str, tuple[Callable[[Path], Path], Callable[[Path], Path], str]] = {
    "two motions": (HAND.write, two_recordings(9, 700)[1].write, "another motion"),
    "no overlap": (
        _some(HAND, slice(None, 330)).write,
        _some(TARGET, slice(370, None)).write,
        "overlap for at least 20%",
    ),
    "a motion that repeats itself": (
        recorded(repeated_motion, TIMES, 0, (5e-4, 2e-4)).write,
        seen(repeated_motion, TIMES, 1).write,
        "repeats itself: two shifts",
    ),
    "a steady turn": (
        recorded(steady_motion, TIMES, 0, (5e-4, 2e-4)).write,
        seen(steady_motion, TIMES, 1).write,
        "speed of turning changes",
    ),
    "few rows": (HAND.write, _some(TARGET, slice(30)).write, "found 30 rows; expected at least 60"),
    "days": (
        HAND.write,
        _later(TARGET, slice(350, None), 1e6).write,
        "a recording of 278 h from its first to its last row",
    ),
    "bursts": (
        HAND.write,
        _some(TARGET, np.arange(700) % 40 < 9).write,
        "0 motions of 0.4 s without a gap in 162 rows",
    ),
    "a body that rests": (
        HAND.write,
        recorded(lambda t: smooth_motion(1, 9.0)(0.0 * t), TIMES, 0, (5e-4, 2e-4)).write,
        "speed of turning changes",
    ),
    "positions alone": (
        HAND.write,
        lambda path: TARGET.write(path, drop=("qx", "qy", "qz", "qw")),
        "positions without orientations",
    ),
    "no times": (HAND.write, lambda path: TARGET.write(path, drop=("time",)), "a column 'time'"),
    "times in ms": (
        HAND.write,
        lambda path: TARGET.write(path, clock=1e3),
        "[ms]'. Such options are those of suta-calib import",
    ),
    "times that run backwards": (
        HAND.write,
        _later(TARGET, slice(350, None), -5.0).write,
        "after 350 rows",
    ),
    "a motion run backwards": (HAND.write, _backwards(TARGET).write, "hand.csv, but run backwards"),
    "rows in the opposite order": (
        HAND.write,
        _some(TARGET, slice(None, None, -1)).write,
        "earlier in every row: the recording runs backwards",
    ),
    "metres and millimetres": (HAND.write, _larger(TARGET, 1e3).write, "give --unit mm"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused(what: str, tmp_path: Path) -> None:
    first, second, says = REFUSED[what]
    a, b = first(tmp_path / "hand.csv"), second(tmp_path / "target.csv")
    out = tmp_path / "out.csv"
    assert says in refused("import", a, "--align", b, "--out", out)
    assert not out.exists()


def test_what_belongs_to_an_alignment_alone(tmp_path: Path, suta_urdf: Path) -> None:
    path = HAND.write(tmp_path / "hand.csv")
    assert "for --align" in refused("import", path, "--urdf", suta_urdf, "--tip", "tip")
    err = refused("import", path, "--align", path, "--urdf", suta_urdf, "--tip", "tip")
    assert "without joint_1" in err
    assert "an input of the same command" in refused("import", path, "--align", path, "--out", path)


def test_joints_may_have_any_names(tmp_path: Path) -> None:
    """Those of the arm are its readings, whatever they are called."""
    text = (
        '<robot name="two"><link name="base"/><link name="arm"/><link name="tip"/>'
        '<joint name="lift" type="revolute"><parent link="base"/><child link="arm"/>'
        '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        '<joint name="roll" type="revolute"><parent link="arm"/><child link="tip"/>'
        '<origin xyz="0.3 0 0.1"/><axis xyz="1 0 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
    )
    urdf = tmp_path / "two.urdf"
    urdf.write_text(text)
    arm, t = ArmModel.from_urdf(urdf, "tip"), np.arange(0.0, 30.0, 0.02)

    def readings(at: FloatArray) -> FloatArray:
        lift = np.sin(0.7 * at) + 0.4 * np.sin(1.9 * at)
        return np.stack([lift, 0.8 * np.sin(1.3 * at + 1.0)], axis=1)

    def tip(at: FloatArray) -> Body:
        rotation, position = arm.forward(readings(at))
        return Body(position, rotation)

    path = tmp_path / "joints.csv"
    rows = np.column_stack([t, readings(t)]).tolist()
    path.write_text("\n".join(["time,lift,roll", *(",".join(map(repr, r)) for r in rows)]) + "\n")
    other = seen(tip, np.arange(1.0, 28.0, 0.02), 3).write(tmp_path / "target.csv")
    told = answer("import", path, "--align", other, "--urdf", urdf, "--tip", "tip")
    found = told["alignment"]
    assert found["at_s"] * DRIFT + SHIFT == pytest.approx(found["shift_s"], abs=1e-3)
