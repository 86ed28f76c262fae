"""Readings that never came: rows that read as others do which were elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from judging import assessed
from offset_arm import NOISE, ONCE, fitted_and_held_out, truth_of, unknowns
from simulated import Scene, arm_named, artefact, artefact_scene, placements

from suta_calib import Problem, Samples, Term, solve
from suta_calib.trust.hypotheses.repeated_readings import RepeatedReadings


@pytest.fixture(scope="module")
def scenes() -> tuple[Scene, Scene]:
    return fitted_and_held_out()


def without_answer(samples: Samples, *rows: int) -> Samples:
    """Zeros where a bus did not answer."""
    q = samples.q.copy()
    q[list(rows)] = 0.0
    return replace(samples, q=q)


def seen(scene: Scene) -> Samples:
    return scene.samples(NOISE, seed=0)[0]


def touched(kind: str) -> tuple[Scene, Samples]:
    arm = arm_named("suta")
    scene = artefact_scene(kind, arm, truth_of(arm), artefact(), placements(3), 2)
    return scene, scene.samples(NOISE, seed=0)[0]


def test_zeros_that_stand_for_readings_are_named(scenes: tuple[Scene, Scene]) -> None:
    fitted, held_out = scenes
    samples = seen(fitted)
    term = fitted.term(without_answer(samples, 5, 12, 30))
    (said,) = RepeatedReadings().of_terms([term])
    assert said.startswith(
        f"3 rows of tracked point ({samples.origin[5]} is the first) read the same"
    )
    solution = solve(Problem([term], unknowns(fitted.arm, priors=False)), ONCE)
    validation = [held_out.term(held_out.samples(NOISE, seed=1)[0])]
    found = assessed(solution, validation)
    assert found.level != "good"
    assert said in found.notes


def test_nobody_is_accused_of_a_posture_that_is_read_again(scenes: tuple[Scene, Scene]) -> None:
    samples = seen(scenes[0])
    again = samples.take(np.repeat(np.arange(12), 3))
    assert again.position is not None
    # What is seen of one posture may be wrong once in three.
    once_wrong = again.position + 0.2 * (np.arange(len(again)) % 3 == 0)[:, None]
    twice = samples.take(np.repeat(np.arange(12), 2))
    for each in (samples, again, replace(again, position=once_wrong), twice):
        assert not [*RepeatedReadings().of_terms([scenes[0].term(each)])]


def test_a_target_elsewhere_is_no_other_posture(scenes: tuple[Scene, Scene]) -> None:
    samples = seen(scenes[0]).take(np.repeat(np.arange(12), 3))
    assert samples.position is not None
    target = np.tile(["A", "B", "C"], 12)
    position = samples.position + 0.1 * (np.arange(36) % 3)[:, None]
    labelled = replace(samples, position=position, labels={"target": target})
    assert not [*RepeatedReadings().of_terms([scenes[0].term(labelled)])]


@pytest.mark.parametrize("kind", ["pairwise_distance", "landmark"])
def test_one_posture_touches_no_two_places(kind: str) -> None:
    scene, samples = touched(kind)
    assert not [*RepeatedReadings().of_terms([scene.term(samples)])]
    # A landmark of the first placement, and another of the second.
    other = int(np.flatnonzero(samples.labels["placement"] != samples.labels["placement"][0])[1])
    (said,) = RepeatedReadings().of_terms([scene.term(without_answer(samples, 0, other))])
    assert said.startswith(f"2 rows of {kind.replace('_', ' ')} ({samples.origin[0]} is the first)")
    # Read again at rest, it is one touch.
    rested = samples.take(np.repeat(np.arange(len(samples)), 2))
    assert not [*RepeatedReadings().of_terms([scene.term(rested)])]


def test_an_arm_that_never_moves_has_no_rows_to_compare(scenes: tuple[Scene, Scene]) -> None:
    term: Term = scenes[0].term(seen(scenes[0]).take(np.arange(1)))
    assert not [*RepeatedReadings().of_terms([term])]
