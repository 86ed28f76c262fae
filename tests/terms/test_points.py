"""Points that a depth camera saw: their noise by distance, their files, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulated import arm_named, camera_scene, dh_parameters, perturbed, points_scene
from studies import first_of

from suta_calib.errors import InputError, SamplesError, SutaCalibWarning
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.measurements import Chessboard, Samples, write_board, write_samples
from suta_calib.measurements.depth_noise import DepthNoise, ray_axes
from suta_calib.measurements.seen_points import SeenPoints, read_seen_points, write_seen_points
from suta_calib.model.parameters import Selection
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import KINDS, ArmPoses, DepthPoints, Setup
from suta_calib.terms.depth_term import with_seen

BOARD = Chessboard(6, 5, 0.03)
NOISE = DepthNoise((1e-3, 2e-3), 5e-4)


def scene(**more: Any):
    arm = arm_named("suta")
    return points_scene(arm, perturbed(dh_parameters(arm), seed=1), **more)


def pictures(noise: DepthNoise, depths: np.ndarray, seed: int = 0):
    """A board in front of a depth camera at several distances, on it and as it is seen."""
    rng = np.random.default_rng(seed)
    on_board = np.array([*BOARD.points.values()])
    for z in depths:
        turn = rotation_from_vector(rng.uniform(-0.5, 0.5, 3))
        place = np.array([*rng.uniform(-0.1, 0.1, 2), z])
        seen = (on_board - on_board.mean(axis=0)) @ turn.T + place
        scatter = noise.sigmas(seen[:, 2]) * rng.standard_normal(seen.shape)
        yield on_board, seen + np.einsum("nij,nj->ni", ray_axes(seen), scatter)


def with_noise(term: DepthPoints, noise: DepthNoise, seed: int) -> DepthPoints:
    """The term over points that scatter by their distance."""
    seen = term.poses.samples.position
    scatter = noise.sigmas(seen[:, 2]) * np.random.default_rng(seed).standard_normal(seen.shape)
    position = seen + np.einsum("nij,nj->ni", ray_axes(seen), scatter)
    samples = replace(term.poses.samples, position=position)
    return replace(term, poses=term.poses.with_samples(samples), weights=None, typical_sigma=None)


def test_noise_grows_along_the_ray_with_the_square() -> None:
    sigma = NOISE.sigmas(np.array([1.0, 2.0]))
    np.testing.assert_allclose(sigma, [[5e-4, 5e-4, 3e-3], [1e-3, 1e-3, 9e-3]])
    # What has no depth is not known without error.
    assert (NOISE.sigmas(np.array([-1.0, 0.0])) > 0).all()


def test_noise_is_learnt_from_how_a_board_scatters() -> None:
    learnt = DepthNoise.learnt(pictures(NOISE, np.linspace(0.4, 2.5, 60)))
    assert learnt is not None
    z = np.array([0.5, 1.0, 2.0])
    np.testing.assert_allclose(learnt.sigmas(z), NOISE.sigmas(z), rtol=0.15)
    assert DepthNoise.learnt([]) is None
    exact = DepthNoise((0.0, 0.0), 0.0)
    assert DepthNoise.learnt(pictures(exact, np.array([1.0]))) is None


def test_rows_that_are_taken_keep_the_noise_of_the_whole() -> None:
    s = scene(board=True)
    s.settings.pop("depth_noise")
    term = with_noise(s.exact(), NOISE, 0)
    some = term.take(np.arange(24))
    assert some.weights == term.weights
    assert some.typical_sigma == term.typical_sigma


def test_a_far_point_has_less_weight() -> None:
    s = scene(n=8)
    term = replace(s.exact(), depth_noise=NOISE, weights=None, typical_sigma=None)
    (block,) = term.blocks
    depth = term.poses.samples.position[:, 2]
    order = np.argsort(depth)
    assert (np.diff(block.relative[order, 2]) >= 0).all()
    np.testing.assert_allclose(block.relative * block.typical, NOISE.sigmas(depth))


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_board_seen_at_two_corners_only_starts_by_its_points(setup: str) -> None:
    """No picture tells the pose of the board, but all together do."""
    s = scene(n=20, board=True, setup=setup)
    term, shown = s.exact(), ((0, 3), (3, 8), (8, 0))
    corners = term.poses.samples.labels["point"].astype(int).reshape(20, 12)
    seen = [np.isin(row, shown[k % 3]) for k, row in enumerate(corners)]
    term = term.take(np.flatnonzero(seen))
    names = [p.name for p in term.own_parameters]
    start = dict(zip(names, term.start(*term.poses.at(s.truth)), strict=True))
    problem = Problem([term], dh_parameters(s.arm))
    x = problem.start({**s.truth, **start})
    for line in problem.linearise(x, problem.assumed_sigmas()):
        assert np.abs(line.residual).max() < 1e-6


def test_the_spread_is_true() -> None:
    """Twelve trials: errors of the camera's place over their standard deviations are about one."""
    s = scene(n=15)
    names, errors = [f"hand_eye.{c}" for c in "xyz"], []
    exact = s.exact()
    truth = exact.start_values(s.truth)
    known = s.arm.at(s.truth)
    for seed in range(12):
        term = with_noise(exact, NOISE, seed)
        term = term.over_poses(ArmPoses(known, term.poses.samples))
        solution = solve(Problem([term], known.select()))
        errors += [(solution.values[n] - truth[n]) / solution.estimates[n].std for n in names]
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.5


