"""What a touch is worth on each kind of feature: holes and side may be touched worse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from certified_artefact import NOISE, TRUE_POSITIONS, Change, certified, positions, truth

from suta_calib.arrays import FloatArray
from suta_calib.certification.noise import ProbingNoise, scatter_of_holes
from suta_calib.certification.points import PLAIN, CertificationOptions
from suta_calib.certification.result import Certification
from suta_calib.certification.scatter import Scatter

STATED = CertificationOptions(sigma=NOISE)
MANY = 40


def worse(feature: str, sigma: float, seed: int) -> Change:
    """Touches of this feature scatter more than all others."""
    random = np.random.default_rng(1000 + seed)

    def change(touched: str, name: str, index: int, point: FloatArray) -> FloatArray:
        del name, index
        return point + sigma * random.standard_normal(3) * (touched == feature)

    return change


def sets(
    folder: Path, feature: str, sigma: float, options: CertificationOptions, count: int = MANY
) -> list[Certification]:
    return [
        certified(folder, worse(feature, sigma, seed), options=options, seed=seed)
        for seed in range(count)
    ]


def standardised(found: list[Certification], axes: slice) -> float:
    """Root mean square of error over standard deviation; the origin has none in x and y."""
    ratios = [
        (positions(each) - TRUE_POSITIONS)[1:, axes]
        / np.array([m.std for m in each.landmarks])[1:, axes]
        for each in found
    ]
    return float(np.sqrt(np.mean(np.square(ratios))))


@pytest.mark.parametrize("options", [PLAIN, STATED], ids=["learnt", "stated"])
@pytest.mark.parametrize("sigma", [0.0, 4e-6, 1e-5])
def test_centres_are_as_sure_as_the_touches_of_holes(
    tmp_path: Path, sigma: float, options: CertificationOptions
) -> None:
    found = sets(tmp_path, "hole", sigma, options)
    assert 0.8 < standardised(found, slice(0, 2)) < 1.25
    assert 0.8 < standardised(found, slice(2, 3)) < 1.25
    learnt = np.median([each.probing.of("hole") for each in found])
    assert learnt == pytest.approx(np.hypot(sigma, NOISE), rel=0.2)
    # Tops and flats have no part in it.
    assert np.median([each.noise for each in found]) == pytest.approx(NOISE, rel=0.2)


def test_holes_touched_ten_times_worse_are_told(tmp_path: Path) -> None:
    found = sets(tmp_path, "hole", 1e-5, CertificationOptions(drawing=truth()), 10)
    assert {each.assessment.level for each in found} == {"care"}
    assert all("diagonals of the holes" in each.assessment.notes[0] for each in found)
    # Few tell less of it than the planes do of theirs: wider intervals.
    assert all(each.coverage_factor > 2.15 for each in found)


def test_sound_sets_say_nothing_of_it(tmp_path: Path) -> None:
    """A touch in a thousand is called wrong where none is; holes and side are not accused."""
    for options in (PLAIN, STATED):
        found = sets(tmp_path, "hole", 0.0, options, 60)
        assert not any(each.damaged for each in found)
        assert all(each.assessment.level == "good" for each in found if not each.wrong_touches)
        assert sum(bool(each.wrong_touches) for each in found) <= 4
        assert sum(bool(each.probing.by_kind) for each in found) <= 12


def test_one_damaged_pillar_makes_no_noise(tmp_path: Path) -> None:
    def astray(feature: str, name: str, index: int, point: FloatArray) -> FloatArray:
        return point + np.array([4e-5 * ((feature, name, index) == ("hole", "L1", 1)), 0, 0])

    for seed in range(10):
        found = certified(tmp_path, astray, seed=seed)
        assert found.damaged == ("L1",)
        assert found.probing.of("hole") < 2 * NOISE


def test_a_rough_side_makes_the_direction_unsure(tmp_path: Path) -> None:
    smooth, found = certified(tmp_path), sets(tmp_path, "side", 5e-6, PLAIN)
    assert sum("side is rougher" in " ".join(e.assessment.notes) for e in found) > 0.9 * MANY
    assert np.median([each.heading_std for each in found]) > 3 * smooth.heading_std
    assert 0.8 < standardised(found, slice(0, 2)) < 1.25


def test_a_pillar_beyond_the_others_does_not_count() -> None:
    random = np.random.default_rng(0)
    uneven = 2e-6 * random.standard_normal((200, 2))
    assert scatter_of_holes(uneven).sigma == pytest.approx(2e-6, rel=0.1)
    uneven[:20] += 1e-3
    assert scatter_of_holes(uneven).freedom == 360
    assert scatter_of_holes(uneven).sigma == pytest.approx(2e-6, rel=0.1)
    assert scatter_of_holes(uneven[:4]).freedom == 0
    assert Scatter(0.0, 0).sigma == 0.0


def test_no_feature_is_worth_more_than_the_planes() -> None:
    noise = ProbingNoise(1e-6, 1e-6, 50.0)
    assert noise.beside("hole", Scatter(30 * 1e-14, 30)).of("hole") == 1e-6
    assert noise.beside("hole", Scatter(3 * 1e-8, 3)).of("hole") == 1e-6
    own = noise.beside("hole", Scatter(30 * 1e-10, 30))
    assert own.of("hole") == pytest.approx(1e-5)
    assert (own.of("side"), own.touch, own.freedom_of("hole")) == (1e-6, 1e-6, 30.0)
    assert own.freedom_of("side") == 50.0
