"""Values of a study: the first runs with every change, all of them with the large studies."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def first_of(values: Iterable[Any], count: int = 1) -> list[Any]:
    """For `pytest.mark.parametrize`: values beyond the first ``count`` are marked slow."""
    quick, slow = [*values][:count], [*values][count:]
    later = (value if isinstance(value, tuple) else (value,) for value in slow)
    return [*quick, *(pytest.param(*value, marks=pytest.mark.slow) for value in later)]


def of_size(quick: int, large: int) -> list[Any]:
    """For `pytest.mark.parametrize`: a study with every change, and a larger one that is slow."""
    return [quick, pytest.param(large, marks=pytest.mark.slow)]
