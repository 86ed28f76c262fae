"""The four metrics against their definitions, and what hides or feigns an outlier."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure
from outlier_studies import Kind, Study, displaced_landmark, moved, named, suta_job, suta_study
from scipy.stats import binom
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

from suta_calib.analysis.outliers import METRICS, Level, Outliers, Thresholds, find_outliers
from suta_calib.analysis.outliers.chance import Simulator
from suta_calib.analysis.outliers.metrics import JudgedFit as Metrics
from suta_calib.analysis.outliers.metrics import measures, shares
from suta_calib.analysis.outliers.reference import ReferenceFit, Registered, groupings
from suta_calib.analysis.outliers.search import not_searched
from suta_calib.analysis.outliers.touches import RobustLinearFit, Touches, find_moves, linearised
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Artefact, Samples
from suta_calib.model.parameters import ParameterSet
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Noise, PairwiseDistance, Term

ARM = arm_named("suta")
PARAMETERS = dh_parameters(ARM)
TRUTH = perturbed(PARAMETERS, 4, 1e-3, 5e-3)
MM = 1e-3


@pytest.fixture(scope="module")
def study() -> Study:
    return suta_study(1, {"S2": np.array([2 * MM, 0.0, 0.0])})


@pytest.fixture(scope="module")
def registered(study: Study) -> Registered:
    return Registered.of(study.calibration, np.ones(len(study.calibration.poses), dtype=bool))


@pytest.fixture(scope="module")
def found(study: Study) -> Outliers:
    return study.outliers()


@pytest.fixture(scope="module")
def calibrated(study: Study) -> Metrics:
    return own_fit(study.calibration, suta_job().parameters)


def own_fit(term: Term, parameters: ParameterSet = PARAMETERS) -> Metrics:
    """The job's own fit, nothing set aside."""
    solution = solve(Problem([term], parameters))
    nothing = np.zeros(len(term.poses), dtype=bool)
    return Metrics(ReferenceFit.of(solution, parameters, 0), ~nothing, nothing)


def level(found: Outliers, name: str) -> Level:
    return found.terms[0].level(name)


def test_samples_are_partitioned_by_landmark_placement_and_set(study: Study) -> None:
    sizes = {g.name: np.bincount(g.member).tolist() for g in groupings(study.calibration)}
    assert sizes == {"landmarks": [15] * 15, "placements": [45] * 5, "sets": [15] * 15}


def test_contributions_share_every_squared_error_by_its_two_landmarks(
    study: Study, calibrated: Metrics
) -> None:
    landmarks = groupings(study.calibration)[0]
    error = calibrated.full_refit.residual[:, 0]
    expected = dict.fromkeys(landmarks.labels, 0.0)
    for label, e in zip(study.calibration.blocks[0].labels, error, strict=True):
        for name in label.split("-"):
            expected[name] += e**2 / 2 / np.sum(error**2)
    got = measures(calibrated, landmarks, chosen=[])[METRICS.index("contribution")]
    np.testing.assert_allclose(got, list(expected.values()), rtol=1e-9)
    assert got.sum() == pytest.approx(1.0)


def test_every_metric_has_a_value_and_a_probability(found: Outliers) -> None:
    for one in found.terms[0].levels:
        assert sum(g.values["contribution"] for g in one.groups) == pytest.approx(1.0)
        assert sum(g.as_calibrated["contribution"] for g in one.groups) == pytest.approx(1.0)
        for g in one.groups:
            assert all(np.isfinite(g.values[m]) and 0 < g.p[m] <= 1 for m in METRICS)


def test_a_displaced_landmark_answers_for_its_distances_alone() -> None:
    pairs = np.array([[0, 1], [1, 2], [0, 2]])
    displaced = np.array([True, False, True])
    expected = [[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]]
    np.testing.assert_allclose(shares(pairs, displaced), expected)


def test_leaving_out_is_the_solve_without_the_samples(study: Study, calibrated: Metrics) -> None:
    kept = study.calibration.poses.samples.labels["landmark"] != "S2"
    quick = calibrated.reference.over(kept)
    exact = solve(Problem([study.calibration.take(kept)], suta_job().parameters))
    for name in calibrated.moved:
        assert abs(quick.values[name] - exact.values[name]) < 1e-3 * exact.estimates[name].std


