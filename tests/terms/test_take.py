"""What every kind promises of itself over other samples: some of them, or simulated ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import dh_parameters
from terms_cases import SIGMA, each_case, noises, problem_of, scene

from suta_calib.analysis.study.trial import resimulated
from suta_calib.errors import SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.solver.compiled_residual import TermErrors
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Term
from suta_calib.terms.block import Block


def residuals(term: Term, values: dict[str, float]) -> list[np.ndarray]:
    problem = Problem([term], dh_parameters(scene_arm(term)))
    x = np.array([values[name] for name in problem.names])
    lines = problem.linearise(x, problem.assumed_sigmas())
    # What the rows of a sample share is whitened by what the pictures at hand say of it.
    return [(line.residual if line.measured is None else line.measured).copy() for line in lines]


def scene_arm(term: Term) -> ArmModel:
    return term.poses.arm  # type: ignore[attr-defined]


def somewhere(problem: Problem) -> dict[str, float]:
    """Values near the start by name, the same for every term that shares them."""
    x = problem.start()
    return problem.values(x + 1e-3 * np.random.default_rng(0).standard_normal(len(x)))


@each_case
def test_some_samples_have_the_rows_that_look_only_at_them(name: str) -> None:
    problem = problem_of(name)
    (term,), values = problem.terms, somewhere(problem)
    mask = np.random.default_rng(1).random(len(term.poses)) < 0.6
    whole = residuals(term, values)
    for rows in (mask, np.flatnonzero(mask)):
        part = term.take(rows)
        assert (part.kind, len(part.poses)) == (term.kind, int(mask.sum()))
        taken = residuals(part, values)
        for block, all_rows, some in zip(term.blocks, whole, taken, strict=True):
            mine = mask[block.samples].all(axis=1)
            assert 0 < mine.sum() < len(mine)
            np.testing.assert_array_equal(some, all_rows[mine])


@each_case
def test_some_samples_are_the_term_that_is_made_of_them(name: str) -> None:
    """Whatever a kind carries over; its rows may then be in another order."""
    (term,) = problem_of(name).terms
    rows = np.flatnonzero(np.random.default_rng(1).random(len(term.poses)) < 0.6)
    taken, made = term.take(rows).take(np.arange(1, len(rows))), term.take(rows[1:])
    for part in (taken, made):
        anew = term.over_poses(term.poses.take(rows[1:]))
        assert (part.own_parameters, part.unknowns, part.notes) == (
            anew.own_parameters,
            anew.unknowns,
            anew.notes,
        )
        assert part.equations() == anew.equations()
        np.testing.assert_array_equal(part.clusters, anew.clusters)
        for ours, theirs in zip(part.blocks, anew.blocks, strict=True):
            mine, its = (np.lexsort(block.samples.T) for block in (ours, theirs))
            for field in ("samples", "own_columns", "data", "known_sigma"):
                np.testing.assert_array_equal(
                    getattr(ours, field)[mine], getattr(theirs, field)[its]
                )
            assert [ours.labels[k] for k in mine] == [theirs.labels[k] for k in its]
            np.testing.assert_array_equal(by_coordinate(ours)[mine], by_coordinate(theirs)[its])


def by_coordinate(block: Block) -> np.ndarray:
    """Derivatives of a block's rows (n, d, marks, 3), landmarks in the order of their names."""
    if block.certified is None:
        return np.zeros(len(block))
    keys, marks = block.certified.keys, block.certified.marks
    assert set(np.unique(marks)) == set(range(len(keys)))
    rank = np.argsort(np.argsort(np.array([str(key) for key in keys])))
    n, size, looked_at, _ = block.certified.derivative.shape
    wide = np.zeros((n, size, len(keys), 4))
    for k in range(looked_at):
        wide[np.arange(n), :, rank[marks[:, k]], :3] += block.certified.derivative[:, :, k]
        wide[np.arange(n), :, rank[marks[:, k]], 3] += block.certified.sigma[marks[:, k], None]
    return wide


