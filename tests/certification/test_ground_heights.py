"""Heights of all landmarks together against a drawing that counts them from the ground too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from certified_artefact import NOISE, Change, certified, moved, truth
from studies import first_of, of_size

from data.artefact.probed_artefact import csv_text, exact_rows
from suta_calib.arrays import FloatArray
from suta_calib.certification.points import CertificationOptions, read_raw_points
from suta_calib.certification.procedure import certify
from suta_calib.certification.result import Certification
from suta_calib.measurements import Artefact, read_artefact

DRAWN = CertificationOptions(drawing=truth())
MADE = 2e-5
SOUND = 30


def of_pillars(by: FloatArray | list[float]) -> Change:
    """Everything that is touched after the ground stands elsewhere."""
    return lambda feature, _name, _k, point: point + np.multiply(by, feature != "ground")


def leaning(turn: float) -> Change:
    return lambda feature, _n, _k, p: p + np.array([0, 0, turn * p[0] * (feature != "ground")])


def made(seed: int, scatter: FloatArray | float = MADE) -> Artefact:
    """A drawing that the workshop has missed, by so much in each coordinate."""
    random = np.random.default_rng(100 + seed)
    marks = {
        name: replace(mark, position=mark.position + scatter * random.standard_normal(3))
        for name, mark in truth().landmarks.items()
    }
    return Artefact("drawing", marks)


def told(found: Certification) -> list[str]:
    return [note for note in found.assessment.notes if note.startswith("All landmarks")]


@pytest.mark.parametrize("seed", first_of(range(2)))
@pytest.mark.parametrize(("size", "word"), [(3e-3, "higher"), (-3e-3, "lower")])
def test_a_ball_s_radius_that_is_taken_off_on_one_plane_alone(
    tmp_path: Path, size: float, word: str, seed: int
) -> None:
    options = CertificationOptions(drawing=made(seed))
    found = certified(tmp_path, moved([0, 0, size], "top"), options=options, seed=seed)
    assert found.assessment.level == "bad"
    (note,) = told(found)
    assert word in note
    assert "ball's radius" in note
    assert found.over_ground.height == pytest.approx(size, abs=4 * found.over_ground.std[0])
    assert found.damaged == ()


def test_a_move_beyond_the_workmanship_deserves_care(tmp_path: Path) -> None:
    """A tolerance says what is bad: without one, what would make a single pillar damaged."""
    move = of_pillars([0, 0, 2.5e-5])
    allowed = {None: {"care", "bad"}, 1e-4: {"care"}, 1.2e-5: {"bad"}}
    for seed in range(4):
        drawing = made(seed, 4e-6)
        for tolerance, levels in allowed.items():
            options = CertificationOptions(drawing=drawing, tolerance=tolerance)
            found = certified(tmp_path, move, options=options, seed=seed)
            assert found.assessment.level in levels
            assert len(told(found)) == 1
    # No workmanship makes up for it where there is none.
    assert certified(tmp_path, of_pillars([0, 0, 2e-5]), options=DRAWN).assessment.level == "bad"


def test_a_tilt_between_ground_and_pillars(tmp_path: Path) -> None:
    for seed in range(4):
        options = CertificationOptions(drawing=made(seed, 4e-6))
        found = certified(tmp_path, leaning(1e-3), options=options, seed=seed)
        assert found.over_ground.risen == "good"
        assert found.over_ground.tilted == "bad"
        (note,) = told(found)
        assert "tilted by 0.05" in note
        # What is lifted towards +x is turned about -y.
        np.testing.assert_allclose(found.over_ground.tilt, [0.0, -1e-3], atol=2e-4)


@pytest.mark.parametrize("seeds", of_size(6, SOUND))
@pytest.mark.parametrize(
    "scatter",
    [0.0, MADE, np.array([5e-6, 5e-6, 5e-5]), np.array([5e-5, 5e-5, 1e-6])],
    ids=["exact", "made", "heights worse", "heights better"],
)
def test_sound_sets_say_nothing(tmp_path: Path, scatter: FloatArray | float, seeds: int) -> None:
    found = [
        certified(tmp_path, options=CertificationOptions(drawing=made(seed, scatter)), seed=seed)
        for seed in range(seeds)
    ]
    # Six heights say little of how badly heights alone are made: at most 2 % then.
    assert sum(bool(told(each)) for each in found) <= (seeds // 15 if np.ndim(scatter) else 0)


@pytest.mark.parametrize("sets", of_size(35, 150))
def test_height_and_tilt_are_as_sure_as_they_are_said_to_be(
    tmp_path: Path, repository: Path, sets: int
) -> None:
    """Fifteen landmarks, so that their heights say how well heights are made."""
    drawing = read_artefact(repository / "data" / "suta" / "artefact.yaml")
    random, off, said = np.random.default_rng(5), list[FloatArray](), 0
    for seed in range(sets):
        exact = [
            (f, n, k, p + np.array([0, 0, by.get(n, 0.0)]))
            for by in [{name: MADE * random.standard_normal() for name in drawing.landmarks}]
            for f, n, k, p in exact_rows(drawing)
        ]
        path = tmp_path / "points.csv"
        path.write_text(csv_text(exact, NOISE, np.random.default_rng(seed)), encoding="utf-8")
        found = certify(read_raw_points(path), CertificationOptions(drawing=drawing)).over_ground
        said += found.level != "good"
        off.append(np.array([found.height, *found.tilt]) / found.std)
    # Student's t: 15 heights less three unknowns tell their scatter. And what the sets leave open.
    expected, within = np.sqrt(12 / 10), 3.0 / np.sqrt(2.0 * sets)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(off), axis=0)), expected, atol=within)
    assert said == 0


@pytest.mark.parametrize("seeds", of_size(6, 15))
def test_an_artefact_against_its_own_certificate(tmp_path: Path, seeds: int) -> None:
    """Its drawing was measured over a ground that was touched as badly."""
    said = 0
    for seed in range(seeds):
        earlier = certified(tmp_path, seed=seed).artefact()
        options = CertificationOptions(drawing=earlier)
        said += len(told(certified(tmp_path, options=options, seed=1000 + seed)))
    assert said == 0
    moved = certified(tmp_path, of_pillars([0, 0, 2e-5]), options=options)
    assert moved.assessment.level == "bad"
    assert told(moved)


def test_three_landmarks_tell_it_too(tmp_path: Path) -> None:
    kept = {name: mark for name, mark in truth().landmarks.items() if name in ("O", "S1", "S2")}
    options = CertificationOptions(drawing=Artefact("three", kept))
    assert not told(certified(tmp_path, options=options))
    found = certified(tmp_path, moved([0, 0, 3e-3], "top"), options=options)
    assert found.assessment.level == "bad"
    assert len(told(found)) == 1


def test_without_a_drawing_nothing_is_asked(tmp_path: Path) -> None:
    assert certified(tmp_path, moved([0, 0, 3e-3], "top")).over_ground is None
