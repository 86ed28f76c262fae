"""Which landmark a rest is of, where the next in the sequence would be a wrong guess."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from acquisition_scenes import Scene
from device_stand_in import Script

from suta_calib.acquisition.seating_check import SeatingCheck, likelier
from suta_calib.acquisition.touch_sequence import read_row
from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel

NAMES = ["O", "M1", "M2", "L1", "M3", "L2", "S1", "S2"]


@pytest.fixture(scope="module")
def seating(job: Path, arm: ArmModel) -> SeatingCheck:
    artefact = read_row(job, None, ["pairwise_distance"]).artefact
    assert artefact is not None
    return SeatingCheck(arm, artefact)


@pytest.mark.parametrize("true", [(0, 1, 3, 4), (1, 2, 3, 5, 6), (0, 2, 4, 5, 7), (3, 4, 5, 6)])
def test_names_that_are_impossible_give_way_to_those_that_fit(
    seating: SeatingCheck, postures: dict[str, FloatArray], true: tuple[int, ...]
) -> None:
    tips = [seating.tip(postures[NAMES[k]]) for k in true]
    assert likelier(seating, NAMES, range(len(true)), tips) == true
    assert likelier(seating, NAMES, true, tips) is None
    assert likelier(seating, NAMES, range(3), tips[:3]) is None  # too few to tell


def test_names_stand_where_the_arm_is_merely_bad(
    seating: SeatingCheck, postures: dict[str, FloatArray]
) -> None:
    """2 deg off in two joints: centimetres, but no other names explain them."""
    off = np.radians([0, 2, -2, 0, 0, 0])
    tips = [seating.tip(postures[name] + off) for name in NAMES]
    for count in range(4, len(NAMES) + 1):
        assert likelier(seating, NAMES, range(count), tips[:count]) is None


def test_a_rest_on_the_way_is_no_landmark_once_the_artefact_is_known(scene: Scene) -> None:
    script = scene.visit(",".join(NAMES[:6]))
    in_the_air = scene["L2"] + np.array([0.0, 0.15, 0.1, 0.0, 0.0, 0.0])
    script.move(in_the_air, 0.6).rest(1.0).move(scene["S1"], 0.6).rest(1.0)
    attempt = scene.attempt(",".join(NAMES[:7]), script)
    assert attempt.landmarks == NAMES[:7]
    scene.check(attempt)
    assert any("treated as a pause" in line for line in attempt.said)


def test_a_landmark_that_is_left_out_does_not_shift_the_names(scene: Scene) -> None:
    visited = [*NAMES[:5], *NAMES[6:]]
    attempt = scene.attempt(",".join(NAMES), scene.visit(",".join(visited)))
    assert attempt.landmarks == visited
    assert attempt.run.missing == ("L2",)
    scene.check(attempt)


def test_the_rest_during_which_the_stream_began_counts_however_short(scene: Scene) -> None:
    """Who starts a moment late has the first landmark all the same."""
    script = Script(scene["O"]).rest(0.45).move(scene["M1"], 0.6).rest(1.0)
    attempt = scene.attempt("O,M1", script)
    assert attempt.landmarks == ["O", "M1"]
    scene.check(attempt)
    assert any("shortened" in line for line in attempt.said)


def test_too_few_landmarks_to_tell_are_pointed_out(scene: Scene) -> None:
    attempt = scene.attempt("O,M1,M2,L1", scene.visit("M1,M2"))
    assert attempt.landmarks == ["O", "M1"]
    assert "check its name" in attempt.run.notes["O"]
