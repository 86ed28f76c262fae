"""The cause of known faults is named with its size, and no other cause."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from judging import assessed
from simulated import (
    PLAIN,
    Spread,
    arm_named,
    artefact,
    artefact_scene,
    perturbed,
    placements,
    tracked_scene,
)
from sound_sets import ARM, BOARD, MOVING, SHEET, TRACKED, TRUTH, UNKNOWN, Sound, of_scene

from suta_calib import ParameterSet, Problem, Selection, SolverOptions, solve
from suta_calib.analysis.model_selection.selection import choose_model
from suta_calib.assessment import Assessment
from suta_calib.terms import Term
from suta_calib.trust.hypotheses.exchanged_marks import ExchangedMarks
from suta_calib.trust.hypotheses.measured_in_motion import per_row
from suta_calib.trust.hypotheses.stretch import stretched
from suta_calib.trust.simulated_faults import displaced, with_columns


def judged(term: Term, unknown: ParameterSet = UNKNOWN) -> Assessment:
    return assessed(solve(Problem([term], unknown), SolverOptions(starts=1, confirm=False)))


def dragged(term: Term, ratio: float = 0.01) -> Term:
    """wrist_1 drags wrist_2 along."""
    q = term.poses.samples.q.copy()
    q[:, 4] -= ratio * q[:, 3]
    return with_columns(term, q=q)


def wobbling(term: Term, size: float = 0.03) -> Term:
    """The first joint's axis goes round a circle of this radius, deg, twice a turn."""
    angle = 2.0 * term.poses.samples.q[:, 0]
    turn = np.zeros((len(angle), 6))
    turn[:, 3:5] = np.radians(size) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    _, position = term.poses.at(TRUTH)
    # About the joint's own origin, 89 mm above the base.
    turn[:, :3] = np.cross(turn[:, 3:], position - [0.0, 0.0, 0.089159])
    return displaced(term, TRUTH, turn)


def old(term: Term, late: float) -> Term:
    """Readings that are older than what the instrument saw, by so much of a row."""
    q = term.poses.samples.q
    rows = np.arange(len(q), dtype=float)
    return with_columns(term, q=np.stack([np.interp(rows - late, rows, c) for c in q.T], axis=1))


@pytest.mark.parametrize(
    ("make", "said", "size"),
    [
        (lambda: dragged(TRACKED.make(1)), "a coupling of two joints: wrist_2_joint moves", 0.01),
        (lambda: wobbling(TRACKED.make(1)), "an axis of shoulder_pan_joint that", 0.0424),
        (lambda: old(MOVING.make(1), 0.2), "taken before the observations", 0.2),
        (lambda: old(MOVING.make(1), -0.1), "taken after the observations", 0.1),
    ],
    ids=["coupling", "wobble", "late", "early"],
)
def test_the_cause_is_said_alone_with_its_size(
    make: Callable[[], Term], said: str, size: float
) -> None:
    answer = judged(make())
    assert answer.level != "good"
    (sentence,) = (note for note in answer.notes if said in note)
    (found,) = re.findall(r" by \+?([\d.]+) ± ", sentence)
    assert float(found) == pytest.approx(size, rel=0.03)
    others = ("look like", "encoder slip", "was moved", "drifted", "crept")
    rest = [note for note in answer.notes if note != sentence]
    assert not any(word in note for note in rest for word in others)


@pytest.mark.parametrize("sound", [TRACKED, MOVING], ids=["at rest", "moving"])
def test_of_sound_data_nothing_is_said(sound: object) -> None:
    notes = judged(TRACKED.make(2) if sound is TRACKED else MOVING.make(2)).notes
    assert not [n for n in notes if "validation data" not in n and "scale" not in n]


def test_extend_frees_the_coupling_and_no_other() -> None:
    chosen = choose_model([dragged(TRACKED.make(3))], UNKNOWN, families=False)
    assert chosen.added == ("wrist_2_joint.coupling[wrist_1_joint]",)
    found = chosen.solution.estimates[chosen.added[0]]
    assert found.std is not None
    assert abs(found.value - 0.01) < 3 * found.std


def test_a_coupling_is_found_where_an_artefact_is_touched() -> None:
    """Also through distances, whose rows share touches."""
    arm = arm_named("suta")
    unknown = arm.select(Selection(("*.offset",), bound_rad=0.26))
    truth = perturbed(unknown, 3, angle=5e-3) | {"joint_5.coupling[joint_4]": 0.01}
    for kind in ("landmark", "pairwise_distance"):
        scene = artefact_scene(kind, arm, truth, artefact(8), placements(5), 2, tilt=0.4)
        term = scene.term(scene.samples(Spread(position=1e-4), 1)[0], PLAIN, PLAIN)
        solution = solve(Problem([term], unknown), SolverOptions(starts=1, confirm=False))
        notes = assessed(solution).notes
        assert any("joint_5 moves by +0.01" in note for note in notes), notes


def test_only_an_arm_that_moves_smoothly_has_a_time_offset() -> None:
    rng, one_file = np.random.default_rng(1), np.zeros(60)
    time = np.linspace(0, 6, 60)[:, None]
    path = np.sin(time + np.arange(6))
    steps = per_row(path, one_file)
    assert steps is not None
    np.testing.assert_allclose(steps[1:-1], np.cos(time + np.arange(6))[1:-1] * 0.1017, atol=2e-3)
    assert per_row(rng.uniform(-2, 2, (60, 6)), one_file) is None
    to_and_fro = path * np.where(np.arange(60) % 2, 1.0, -1.0)[:, None]
    assert per_row(to_and_fro, one_file) is None
    assert per_row(path[:6], one_file[:6]) is None


@pytest.mark.parametrize("longer", [1.004, 1.012])
@pytest.mark.parametrize("sound", [SHEET, BOARD], ids=["artefact", "board"])
def test_a_print_that_is_longer_along_x_is_suspected_before_encoders(
    sound: Sound, longer: float
) -> None:
    # The file says what was drawn, which is shorter than what the paper has.
    answer = judged(stretched(sound.make(1), (1.0 / longer, 1.0)), sound.unknown)
    (sentence,) = (note for note in answer.notes if "stretched" in note)
    (found, std) = map(float, re.findall(r"along x are ([\d.]+) ± ([\d.]+) % longer", sentence)[0])
    assert abs(found - 100 * (longer - 1.0)) < 3 * std
    assert not any("encoder" in note for note in answer.notes)


@pytest.mark.parametrize("rows", [20, 40])
def test_exchanged_targets_are_named_whether_the_fit_converged_or_not(rows: int) -> None:
    targets = [(0.05, 0, 0.02, 0, 0, 0), (-0.03, 0.04, 0.03, 0, 0, 0), (0.01, -0.03, 0.05, 0, 0, 0)]
    sound = of_scene(tracked_scene(ARM, TRUTH, rows, targets=targets))
    spoilt = ExchangedMarks().spoil(sound.make(1), TRUTH, np.random.default_rng(0))
    answer = judged(spoilt.data)
    assert answer.level == "bad"
    assert (
        f"The labels of targets T0 and T1 seem to be exchanged from row {3 * rows // 2} on"
        in answer.notes[0]
    )
