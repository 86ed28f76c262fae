"""Offsets from known poses: recovered, all branches listed, and honest about what is missing."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from two_arms import ROBOT

from suta_calib.acquisition.zero_offsets import find_zero_offsets
from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import rotation_from_vector, wrap
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel

OFFSETS = np.array([0.4, -1.1, 0.02, 2.9, -0.3, 0.7])


@pytest.fixture(scope="module")
def arm(suta_urdf: Path) -> ArmModel:
    return ArmModel.from_urdf(suta_urdf, "tip")


def known(
    arm: ArmModel,
    count: int,
    *,
    oriented: bool,
    noise: float = 0.0,
    turn: float = 0.0,
    seed: int = 3,
) -> Samples:
    random = np.random.default_rng(seed)
    q = np.random.default_rng(3).uniform(-2, 2, (count, 6))
    values = dict(zip((f"{j}.offset" for j in arm.joints), OFFSETS, strict=True))
    rotation, position = arm.forward(q, values)
    position = position + noise * random.standard_normal(position.shape)
    rotation = rotation @ rotation_from_vector(turn * random.standard_normal(position.shape))
    return Samples.from_arrays(
        arm.joints, q, position=position, rotation=rotation if oriented else None
    )


def away(offsets: FloatArray) -> float:
    return float(np.abs(wrap(offsets - OFFSETS)).max())


def test_one_pose_lists_every_branch_and_the_true_one_among_them(arm: ArmModel) -> None:
    samples = known(arm, 1, oriented=True)
    found = find_zero_offsets(arm, samples)
    assert found.undetermined == ()
    assert len(found.branches) >= 4
    assert min(away(branch.offsets) for branch in found.branches) < 1e-6
    for branch in found.branches:
        assert branch.rms < 1e-8
        assert branch.angles is not None
        assert branch.angles.max() < 1e-8
        _, position = arm.forward(samples.q, found.values(branch))
        assert np.allclose(position, samples.position, atol=1e-8)
    sizes = [float(np.linalg.norm(branch.offsets)) for branch in found.branches]
    assert sizes == sorted(sizes)
    for one, other in combinations(found.branches, 2):
        assert np.abs(wrap(one.offsets - other.offsets)).max() > 1e-3


@pytest.mark.parametrize("oriented", [True, False])
def test_several_poses_leave_the_truth(arm: ArmModel, oriented: bool) -> None:
    found = find_zero_offsets(arm, known(arm, 6, oriented=oriented))
    assert found.undetermined == ()
    assert len(found.branches) == 1
    assert away(found.branches[0].offsets) < 1e-6


def test_what_no_position_can_tell_is_held_and_named(suta_urdf: Path) -> None:
    wrist = ArmModel.from_urdf(suta_urdf, "link_6")
    found = find_zero_offsets(wrist, known(wrist, 6, oriented=False))
    # The axes of the last two joints meet in this point, so it does not move with them.
    alone = [{"joint_5.offset": 1.0}, {"joint_6.offset": 1.0}]
    assert [c.direction for c in found.undetermined] == alone
    assert found.unique
    errors = [np.abs(wrap(branch.offsets - OFFSETS)[:4]).max() for branch in found.branches]
    assert min(errors) < 1e-6
    assert not any(branch.offsets[4:].any() for branch in found.branches)


def test_noise_is_averaged_over_the_poses(arm: ArmModel) -> None:
    found = find_zero_offsets(arm, known(arm, 20, oriented=True, noise=0.5e-3))
    assert len(found.branches) == 1
    assert away(found.branches[0].offsets) < 1e-3
    assert found.branches[0].rms == pytest.approx(0.5e-3 * 3**0.5, rel=0.3)


def test_one_position_leaves_a_choice(arm: ArmModel) -> None:
    found = find_zero_offsets(arm, known(arm, 1, oriented=False))
    assert not found.unique
    assert len(found.undetermined) == 3
    assert found.branches[0].rms < 1e-3


def test_a_pose_out_of_reach_stays_far(arm: ArmModel) -> None:
    samples = Samples.from_arrays(arm.joints, np.zeros((1, 6)), position=[[5.0, 0.0, 0.0]])
    assert find_zero_offsets(arm, samples).branches[0].rms > 1.0


def test_one_pose_checks_nothing_and_its_offsets_may_be_anything(arm: ArmModel) -> None:
    """Six equations for six offsets: whatever is read, the tip stays 0.000 mm away."""
    true = known(arm, 1, oriented=True)
    wrong = replace(true, q=true.q + 0.7)
    found = find_zero_offsets(arm, wrong)
    assert found.redundancy == 0
    assert found.chosen.rms < 1e-8
    assert np.abs(found.chosen.offsets).max() > np.radians(45)
    assert not found.assessment.usable
    assert "no more equations than offsets" in found.assessment.sentence
    assert "no second posture confirms" in found.assessment.notes[0]
    # The same posture once more is no second one; another one tells that something is wrong.
    assert find_zero_offsets(arm, wrong.take([0, 0, 0])).redundancy == 0


@pytest.mark.parametrize(
    ("count", "oriented", "left"), [(2, True, 6), (6, False, 12), (1, True, 0)]
)
def test_redundancy_counts_equations(arm: ArmModel, count: int, oriented: bool, left: int) -> None:
    found = find_zero_offsets(arm, known(arm, count, oriented=oriented))
    assert found.redundancy == left
    said = " ".join([found.assessment.sentence, *found.assessment.notes])
    assert ("not checked by any other data" in said) is (left == 0)
    if left:
        # Far beyond what one would expect, but borne out.
        assert np.abs(found.chosen.offsets).max() > np.radians(45)
        assert found.assessment.usable


def test_offsets_scatter_as_they_say(arm: ArmModel) -> None:
    """Although the noise is four times what is assumed where nothing tells it."""
    noise = {"noise": 2e-3, "turn": np.radians(0.4)}
    fits = [find_zero_offsets(arm, known(arm, 8, oriented=True, seed=k, **noise)) for k in range(7)]
    pulls = np.array([wrap(f.chosen.offsets - OFFSETS) / f.chosen.std for f in fits]).ravel()
    # Chi-squared of 42 numbers, one in a thousand either way; noise is found from 42 residuals.
    low, high = chi2.ppf([0.0005, 0.9995], pulls.size)
    assert low < pulls @ pulls < 1.1 * high


@pytest.mark.parametrize(("count", "oriented"), [(4, True), (8, True), (8, False)])
@pytest.mark.parametrize("off", [0.005, 0.1])
def test_a_pose_that_all_others_contradict_is_named(
    arm: ArmModel, count: int, oriented: bool, off: float
) -> None:
    noise = {"noise": 1e-4, "turn": 1e-4}
    true = known(arm, count, oriented=oriented, **noise)
    assert true.position is not None
    position = true.position.copy()
    position[2, 1] += off
    wrong = replace(true, position=position)
    assert find_zero_offsets(arm, true).contradicted is None
    found = find_zero_offsets(arm, wrong)
    odd = found.contradicted
    assert odd is not None
    assert odd.row == wrong.origin[2]
    assert odd.distance == pytest.approx(off, rel=0.2)
    assert odd.rms < 1e-3
    assert found.assessment.level == ("bad" if found.status == "no_fit" else "care")
    assert any(f"{odd.row} contradicts all" in note for note in found.assessment.notes)
    # What one wrong pose explains is no wrong unit.
    assert not any("wrong unit" in note for note in found.assessment.notes)


def test_too_few_poses_and_repeats_of_one_contradict_no_other(arm: ArmModel) -> None:
    """Of two poses either may be wrong, however often one of them was taken."""
    samples = known(arm, 2, oriented=True).take([0, 0, 0, 0, 1])
    off = 0.03 * np.array([[0, 0, 0]] * 4 + [[1, 0, 0]])
    wrong = replace(samples, position=samples.position + off)
    assert find_zero_offsets(arm, wrong).contradicted is None


@pytest.mark.parametrize("sets", [10, pytest.param(300, marks=pytest.mark.slow)])
def test_poses_that_only_scatter_are_seldom_contradicted(arm: ArmModel, sets: int) -> None:
    """One in a thousand sets is allowed."""
    found = [
        find_zero_offsets(arm, known(arm, 5, oriented=k % 2 == 0, noise=1e-3, turn=2e-3, seed=k))
        for k in range(sets)
    ]
    assert sum(each.contradicted is not None for each in found) <= sets // 100


def test_a_joint_beyond_its_limits_is_named(tmp_path: Path, suta_urdf: Path, arm: ArmModel) -> None:
    samples = known(arm, 4, oriented=True)
    stands = wrap(samples.q + OFFSETS)[:, 2]
    text = suta_urdf.read_text()
    start = text.index('<joint name="joint_3"')
    at = text.index("<limit", start)
    ends = f'lower="{stands.min() + 0.1}" upper="{stands.max() + 0.1}"'
    limit = f'<limit {ends} effort="1" velocity="1"/>'
    (tmp_path / "arm.urdf").write_text(text[:at] + limit + text[text.index("/>", at) + 2 :])
    narrow = ArmModel.from_urdf(tmp_path / "arm.urdf", "tip")
    assert find_zero_offsets(arm, samples).beyond_limits == ()
    found = find_zero_offsets(narrow, samples)
    assert found.beyond_limits == ("joint_3",)
    assert any("joint_3 would be beyond" in note for note in found.assessment.notes)


def test_positions_are_needed(arm: ArmModel) -> None:
    with pytest.raises(InputError, match="no positions"):
        find_zero_offsets(arm, Samples.from_arrays(arm.joints, np.zeros((1, 6))))


def test_an_encoder_off_the_chain_is_refused_by_name(tmp_path: Path) -> None:
    """The second finger follows the first, which the chain to it does not pass."""
    (tmp_path / "robot.urdf").write_text(ROBOT)
    arm = ArmModel.from_urdf(tmp_path / "robot.urdf", "f2", "right")
    samples = Samples.from_arrays(arm.joints, [[0.1]], position=[[0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"--tip: found finger_1, which finger_2 follows") as told:
        find_zero_offsets(arm, samples)
    assert "Choose a --tip behind finger_1" in str(told.value)
