"""What is held and why, on problems small enough to work out."""

from __future__ import annotations

import numpy as np
import pytest

from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.solver.identifiability import Identification, identify
from suta_calib.solver.information import Information


def parameters_named(*names: str, prior: float | None = None) -> ParameterSet:
    return ParameterSet(
        Parameter(owner, key, "rad" if key[0] in "ro" else "m", prior=prior, plausible=1.0)
        for owner, key in (name.split(".") for name in names)
    )


def verdict(
    parameters: ParameterSet, curvature: np.ndarray, noise_induced: np.ndarray | None = None
) -> Identification:
    n = len(parameters)
    nothing = np.zeros((n, n))
    information = Information(
        curvature, curvature, nothing if noise_induced is None else noise_induced
    )
    prior = parameters.array("prior")
    precision = np.where(np.isnan(prior), 0.0, 1 / np.where(np.isnan(prior), 1, prior) ** 2)
    return identify(parameters, n, information, precision)


def test_a_direction_is_weak_from_a_tenth_of_what_is_plausible() -> None:
    parameters = parameters_named("a.x", "b.x")
    fixed = [verdict(parameters, np.diag([1e4, 1 / std**2])).fixed for std in (0.09, 0.11)]
    assert [h.tolist() for h in fixed] == [[], [1]]


def test_a_direction_that_noise_excites_is_held() -> None:
    parameters = parameters_named("a.x", "b.x")
    known = np.diag([1e6, 1e6])
    real = verdict(parameters, known, noise_induced=np.diag([1.0, 0.009e6]))
    noise_induced = verdict(parameters, known, noise_induced=np.diag([1.0, 0.011e6]))
    assert real.fixed.tolist() == []
    assert noise_induced.fixed.tolist() == [1]
    assert noise_induced.combinations[0].direction == {"b.x": 1.0}


def test_turns_are_held_before_lengths_and_lengths_before_offsets() -> None:
    difference = 1e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    for names, fixed in (
        (("a.x", "b.rx"), "b.rx"),
        (("a.offset", "b.rz"), "b.rz"),
        (("a.offset", "b.z"), "b.z"),
        (("a.x", "b.x"), "a.x"),
    ):
        found = verdict(parameters_named(*names), difference)
        (combination,) = found.combinations
        assert combination.fixed == fixed
        assert combination.direction == pytest.approx(dict.fromkeys(names, 1.0), abs=1e-6)
        (other,) = set(names) - {fixed}
        assert found.given(other) == (fixed,)
        assert found.given(fixed) == ()


def test_a_prior_keeps_even_what_no_data_touch() -> None:
    assert len(verdict(parameters_named("a.x", "b.x", prior=0.1), np.zeros((2, 2))).fixed) == 0
