"""How the tip scatters among repeats of the same touch, against known scatter."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from suta_calib import CalibrationJob
from suta_calib.trust import TouchRepeatability, touch_repeatability

SIGMA = 0.2e-3


def found(
    repeats: int = 3, places: int = 20, seed: int = 0, readings: int = 1
) -> TouchRepeatability | None:
    """Of touches that scatter by SIGMA along each axis, each read some times at one rest."""
    random = np.random.default_rng(seed)
    place = np.repeat(np.arange(places), repeats)
    position = random.uniform(-1, 1, (places, 3))[place]
    position = position + SIGMA * random.standard_normal(position.shape)
    rests = np.repeat(np.arange(len(place)), readings)
    poses = SimpleNamespace(rests=rests, at=lambda _: (None, position[rests]))
    term = SimpleNamespace(poses=poses, repeats=lambda: place[rests])
    return touch_repeatability(term, {})  # type: ignore[arg-type]


def test_it_is_the_scatter_put_in_with_its_own_uncertainty() -> None:
    every = [found(seed=seed) for seed in range(300)]
    rms = np.array([each.rms for each in every if each is not None])
    z = (rms - np.sqrt(3) * SIGMA) / np.array([each.std for each in every if each is not None])
    assert abs(z.mean()) < 0.25
    assert 0.88 < z.std() < 1.12


def test_what_is_read_again_at_one_rest_counts_once() -> None:
    assert found(readings=5) == found()


@pytest.mark.parametrize("few", [{"repeats": 1}, {"places": 9}])
def test_too_few_repeats_tell_nothing(few: dict[str, int]) -> None:
    assert found(**few) is None


def test_of_simulated_seats_it_is_what_they_scatter(repository: Path) -> None:
    term = CalibrationJob.load(repository / "data/thesis/calibration.yaml").validation[0]
    seen = touch_repeatability(term, {})
    assert seen is not None
    assert (seen.touches, seen.places) == (225, 75)
    # 0.167 mm per axis were put in; a nominal arm some millimetres off shows them as well.
    assert abs(seen.rms - np.sqrt(3) * 0.167e-3) < 3 * seen.std