def test_leave_one_out_is_the_relative_fall_of_the_rms(study: Study, calibrated: Metrics) -> None:
    landmarks = groupings(study.calibration)[0]
    k = landmarks.labels.index("S2")
    whole, without = calibrated.full_refit, calibrated.reference.over(~landmarks.rows(k))
    rms = [np.sqrt(np.mean(fit.residual**2)) for fit in (whole, without)]
    got = measures(calibrated, landmarks, [k])[METRICS.index("leave_one_out"), k]
    assert got == pytest.approx(1 - rms[1] / rms[0])


def test_simulated_metrics_are_those_of_exact_refits() -> None:
    """What noise makes of each metric, to first order and by exact refits of simulated data."""
    scene, sigma = touched("landmark"), 0.2 * MM
    exact = []
    for samples in scene.samples(Spread(position=sigma), seed=3, trials=12):
        metrics = own_fit(scene.term(samples))
        exact.append(measures(metrics, groupings(metrics.reference.term)[0]))
    n = len(metrics.believed)
    noise = Touches(np.zeros((n, 3)), sigma, 0.0, np.zeros(n, dtype=bool))
    landmarks = groupings(metrics.reference.term)[0]
    simulated = Simulator(metrics, noise, 0).metrics(landmarks).mean(axis=(1, 2))
    ratio = np.mean(exact, axis=(0, 2)) / simulated
    contribution, cook, _, bias = ratio
    assert contribution == pytest.approx(1.0)
    assert 0.7 < cook < 1.4
    assert 0.85 < bias < 1.15
    assert np.mean(exact, axis=(0, 2))[2] == pytest.approx(simulated[2], abs=0.01)


def test_registration_takes_out_every_rigid_motion(registered: Registered) -> None:
    turned = np.cross([0.01, -0.02, 0.03], registered.certified)
    motion = turned + np.array([0.1, 0.2, 0.3])
    assert np.abs(registered.registered(motion[None])).max() < 1e-12
    # Small displacements register as the arm's own touches do.
    exact = registered.residuals(TRUTH)
    np.testing.assert_allclose(registered.registered(exact[None])[0], exact, atol=1e-5)


def test_all_four_metrics_name_the_landmark_and_say_where_it_is(found: Outliers) -> None:
    assert named(found) == ({"S2": 4}, ["S2"])
    (s2,) = level(found, "landmarks").outliers
    error = s2.displacement.vector - [-2 * MM, 0.0, 0.0]
    assert np.all(np.abs(error) < 4 * s2.displacement.std)
    assert not level(found, "placements").outliers
    assert not level(found, "sets").outliers
    assert "S2" in found.assessment.sentence


def test_gross_touches_are_named_singly_and_blame_no_landmark() -> None:
    study = suta_study(3, {})
    one = study.outliers("landmarks")
    assert len(one.terms[0].touches) == study.gross == 5
    assert named(one)[1] == []
    # One of them weighs so much in the job's own fit that three raw metrics exceed there.
    raw = [g.as_calibrated["contribution"] for g in level(one, "landmarks").groups]
    assert max(raw) > 1.5 / 15


def test_excluding_it_helps_on_data_that_were_not_fitted(found: Outliers) -> None:
    term = found.terms[0]
    assert term.method == "validation"
    effect = term.held_out["landmarks"]["S2"]
    assert effect.count == 15 * 14 * 13 // 2
    assert effect.after != effect.before


def test_scatter_that_is_no_noise_singles_out_nothing_and_is_no_answer(found: Outliers) -> None:
    """As a joint that counts the other way leaves it."""
    strange = replace(found, terms=[replace(found.terms[0], sigma=0.05)]).assessment
    assert found.assessment.usable
    assert not strange.usable
    assert "scatter by 50 mm per axis for any geometry of the arm" in strange.notes[0]


def test_without_validation_placements_are_held_out(study: Study) -> None:
    problem = Problem([study.calibration], suta_job().parameters)
    term = find_outliers(problem, sorts={"landmarks"}).terms[0]
    assert term.method == "leave one of the placements out"
    assert set(term.held_out["landmarks"]) == {"S2"}