# ── files ────────────────────────────────────────────────────────────────────────────────────
def job_folder(folder: Path, *, board: bool) -> SeenPoints:
    """Samples with a row for each picture, and the points in a file of their own."""
    s = scene(n=12, board=board)
    samples = s.samples()[0]
    first = np.unique(samples.labels["image"], return_index=True)[1]
    pictures = Samples.from_arrays(
        s.arm.joints, samples.q[first], labels={"image": samples.labels["image"][first]}
    )
    write_samples(folder / "samples.csv", pictures)
    points = SeenPoints(samples.labels["image"], samples.labels["point"], samples.position)
    write_seen_points(folder / "points.csv", points)
    write_board(folder / "board.yaml", Chessboard(4, 3, 0.04))
    return points


def test_points_stand_in_a_file_of_their_own(tmp_path: Path) -> None:
    points = job_folder(tmp_path, board=True)
    again = read_seen_points(tmp_path / "points.csv")
    np.testing.assert_allclose(again.position, points.position, atol=1e-6)
    assert again.point.tolist() == points.point.tolist()
    assert again.sigma is None


def test_sigmas_are_written_and_read(tmp_path: Path) -> None:
    names = np.array(["a", "a"]), np.array(["1", "2"])
    sigma = np.array([[1e-3, 1e-3, 2e-3], [2e-3, 2e-3, 4e-3]])
    points = SeenPoints(*names, np.array([[0, 0, 1.0], [0, 0, 2.0]]), sigma)
    write_seen_points(tmp_path / "points.csv", points)
    np.testing.assert_allclose(read_seen_points(tmp_path / "points.csv").sigma, sigma)


def test_a_point_twice_in_a_picture_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("image,point,x,y,z\na,1,0,0,1\na,1,0,0,2\n")
    with pytest.raises(SamplesError, match="same point as in line 2"):
        read_seen_points(path)


def test_pictures_without_points_are_left_out(tmp_path: Path) -> None:
    points = job_folder(tmp_path, board=False)
    s = scene(n=12)
    samples = s.samples()[0].take(np.arange(0, 36, 3))
    poses = ArmPoses(s.arm, samples)
    some = replace(
        points, image=points.image[3:], point=points.point[3:], position=points.position[3:]
    )
    with pytest.warns(SutaCalibWarning, match="no points of 1 of 12 images"):
        joined = with_seen(poses, some, "point")
    assert len(joined) == 33
    other = replace(points, image=np.array([f"x{n}" for n in points.image.tolist()]))
    with pytest.raises(SamplesError, match="the same names in both"):
        with_seen(poses, other, "point")


