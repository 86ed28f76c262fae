"""Every other reading undoes the mistake that it speaks of, to the last digit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from simulated import Scene, Spread, arm_named, random_readings, tracked_scene

from suta_calib import ArmPoses, Noise, Problem, Samples, Selection, SolverOptions, solve
from suta_calib.robots import load
from suta_calib.terms import Term
from suta_calib.trust import Reinterpretation, known_hypotheses
from suta_calib.trust.hypotheses.clipped_column import ClippedColumn
from suta_calib.trust.hypotheses.rounded import Rounded

Change = Callable[[Samples], Samples]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Sixty rows of an arm, seen in two files."""
    arm = arm_named("suta")
    return tracked_scene(arm, {}, 60)


@pytest.fixture(scope="module")
def samples(scene: Scene) -> Samples:
    found = scene.samples(Spread(position=1e-4), seed=3)[0]
    origin = [f"{'first' if row < 36 else 'second'}.csv:{row + 2}" for row in range(len(found))]
    return replace(found, origin=tuple(origin))


def readings(terms: list[Term]) -> list[tuple[str, Sequence[Term]]]:
    problem = Problem(terms)
    hypotheses = (h for h in known_hypotheses().values() if isinstance(h, Reinterpretation))
    hypotheses = (h for h in hypotheses if h.needs_arm)
    return [reading for h in hypotheses if h.tried == "ranked" for reading in h.readings(problem)]


def columns(*order: int) -> Change:
    """Under the name of each joint the readings of another."""
    return lambda s: replace(s, q=s.q[:, list(order)])


def lost(rows: int, after: int, of_joints: bool) -> Change:
    """Rows of the first file's readings, or of what was seen, that were never written."""

    def changed(samples: Samples) -> Samples:
        here = np.flatnonzero([o.startswith("first") for o in samples.origin])
        there = np.arange(len(here), len(samples))
        kept = here[: len(here) - rows]
        other = kept + rows * (kept >= after)
        read, seen = (other, kept) if of_joints else (kept, other)
        q = samples.q[np.concatenate([read, there])]
        return replace(samples.take(np.concatenate([seen, there])), q=q)

    return changed


def clock_set(samples: Samples) -> Samples:
    """Three rows late from the middle of each file on."""
    parts = []
    for first in (True, False):
        mine = samples.take([o.startswith("first") == first for o in samples.origin])
        kept = np.arange(len(mine) - 3)
        parts.append(replace(mine.take(kept), q=mine.q[kept + 3 * (kept >= len(kept) // 2)]))
    return Samples.concatenate(parts)


UNDONE = {
    "the clock of the observations was set in the middle part of a file: 3 rows late from "
    "there on": clock_set,
    "the columns of joint_2 and joint_5 are exchanged": columns(0, 4, 2, 3, 1, 5),
    "the joints' columns are each under the name of the next joint": columns(5, 0, 1, 2, 3, 4),
    "the joints' columns are each under the name of the previous joint": columns(1, 2, 3, 4, 5, 0),
    "the joints' columns are in the opposite order": columns(5, 4, 3, 2, 1, 0),
    "a row is missing among the joints' readings, between first.csv:14 and first.csv:25": lost(
        1, 20, True
    ),
    "3 rows are missing among the observations, between first.csv:13 and first.csv:26": lost(
        3, 20, False
    ),
}


@pytest.mark.parametrize("sentence", UNDONE)
def test_a_reading_undoes_its_mistake(scene: Scene, samples: Samples, sentence: str) -> None:
    assert samples.position is not None
    belongs = {tuple(q): tuple(p) for q, p in zip(samples.q, samples.position, strict=True)}
    wrong = scene.term(UNDONE[sentence](samples), Noise())
    read = dict(readings([wrong]))
    (term,) = read[sentence]
    found = term.poses.samples
    assert found.position is not None
    assert len(found) >= 0.5 * len(samples)
    for q, position in zip(found.q, found.position, strict=True):
        assert belongs[tuple(q)] == tuple(position)


def test_a_file_of_one_term_is_not_looked_for_in_another(scene: Scene, samples: Samples) -> None:
    terms = [
        scene.term(samples.take([o.startswith(name) for o in samples.origin]), Noise())
        for name in ("first", "second")
    ]
    found = [
        tuple(len(term.poses) for term in read)
        for sentence, read in readings(terms)
        if "missing among" in sentence and "between first.csv" in sentence
    ]
    assert found
    assert all(first < 36 and second == 24 for first, second in found)


def test_names_and_readings_in_two_orders_are_told_apart() -> None:
    """ROS lists joints by name, an arm from base to tip."""
    arm = load("romeo", tip="r_wrist")
    names = list(arm.joints)
    by_name = [names.index(name) for name in sorted(names)]
    assert by_name != sorted(by_name)
    q = random_readings(arm, np.random.default_rng(0), 12)
    scene = tracked_scene(arm, {}, 12)
    samples = replace(scene.samples()[0], q=q)
    read = dict(readings([scene.term(samples, Noise())]))
    sentences = [s for s in read if "alphabetical" in s]
    assert sentences
    for sentence in sentences:
        (term,) = read[sentence]
        assert isinstance(term.poses, ArmPoses)
        order = by_name if sentence.startswith("the joints' readings") else np.argsort(by_name)
        np.testing.assert_array_equal(term.poses.samples.q[:, order], q)


def test_a_reading_that_ends_somewhere_is_named(scene: Scene, samples: Samples) -> None:
    def saturated(end: float) -> Samples:
        q = samples.q.copy()
        q[:, 2] = np.minimum(q[:, 2], end)
        return replace(samples, q=q)

    (said,) = ClippedColumn().of_terms([scene.term(saturated(1.0), Noise())])
    assert said.startswith(
        f"{np.sum(samples.q[:, 2] >= 1.0)} of 60 readings of joint_3 are 57.2958 deg"
    )
    assert not [*ClippedColumn().of_terms([scene.term(samples, Noise())])]


def test_positions_that_were_rounded_are_told(scene: Scene, samples: Samples) -> None:
    """Whole centimetres scatter by 2.9 mm; noise as large does not stand in steps."""
    assert samples.position is not None
    coarse = replace(samples, position=np.round(samples.position, 2))
    noisy = scene.samples(Spread(position=2.9e-3), seed=4)[0]
    offsets = scene.arm.select(Selection(("*.offset",), bound_rad=0.1))
    once = SolverOptions(starts=1, max_iterations=30)
    said, unsaid = (
        [*Rounded().matches(solve(Problem([scene.term(each, Noise())], offsets), once))]
        for each in (coarse, noisy)
    )
    assert len(said) == 1
    assert "positions of tracked point are in steps of 10.000 mm" in said[0]
    assert "moves the tip by 2.887 mm" in said[0]
    assert not unsaid