def test_a_large_displacement_hides_no_small_one() -> None:
    shifts = {"S2": np.array([0.0, 2 * MM, 0.0]), "L1": np.array([12 * MM, 0.0, 0.0])}
    _, outliers = named(suta_study(2, shifts).outliers("landmarks"))
    assert set(outliers) == {"S2", "L1"}


def test_the_same_numbers_every_time(study: Study, found: Outliers) -> None:
    """Whatever else is looked at beside landmarks."""
    one, other = (level(each, "landmarks") for each in (found, study.outliers("landmarks")))
    for g, h in zip(one.groups, other.groups, strict=True):
        assert [*g.values.values(), *g.p.values()] == [*h.values.values(), *h.p.values()]


def touched(kind: str) -> Scene:
    certified = artefact(8)
    return artefact_scene(kind, ARM, TRUTH, certified, placements(4), repeats=2, tilt=0.2)


def test_a_landmark_term_is_searched_like_distances() -> None:
    scene = touched("landmark")
    samples = scene.samples(Spread(position=0.1 * MM), seed=1)[0]
    marks = dict(artefact(8).landmarks)
    shift = np.array([0.0, 2 * MM, 0.0])
    marks["L3"] = replace(marks["L3"], position=marks["L3"].position + shift)
    wrong = replace(scene, artefact=Artefact("wrong", marks))
    one = find_outliers(Problem([wrong.term(samples, Noise(None, 1 * MM))], PARAMETERS))
    assert [g.label for g in level(one, "landmarks").outliers] == ["L3"]


def displaced_row(term: Term, samples: Samples, row: int, scene: Scene) -> Term:
    """One row whose reading, or whose measured position, is wrong by 8 mm."""
    if samples.position is not None:
        position = samples.position.copy()
        position[row, 1] += 8 * MM
        return scene.term(replace(samples, position=position), Noise(None, 1 * MM))
    q = samples.q.copy()
    q[row] += 8 * MM
    return scene.term(replace(samples, q=q), Noise(None, 1 * MM))


@pytest.mark.parametrize("kind", ["fixed_point", "tracked_point", "hand_eye"])
def test_one_wrong_row_is_named_where_rows_are_judged(kind: str) -> None:
    make = {
        "fixed_point": partial(fixed_point_scene, directions=10),
        "tracked_point": partial(tracked_scene, n=20),
        # So few that some are held out one by one, which no pose of the camera follows from.
        "hand_eye": partial(hand_eye_scene, n=15),
    }[kind]
    scene = make(ARM, TRUTH)
    samples = scene.samples(Spread(position=0.1 * MM, rotation=1e-4), seed=2)[0]
    term = displaced_row(scene.term(samples), samples, 7, scene)
    one = find_outliers(Problem([term], PARAMETERS))
    assert [g.label for g in level(one, "rows").outliers] == ["row 7"]
    clean = find_outliers(Problem([scene.term(samples, Noise(None, 1 * MM))], PARAMETERS))
    assert not level(clean, "rows").outliers


def test_too_few_groups_are_refused() -> None:
    scene = artefact_scene("pairwise_distance", ARM, TRUTH, artefact(8), placements(2))
    few = np.isin(scene.labels["landmark"], ["L1", "L2"])
    term = scene.exact().take(few)
    with pytest.raises(SamplesError, match="fewer than three"):
        find_outliers(Problem([term], ParameterSet()))


def test_turning_the_artefact_s_frame_changes_nothing(study: Study, found: Outliers) -> None:
    turn = rotation_from_vector([0.4, -0.2, 1.1])
    known = study.calibration.artefact
    marks = {n: replace(m, position=turn @ m.position) for n, m in known.landmarks.items()}
    samples = study.calibration.poses.samples
    turned = type(study.calibration)(
        ArmPoses(suta_job().arm, samples), replace(known, landmarks=marks), study.calibration.noise
    )
    problem = Problem([turned], suta_job().parameters)
    one = find_outliers(problem, [study.validation], sorts={"landmarks"})
    for g, h in zip(level(found, "landmarks").groups, level(one, "landmarks").groups, strict=True):
        assert g.values["bias"] == pytest.approx(h.values["bias"], abs=1e-6)
        assert g.flags == h.flags


