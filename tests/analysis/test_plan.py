"""Planning on the simulated SUTA: what parallel pillars cannot see, what helps, when to stop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from simulated import arm_named, dh_parameters, hand_eye_scene, perturbed, tracked_scene

from benchmarks import bench_plan as bench
from suta_calib.analysis.planning import (
    Placement,
    Plan,
    PlanOptions,
    Pool,
    Posture,
    Region,
    Situation,
    plan,
)
from suta_calib.errors import JobError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.plan import plan_document
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve

SMALL = Pool(placements=90, points=12, poses=40)
# m: what the data lack at hand, three times their repeats, is in what is planned.
TARGET = 0.5e-3


@pytest.fixture(scope="module")
def thesis(repository: Path) -> Situation:
    """The thesis' layout: parallel pillars, every placement flat."""
    job = CalibrationJob.load(repository / "data" / "suta" / "calibration.yaml")
    problem = job.problem()
    return Situation.of(problem, solve(problem, SolverOptions(starts=1)))


@pytest.fixture(scope="module")
def found(thesis: Situation) -> Plan:
    """A small plan from there."""
    return plan(thesis, PlanOptions(count=4, target=TARGET, pool=SMALL))


def test_it_finds_by_itself_what_parallel_pillars_cannot_see(found: Plan) -> None:
    by_name = {r.parameter: r for r in found.remedies}
    assert set(by_name) == {"tip.y", "joint_1.offset", "joint_2.z"}
    length = by_name["tip.y"]
    assert length.by_all
    assert "tool's length along the tip's z axis" in length.why
    assert length.sorts == ("point from many directions",)
    points = {c.name for c in found.candidates if c.place.kind == "point"}
    assert set(length.candidates) == points


def test_nothing_touched_tells_where_the_base_is(found: Plan) -> None:
    never = plan_document(found).json()["no_candidate_can"]
    assert set(never) == {"joint_1.offset", "joint_2.z"}
    assert "cannot show where the arm stands" in never["joint_1.offset"]


def test_the_plan_identifies_what_can_be_and_beats_random_choices(found: Plan) -> None:
    assert "tip.y" in found.before.fixed
    assert "tip.y" not in found.after.fixed
    assert found.chosen[0].identifies == ("tip.y",)
    assert found.after.tip == pytest.approx(found.chosen[-1].tip, rel=1e-6)
    assert found.after.tip < np.median(found.random)
    assert found.after.tip <= found.random.min() * 1.0001


def test_figures_fall_and_the_first_below_the_target_is_named(found: Plan) -> None:
    tips = np.array(found.stop.tips)
    assert np.all(np.diff(tips) < 0)
    assert tips[0] == pytest.approx(found.before.tip, rel=1e-6)
    needed = found.stop.needed
    assert tips[needed] <= TARGET < tips[needed - 1]
    worth = found.stop.worthwhile
    assert tips[worth + 1] > 0.95 * tips[worth]


def test_the_present_data_are_far_from_the_best_of_their_size(found: Plan) -> None:
    assert found.best.count == 5
    assert found.best.tip < found.best.present / 1.5
    assert 0 < found.best.efficiency < 0.5
    assert 0 < found.best.d_efficiency < 0.5


def test_candidates_are_reached_as_the_place_says(found: Plan, thesis: Situation) -> None:
    names = {c.name for c in found.candidates}
    assert not names & {u.name for u in found.unreachable}
    for candidate in found.candidates:
        rotation, position = thesis.arm.forward(candidate.q, thesis.values)
        place = candidate.place
        if isinstance(place, Placement):
            marks = thesis.artefact.position_of(candidate.marks)
            wanted = marks @ place.rotation.T + place.position
        else:
            wanted = np.tile(place.position, (len(position), 1))
            assert np.all(rotation[:, :, 2] @ place.axis > np.cos(place.cone) - 1e-6)
        np.testing.assert_allclose(position, wanted, atol=1e-8)


def test_the_same_seed_gives_the_same_plan(thesis: Situation) -> None:
    options = PlanOptions(count=2, pool=Pool(placements=12, points=2), horizon=3, random=10)
    one, other = (plan_document(plan(thesis, options)).json() for _ in range(2))
    assert one == other