# ── what is refused, or doubted ──────────────────────────────────────────────────────────────
def scaled(term: DepthPoints, factors: Any) -> DepthPoints:
    samples = term.poses.samples
    samples = replace(samples, position=samples.position * factors)
    return replace(term, poses=term.poses.with_samples(samples), weights=None, typical_sigma=None)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1000.0, "1e[+]03 times as far apart.*seem to be in mm, where m are expected"),
        (0.001, "0.001 times as far apart.*seem to be in m, where mm are expected"),
        (25.4, "25.4 times as far apart.*inches"),
        (1.5, "1.5 times as far apart.*check the size of the squares"),
    ],
)
def test_another_unit_is_named_by_the_board(factor: float, words: str) -> None:
    with pytest.raises(SamplesError, match=words):
        scaled(scene(board=True).exact(), factor).check_enough()


def test_millimetres_of_balls_are_named() -> None:
    with pytest.raises(SamplesError, match=r"scatter by .* mm about their middle"):
        scaled(scene().exact(), 1000.0).check_enough()


@pytest.mark.parametrize(("factor", "right"), [(10.0, "0.1"), (0.25, "4")])
def test_another_step_of_the_depth_is_named(factor: float, right: str) -> None:
    """As 0.1 mm for 1 mm, which no unit tells apart."""
    with pytest.raises(SamplesError, match=f"if all are {right} times as far away.*--unit"):
        scaled(scene().exact(), factor).check_enough()


@pytest.mark.parametrize("longer", first_of([1.01, 0.985]))
def test_a_scale_of_the_depth_is_named_as_the_cause(longer: float) -> None:
    """And not an arm or a board that is too long, which it looks like."""
    arm = arm_named("ur5")
    held = arm.select(Selection("*.offset", prior_rad=2e-4))
    sound = with_noise(points_scene(arm, {}, n=12).exact(), DepthNoise((2e-4, 5e-4), 3e-4), 1)
    solution = solve(Problem([scaled(sound, longer)], held), SolverOptions(starts=1, confirm=False))
    assessment = solution.assessment
    assert assessment.level == "bad"
    assert assessment.notes[0].startswith("All depths of the depth camera seem to be")
    assert f"too {'long' if longer > 1 else 'short'}" in assessment.notes[0]
    assert not any("if all lengths" in note for note in assessment.notes)


def test_a_scale_of_the_depth_is_doubted() -> None:
    sound = with_noise(scene(board=True).exact(), DepthNoise((1e-4, 2e-4), 1e-4), 0)
    assert not sound.doubts
    (sentence,) = scaled(sound, 1.02).doubts
    assert "2.0" in sentence
    assert "too large" in sentence


def test_body_axes_are_named() -> None:
    term = scene().exact()
    samples = term.poses.samples
    # ROS: x ahead, y left, z up.
    body = samples.position @ np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0.0]])
    moved = replace(term, poses=term.poses.with_samples(replace(samples, position=body)))
    (sentence,) = moved.doubts
    assert "body axes" in sentence


@pytest.mark.parametrize(
    ("joints", "words"),
    [((), "hardly turned"), ((0,), "about one axis only"), ((0, 3, 4), "")],
    ids=["none", "one", "several"],
)
def test_turns_that_leave_the_camera_open_are_said(joints: tuple[int, ...], words: str) -> None:
    s = scene(n=12)
    q = np.tile(s.q[0], (12, 1))
    q[:, list(joints)] += np.random.default_rng(0).uniform(-0.5, 0.5, (12, len(joints)))
    rotation, position = s.arm.forward(q)
    ahead = np.array([0.0, 0.0, 0.6])
    seen = np.einsum("nji,nj->ni", rotation, position[0] + rotation[0] @ ahead - position)
    said = DepthPoints.from_arrays(s.arm, q, position=seen).doubts
    assert [words in sentence for sentence in said] == [True] * bool(words)


