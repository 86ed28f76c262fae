"""Readings of a size that nobody knows: a step, a factor of depths, a unit of a length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import Scene, dh_parameters
from terms_cases import SIGMA, noises, scene

from suta_calib import ArmPoses, Problem, Samples, Solution, SolverOptions, solve
from suta_calib.arrays import BoolArray
from suta_calib.terms import Term
from suta_calib.trust.hypotheses.missed_count import MissedCount
from suta_calib.trust.hypotheses.other_camera import OtherCamera
from suta_calib.trust.rereading import Rereading, explaining_reading

ONCE = SolverOptions(starts=1)
FIFTY = SolverOptions(starts=1, max_iterations=50)
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
        "in which its true angle is above"
    )
    np.testing.assert_allclose(term.poses.samples.q, samples_of(s).q, atol=1e-9)


def test_a_count_that_stays_lost_is_told_by_its_rows_and_is_the_cause() -> None:
    s = scene("tracked_point with orientation")
    count = len(samples_of(s))
    rows = (np.arange(count) >= 8) & (np.arange(count) < 17)
    term = stepped(s, rows, 2 * np.pi / 6)
    cause = explaining_reading(solve(Problem([term], dh_parameters(s.arm)), ONCE))
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
    cause = explaining_reading(solve(Problem([term], dh_parameters(s.arm)), ONCE))
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


# ── poses of another camera ──


def fitted(s: Scene, factor: float) -> Solution:
    samples = s.samples(SIGMA)[0]
    assert samples.position is not None
    samples = replace(samples, position=samples.position * [1.0, 1.0, factor])
    return solve(Problem([s.term(samples, *noises(SIGMA, False))], dh_parameters(s.arm)), ONCE)


@pytest.mark.parametrize("name", ["hand_eye", "tracked_point with orientation"])
@pytest.mark.parametrize(("factor", "said"), [(1.08, "too far"), (0.9, "too near")])
def test_the_factor_of_all_depths_is_found(name: str, factor: float, said: str) -> None:
    s = scene(name)
    solution = fitted(s, factor)
    ((sentence, (term,)),) = OtherCamera().readings(solution.problem)
    depth = s.samples(SIGMA)[0].position
    found = term.poses.samples.position
    assert depth is not None
    assert found is not None
    np.testing.assert_allclose(found, depth, rtol=1e-3, atol=1e-9)
    cause = explaining_reading(solution)
    assert cause is not None
    assert cause.description == sentence
    by, _, rest = sentence.removeprefix("targets are ").partition(" % ")
    assert float(by) == pytest.approx(100 * abs(factor - 1), abs=0.05)
    assert rest.startswith(said)


def test_right_depths_are_left_alone() -> None:
    assert not [*OtherCamera().readings(fitted(scene("hand_eye"), 1.0).problem)]
    assert not [*OtherCamera().readings(fitted(scene("tracked_point"), 1.0).problem)]


# ── a length of the arm ──


def cause(name: str, length: str, factor: float) -> tuple[float, Rereading | None]:
    """Of data of an arm, one of whose lengths stands in another unit; and that length, mm."""
    s = scene(name)
    right = s.arm.parameters[length].nominal
    arm = s.arm.at({length: factor * right})
    term = s.term(s.samples(SIGMA)[0], *noises(SIGMA, False))
    wrong = term.over_poses(ArmPoses(arm, term.poses.samples))
    return 1e3 * right, explaining_reading(solve(Problem([wrong], dh_parameters(arm)), FIFTY))


@pytest.mark.parametrize("name", ["tracked_point", "hand_eye"])
@pytest.mark.parametrize("factor", [10.0, 0.01])
def test_a_length_in_another_unit_is_named(name: str, factor: float) -> None:
    right, found = cause(name, "joint_4.z", factor)
    assert found is not None
    assert found.description == (
        f"joint_4.z is {right:.6g} mm instead of {factor * right:.6g} mm: a wrong unit in the URDF"
    )
    assert found.after < 0.1 * found.before


def test_a_length_in_its_own_unit_is_not() -> None:
    _, found = cause("tracked_point", "joint_4.z", 1.0)
    assert found is None
