"""Which samples belong together, and terms over some of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from simulated import (
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    dh_parameters,
    fixed_point_scene,
    hand_eye_scene,
    perturbed,
    placements,
    tracked_scene,
)

from suta_calib.analysis.study.trial import resimulated, sets_of
from suta_calib.errors import SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.terms import Term

SEATING = Spread(position=1e-4, rotation=1e-3)
LEVEL = 2e-4


@cache
def truth() -> tuple[ArmModel, dict[str, float]]:
    arm = arm_named("suta")
    return arm, perturbed(dh_parameters(arm), 1)


@cache
def scene(kind: str) -> Scene:
    arm, values = truth()
    if kind in ("pairwise_distance", "landmark", "landmark with seats"):
        seats = kind == "landmark with seats"
        marks = artefact(5, oriented=seats)
        name = kind.removesuffix(" with seats")
        return artefact_scene(name, arm, values, marks, placements(3), 2)
    if kind == "fixed_point":
        return fixed_point_scene(arm, values, 8)
    if kind == "hand_eye":
        return hand_eye_scene(arm, values)
    return tracked_scene(arm, values, oriented=kind == "tracked_point with orientations")


def term(kind: str, seed: int = 0) -> Term:
    return scene(kind).term(scene(kind).samples(SEATING, seed)[0])


def test_a_set_is_one_placement_and_repeat() -> None:
    found = sets_of([term("pairwise_distance"), term("fixed_point")])
    assert found.unit == "set"
    assert found.names == ("P0/0", "P0/1", "P1/0", "P1/1", "P2/0", "P2/1")
    assert found.kept_whole == (1,)


def test_the_same_label_in_two_terms_is_one_set() -> None:
    both = [term("pairwise_distance"), term("landmark")]
    found = sets_of(both)
    assert len(found) == 6
    assert found.kept_whole == ()
    assert [len(t.poses) for t in found.take(both, [0, 3])] == [10, 10]


@pytest.mark.parametrize(
    ("kind", "count"), [("fixed_point", 16), ("tracked_point", 30), ("hand_eye", 25)]
)
def test_without_placements_samples_are_drawn(kind: str, count: int) -> None:
    found = sets_of([term(kind)])
    assert (found.unit, len(found)) == ("sample", count)


def test_four_points_are_worth_choosing_from() -> None:
    arm, values = truth()
    points = [(0.45, 0.1, 0.05), (-0.2, 0.4, 0.2), (0.4, -0.2, 0.1), (0.1, 0.45, 0.1)]
    many = fixed_point_scene(arm, values, 4, points)
    found = sets_of([many.term(many.samples(SEATING)[0])])
    assert (found.unit, len(found)) == ("point", 4)


def test_a_unit_may_be_asked_for() -> None:
    distances = [term("pairwise_distance")]
    assert sets_of(distances, "placement").names == ("P0", "P1", "P2")
    assert len(sets_of(distances, "sample")) == 30
    with pytest.raises(SamplesError, match="no samples with labels point"):
        sets_of(distances, "point")


def test_one_set_cannot_be_chosen_from() -> None:
    one = term("pairwise_distance").take(np.arange(5))
    with pytest.raises(SamplesError, match=r"only one set \(P0/0\).*at least 2"):
        sets_of([one])


def test_sets_are_taken_whole_and_the_rest_is_what_is_left() -> None:
    terms = [term("pairwise_distance"), term("fixed_point")]
    found = sets_of(terms)
    drawn, whole = found.take(terms, [0, 5])
    assert whole is terms[1]
    labels = drawn.poses.samples.labels
    assert set(zip(labels["placement"], labels["repeat"], strict=True)) == {
        ("P0", "0"),
        ("P2", "1"),
    }
    (rest,) = found.rest(terms, [0, 5])
    assert len(rest.poses) == 20
    assert not set(rest.poses.samples.origin) & set(drawn.poses.samples.origin)


def test_copies_of_a_set_do_not_pair_and_the_order_of_drawing_does_not_matter() -> None:
    terms = [term("pairwise_distance")]
    found = sets_of(terms)
    (once,), (thrice,) = (found.take(terms, drawn) for drawn in ([2], [2, 2, 2]))
    assert len(thrice.poses) == 3 * len(once.poses)
    assert len(thrice.blocks[0]) == 3 * len(once.blocks[0])
    # Clusters of one posture stay one cluster.
    assert len(np.unique(thrice.repeats())) == len(np.unique(once.repeats()))
    one, other = (found.take(terms, order)[0].poses.samples for order in ([4, 1], [1, 4]))
    np.testing.assert_array_equal(one.q, other.q)


@pytest.mark.parametrize("unit", ["set", "placement"])
def test_a_copy_counts_as_a_weight_of_two(unit: str) -> None:
    terms = [term("landmark")]
    found = sets_of(terms, unit)
    everything = list(range(len(found)))
    once, twice = (
        Problem(found.take(terms, k), ParameterSet()) for k in (everything, everything * 2)
    )
    x, sigmas = once.start(), once.assumed_sigmas()
    assert twice.names == once.names
    assert twice.evaluation.cost(x, sigmas) == pytest.approx(2 * once.evaluation.cost(x, sigmas))


AGAIN = (
    *("pairwise_distance", "landmark", "landmark with seats", "fixed_point"),
    *("tracked_point", "tracked_point with orientations", "hand_eye"),
)


def simulated_residuals(kind: str, level: float) -> tuple[Problem, list[np.ndarray]]:
    """Residuals at the values that were taken for the truth."""
    original = term(kind)
    arm, values = truth()
    problem = Problem([original], dh_parameters(arm))
    at = problem.values(problem.start(values))
    noise = [level] * len(original.blocks)
    again = resimulated([original], at, noise, np.random.default_rng(4))
    repeated = Problem(again, dh_parameters(arm))
    x = np.array([at[name] for name in repeated.names])
    lines = repeated.linearise(x, repeated.assumed_sigmas())
    return repeated, [line.residual.copy() for line in lines]


@pytest.mark.parametrize("kind", AGAIN)
def test_a_simulation_without_noise_fits_exactly(kind: str) -> None:
    problem, residuals = simulated_residuals(kind, 0.0)
    original = Problem([term(kind)], ParameterSet())
    assert [len(b) for b in problem.blocks] == [len(b) for b in original.blocks]
    for residual in residuals:
        assert np.abs(residual).max() < 1e-8


@pytest.mark.parametrize("kind", AGAIN)
def test_simulated_residuals_scatter_as_asked(kind: str) -> None:
    """Turns of what a hand-eye camera sees move nothing, so each block has its own noise alone."""
    _, residuals = simulated_residuals(kind, LEVEL)
    for residual in residuals:
        assert np.sqrt(np.mean(residual**2)) == pytest.approx(LEVEL, rel=0.25)


def test_a_simulation_stays_near_the_measured_postures() -> None:
    original = term("pairwise_distance")
    _, values = truth()
    again = resimulated([original], values, [1e-4], np.random.default_rng(0))
    turned = np.abs(again[0].poses.samples.q - original.poses.samples.q).max()
    assert 0 < turned < np.radians(0.5)


def test_a_kind_that_cannot_be_simulated_is_named() -> None:
    class Other(type(term("tracked_point"))):
        kind = "other"
        observed = Term.observed

    samples = term("tracked_point").poses
    with pytest.raises(SamplesError, match="kind other"):
        resimulated([Other(samples)], {}, [1e-4], np.random.default_rng(0))
