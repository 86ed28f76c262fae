"""Several eyes and targets in one answer: accuracy, ±, and what is said of the graph."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hand_eye_scenes import noisy
from many_eyes import EYES, TARGETS, Scene, pose_errors, scene
from studies import first_of

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.pose_calibration.hand_eye import calibrate_hand_eye
from suta_calib.pose_calibration.many_eyes import ManyEyesCalibration, calibrate_many_eyes
from suta_calib.terms.hand_eye_start import Poses, some_poses
from suta_calib.terms.synthetic import EXACT, PoseNoise


def calibrate(data: Scene, **more: Any) -> ManyEyesCalibration:
    return calibrate_many_eyes(data.hand, data.seen, eye=data.eye, target=data.target, **more)


def errors(found: ManyEyesCalibration, data: Scene) -> tuple[FloatArray, FloatArray]:
    """(k, 6) errors of all eyes, then of all targets, and their standard deviations."""
    off, std = [], []
    sides = ((found.eyes, EYES, data.X), (found.targets, TARGETS, data.Z))
    for poses, names, truth in sides:
        at = [names.tolist().index(one.name) for one in poses]
        off.append(pose_errors(np.array([one.pose for one in poses]), some_poses(truth, at)))  # type: ignore[arg-type]
        std += [one.std6 for one in poses]
    return np.vstack(off), np.array(std)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("robust", [True, False])
def test_exact_poses_give_back_every_x_and_z(setup: Any, robust: bool) -> None:
    data = scene(3, 2, 12, hand=EXACT, eye=EXACT, setup=setup)
    found = calibrate(data, setup=setup, robust=robust)
    assert np.abs(errors(found, data)[0]).max() < 1e-8
    assert found.outliers == ()


def test_three_eyes_and_two_targets_are_within_their_std() -> None:
    every = []
    for seed in range(4):
        data = scene(3, 2, 20, seed=seed)
        found = calibrate(data)
        off, std = errors(found, data)
        every.append(off / std)
        assert found.assessment.level == "good"
    ratio = np.array(every)
    assert (np.abs(ratio) < 3.0).mean() > 0.96
    assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.4


def test_wrong_rows_are_left_out_of_every_eye() -> None:
    data = scene(3, 2, 30, seed=3, gross=0.15)
    found = calibrate(data)
    lost = np.zeros(90, dtype=bool)
    lost[list(found.outliers)] = True
    assert (lost | ~data.outliers).all()
    assert (lost & ~data.outliers).sum() <= 1
    off, std = errors(found, data)
    assert (np.abs(off / std) < 4.0).all()


def test_one_eye_and_one_target_give_the_single_answer() -> None:
    data = noisy(25, seed=1)
    single = calibrate_hand_eye(data.poses, data.seen)
    many = calibrate_many_eyes(data.poses, data.seen)
    np.testing.assert_array_equal(many.X[0], single.X)
    np.testing.assert_array_equal(many.Z[0], single.Z)
    np.testing.assert_array_equal(many.covariance, single.covariance)


def test_eyes_that_share_a_hand_are_known_better_to_each_other() -> None:
    """A hand that is off displaces both eyes; between them it cancels."""
    coarse, fine = PoseNoise(2e-3, 5e-3), PoseNoise(5e-5, 1e-4)
    ratio = []
    for seed in range(5):
        data = scene(2, 1, 40, seed=seed, hand=coarse, eye=fine)
        found = calibrate(data)
        between, std = found.relative("left", "right")
        apart = np.sqrt(sum(np.sum(one.std6[:3] ** 2) for one in found.eyes))
        assert np.linalg.norm(std[:3]) < 0.5 * apart
        X = [
            np.vstack([np.column_stack([R, p]), [0, 0, 0, 1]]) for R, p in zip(*data.X, strict=True)
        ]
        true = np.linalg.inv(X[0]) @ X[1]
        ratio.append(pose_errors(between[None], (true[None, :3, :3], true[None, :3, 3]))[0] / std)
    assert np.sqrt(np.mean(np.square(ratio))) < 2.0


# ── The graph ────────────────────────────────────────────────────────────────────────────────
def test_a_target_that_one_eye_saw_is_said_to_hang_on_it() -> None:
    sees = np.array([[True, True], [True, False]])
    notes = calibrate(scene(2, 2, 30, sees=sees)).assessment.notes
    (note,) = [n for n in notes if "one eye only" in n]
    assert "Target B (eye left) was seen by one eye only" in note
    assert "hangs on this eye alone" in note


def test_parts_that_no_row_joins_are_named() -> None:
    found = calibrate(scene(2, 2, 30, sees=np.eye(2, dtype=bool)))
    (note,) = [n for n in found.assessment.notes if "groups that no row joins" in n]
    assert "(eye left, target A), (eye right, target B)" in note
    assert found.assessment.usable


def with_a_flat_eye(of_left: bool = False) -> tuple[Poses, Poses, Scene]:
    """The hand turns about one axis where the right eye looks; about all where the left does."""
    axis = np.array([0.0, 0.6, 0.8])
    whole = scene(2, 2, 40, seed=2, sees=np.eye(2, dtype=bool), hand=EXACT)
    flat = scene(
        2, 2, 40, seed=2, sees=np.eye(2, dtype=bool), axes=np.array([axis, axis]), hand=EXACT
    )
    rows = np.where((whole.eye == "right") | of_left, 80, 0) + np.arange(80)
    hand, seen = (
        some_poses((np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]])), rows)
        for a, b in ((whole.hand, flat.hand), (whole.seen, flat.seen))
    )
    return hand, seen, whole


def test_an_eye_that_stays_open_is_named_and_the_others_keep_their_x() -> None:
    hand, seen, whole = with_a_flat_eye()
    found = calibrate_many_eyes(hand, seen, eye=whole.eye, target=whole.target)
    left = np.flatnonzero(whole.eye == "left")
    alone = calibrate_many_eyes(*(some_poses(p, left) for p in (hand, seen)), eye=whole.eye[left])
    assert [eye.name for eye in found.eyes] == ["left"]
    np.testing.assert_allclose(found.X, alone.X, atol=1e-9)
    np.testing.assert_allclose(found.eyes[0].std6, alone.eyes[0].std6, rtol=1e-6)
    assert found.numbers is not None
    assert found.numbers.tolist() == left.tolist()
    eye, target = found.not_found
    assert (eye.role, eye.name, eye.rows) == ("eye", "right", 40)
    assert (target.role, target.name, target.partners) == ("target", "B", ("right",))
    verdict = found.assessment
    assert verdict.level == "care"
    assert "X of eye right could not be determined and is not given" in verdict.notes[0]
    assert "slide along (0.00, 0.60, 0.80)" in verdict.notes[0]
    assert "another eye sees too" in verdict.notes[0]
    assert "Z of target B is not given: it was seen with eye right only" in verdict.notes[1]


def test_where_every_eye_stays_open_there_is_no_answer() -> None:
    hand, seen, whole = with_a_flat_eye(of_left=True)
    with pytest.raises(SamplesError, match=r"determine no eye\. X of eye left"):
        calibrate_many_eyes(hand, seen, eye=whole.eye, target=whole.target)


def test_a_target_of_which_no_row_agrees_has_no_pose() -> None:
    data = scene(3, 3, 30, seed=4)
    R, p = data.seen[0].copy(), data.seen[1].copy()
    some = np.flatnonzero(data.target == "C")
    kept = np.isin(np.arange(90), some[3:], invert=True)
    wrong = some[:3]
    R[wrong] = R[wrong] @ rotation_from_vector(np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]]))
    p[wrong] += [[0.2, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, -0.4]]
    hand, seen = some_poses(data.hand, kept), some_poses((R, p), kept)
    found = calibrate_many_eyes(hand, seen, eye=data.eye[kept], target=data.target[kept])
    assert len(found.X) == 3
    if found.not_found:
        (lost,) = found.not_found
        assert (lost.role, lost.name) == ("target", "C")
        assert "none of its 3 rows agrees" in lost.sentence
    else:
        (C,) = (target for target in found.targets if target.name == "C")
        assert C.inliers < 3


def test_an_eye_with_few_motions_is_placed_by_a_target_that_others_know() -> None:
    """Two rows of one eye: alone they tell nothing, the shared target tells all."""
    data = scene(3, 1, 30, seed=4)
    rows = (data.together.eye < 2) | (np.arange(90) < 9)
    hand, seen = (some_poses(poses, rows) for poses in (data.hand, data.seen))
    found = calibrate_many_eyes(hand, seen, eye=data.eye[rows], target=data.target[rows])
    top = found.eyes[2]
    assert len(top.rows) == 3
    off = pose_errors(top.pose[None], some_poses(data.X, np.array([2])))[0]
    assert (np.abs(off / top.std6) < 4.0).all()
    assert np.linalg.norm(top.std6[:3]) > np.linalg.norm(found.eyes[0].std6[:3])


# ── Wrong data ───────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("since", [30, 45, 66])
@pytest.mark.parametrize("role", ["eye", "target"])
def test_labels_exchanged_from_a_row_on_are_named_first(role: str, since: int) -> None:
    data = scene(3, 2, 30, seed=1)
    labels = {"eye": data.eye.copy(), "target": data.target.copy()}
    names = ("left", "top") if role == "eye" else ("A", "B")
    late = labels[role][since:]
    labels[role][since:] = [
        names[1 - names.index(name)] if name in names else name for name in late
    ]
    with pytest.raises(SamplesError, match="are exchanged from row") as problem:
        calibrate_many_eyes(data.hand, data.seen, eye=labels["eye"], target=labels["target"])
    said = str(problem.value)
    assert all(name in said.split("exchanged from row")[0] for name in names)
    wrong = np.flatnonzero((labels["eye"] != data.eye) | (labels["target"] != data.target))
    assert int(said.split("exchanged from row ")[1].split()[0]) == wrong[0]


def test_good_rows_are_never_told_to_be_exchanged() -> None:
    for seed in range(3):
        found = calibrate(scene(3, 2, 20, seed=seed, gross=0.25))
        assert found.inliers.sum() >= 30


def test_a_target_moved_half_way_is_named() -> None:
    data = scene(2, 2, 40, seed=5)
    R, p = data.seen[0].copy(), data.seen[1].copy()
    late = (np.arange(80) >= 40) & (data.together.target == 1)
    # 4 mm along an axis of the target.
    p[late] += np.einsum("nij,j->ni", R[late], [4e-3, 0.0, 0.0])
    found = calibrate_many_eyes(data.hand, (R, p), eye=data.eye, target=data.target)
    assert found.moved is not None
    assert "target B" in found.moved.sentence
    assert found.assessment.level != "good"


def test_a_stuck_eye_is_named() -> None:
    data = scene(2, 1, 20)
    R, p = data.seen[0].copy(), data.seen[1].copy()
    stuck = np.flatnonzero(data.eye == "right")
    R[stuck], p[stuck] = R[stuck[0]], p[stuck[0]]
    with pytest.raises(SamplesError, match="eye right, target A"):
        calibrate_many_eyes(data.hand, (R, p), eye=data.eye, target=data.target)


def test_an_eye_most_of_whose_rows_are_wrong_is_named() -> None:
    data = scene(3, 1, 20)
    R = data.seen[0].copy()
    wrong = np.flatnonzero(data.eye == "top")[::2]
    R[wrong] = R[wrong] @ rotation_from_vector([0.0, 0.5, 0.0])
    found = calibrate_many_eyes(data.hand, (R, data.seen[1]), eye=data.eye, target=data.target)
    assert any("rows of eye top do not agree" in note for note in found.assessment.notes)
    assert found.assessment.level != "good"


@pytest.mark.parametrize(
    ("labels", "said"),
    [({"eye": ["a"] * 5}, "one for each of the 36 rows"), ({"target": [""] * 36}, "empty label")],
)
def test_labels_that_cannot_be_are_refused(labels: dict[str, Any], said: str) -> None:
    data = scene(3, 1, 12)
    with pytest.raises(SamplesError, match=said):
        calibrate_many_eyes(data.hand, data.seen, **labels)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("seed", first_of(range(3)))
def test_an_eye_in_millimetres_is_named(seed: int, setup: Any) -> None:
    data = scene(3, 2, 25, seed=seed, setup=setup)
    R, p = data.seen[0], data.seen[1].copy()
    p[data.eye == "top"] *= 1e3
    with pytest.raises(SamplesError, match="mm") as problem:
        calibrate_many_eyes(data.hand, (R, p), eye=data.eye, target=data.target, setup=setup)
    assert "eye top" in str(problem.value)


def exchanged(names: Any, a: str, b: str, since: int) -> Any:
    other = names.copy()
    late = other[since:]
    other[since:] = np.where(late == a, b, np.where(late == b, a, late))
    return other


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_exchanges_are_named_in_every_set_and_sound_sets_are_not(setup: Any) -> None:
    """Forty sets: sound, and with eyes or targets exchanged from a row on."""
    for seed in range(40):
        random = np.random.default_rng(seed)
        eyes, targets = int(random.integers(2, 5)), int(random.integers(2, 4))
        instants = int(random.integers(15, 40))
        size = float(10.0 ** random.uniform(-0.7, 0.7))
        noise = PoseNoise(3e-4 * size, float(np.radians(0.1)) * size)
        data = scene(eyes, targets, instants, seed=seed, hand=noise, eye=noise, setup=setup)
        sound = calibrate_many_eyes(
            data.hand, data.seen, eye=data.eye, target=data.target, setup=setup
        )
        assert not sound.not_found
        assert not sound.findings
        since = int(random.integers(0.3 * len(data.eye), 0.7 * len(data.eye)))
        by_eye = {"eye": exchanged(data.eye, "left", "right", since), "target": data.target}
        by_target = {"eye": data.eye, "target": exchanged(data.target, "A", "B", since)}
        for labels, said in ((by_eye, "eyes left and right"), (by_target, "targets A and B")):
            with pytest.raises(SamplesError) as problem:
                calibrate_many_eyes(data.hand, data.seen, setup=setup, **labels)
            words = str(problem.value).replace("right and left", "left and right")
            assert said in words.replace("B and A", "A and B")
