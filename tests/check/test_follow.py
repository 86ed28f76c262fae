"""Rows one by one: sound ones never raise an alarm, a change is told after a few."""

from __future__ import annotations

import math

import pytest
from checked_scene import checker, scene, shifted, with_joint_off

from suta_calib.check import Follow


def test_sound_rows_never_raise_an_alarm_and_one_bad_row_does_not() -> None:
    follow = Follow(checker())
    later = scene()[2]
    step = follow.add(later[0])
    assert not step.changed
    step = follow.add(shifted(later[1].take([0, 1, 2]), [0.0, 4e-3, 0.0], rows=1))
    assert not step.changed
    assert step.bad_rows == (later[1].poses.samples.origin[1],)
    assert step.rows == 12


def test_a_joint_that_slipped_is_told_after_a_few_rows_and_named() -> None:
    follow = Follow(checker())
    rows = with_joint_off(scene()[2][2], 2, math.radians(0.15))
    needed = 0
    for needed in range(1, len(rows.poses) + 1):
        if follow.add(rows.take([needed - 1])).changed:
            break
    assert 2 <= needed < len(rows.poses)
    check = follow.check()
    assert not check.unchanged
    # Few rows tell it from little else.
    (first, *_) = check.changed
    assert "joint joint_3" in (first.what, *first.instead)


@pytest.mark.slow
def test_rows_that_never_end_cost_no_more_than_the_first_and_hide_no_change() -> None:
    """Sound ones over several stretches, and then a joint that slips."""
    follow, later = Follow(checker()), scene()[2]
    for term in later[:14]:
        assert not follow.add(term).changed
    # Of 126 rows with three numbers each, those of the last stretch are left.
    assert len(follow._rows) < 81
    step = follow.add(with_joint_off(later[15], 2, math.radians(0.3)))
    assert step.changed
    assert 126 < step.rows <= 135
    (first, *_) = follow.check().changed
    assert "joint joint_3" in (first.what, *first.instead)
