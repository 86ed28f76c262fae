"""Poses found with another camera's file are seen for what they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Scene, dh_parameters
from terms_cases import SIGMA, noises, scene

from suta_calib import Problem, Solution, SolverOptions, solve
from suta_calib.trust.hypotheses.other_camera import OtherCamera
from suta_calib.trust.rereading import explaining_reading

ONCE = SolverOptions(starts=1)


def fitted(s: Scene, factor: float) -> Solution:
    samples = s.samples(SIGMA)[0]
    assert samples.position is not None
    samples = replace(samples, position=samples.position * [1.0, 1.0, factor])
    return solve(Problem([s.term(samples, *noises(SIGMA, False))], dh_parameters(s.arm)), ONCE)


@pytest.mark.parametrize("name", ["hand_eye", "tracked_point with orientation"])
@pytest.mark.parametrize(("factor", "said"), [(1.08, "too far"), (0.9, "too near")])
def test_the_factor_of_all_depths_is_found(name: str, factor: float, said: str) -> None:
    s = scene(name)
    solution = fitted(s, factor)
    ((sentence, (term,)),) = OtherCamera().readings(solution.problem)
    depth = s.samples(SIGMA)[0].position
    found = term.poses.samples.position
    assert depth is not None
    assert found is not None
    np.testing.assert_allclose(found, depth, rtol=1e-3, atol=1e-9)
    cause = explaining_reading(solution)
    assert cause is not None
    assert cause.description == sentence
    by, _, rest = sentence.removeprefix("what was seen is ").partition(" % ")
    assert float(by) == pytest.approx(100 * abs(factor - 1), abs=0.05)
    assert rest.startswith(said)


def test_right_depths_are_left_alone() -> None:
    solution = fitted(scene("hand_eye"), 1.0)
    assert not [*OtherCamera().readings(solution.problem)]
    assert not [*OtherCamera().readings(fitted(scene("tracked_point"), 1.0).problem)]
