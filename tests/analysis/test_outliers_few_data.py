"""Little noise, or little more data than unknowns: no reason to name anything."""

from __future__ import annotations

import numpy as np
import pytest
from outlier_studies import moved, named
from simulated import (
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    perturbed,
    placements,
)

from suta_calib.analysis.outliers import Outliers, Thresholds, find_outliers
from suta_calib.analysis.outliers.search import not_searched
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise, PairwiseDistance

ARM = arm_named("suta")
PARAMETERS = dh_parameters(ARM)
TRUTH = perturbed(PARAMETERS, 4, 1e-3, 5e-3)
MM = 1e-3


def test_without_noise_nothing_is_named_but_what_is_displaced() -> None:
    scene = artefact_scene("pairwise_distance", ARM, TRUTH, artefact(8), placements(5))
    clean = find_outliers(Problem([scene.exact()], PARAMETERS))
    assert clean.assessment.level == "good"
    marks = moved(artefact(8), {"L2": np.array([2 * MM, 0, 0])})
    wrong = PairwiseDistance(scene.exact().poses, marks, Noise(None, 1 * MM))
    found = find_outliers(Problem([wrong], PARAMETERS))
    assert named(found) == ({"L2": 4}, ["L2"])


@pytest.mark.parametrize("places", [3, 4])
def test_hardly_more_data_than_unknowns_blame_nothing(places: int) -> None:
    scene = artefact_scene("pairwise_distance", ARM, TRUTH, artefact(4), placements(places))
    samples = scene.samples(Spread(position=0.2 * MM), seed=3)[0]
    whole = Problem([scene.term(samples)], ARM.select("geometric", "*.offset"))
    found = find_outliers(whole)
    assert found.assessment.level == "good"
    assert not any(g.flags for level in found.terms[0].levels for g in level.groups)


def test_what_fits_exactly_is_not_searched() -> None:
    scene = artefact_scene("pairwise_distance", ARM, TRUTH, artefact(8), placements(4))
    solution = solve(Problem([scene.exact()], PARAMETERS))
    assessment = Outliers(
        solution, [not_searched(scene.exact(), exact=True)], Thresholds(), ()
    ).assessment
    assert not assessment.usable
    assert "as many unknowns as data" in assessment.notes[0]
