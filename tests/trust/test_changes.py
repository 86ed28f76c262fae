"""What changed while it was measured: found, with its size, and not seen in sound data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judging import notes_on
from simulated import (
    Scene,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    fixed_point_scene,
    hand_eye_scene,
    perturbed,
    placements,
    plane_scene,
    tracked_scene,
)
from studies import first_of
from suta_simulated import everything, scene

from suta_calib import (
    CalibrationJob,
    Noise,
    ParameterSet,
    Problem,
    Samples,
    Selection,
    SolverOptions,
    solve,
)
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.solver.solution import Solution
from suta_calib.terms import DepthPoints
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.changes import suspects, waves
from suta_calib.trust.hypotheses.encoder_slip import EncoderSlip
from suta_calib.trust.hypotheses.tip_moved import TipMoved
from suta_calib.trust.in_time import ChangeInTime
from suta_calib.trust.neighbour_correlation import chance_beside_shared_errors
from suta_calib.trust.reduced_fit import everything_follows

NOISE = Spread(position=1e-4, rotation=1e-3)
ARM = arm_named("suta")
UNKNOWN: ParameterSet = ARM.select(Selection(("*.offset",), bound_rad=0.26))
TRUTH = perturbed(UNKNOWN, 3, angle=5e-3)


def solved(scene: Scene, change: Callable[[Samples], Samples], seed: int = 0) -> Solution:
    """The fit of a scene's samples, changed."""
    samples = change(scene.samples(NOISE, seed)[0])
    term = scene.term(samples, Noise(None, 1e-3), Noise(None, 0.01))
    return solve(Problem([term], UNKNOWN), SolverOptions(starts=1))


def changes_of(solution: Solution) -> tuple[ChangeInTime, ...]:
    return CalibrationExamination.of(solution).changes


def unchanged(samples: Samples) -> Samples:
    return samples


def found(
    scene: Scene, change: Callable[[Samples], Samples] = unchanged, seed: int = 0
) -> tuple[ChangeInTime, ...]:
    return changes_of(solved(scene, change, seed))


def read(joint: int, change: Callable[[Any], Any]) -> Callable[[Samples], Samples]:
    """The readings of a joint, which ``change`` makes of an array."""

    def changed(samples: Samples) -> Samples:
        q = samples.q.copy()
        q[:, joint] = change(q[:, joint])
        return replace(samples, q=q)

    return changed


def slipped(by: float, since: int, joint: int = 1) -> Callable[[Samples], Samples]:
    return read(joint, lambda q: q + by * (np.arange(len(q)) >= since))


def seen(change: Callable[[Any], Any]) -> Callable[[Samples], Samples]:
    def changed(samples: Samples) -> Samples:
        assert samples.position is not None
        return replace(samples, position=change(samples.position))

    return changed


def crept(position: Any) -> Any:
    return position + np.linspace(0.0, 1e-3, len(position))[:, None] * [0.6, 0.0, 0.8]


def pushed(position: Any) -> Any:
    return position + (np.arange(len(position)) >= 35)[:, None] * [0.0, 8e-4, 0.0]


TRACKED = tracked_scene(ARM, TRUTH, 60)


def touched() -> Scene:
    return artefact_scene("pairwise_distance", ARM, TRUTH, artefact(8), placements(5), 2)