def test_d_optimality_lessens_the_ellipsoid_more(thesis: Situation, found: Plan) -> None:
    places = [c.place for c in found.candidates[::3]]
    by_d = plan(thesis, PlanOptions(count=3, criterion="d"), places)
    by_tip = plan(thesis, PlanOptions(count=3), places)
    bits = [sum(c.bits for c in each.chosen) for each in (by_d, by_tip)]
    assert bits[0] >= bits[1]
    assert by_tip.after.tip <= by_d.after.tip


def test_an_instrument_is_planned_with_postures() -> None:
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), 2)
    problem = Problem([tracked_scene(arm, truth, 12).exact()], dh_parameters(arm))
    situation = Situation(problem, problem.start(truth), (0.2e-3,), True)
    box = np.array([0.2, -0.3, 0.0]), np.array([0.7, 0.3, 0.4])
    found = plan(situation, PlanOptions(count=3, pool=SMALL), region=Region.box(*box, situation))
    assert all(isinstance(c.candidate.place, Posture) for c in found.chosen)
    assert found.after.tip < found.before.tip
    assert not [r for r in found.remedies if r.parameter not in found.before.fixed]


def test_what_the_job_cannot_measure_is_no_candidate(thesis: Situation) -> None:
    with pytest.raises(JobError, match=r"pose 'A1'.*tracked_point"):
        plan(thesis, PlanOptions(), [Posture("A1", np.zeros(6))])
    far = Placement("far", np.array([5.0, 0, 0]), np.eye(3))
    with pytest.raises(
        JobError, match=r"the arm reaches none of them; far: landmark .+ out of reach"
    ):
        plan(thesis, PlanOptions(), [far])


@pytest.mark.parametrize(
    ("pool", "trials", "sets"),
    [(Pool(placements=60, points=8), 4, 20), pytest.param(Pool(), 5, 200, marks=pytest.mark.slow)],
)
def test_the_planned_set_is_better_than_the_grid_and_random_sets(
    pool: Pool, trials: int, sets: int
) -> None:
    made = bench.scene(trials, pool)
    grid, planned = list(range(made.grid)), made.planned(made.pool)
    random = bench.random_sets(made.design(made.pool), len(grid), sets, 1)
    others = [[made.pool[k] for k in rows] for rows in random]
    assert made.predicted(grid) > 1.5 * made.predicted(planned)
    assert np.median([made.predicted(rows) for rows in others]) > made.predicted(planned)
    simulated = bench.rms(made.simulated(planned))
    assert bench.rms(made.simulated(grid)) > 1.5 * simulated
    assert simulated == pytest.approx(made.predicted(planned), rel=0.35)
    if sets >= 200:
        assert np.median([bench.rms(made.simulated(rows)) for rows in others]) > simulated


def test_a_camera_that_cannot_tell_the_tip_is_said_to_be_no_help() -> None:
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), 2)
    problem = Problem([hand_eye_scene(arm, truth, 15).exact()], dh_parameters(arm))
    sigmas = tuple(0.2e-3 if block.unit == "m" else 1e-3 for block in problem.blocks)
    situation = Situation(problem, problem.start(truth), sigmas, True)
    found = plan(situation, PlanOptions(count=2, criterion="d", pool=SMALL))
    assert sum(choice.bits for choice in found.chosen) > 0
    never = plan_document(found).json()["no_candidate_can"]
    assert {"tip.y", "tip.z"} & set(never)
    assert any(
        "No candidate reduces the uncertainty of the tip" in note for note in found.assessment.notes
    )


def test_a_plan_draws_what_it_says(found: Plan) -> None:
    figure = found.plot(Figure())
    above, side = figure.axes[:2]
    arm = next(line for line in above.lines if line.get_label() == "arm")
    q = found.chosen[0].candidate.q[0]
    tip = found.situation.arm.forward(q)[1]
    np.testing.assert_allclose(np.array(arm.get_data())[:, -1], 1e3 * tip[:2], atol=1e-6)
    written = {text.get_text() for text in side.texts}
    assert {choice.candidate.name for choice in found.chosen} <= written
    axes = Figure().subplots()
    assert found.plot_gain(axes) is axes
    best = next(line for line in axes.lines if line.get_label() == "best choice")
    np.testing.assert_allclose(best.get_ydata(), 1e3 * np.array(found.stop.tips))
    assert found.assessment.sentence in repr(found)
    assert all(choice.candidate.name in found._repr_html_() for choice in found.chosen)
