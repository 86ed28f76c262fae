"""Honest data of every kind, and what a new job frees: nothing is said but what is true."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from simulated import arm_named, perturbed, tracked_scene

from suta_calib import ArmModel, Noise, Problem, Selection, SolverOptions, Term, solve
from suta_calib.assessment import Assessment
from suta_calib.diagnostics.assessment import assess_calibration
from suta_calib.diagnostics.rich_data import RichData, Sort
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.parameters import ParameterSet
from suta_calib.registry import shipped
from suta_calib.terms import KINDS
from suta_calib.trust.calibration_examination import CalibrationExamination

SORTS = [
    (kind, oriented)
    for kind, of in shipped(KINDS).items()
    for oriented in (False, True)
    if (of.has_angles or not oriented) and (oriented or of.columns.orientation != "required")
]


def as_init_frees(arm: ArmModel) -> ParameterSet:
    offsets = Selection(("*.offset",), bound_rad=math.radians(15))
    return arm.select(offsets, Selection(("geometric",), bound_m=0.03, bound_rad=math.radians(5)))


def with_priors(arm: ArmModel) -> ParameterSet:
    offsets = Selection(("*.offset",), prior_rad=0.013)
    return arm.select(offsets, Selection(("geometric",), prior_m=1e-3, prior_rad=0.003))


def measured(arm: ArmModel, unknown: ParameterSet, sort: Sort, seed: int) -> tuple[Term, Term]:
    """Rich data of an arm that is a little off, with noise: to fit, and to hold out."""
    random = np.random.default_rng(seed)
    truth = perturbed(unknown, seed, 1e-3, 3e-3)
    problem = Problem([tracked_scene(arm, truth).exact()], unknown)
    exact, _ = RichData(problem, problem.start(truth)).observations(sort, "data")
    samples = exact.poses.samples
    if samples.position is None:
        shaken = replace(samples, q=samples.q + 2e-4 * random.standard_normal(samples.q.shape))
    else:
        noise = 1e-4 * random.standard_normal(samples.position.shape)
        shaken = replace(samples, position=samples.position + noise)
        if samples.rotation is not None:
            turn = rotation_from_vector(1e-3 * random.standard_normal((len(samples), 3)))
            shaken = replace(shaken, rotation=samples.rotation @ turn)
    term: Any = exact.over_poses(exact.poses.with_samples(shaken))
    held_out = np.arange(len(samples)) % 3 == 0
    if term.place in samples.labels:
        places = samples.labels[term.place]
        held_out = np.isin(places, np.unique(places)[:2])
    huber = Noise(None, 1.35e-3)
    return replace(term.take(~held_out), noise=huber), term.take(held_out)


def judged(
    arm: ArmModel, unknown: ParameterSet, kind: str, oriented: bool, seed: int
) -> Assessment:
    term, held_out = measured(arm, unknown, Sort(KINDS[kind], oriented), seed)
    solution = solve(Problem([term], unknown), SolverOptions())
    return assess_calibration(CalibrationExamination.of(solution, [held_out]))


def knows_lengths(kind: str) -> bool:
    """Whether something that a kind uses has a scale, which is then named once."""
    return kind not in ("fixed_point", "line", "plane")


def is_good(found: Assessment, kind: str) -> bool:
    """Good, and nothing said but what is true of what knows all lengths, and of a camera's tip."""
    others = [note for note in found.notes if "carries the scale" not in note]
    if len(found.notes) - len(others) != knows_lengths(kind):
        return False
    if kind not in ("hand_eye", "camera_view"):
        return (found.level, others) == ("good", [])
    (note,) = others
    return found.level == "good" and "The tip is as good as its drawing" in note


@pytest.mark.parametrize(("kind", "oriented"), SORTS)
def test_what_init_frees_is_good(kind: str, oriented: bool) -> None:
    arm = arm_named("suta")
    found = judged(arm, as_init_frees(arm), kind, oriented, seed=1)
    if kind in ("fixed_point", "line", "plane"):
        # None of them knows a length, so that one length of the arm stays open: its scale.
        (note,) = found.notes
        assert "do not tell joint_3.y" in note
        assert "tracked_point" in note
    else:
        assert is_good(found, kind)


@pytest.mark.parametrize(("kind", "oriented"), SORTS)
def test_what_priors_hold_is_good(kind: str, oriented: bool) -> None:
    arm = arm_named("suta")
    found = judged(arm, with_priors(arm), kind, oriented, seed=2)
    assert found.level == "good"
    named = ["carries the scale" in note for note in found.notes]
    assert named == [True] * knows_lengths(kind)


@pytest.mark.parametrize(
    ("kind", "oriented"), [("tracked_point", False), ("landmark", True), ("hand_eye", True)]
)
def test_another_arm_is_good_too(kind: str, oriented: bool) -> None:
    arm = arm_named("ur5")
    assert is_good(judged(arm, as_init_frees(arm), kind, oriented, seed=2), kind)
