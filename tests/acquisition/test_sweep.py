"""A sweep by hand: what counts, in which stroke, and whether the tip was on its place."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from device_stand_in import POSTURE, Script
from hand_sweeps import (
    SEAT,
    contact_of,
    hand_motion,
    hand_readings,
    moments_of,
    postures_of,
    suta,
)
from spread import is_as_predicted
from studies import first_of

from suta_calib.acquisition.continuous import Continuous
from suta_calib.acquisition.run import SamplesFile
from suta_calib.acquisition.sweep import APART, Moment, PostureDistance, thinned
from suta_calib.acquisition.sweep_contact import Surface, Telling
from suta_calib.acquisition.touch_sequence import repeated
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import wrap
from suta_calib.measurements import Samples, read_csv_table
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, FixedPoint


# ── Thinning ───────────────────────────────────────────────────────────────────────────────────
def test_postures_that_count_are_apart_and_near_to_all_others() -> None:
    moments = moments_of(hand_readings(hand_motion()))
    rows, strokes = postures_of(moments)
    q = np.array([moments[k].angles for k in rows])
    distance = np.abs(wrap(q[:, None] - q)).max(axis=2)
    assert distance[np.triu_indices(len(q), 1)].min() >= APART
    every = np.array([moment.angles for moment in moments[::20]])
    assert np.abs(wrap(every[:, None] - q)).max(axis=2).min(axis=1).max() < APART
    assert (np.diff(strokes) >= 0).all()
    assert 8 <= strokes.max() <= 30


def test_neither_rate_nor_speed_nor_standing_still_makes_postures() -> None:
    """The same way, sampled at another rate, gone in half the time, with rests, or gone twice."""
    there = POSTURE + np.radians([30, 0, 0, 10, 0, 0])

    def count(script: Script) -> int:
        return len(postures_of(moments_of(script.readings()))[0])

    once = count(Script(POSTURE).move(there, 2.0))
    assert once == pytest.approx(15, abs=1)
    assert count(Script(POSTURE, rate=100.0).move(there, 2.0)) == pytest.approx(once, abs=1)
    assert count(Script(POSTURE).move(there, 1.0)) == pytest.approx(once, abs=1)
    assert count(Script(POSTURE).rest(3.0).move(there, 2.0).rest(3.0)) == pytest.approx(once, abs=1)
    assert count(Script(POSTURE).move(there, 2.0).move(POSTURE, 2.0)) == pytest.approx(once, abs=2)
    assert count(Script(POSTURE).rest(2.0)) == 1


def test_a_stroke_ends_where_the_motion_turns_back() -> None:
    there = POSTURE + np.radians([30, 0, 0, 10, 0, 0])
    aside = there + np.radians([0, 20, 0, 0, 0, 0])
    script = Script(POSTURE).move(there).move(aside).move(there).move(POSTURE)
    moments = moments_of(script.readings())
    thin = {"apart": 1e-9, "earlier": [], "strokes": 4}
    _, strokes = thinned(PostureDistance(suta()), moments, [True] * len(moments), **thin)
    assert sorted(set(strokes.tolist())) == [5, 6]
    # On the far side, up to what is no hesitation any more.
    assert 1.6 < moments[int(np.argmax(strokes == 6))].time < 2.2
    # A tremor is no reversal.
    trembling = [
        replace(m, angles=m.angles + np.radians(0.3) * np.sin(50.0 * m.time)) for m in moments
    ]
    _, again = thinned(PostureDistance(suta()), trembling, [True] * len(moments), **thin)
    assert set(again.tolist()) == {5, 6}


# ── Lift-off and slip ──────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("seed", first_of([1, 3, 4]))
@pytest.mark.parametrize("kind", ["fixed_point", "plane"])
def test_nothing_is_found_in_a_sound_sweep(seed: int, kind: str) -> None:
    seed = {1: 1, 3: 5, 4: 6}[seed] if kind == "plane" else seed
    motion = hand_motion(seed, size=0.12 if kind == "plane" else 0.0)
    found = contact_of(moments_of(hand_readings(motion)), kind)
    assert found.touching.all()
    assert (found.lift_offs, found.slips) == ((), ())
    assert 0.3 * SEAT < found.scatter < 1.3 * SEAT


@pytest.mark.parametrize("kind", ["fixed_point", "plane"])
def test_lift_off_and_slip_are_found_with_their_times_and_sizes(kind: str) -> None:
    faults = "lift=3:0.5@6,lift=1.5:0.3@18,slip=1.2@11"
    motion = hand_motion(5, faults, size=0.12 if kind == "plane" else 0.0)
    found = contact_of(moments_of(hand_readings(motion)), kind)
    off = [(lift.begin, lift.end, lift.distance) for lift in found.lift_offs]
    # From when the tip begins to move to when it is back, with the margin; and how high.
    expected = [(6.0, 6.65, 3e-3), (18.0, 18.45, 1.5e-3)]
    for (begin, end, distance), (first, last, height) in zip(off, expected, strict=True):
        assert first - 0.1 < begin < first + 0.1
        assert last - 0.1 < end < last + 0.1
        assert distance == pytest.approx(height, rel=0.25)
    (slip,) = found.slips
    assert slip.time == pytest.approx(11.1, abs=0.25)
    assert slip.distance == pytest.approx(1.2e-3, abs=max(4 * slip.std, 1.5e-4))


def test_a_tip_in_no_socket_is_said() -> None:
    script = Script(POSTURE)
    rng = np.random.default_rng(0)
    for _ in range(12):
        script.move(POSTURE + rng.uniform(-0.6, 0.6, 6), 0.8)
    with pytest.raises(SamplesError, match="is the tip in its socket"):
        contact_of(moments_of(script.readings()))
    with pytest.raises(SamplesError, match="found 1 postures"):
        contact_of(moments_of(Script(POSTURE).rest(2.0).readings()))


def test_what_other_postures_would_tell_is_named() -> None:
    arm = suta()
    unknowns = arm.select("joint_*.offset")
    telling = Telling(Surface(arm, FixedPoint, {}), unknowns)
    moments = moments_of(hand_readings(hand_motion()))
    rows, _ = postures_of(moments)
    q = np.array([moments[k].angles for k in rows])
    # Of a point nothing tells the first joint: it is not asked for.
    assert telling.untold(q[:30] * 0 + q[:1] + 1e-3 * np.arange(30)[:, None]) != ()
    assert "joint_1.offset" not in telling.untold(q[:30])
    assert telling.untold(q) == ()


# ── Measuring ──────────────────────────────────────────────────────────────────────────────────
def swept(path: Path, said: list[str], *, resume: bool = False) -> Continuous:
    arm = suta()
    plan = repeated(arm, FixedPoint, "F1", "1", 1)
    columns = (*plan.label_columns, "time", "stroke")
    file = SamplesFile(path, arm.joints, columns, plan.key, resume=resume)
    surface, unknowns = Surface(arm, FixedPoint, {}), arm.select("joint_*.offset", "tip.x")
    return Continuous(plan, file, said.append, surface=surface, unknowns=unknowns)


def test_how_far_a_sweep_is_is_said_and_a_key_ends_it(tmp_path: Path) -> None:
    said: list[str] = []
    readings = hand_readings(hand_motion(1))
    sweep = swept(tmp_path / "a.csv", said)
    for first in range(0, 9000, 500):
        sweep.feed(readings[first : first + 500])
    assert len(said) == 1
    assert re.match(r"\d+ postures in \d+ strokes, 10 s; covered: joint_1 \d+°, joint_2", said[0])
    rows = len(read_csv_table(tmp_path / "a.csv"))
    assert 0.8 * sweep.count < rows <= sweep.count
    sweep.press("x")
    assert not sweep.done
    sweep.press("q")
    assert sweep.done
    assert not sweep.feed(readings[9000:9500])
    first, *_ = sweep.conclude()
    assert first.startswith(f"{sweep.count} postures in")
    assert sweep.conclude() == []
    # Going on, only what is new counts, in strokes of their own.
    before = read_csv_table(tmp_path / "a.csv")
    again = swept(tmp_path / "a.csv", said, resume=True)
    again.feed(readings[:14000])
    again.conclude()
    after = read_csv_table(tmp_path / "a.csv")
    assert len(after) == len(before) + again.count
    assert after.columns["joint_1"][: len(before)] == before.columns["joint_1"]
    assert 0 < again.count < 0.6 * len(before)
    strokes = [int(stroke) for stroke in after.columns["stroke"]]
    assert min(strokes[len(before) :]) > max(strokes[: len(before)])


# ── The ± ──────────────────────────────────────────────────────────────────────────────────────
def test_the_stated_error_of_the_tip_is_true_though_strokes_err_together() -> None:
    """Each stroke has the tip elsewhere in its socket, and every row scatters."""
    arm = suta()
    unknowns = arm.select("joint_[2-5].offset", "tip.x", "tip.y")
    truth = {p.name: p.nominal for p in arm.parameters.values()} | {
        "joint_3.offset": 0.01,
        "joint_5.offset": -0.01,
        "tip.x": 0.001,
    }
    motion = hand_motion(1, seconds=60.0, seat=0.0)
    moments = moments_of(hand_readings(motion, rate=100.0, noise=0.0))
    wide = {"apart": 3 * APART}
    rows, strokes = thinned(PostureDistance(arm), moments, [True] * len(moments), **wide)
    q = np.array([moments[k].angles for k in rows])
    rotation, position = arm.forward(q, truth)
    middle = position.mean(axis=0)
    kinematics, rng = InverseKinematics(arm, truth), np.random.default_rng(0)
    labels = {"point": ["F1"] * len(q), "stroke": list(map(str, strokes))}
    somewhere = q[rng.integers(0, len(q), 30)] + 0.3 * rng.standard_normal((30, 6))
    errors, stated, alone = list[float](), list[float](), list[float]()
    for _ in range(60):
        seats = SEAT * rng.standard_normal((strokes.max() + 1, 3))[strokes]
        seats += 0.2 * SEAT * rng.standard_normal(seats.shape)
        answer = kinematics.solve(Targets(middle + seats, rotation, "pose"), q, rng, 1)
        assert answer.reached.all()
        samples = Samples.from_arrays(arm.joints, answer.q, labels=labels)
        term = FixedPoint(ArmPoses(arm, samples))
        fit = solve(Problem([term], unknowns), SolverOptions(confirm=False))
        assert not len(fit.identification.fixed)
        at = [fit.problem.names.index(name) for name in unknowns.names]
        values = truth | fit.problem.values(fit.x)
        tip = arm.forward(somewhere, values)[1] - arm.forward(somewhere, truth)[1]
        step = 1e-6
        columns = [
            (
                arm.forward(somewhere, truth | {n: truth[n] + step})[1]
                - arm.forward(somewhere, truth)[1]
            )
            / step
            for n in unknowns.names
        ]
        by = np.stack(columns, axis=-1)
        errors.append(float(np.mean(tip**2)))
        covariance = fit.covariance[np.ix_(at, at)]
        stated.append(float(np.mean(np.einsum("nij,jk,nik->ni", by, covariance, by))))
        if not alone:
            bare = samples.take(np.arange(len(q)))
            bare = replace(bare, labels={"point": bare.labels["point"]})
            plain = solve(Problem([FixedPoint(ArmPoses(arm, bare))], unknowns)).covariance
            plain = plain[np.ix_(at, at)]
            alone.append(float(np.mean(np.einsum("nij,jk,nik->ni", by, plain, by))))
    ratio = np.sqrt(np.mean(errors) / np.mean(stated))
    assert 0.9 < ratio < 1.1
    # Six unknowns were found in each trial.
    assert is_as_predicted(float(ratio), 6 * len(errors))
    # Rows that are taken for independent would claim much less.
    assert np.mean(errors) / np.mean(alone) > 1.4**2


# ── Hostile streams ────────────────────────────────────────────────────────────────────────────
def test_a_stream_with_nonsense_in_it_gives_the_same_sweep() -> None:
    readings = hand_readings(hand_motion(1, seconds=12.0))
    rng = np.random.default_rng(0)
    spoilt = []
    for k, each in enumerate(readings):
        if 3000 < k < 4200:
            continue  # the cable was out
        angles = each.angles.copy()
        if rng.random() < 0.01:
            angles[rng.integers(6)] = np.nan
        elif rng.random() < 0.002:
            angles[rng.integers(6)] += rng.uniform(-3.0, 3.0)
        spoilt.append(replace(each, angles=angles, time=each.time if k < 6000 else each.time - 7.0))
        if k == 7000:
            spoilt[-1] = replace(spoilt[-1], time=1e9)
        if rng.random() < 0.01:
            spoilt.append(spoilt[-1])
    moments = moments_of(spoilt)
    rows, strokes = postures_of(moments)
    found = contact_of(moments)
    assert found.slips == ()
    assert all(lift.end - lift.begin < 0.3 for lift in found.lift_offs)
    # What is left are postures that the arm was truly in.
    true = hand_motion(1, seconds=12.0).readings(np.arange(0, 12.0, 1e-3))
    for row in rows[found.touching[rows]]:
        assert np.abs(wrap(true - moments[row].angles)).max(axis=1).min() < 3e-3
    times = [moment.time for moment in moments]
    assert (np.diff(times) > 0).all()
    assert sum(moment.cut for moment in moments) == 5
    assert 10.0 < times[-1] < 13.0
    assert len(set(strokes.tolist())) > 3


def test_moments_of_nothing() -> None:
    assert moments_of([]) == []
    rows, strokes = thinned(PostureDistance(suta()), list[Moment](), [])
    assert len(rows) == len(strokes) == 0