# ── Moved half-way ───────────────────────────────────────────────────────────────────────────
def moved_after(samples: Samples, row: int, by: float) -> Samples:
    """An instrument that was pushed aside before some row."""
    later = np.arange(len(samples))[:, None] >= row
    return replace(samples, position=samples.position + later * [by, 0.0, 0.0])


@pytest.mark.parametrize("row", [20, pytest.param(33, marks=pytest.mark.slow)])
def test_an_instrument_that_was_moved_between_its_rows_is_named_with_the_row(row: int) -> None:
    scene = tracked_scene(ARM, TRUTH, 40)
    samples = scene.samples(Spread(position=0.1 * MM), seed=2)[0]
    term = scene.term(moved_after(samples, row, 50 * MM))
    found = find_outliers(Problem([term], PARAMETERS))
    (move,) = found.terms[0].moves
    assert (move.what, move.origin) == ("the instrument", samples.origin[row])
    assert move.distance == pytest.approx(50 * MM, rel=0.02)
    assert move.p < 1e-6
    assert found.assessment.level == "care"
    assert "moved during the measurement: the instrument" in found.assessment.sentence


def test_an_artefact_that_was_pushed_aside_between_its_rows_is_named() -> None:
    scene = touched("landmark")
    samples = scene.samples(Spread(position=0.1 * MM), seed=1)[0]
    rows = np.flatnonzero(samples.labels["placement"] == samples.labels["placement"][-1])
    # What the arm reads is as if the rows had been touched where the artefact stood before.
    later = rows[len(rows) // 2 :]
    q = samples.q.copy()
    q[later, 0] += 0.01
    found = find_outliers(
        Problem([scene.term(replace(samples, q=q))], PARAMETERS), sorts={"landmarks"}
    )
    (move,) = found.terms[0].moves
    assert move.what == f"placement {samples.labels['placement'][-1]}"
    assert move.origin == samples.origin[later[0]]


def test_what_was_not_moved_seldom_looks_so() -> None:
    """Of noise alone, with the threshold of size out of the way; Bonferroni errs to the safe."""
    scene = tracked_scene(ARM, TRUTH, 40)
    reference = own_fit(scene.exact()).reference
    term, names, fit = linearised(reference, PARAMETERS)
    random, alarms, trials = np.random.default_rng(5), 0, 60
    for _ in range(trials):
        noise = 0.1 * MM * random.standard_normal(fit.residual.shape)
        drawn = RobustLinearFit(fit.jacobian, noise, fit.precision, fit.deviation)
        alarms += len(find_moves(term, names, drawn, Thresholds(bias=0.0, significance=0.05)))
    assert alarms <= binom.ppf(0.999, trials, 0.05)


def test_outliers_draw_a_panel_for_each_metric(found: Outliers) -> None:
    figure = found.plot(figure=Figure())
    panels = [axes for axes in figure.axes if axes.get_title(loc="left") or axes.get_title()]
    landmarks = found.terms[0].level("landmarks")
    named_panels = [axes for axes in panels if len(axes.texts) >= len(landmarks.groups)]
    assert len(named_panels) == len(METRICS)
    for axes in named_panels:
        said = [text.get_text().split()[0] for text in axes.texts]
        assert sorted(said) == sorted(group.label for group in landmarks.groups)
    assert "S2" in repr(found)
    assert "exclude: {landmarks: [S2]}" in found._repr_html_()


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


KINDS: tuple[Kind, ...] = ("touches", "certificate")


def right(seed: int, kind: Kind) -> bool:
    """All four metrics name the displaced landmark, and none names another."""
    name, shift = displaced_landmark(seed)
    flags, outliers = named(suta_study(seed, {name: shift}, kind).outliers("landmarks"))
    return flags == {name: 4} and outliers == [name]


def silent(seed: int) -> bool:
    """Nothing is displaced, and no landmark is called an outlier."""
    return not named(suta_study(seed, {}).outliers("landmarks"))[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_in_95_of_100_seeds_the_displaced_landmark_and_no_other(kind: Kind) -> None:
    assert sum(right(seed, kind) for seed in range(100)) >= 95


@pytest.mark.slow
def test_in_95_of_100_seeds_nothing_where_nothing_is_displaced() -> None:
    assert sum(silent(seed) for seed in range(100)) >= 95
