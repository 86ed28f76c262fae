"""Sound jobs of every kind of observation of one arm, simulated anew with every seed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from simulated import perturbed, tracked_scene

from suta_calib import ArmModel, Noise, Problem, Selection, SolverOptions, Term, solve
from suta_calib.assessment import Assessment
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.model.parameters import ParameterSet
from suta_calib.registry import shipped
from suta_calib.terms import KINDS
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.rich_data import RichData, Sort

SORTS = [
    (kind, oriented)
    for kind, of in shipped(KINDS).items()
    for oriented in (False, True)
    if not of.between_chains
    and (of.has_angles or not oriented)
    and (oriented or of.columns.orientation != "required")
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