CASES: dict[str, tuple[Callable[[], Scene], Callable[[Samples], Samples], str, str, float]] = {
    "slip": (lambda: TRACKED, slipped(2e-3, 22), "slip", "row 22", 2e-3),
    "travel": (lambda: TRACKED, read(2, lambda q: q * (1 + 1e-3)), "travel", "", 1e-3),
    "drift": (
        lambda: TRACKED,
        read(1, lambda q: q + np.linspace(0.0, 2e-3, len(q))),
        "drift",
        "",
        2e-3,
    ),
    "creep": (lambda: TRACKED, seen(crept), "base creep", "", 1e-3),
    "moved": (lambda: TRACKED, seen(pushed), "base", "row 35", 8e-4),
    "camera on its tool": (
        lambda: hand_eye_scene(ARM, TRUTH, 60),
        seen(crept),
        "tip creep",
        "",
        1e-3,
    ),
    "slip between touches": (touched, slipped(5e-3, 38, 3), "slip", "row 38", 5e-3),
    # Planes meet no length: an arm of no size would fit them all.
    "slip without lengths": (
        lambda: plane_scene(ARM, TRUTH, touches=30),
        slipped(5e-3, 60, 3),
        "slip",
        "row 60",
        5e-3,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_small_change_is_named_and_sized(case: str) -> None:
    make, change, kind, since, size = CASES[case]
    (told,) = found(make(), change)
    assert (told.kind, told.since) == (kind, since)
    assert told.joint == (ARM.joints[3] if "slip " in case else told.joint)
    assert abs(told.size - size) < 4 * told.std
    assert told.std < 0.1 * size or "slip " in case
    assert since in told.sentence


@pytest.mark.parametrize(("by", "level"), [(4e-4, "care"), (3e-3, "bad")])
def test_an_arm_that_was_fitted_in_two_states_is_not_used(by: float, level: str) -> None:
    def pushed_by(position: Any) -> Any:
        return position + (np.arange(len(position)) >= 35)[:, None] * [0.0, by, 0.0]

    assessment = solved(TRACKED, seen(pushed_by)).assessment
    assert assessment.level == level
    first = next(note for note in assessment.notes if "no validation data" not in note)
    assert "was moved by" in first


def exchanged_after(
    make: Callable[[dict[str, float]], Scene], longer: float, since: int
) -> Callable[[Samples], Samples]:
    """What is read where the same places are met with a longer tool from a row on."""
    after = make(TRUTH | {"tip.z": longer}).samples(NOISE, 1)[0]

    def changed(samples: Samples) -> Samples:
        rows = np.arange(len(samples))
        return Samples.concatenate([samples.take(rows < since), after.take(rows >= since)])

    return changed


@pytest.mark.parametrize("make", [plane_scene, fixed_point_scene])
def test_a_tool_that_was_exchanged_between_touches_is_named(make: Callable[..., Scene]) -> None:
    """Each place has an unknown of its own, which takes as much of the new tool as it can."""
    before = make(ARM, TRUTH)
    half = len(before.q) // 2
    (told,) = found(before, exchanged_after(lambda truth: make(ARM, truth), 4e-3, half))
    assert told.kind == "tip"
    assert abs(told.size - 4e-3) < 4 * told.std < 2e-3
    assert not found(before)


def distances(truth: dict[str, float]) -> Scene:
    return artefact_scene("pairwise_distance", ARM, truth, artefact(12), placements(4), 2)


@pytest.mark.parametrize("longer", [2e-3, 5e-3])
def test_a_tool_that_grew_across_all_distances_is_named(longer: float) -> None:
    """Touched from above, no distance changes at first: the touches beside one another do."""
    (told,) = found(distances(TRUTH), exchanged_after(distances, longer, 53))
    assert (told.kind, told.since) == ("tip", "row 53")
    assert abs(told.size - longer) < 4 * told.std < 2e-3
    assert not found(distances(TRUTH))


def test_what_the_data_cannot_tell_apart_is_said_beside_each_other() -> None:
    """A tip that was bent sideways touches where the last joint, read wrongly, has it touch."""
    scene, last = distances(TRUTH), ARM.joints[-1]
    rows = np.arange(len(scene.q))
    (told,) = found(scene, read(5, lambda q: q + 0.02 * (rows >= 53)))
    assert "joint_6" in told.sentence
    assert "These data fit another cause as well: The tool" in told.sentence
    assert (told.kind, told.joint) == ("slip", last)
    (plain,) = found(TRACKED, slipped(2e-3, 22))
    assert not plain.instead


@pytest.mark.parametrize("since", [30, 45])
def test_a_change_between_terms_and_in_one_of_them_lasts(since: int) -> None:
    """What follows a row stands in the same file, or in others that were measured later."""
    samples = slipped(2e-3, since)(TRACKED.samples(NOISE)[0])
    rows = np.arange(len(samples))
    terms = [
        TRACKED.term(samples.take(part), Noise(None, 1e-3), Noise(None, 0.01))
        for part in (rows < 30, rows >= 30)
    ]
    (told,) = changes_of(solve(Problem(terms, UNKNOWN), SolverOptions(starts=1)))
    assert (told.kind, told.joint) == ("slip", ARM.joints[1])
    assert (told.since, told.until) == (f"row {since}", "")
    assert abs(told.size - 2e-3) < 4 * told.std


def test_what_is_so_in_one_file_alone_has_an_end() -> None:
    def one_file(samples: Samples) -> Samples:
        rows = np.arange(len(samples))
        origin = [f"{'abc'[row // 20]}.csv:{row % 20 + 2}" for row in rows.tolist()]
        q = samples.q.copy()
        q[rows // 20 == 1, 1] += 2e-3
        return replace(samples, q=q, origin=tuple(origin))

    (told,) = found(TRACKED, one_file)
    assert (told.kind, told.since, told.until) == ("slip", "b.csv:2", "b.csv:21")
    assert "from b.csv:2 to b.csv:21" in told.sentence
    assert abs(told.size - 2e-3) < 4 * told.std


@pytest.mark.parametrize("changed", [False, True])
def test_a_slip_among_gross_errors_is_named(changed: bool) -> None:
    """One touch in ten is grossly wrong, which is most of the squares and hides what is not."""
    made = scene(0, bent=True)
    calibration, point = made.term("calibration"), made.term("fixed_point")
    rows = np.arange(len(calibration.poses))
    slip = read(3, lambda q: q + 5e-3 * (rows >= 142)) if changed else unchanged
    calibration = calibration.over_poses(
        calibration.poses.with_samples(slip(calibration.poses.samples))
    )
    problem = Problem([calibration, point], everything(made.arm))
    told = changes_of(solve(problem, SolverOptions(starts=1)))
    assert [(each.kind, each.joint) for each in told] == [("slip", "joint_4")] * changed
    origin = calibration.poses.samples.origin
    # Not every row is tried.
    assert all(abs(origin.index(each.since) - 142) < 225 / 40 for each in told)


def test_a_change_is_as_sure_as_it_says() -> None:
    pulls = []
    for seed in range(8):
        (told,) = changes_of(solved(TRACKED, slipped(2e-3, 30), seed))
        pulls.append((told.size - 2e-3) / told.std)
    squares = float(np.sum(np.square(pulls)))
    # Chi-squared with eight degrees of freedom: 0.1 % on either side.
    assert 0.86 < squares < 26.1


@pytest.mark.parametrize("kind", ["tracked_point", "landmark", "pairwise_distance"])
def test_sound_data_have_not_changed(kind: str) -> None:
    """Nor have those of an arm that is crooked in a way that the job does not free."""
    crooked = perturbed(ARM.select(Selection(("joint_?.[xy]",), bound_m=0.01)), 3, 1e-3)
    for truth in (TRUTH, TRUTH | crooked):
        scene = (
            tracked_scene(ARM, truth, 60)
            if kind == "tracked_point"
            else artefact_scene(kind, ARM, truth, artefact(6), placements(5))
        )
        for seed in range(3):
            assert not found(scene, unchanged, seed)


def wavy(samples: Samples, size: float = 5e-4) -> Samples:
    """Encoders with an error that no model has: three waves in a turn."""
    return replace(samples, q=samples.q + size * np.sin(3 * samples.q + np.arange(6)))


@pytest.mark.parametrize("size", [5e-4, 2e-3])
@pytest.mark.parametrize("joint", range(4))
def test_what_a_model_lacks_is_no_change_where_poses_stand_in_order(
    joint: int, size: float
) -> None:
    """In the order of one joint what the model gets wrong there comes and goes like a change."""
    for seed in range(2):
        assert not found(TRACKED, lambda s: wavy(s.take(np.argsort(s.q[:, joint])), size), seed)


def test_a_slip_beside_what_a_model_lacks_is_still_named() -> None:
    (told,) = found(TRACKED, lambda s: wavy(slipped(6e-3, 30)(s)))
    assert (told.kind, told.joint) == ("slip", ARM.joints[1])


def test_chances_beside_shared_errors_are_even() -> None:
    """Nothing changed: beside errors that neighbours share, every chance is as likely."""
    chances = []
    ordered = np.argsort(TRACKED.q[:, 1])
    for seed in range(24):
        solution = solved(TRACKED, lambda s: wavy(s.take(ordered)), seed)
        fit = everything_follows(CalibrationExamination.of(solution))
        slip = next(
            s
            for s in suspects(fit)[0]
            if isinstance(s.hypothesis, EncoderSlip) and s.motion.joint == ARM.joints[2]
        )
        velocity = slip.motion.within(20 + seed % 20, 60)
        beside = [*fit.lacking.values()], waves(fit, slip)
        chances.append(chance_beside_shared_errors(fit, velocity, *beside))
    # Binomial with 24 trials: more than six below a tenth has a chance of 1 %.
    assert np.sum(np.array(chances) < 0.1) <= 6
    assert np.median(chances) > 0.15


def test_the_measured_panda_has_not_changed(repository: Path) -> None:
    """Led by hand from pose to pose: wherever its rows begin, their order is one in space."""
    solution = CalibrationJob.load(repository / "examples/panda_sockets/calibration.yaml").run()
    (term,) = solution.solution.problem.terms
    rows = np.arange(len(term.poses))
    for first in (0, 6, 14, 22, 34, 46, 54):
        begun = term.take(np.roll(rows, -first))
        problem = Problem([begun], solution.solution.problem.arm_parameters)
        if problem.names == solution.solution.problem.names:
            assert not changes_of(replace(solution.solution, problem=problem))


def test_an_eccentric_encoder_is_no_change() -> None:
    truth = TRUTH | {f"{ARM.joints[2]}.ecc_s1": 2e-3}
    solution = solved(tracked_scene(ARM, truth, 60), unchanged)
    assert not changes_of(solution)
    said = notes_on(solution)
    assert "eccentric encoder" in said


def test_a_lost_count_is_not_called_an_eccentric_encoder() -> None:
    solution = solved(TRACKED, read(2, lambda q: q * (1 - 1 / 4096)))
    said = notes_on(solution)
    assert "eccentric encoder" not in said
    assert "lose or double counts" in said
    (told,) = changes_of(solution)
    assert abs(told.size + 1 / 4096) < 4 * told.std
    assert math.isclose(told.size, -1 / 4096, rel_tol=0.3)


def test_what_follows_is_the_minimum_of_the_robust_cost() -> None:
    """Rows within their threshold are summed once, those beyond it taken out, some far beyond."""

    def astray(position: Any) -> Any:
        return position + (np.arange(len(position)) % 9 == 4)[:, None] * [0.02, 0.0, 0.1]

    fit = everything_follows(CalibrationExamination.of(solved(TRACKED, seen(astray)))).linear
    done = fit.robust

    def cost(step: Any) -> float:
        pulled = float(fit.prior @ (fit.away + step) ** 2)
        return pulled + float(np.sum(fit.costs(fit.residual + fit.jacobian @ step)))

    assert np.any(fit.weights < 0.1)
    lowest = cost(done.step)
    # Rounds end where the cost no longer falls by more than `SETTLED`.
    assert lowest <= done.cost <= lowest * (1 + 1e-5)
    # One at a time, by what lifts the cost by one.
    reach = np.diag(np.linalg.inv(done.inverse)) ** -0.5
    for k, size in enumerate(reach):
        away = np.arange(len(reach)) == k
        slope = (cost(done.step + size * away) - cost(done.step - size * away)) / 2
        assert abs(slope) < 0.02
    assert 0 < done.spent < len(fit.prior)


def test_a_size_that_is_hardly_more_than_its_std_is_no_finding() -> None:
    unsure = ChangeInTime(TipMoved(), "", "row 9", 3.9e-3, 7.1e-3, 1e-6)
    assert not unsure.sized
    turned = replace(unsure, turn=math.radians(2.0), turn_std=math.radians(0.1))
    assert turned.sized
    assert "moved by 2.00 ± 0.10 deg at row 9" in turned.sentence
    both = replace(turned, std=1e-4)
    assert "moved by 3.90 ± 0.10 mm and 2.00 ± 0.10 deg at row 9" in both.sentence


def two_balls(seed: int, slip: float = 0.0) -> str:
    """Notes on two balls at each of fourteen rests, of an arm whose encoder may have slipped."""
    arm, random = arm_named("ur5"), np.random.default_rng(seed)
    middle = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    q = middle + random.uniform(-0.4, 0.4, (14, 6))
    R, p = arm.forward(q)
    held, at = rotation_from_vector([0.05, -0.1, 0.6]), np.array([0.03, -0.06, 0.07])
    (turn,), (place,) = arm.forward(middle[None])
    ahead = np.array([[0.08, 0.05, 0.5], [-0.07, 0.02, 0.45]])
    balls = (ahead @ held.T + at) @ turn.T + place
    # The camera sees them five times as well as the arm knows where it is.
    scatter = 2e-5 * random.standard_normal((14, 2, 3))
    seen = ((balls - p[:, None]) @ R - at) @ held + scatter
    read = q + 1e-4 * random.standard_normal(q.shape)
    read[8:, 3] += slip
    term = DepthPoints.from_arrays(
        arm,
        np.repeat(read, 2, axis=0),
        position=seen.reshape(-1, 3),
        point=["A", "B"] * 14,
        image=[str(k) for k in range(14) for _ in "AB"],
    )
    usual = Selection(("*.offset",), prior_rad=math.radians(0.02))
    return notes_on(solve(Problem([term], arm.select(usual)), SolverOptions(starts=1)))


@pytest.mark.parametrize("seed", first_of((4, 5, 6, 14)))
def test_what_two_balls_at_one_rest_share_is_no_change(seed: int) -> None:
    assert "more from row" not in two_balls(seed)
    assert "was moved by" not in two_balls(seed)


def test_a_slip_of_an_encoder_is_seen_by_two_balls() -> None:
    assert "wrist_1_joint reads" in two_balls(4, slip=math.radians(0.4))
