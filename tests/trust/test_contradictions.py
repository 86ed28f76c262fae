"""What contradicts an answer, and which reading of the data explains them: on simulated lies."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from judging import assessed, notes_on
from offset_arm import NOISE, ONCE, fitted_and_held_out, truth_of, unknowns
from simulated import Scene, arm_named, artefact, artefact_scene, placements, tracked_scene

from suta_calib import Assessment, Noise, Problem, Samples, SolverOptions, Term, solve
from suta_calib.errors import SamplesError
from suta_calib.job import CalibrationJob
from suta_calib.measurements import Artefact, read_yaml
from suta_calib.trust.hypotheses.rounded import Rounded
from suta_calib.trust.hypotheses.sorted_column import SortedColumn
from suta_calib.trust.hypotheses.stuck_instrument import StuckInstrument

Change = Callable[[Samples], Samples]
LEARNT = Noise()


@pytest.fixture(scope="module")
def scenes() -> tuple[Scene, Scene]:
    return fitted_and_held_out()


def judged(
    scenes: tuple[Scene, Scene],
    change: Change = lambda samples: samples,
    held_out: Change | None = None,
    *,
    priors: bool = True,
    noise: Noise = LEARNT,
    options: SolverOptions = ONCE,
) -> Assessment:
    """The assessment of a calibration whose samples were changed."""
    fitted, validation = (s.samples(NOISE, seed=k)[0] for k, s in enumerate(scenes))
    arm = scenes[0].arm
    terms = [scenes[0].term(change(fitted), noise)]
    validated = [scenes[1].term((held_out or change)(validation), noise)]
    return assessed(solve(Problem(terms, unknowns(arm, priors=priors)), options), validated)


def joint(k: int, change: Callable[[Any], Any]) -> Change:
    def changed(samples: Samples) -> Samples:
        q = samples.q.copy()
        q[:, k] = change(q[:, k])
        return replace(samples, q=q)

    return changed


def seen(change: Callable[[Any], Any]) -> Change:
    def changed(samples: Samples) -> Samples:
        assert samples.position is not None
        return replace(samples, position=change(samples.position.copy()))

    return changed


def late(samples: Samples) -> Samples:
    kept = np.arange(len(samples) - 1)
    read, observed = samples.take(kept + 1), samples.take(kept)
    return replace(read, position=observed.position, rotation=observed.rotation)


def moved(position: Any) -> Any:
    position[len(position) // 2 :] += [0.05, 0.0, 0.0]
    return position


@pytest.mark.parametrize("priors", [True, False])
def test_honest_data_are_not_accused(scenes: tuple[Scene, Scene], priors: bool) -> None:
    found = judged(scenes, priors=priors)
    assert found.usable
    said = " ".join(found.notes)
    assert "far better" not in said
    assert "times " not in said
    assert "standard deviations from" not in said


def later_from(share: float, samples: Samples) -> Samples:
    """Three rows of the readings missing from there on."""
    kept = np.arange(len(samples) - 3)
    return replace(samples.take(kept), q=samples.q[kept + 3 * (kept >= share * len(kept))])


# One of each sort: `test_contract` has every hypothesis. Where rows are missing must be told too.
LIES: dict[str, tuple[Change, str]] = {
    "sign": (joint(1, np.negative), "joint_2 counts the other way"),
    "late": (late, "one row"),
    "moved": (seen(moved), "was moved"),
    "missing": (partial(later_from, 0.5), "among the joints' readings, between row 13"),
    "missing early": (partial(later_from, 0.33), "among the joints' readings, between row 7"),
    "dead": (joint(3, lambda q: np.full_like(q, q.mean())), "joint_4 reads the same in every row"),
}
BOTH = ("sign", "late", "moved")


@pytest.mark.parametrize(
    ("lie", "priors"), [(lie, False) for lie in LIES] + [(lie, True) for lie in BOTH]
)
def test_a_lie_is_refused_and_its_cause_named(
    scenes: tuple[Scene, Scene], lie: str, priors: bool
) -> None:
    change, cause = LIES[lie]
    options = replace(ONCE, max_iterations=10) if lie == "dead" else ONCE
    found = judged(scenes, change, priors=priors, options=options)
    assert not found.usable
    assert cause in " ".join(found.notes)


@pytest.mark.parametrize("rows", [2, 8])
def test_an_instrument_that_repeats_itself_is_said(scenes: tuple[Scene, Scene], rows: int) -> None:
    def lost(position: Any) -> Any:
        position[11 : 11 + rows] = position[10]
        return position

    found = judged(scenes, seen(lost), held_out=lambda samples: samples, priors=False)
    (said,) = (note for note in found.notes if "repeat its last value" in note)
    assert said.startswith(f"{rows} rows of tracked point")


def test_an_arm_that_rests_may_show_the_same_again(scenes: tuple[Scene, Scene]) -> None:
    samples = scenes[0].samples(NOISE, seed=0)[0]
    twice = samples.take(np.repeat(np.arange(len(samples)), 2))
    assert not [*StuckInstrument().of_terms([scenes[0].term(twice)])]


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_another_unit_is_refused_before_anything_is_solved(
    scenes: tuple[Scene, Scene], factor: float
) -> None:
    with pytest.raises(SamplesError, match="is the unit right"):
        judged(scenes, seen(lambda p: factor * p))


def test_a_few_rows_in_order_accuse_nobody(scenes: tuple[Scene, Scene]) -> None:
    few = scenes[0].samples(NOISE, seed=0)[0].take(np.arange(5))
    assert not [*SortedColumn().of_terms([scenes[0].term(joint(2, np.sort)(few))])]


def to_the_degree(q: np.ndarray) -> np.ndarray:
    return np.radians(np.round(np.degrees(q)))


def test_readings_that_were_rounded_are_told_from_an_arm_sent_there(
    scenes: tuple[Scene, Scene],
) -> None:
    """Whole degrees scatter the tip by millimetres, unless the arm truly stood there."""
    found = judged(scenes, lambda s: replace(s, q=to_the_degree(s.q)))
    said = "joint_5, joint_6 are in steps of 1 deg. This rounding moves the tip by"
    assert said in " ".join(found.notes)
    there = replace(scenes[0], q=to_the_degree(scenes[0].q))
    arm, truth = there.arm, truth_of(there.arm)
    R, p = arm.forward(there.q, truth)
    there = replace(there, rotation=R, position=p)
    sent = Problem([there.term(there.samples(NOISE)[0])], unknowns(arm, priors=True))
    assert not [*Rounded().matches(solve(sent, ONCE))]


@pytest.fixture(scope="module")
def touches() -> Scene:
    """Landmarks touched at four placements, each placement a file."""
    arm = arm_named("suta")
    return artefact_scene("landmark", arm, truth_of(arm), artefact(7, tilt=0.3), placements(4))


def said_of(touches: Scene, samples: Samples) -> str:
    term = touches.term(samples)
    return notes_on(solve(Problem([term], unknowns(touches.arm, priors=False)), ONCE))


def in_files(samples: Samples) -> Samples:
    """A file for each placement."""
    rows = enumerate(samples.labels["placement"])
    return replace(samples, origin=tuple(f"{place}.csv:{row}" for row, place in rows))


def labels_late(rows: int, samples: Samples) -> Samples:
    """What was touched stands some rows too late, in the first two files."""
    parts = []
    for place in dict.fromkeys(samples.labels["placement"].tolist()):
        mine = samples.take(samples.labels["placement"] == place)
        by = rows if place in ("P0", "P1") else 0
        kept = np.arange(len(mine) - by)
        parts.append(replace(mine.take(kept), q=mine.q[kept + by]))
    return Samples.concatenate(parts)


@pytest.mark.parametrize(
    ("rows", "cause"), [(1, "one row late in P0.csv"), (0, ""), (-1, "the opposite order")]
)
def test_what_was_touched_in_another_order_is_named(touches: Scene, rows: int, cause: str) -> None:
    samples = in_files(touches.samples(NOISE)[0])
    if rows < 0:
        samples = replace(samples, q=samples.q.reshape(4, 7, -1)[:, ::-1].reshape(28, -1))
    elif rows:
        late_files = labels_late(rows, samples)
        first = late_files.labels["placement"] == "P0"
        others = samples.take(samples.labels["placement"] != "P0")
        samples = Samples.concatenate([late_files.take(first), others])
    said = said_of(touches, samples)
    assert cause in said
    assert ("far better" in said) == bool(cause)


def test_a_mirrored_artefact_is_named(touches: Scene) -> None:
    assert touches.artefact is not None
    marks = {
        name: replace(mark, position=mark.position * [-1.0, 1.0, 1.0])
        for name, mark in touches.artefact.landmarks.items()
    }
    lie = replace(touches, artefact=Artefact("mirrored", marks))
    assert "the artefact is mirrored" in said_of(lie, in_files(touches.samples(NOISE)[0]))


@pytest.mark.parametrize("on", [False, True])
def test_landmarks_that_are_counted_from_one_too_many_are_named(touches: Scene, on: bool) -> None:
    """Within each letter, or on from the last of one letter to the first of the next."""
    names = ("L1", "L2", "L3", "M1", "M2", "S1", "S2")
    assert touches.artefact is not None
    marks = dict(zip(names, touches.artefact.landmarks.values(), strict=True))
    lettered = Artefact("lettered", {n: replace(m, name=n) for n, m in marks.items()})
    rings = [names] if on else [names[:3], names[3:5], names[5:]]
    wrong = {a: b for r in rings for a, b in zip(r, (*r[1:], r[0]), strict=True)}
    samples = in_files(touches.samples(NOISE)[0])
    order = dict(zip(touches.artefact.landmarks, names, strict=True))
    named = np.array([wrong[order[n]] for n in samples.labels["landmark"].tolist()])
    samples = replace(samples, labels={**samples.labels, "landmark": named})
    said = said_of(replace(touches, artefact=lettered), samples)
    assert "if the landmarks' numbers are one too high" in said
    assert ("counted on from one letter to the next" in said) == on


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_gross_rows_that_least_squares_follow_are_said(
    scenes: tuple[Scene, Scene], share: float
) -> None:
    samples = scenes[0].samples(replace(NOISE, outliers=share), seed=3)[0]
    assert ("Run suta-calib outliers" in said_of(scenes[0], samples)) == (share > 0)


def test_an_instrument_that_was_moved_before_the_held_out_rows_is_said(
    scenes: tuple[Scene, Scene],
) -> None:
    found = judged(scenes, held_out=seen(lambda p: p + np.array([0.05, 0.0, 0.0])))
    assert not found.usable
    assert "or the artefact was moved" in " ".join(found.notes)


def test_validation_that_repeats_the_calibration_is_no_validation(
    scenes: tuple[Scene, Scene],
) -> None:
    term: Term = scenes[0].term(scenes[0].samples(NOISE)[0])
    solution = solve(Problem([term], unknowns(scenes[0].arm, priors=True)), ONCE)
    assert "no row was held out" in notes_on(solution, [term.take(np.arange(len(term.poses)))])


def test_noise_that_is_ten_times_the_stated_is_refused(scenes: tuple[Scene, Scene]) -> None:
    found = judged(scenes, noise=Noise(sigma=5e-6))
    assert not found.usable
    assert "that the job states" in " ".join(found.notes)


@pytest.mark.parametrize(("far", "said"), [(0.05, True), (4e-4, False)])
def test_one_row_that_outweighs_all_others_is_said(
    scenes: tuple[Scene, Scene], far: float, said: bool
) -> None:
    """Under one in a hundred, which plain least squares follow all the same."""
    scene = tracked_scene(scenes[0].arm, truth_of(scenes[0].arm), 150)
    samples = scene.samples(NOISE, seed=2)[0]
    assert samples.position is not None
    position = samples.position.copy()
    position[30, 0] += far
    for huber in (np.inf, 1e-3):
        term = scene.term(replace(samples, position=position), Noise(huber=huber))
        notes = assessed(solve(Problem([term], unknowns(scene.arm, priors=False)), ONCE)).notes
        named = any(note.startswith("1 of 150 position residuals are more") for note in notes)
        # Where it is believed less, it decides nothing.
        assert named == (said and np.isinf(huber))


@pytest.mark.parametrize("share", [0.97, 1.0])
def test_a_sheet_that_was_printed_to_fit_the_page_is_named(
    share: float, repository: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "arm"
    shutil.copytree(repository / "examples" / "so101_printed_sheet", folder)
    artefact = read_yaml(folder / "artefact.yaml").data
    for landmark in artefact["landmarks"].values():
        landmark["position_mm"] = [x / share for x in landmark["position_mm"]]
    # Nobody held a ruler to it.
    del artefact["scale_ppm"]
    (folder / "artefact.yaml").write_text(yaml.safe_dump(artefact), encoding="utf-8")
    assessment = CalibrationJob.load(folder / "calibration.yaml").run().assessment
    named = [note for note in assessment.notes if "printed to fit the page" in note]
    assert bool(named) == (share != 1.0)
    assert all("printed sheet seems to be" in note and "shorter along x" in note for note in named)
    assert assessment.level == ("care" if named else "good")
