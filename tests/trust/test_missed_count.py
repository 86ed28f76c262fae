"""A step of one joint in some rows, of a size that nobody knows, is found and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Scene, dh_parameters
from terms_cases import SIGMA, noises, scene

from suta_calib import Problem, Samples, SolverOptions, solve
from suta_calib.arrays import BoolArray
from suta_calib.terms import Term
from suta_calib.trust.hypotheses.missed_count import MissedCount
from suta_calib.trust.rereading import explaining_reading

JOINT = 4


def samples_of(s: Scene) -> Samples:
    return s.samples(SIGMA)[0]


def stepped(s: Scene, rows: BoolArray, size: float) -> Term:
    """With readings of one joint that are too little by so much, rad, in some rows."""
    samples = samples_of(s)
    q = samples.q.copy()
    q[:, JOINT] -= size * rows
    return s.term(replace(samples, q=q), *noises(SIGMA, False))


def beyond(s: Scene, share: float) -> BoolArray:
    """The rows in which the joint is farthest."""
    q = samples_of(s).q[:, JOINT]
    return np.asarray(q > np.quantile(q, share))


# Of few touches at each of several placements, some steps are too large to be sorted.
@pytest.mark.parametrize(
    ("name", "parts"),
    [(name, parts) for name in ("tracked_point", "hand_eye") for parts in (10, 4, -3)]
    + [(name, parts) for name in ("landmark", "pairwise_distance") for parts in (10, -3)],
)
def test_a_wrap_that_was_missed_is_undone(name: str, parts: int) -> None:
    s = scene(name)
    # Which of two parts of the rows is wrong, registration says: the smaller.
    rows = beyond(s, 0.6 if parts > 0 else 0.75)
    ((sentence, (term,)),) = MissedCount().readings(Problem([stepped(s, rows, 2 * np.pi / parts)]))
    way = "little" if parts > 0 else "much"
    assert sentence.startswith(
        f"joint_5 reads {360 / abs(parts):.4f} deg too {way} in {rows.sum()} of {len(rows)} rows, "
        "where it truly is above"
    )
    np.testing.assert_allclose(term.poses.samples.q, samples_of(s).q, atol=1e-9)


def test_a_count_that_stays_lost_is_told_by_its_rows_and_is_the_cause() -> None:
    s = scene("tracked_point with orientation")
    count = len(samples_of(s))
    rows = (np.arange(count) >= 8) & (np.arange(count) < 17)
    term = stepped(s, rows, 2 * np.pi / 6)
    cause = explaining_reading(
        solve(Problem([term], dh_parameters(s.arm)), SolverOptions(starts=1))
    )
    assert cause is not None
    origin = samples_of(s).origin
    assert cause.description == (
        f"joint_5 reads 60.0000 deg too little from {origin[8]} to {origin[16]}: "
        "a step that its count missed"
    )


def test_a_tool_of_no_length_does_not_hide_a_step_of_the_wrist() -> None:
    """Without a tool no turn of the wrist would change a distance: no unit makes it so short."""
    s = scene("pairwise_distance")
    term = stepped(s, beyond(s, 0.6), 2 * np.pi / 10)
    cause = explaining_reading(
        solve(Problem([term], dh_parameters(s.arm)), SolverOptions(starts=1))
    )
    assert cause is not None
    assert cause.description.startswith("joint_5 reads 36.0000 deg too little in ")


def test_rows_without_an_order_have_no_count_that_missed_a_step() -> None:
    """A bad plug does that, and only says so now and then."""
    s = scene("tracked_point")
    rows = np.random.default_rng(1).random(len(samples_of(s))) < 0.4
    assert not [*MissedCount().readings(Problem([stepped(s, rows, 2 * np.pi / 10)]))]


@pytest.mark.parametrize("name", ["tracked_point", "hand_eye", "landmark", "pairwise_distance"])
def test_sound_rows_have_no_step(name: str) -> None:
    s = scene(name)
    assert not [*MissedCount().readings(Problem([stepped(s, beyond(s, 0.6), 0.0)]))]
