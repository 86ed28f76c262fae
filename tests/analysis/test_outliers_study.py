"""Seeds of the simulated SUTA: a landmark 2 mm off is named by all metrics, and no other."""

from __future__ import annotations

import pytest
from outlier_studies import Kind, displaced_landmark, named, suta_study

KINDS: tuple[Kind, ...] = ("touches", "certificate")


def right(seed: int, kind: Kind) -> bool:
    """All four metrics name the displaced landmark, and none names another."""
    name, shift = displaced_landmark(seed)
    flags, outliers = named(suta_study(seed, {name: shift}, kind).outliers("landmarks"))
    return flags == {name: 4} and outliers == [name]


def silent(seed: int) -> bool:
    """Nothing is displaced, and no landmark is called an outlier."""
    return not named(suta_study(seed, {}).outliers("landmarks"))[1]


def test_all_metrics_name_the_displaced_landmark_and_no_other() -> None:
    """Here where it was touched; `test_outliers` has a wrong certificate, and nothing displaced."""
    assert right(0, "touches")


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_in_95_of_100_seeds_the_displaced_landmark_and_no_other(kind: Kind) -> None:
    assert sum(right(seed, kind) for seed in range(100)) >= 95


@pytest.mark.slow
def test_in_95_of_100_seeds_nothing_where_nothing_is_displaced() -> None:
    assert sum(silent(seed) for seed in range(100)) >= 95