def test_mirrored_points_are_read_otherwise() -> None:
    s = scene(board=True, n=10)
    known = s.arm.at(s.truth)
    term = scaled(s.exact(), [-1.0, 1.0, 1.0])
    ((sentence, other),) = term.misread
    assert "mirrored" in sentence
    wrong, right = (
        solve(Problem([t.over_poses(ArmPoses(known, t.poses.samples))], known.select())).noise[0]
        for t in (term, other)
    )
    assert right < 1e-3 * wrong


def test_a_board_that_looks_the_same_is_numbered_from_one_end() -> None:
    s = scene(board=True, n=12)
    s.settings["board"] = board = Chessboard(4, 4, 0.04)
    assert board.symmetric
    term = s.exact()
    labels = term.poses.samples.labels["point"].reshape(12, 12).copy()
    # Corners 0 to 11 of the sixteen are seen; in three pictures numbered from the other end.
    for k in (1, 5, 9):
        labels[k] = [str(15 - int(name)) for name in labels[k]]
    samples = s.samples()[0]
    samples = replace(samples, labels={**samples.labels, "point": labels.reshape(-1)})
    with pytest.warns(SutaCalibWarning, match=r"In 1\.png, 5\.png, 9\.png its corners"):
        again = s.term(samples)
    assert again.poses.samples.labels["point"].tolist() == s.samples()[0].labels["point"].tolist()


def test_pictures_and_depth_share_camera_and_board() -> None:
    """One row in pixels and one in 3-D: one pose of the camera, and one of the board."""
    s, arm = scene(board=True, n=8), arm_named("suta")
    pictures = camera_scene(arm, s.truth, 8)
    known, terms = arm.at(s.truth), (s.exact(), pictures.exact())
    both = [t.over_poses(ArmPoses(known, t.poses.samples)) for t in terms]
    problem = Problem(both, known.select())
    assert [p.name for p in both[0].own_parameters] == [p.name for p in both[1].own_parameters]
    solution = solve(problem)
    for line in problem.linearise(solution.x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-8)
    for first, second in (both, both[::-1]):
        second.check_beside(first)
        with pytest.raises(SamplesError, match="another setup than in an earlier row"):
            replace(second, setup="eye-to-hand").check_beside(first)
    other = replace(both[1], board=Chessboard(4, 3, 0.05))
    for first, second in ((both[0], other), (other, both[0])):
        with pytest.raises(SamplesError, match="another board than in an earlier row"):
            second.check_beside(first)
        replace(second, target="second").check_beside(first)


def test_points_that_the_board_lacks_are_refused() -> None:
    s = scene(board=True)
    samples = s.samples()[0]
    labels = {**samples.labels, "point": np.full(len(samples), "99")}
    with pytest.raises(SamplesError, match="point '99'"):
        s.term(replace(samples, labels=labels))


def test_too_few_are_refused() -> None:
    with pytest.raises(SamplesError, match="points at 2 postures"):
        scene(n=2).exact().check_enough()
    s = scene(n=4)
    samples = s.samples()[0]
    names = np.array(["other", *samples.labels["point"][1:]])
    with pytest.raises(SamplesError, match="point other seen once"):
        s.term(replace(samples, labels={**samples.labels, "point": names})).check_enough()


def test_a_single_ball_needs_no_name() -> None:
    s = scene(n=12)
    samples = s.samples()[0].take(np.arange(0, 36, 3))
    term = DepthPoints.from_arrays(s.arm, samples.q, position=samples.position)
    assert [p.name for p in term.own_parameters][6:] == ["point.x", "point.y", "point.z"]
    assert [frame.owner for frame in term.outside] == ["hand_eye", "point"]


def test_noise_of_a_job_is_read(tmp_path: Path) -> None:
    kind = KINDS["points"]
    term = kind.over(scene().exact().poses, Setup(settings={"depth_noise": NOISE}))
    assert isinstance(term, DepthPoints)
    assert term.weights == NOISE
    assert issubclass(SamplesError, InputError)