@each_case
def test_errors_without_derivatives_are_those_of_the_problem(name: str) -> None:
    problem = problem_of(name)
    (term,) = problem.terms
    errors = TermErrors(term, problem.arm_parameters.names)
    for step in (0.0, 1e-3):
        x = problem.start() + step
        lines = problem.linearise(x, problem.assumed_sigmas())
        for line, found in zip(lines, errors(problem.values(x)), strict=True):
            np.testing.assert_allclose(found, line.error, rtol=1e-12, atol=1e-15)


@each_case
def test_errors_at_other_readings_are_those_of_samples_that_have_them(name: str) -> None:
    problem = problem_of(name)
    (term,), samples = problem.terms, problem.terms[0].poses.samples
    shifts = 1e-3 * np.sin(np.arange(samples.q.size)).reshape(samples.q.shape)
    values, errors = problem.values(problem.start()), TermErrors(term, ())
    there = term.over_poses(term.poses.with_samples(replace(samples, q=samples.q + shifts)))
    shifted = [found.copy() for found in errors(values, shifts)]
    for found, expected in zip(shifted, TermErrors(there, ())(values), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)
    for found, expected in zip(errors(values), TermErrors(term, ())(values), strict=True):
        np.testing.assert_array_equal(found, expected)


@each_case
def test_a_sample_taken_twice_counts_twice(name: str) -> None:
    problem = problem_of(name)
    (term,), values = problem.terms, somewhere(problem)
    twice = term.take(np.concatenate([np.arange(len(term.poses)), [0]]))
    assert len(twice.poses) == len(term.poses) + 1
    for once, more in zip(residuals(term, values), residuals(twice, values), strict=True):
        assert len(more) > len(once)
        np.testing.assert_allclose(np.abs(more).max(), np.abs(once).max(), rtol=1e-12)


@each_case
def test_all_samples_are_the_term_itself(name: str) -> None:
    problem = problem_of(name, robust=True)
    (term,) = problem.terms
    same = term.take(np.arange(len(term.poses)))
    assert same.own_parameters == term.own_parameters
    for ours, theirs in zip(same.blocks, term.blocks, strict=True):
        for field in ("samples", "own_columns", "data", "known_sigma"):
            np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
        assert (ours.labels, ours.noise, ours.residual) == (
            *(theirs.labels, theirs.noise, theirs.residual),
        )
    np.testing.assert_array_equal(same.repeats(), term.repeats())
    again = Problem([same], dh_parameters(scene(name).arm))
    one, other = solve(problem), solve(again)
    assert one.unidentified == other.unidentified
    np.testing.assert_allclose(other.x, one.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-9, atol=1e-18)


@each_case
def test_simulated_again_it_fits_what_was_taken_for_the_truth(name: str) -> None:
    s = scene(name)
    term = s.term(s.samples(SIGMA, 0)[0], *noises(SIGMA, False))
    problem = Problem([term], dh_parameters(s.arm))
    values = problem.values(problem.start(s.truth))
    (again,) = resimulated([term], values, [0.0] * len(term.blocks), np.random.default_rng(0))
    assert [len(b) for b in again.blocks] == [len(b) for b in term.blocks]
    for block, residual in zip(again.blocks, residuals(again, values), strict=True):
        # A hand with play is somewhere else anew, by 0.2 mm and 0.5 mrad.
        most = 1e-8 if block.sample_errors is None else 2e-3
        assert np.abs(residual).max() < most


def test_the_twice_taken_sample_of_pairs_makes_no_pair_with_itself() -> None:
    problem = problem_of("pairwise_distance")
    (term,) = problem.terms
    pairs = term.take([0, 0, 1]).blocks[0].samples
    assert len(pairs) == 2
    with pytest.raises(SamplesError, match="two different landmarks"):
        term.take([0, 0])
