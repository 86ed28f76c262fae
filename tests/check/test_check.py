"""A calibration is held against a few new rows: what changed is named, and sound rows are quiet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from checked_scene import checker, scene, shifted, with_joint_off
from simulated import (
    arm_named,
    dh_parameters,
    fixed_point_scene,
    perturbed,
    random_readings,
)

from suta_calib import InputError, Term
from suta_calib.check import Check, Checker, repaired
from suta_calib.check.checking import UNKNOWN
from suta_calib.measurements import Samples


def checked(term: Term) -> Check:
    return checker().check(term)


def test_sound_rows_are_quiet() -> None:
    found = [checked(term) for term in scene()[2]]
    assert sum(not check.unchanged for check in found) <= 1
    # Were the noise too small or too large, these would not be spread over all of 0 to 1.
    assert float(np.median([check.p for check in found])) > 0.1


@pytest.mark.parametrize("joint", range(1, 5))
def test_a_joint_whose_zero_slipped_is_named(joint: int) -> None:
    angle = math.radians(0.1)
    check = checked(with_joint_off(scene()[2][0], joint, angle))
    change = check.changed[0]
    amount, std = change.amounts["rad"]
    assert change.what == f"joint joint_{joint + 1}"
    assert amount == pytest.approx(-angle, abs=4 * std)
    assert change.p < 1e-4
    assert not check.assessment.usable
    assert f"zero of joint_{joint + 1}" in check.assessment.notes[0]


def test_an_instrument_that_was_moved_cannot_be_told_from_the_base() -> None:
    (change,) = checked(shifted(scene()[2][1], [1e-3, 0.0, 0.0])).changed
    assert {change.what, *change.instead} >= {"instrument", "base"}
    assert change.amounts["m"][0] == pytest.approx(1e-3, abs=4 * change.amounts["m"][1])


def test_a_bad_row_is_no_change() -> None:
    check = checked(shifted(scene()[2][2], [0.0, 5e-3, 0.0], rows=3))
    assert check.unchanged
    assert check.bad_rows == (scene()[2][2].poses.samples.origin[3],)
    assert check.assessment.level == "care"
    assert check.p > 0.01


def test_these_rows_say_what_they_would_have_shown() -> None:
    check = checked(scene()[2][3])
    shown = {power.what: power.amounts for power in check.power}
    assert 0.1e-3 < shown["instrument"]["m"] < 1e-3
    # A change of that size is found in nine of ten, and half of it in few.
    least = shown["joint joint_2"]["rad"]
    for factor, most, fewest in ((1.0, 20, 15), (0.4, 10, 0)):
        found = [checked(with_joint_off(t, 1, factor * least)).changed for t in scene()[2]]
        assert fewest <= sum(map(bool, found)) <= most


def some_off(rows: slice, joint: int = 1) -> Term:
    """Eighteen rows, some of them with a joint off by 0.1°."""
    term = checker().solution.problem.terms[0]
    both = [later.poses.samples for later in scene()[2][5:7]]
    term = term.over_poses(term.poses.with_samples(Samples.concatenate(both)))
    q = term.poses.samples.q.copy()
    q[rows, joint] += math.radians(0.1)
    return term.over_poses(term.poses.with_samples(replace(term.poses.samples, q=q)))


@pytest.mark.parametrize("joint", [1, 2])
def test_a_change_in_the_middle_of_the_rows_is_named_from_there_on(joint: int) -> None:
    term = some_off(slice(9, None), joint)
    checking = checker().checking(term)
    check = checking.run()
    (change,) = check.changed
    amount, std = change.amounts["rad"]
    assert change.what == f"joint joint_{joint + 1}"
    assert amount == pytest.approx(-math.radians(0.1), abs=4 * std)
    # Errors of one row may hide the first that changed.
    assert check.first in (8, 9, 10)
    assert change.since == term.poses.samples.origin[check.first]
    assert f"From {change.since} on: the zero of joint_{joint + 1}" in change.sentence
    assert repaired(checking, check).rows == 18 - check.first


def test_a_change_in_the_last_rows_is_no_row_of_bad_ones_and_bad_rows_are_no_change() -> None:
    check = checked(some_off(slice(14, None)))
    assert [change.what for change in check.changed] == ["joint joint_2"]
    assert check.first in (13, 14, 15)
    loose = np.random.default_rng(5).normal(0.0, 4e-3, (2, 3))
    check = checked(shifted(some_off(slice(0)), loose, rows=slice(16, None)))
    assert check.unchanged
    assert len(check.bad_rows) == 2


def test_rows_that_no_one_change_explains_name_no_culprit() -> None:
    """Each row is off another way, as of a loose target."""
    loose = np.random.default_rng(3).normal(0.0, 2e-3, (18, 3))
    check = checked(shifted(some_off(slice(0)), loose))
    assert [(change.what, dict(change.amounts)) for change in check.changed] == [(UNKNOWN, {})]
    assert not check.bad_rows


def test_what_the_rows_cannot_show_is_named() -> None:
    """A zero about whose axis the tip lies; and of one row, that it proves little."""
    checking = checker().checking(scene()[2][3].take([0]))
    joint = checking.start.problem.names.index("joint_6.offset")
    checking.start.jacobian[:, joint] = 0.0
    check = checking.run()
    shown = {power.what: power.amounts for power in check.power}
    assert {f"joint joint_{k}" for k in range(1, 7)} <= shown.keys()
    assert math.isinf(shown["joint joint_6"]["rad"])
    said = " ".join(check.assessment.notes)
    assert "cannot show a change of the zero of joint_6." in said
    assert "1 row proves little" in said
    assert "proves little" not in " ".join(checked(scene()[2][3]).assessment.notes)


def test_rows_of_a_kind_that_was_not_calibrated_are_refused() -> None:
    arm = arm_named("suta")
    with pytest.raises(InputError, match="tracked_point"):
        checked(fixed_point_scene(arm, {}, 4).exact())


def test_a_slipped_joint_is_repaired_nearly_as_well_as_by_a_calibration() -> None:
    """Errors all over the arm's range, with a joint off by 0.3° and ten rows."""
    arm, _, later = scene()
    before = perturbed(dh_parameters(arm), 1, 1e-3, 3e-3)
    now = before | {"joint_3.offset": before["joint_3.offset"] - math.radians(0.3)}
    rows = with_joint_off(later[4], 2, math.radians(0.3))
    checking = checker().checking(rows)
    check = checking.run()
    assert [change.what for change in check.changed] == ["joint joint_3"]
    repair = repaired(checking, check)
    q = random_readings(arm, np.random.default_rng(8), 200)

    def error(values: Mapping[str, float], of: Mapping[str, float]) -> float:
        """RMS of the tips, once laid over the true ones: where the base is, is a convention."""
        tips, true = (
            p - p.mean(axis=0)
            for p in (arm.forward(q, {n: values[n] for n in of})[1], arm.forward(q, of)[1])
        )
        left, _, right = np.linalg.svd(tips.T @ true)
        return float(np.sqrt(np.mean(np.sum((tips @ left @ right - true) ** 2, axis=1))))

    calibrated = error(repair.before.values, before)
    assert error(repair.before.values, now) > 5 * calibrated
    assert error(repair.solution.values, now) < 1.5 * calibrated
    std = repair.solution.estimates["joint_3.offset"].std
    assert std is not None
    off = repair.solution.values["joint_3.offset"] - now["joint_3.offset"]
    assert abs(off) < 4 * std
    # Other rows agree with it.
    again = Checker(repair.before, repair.solution.values, repair.solution.told)
    found = [again.check(with_joint_off(rows, 2, math.radians(0.3))) for rows in later[5:15]]
    assert sum(not check.unchanged for check in found) <= 1
