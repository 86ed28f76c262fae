"""What a public analysis cannot use is refused where it is called, not by its first inner line."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import suta_calib
from suta_calib.analysis import iso10360, planning, repeatability, study, tip_map_of_solution
from suta_calib.arguments import checked
from suta_calib.certification import certify
from suta_calib.errors import InputError

PUBLIC = [
    *(suta_calib.acceptance_test, suta_calib.assess, suta_calib.choose_model, suta_calib.observe),
    *(suta_calib.error_budget, suta_calib.find_outliers, suta_calib.simulate, suta_calib.tip_map),
    *(iso10360.accept, planning.plan, planning.situation_of_job, tip_map_of_solution, certify),
    *(repeatability.repeatability, repeatability.repeated_touches, repeatability.stationary),
    *(study.drift_study, study.plan_study, study.run_study, study.study_of_job),
]


@pytest.mark.parametrize("value", [5, "x", None])
@pytest.mark.parametrize("function", PUBLIC, ids=lambda function: function.__name__)
def test_objects_of_another_class_are_refused_in_words(
    function: Callable[..., Any], value: object
) -> None:
    parameters = inspect.signature(function).parameters.values()
    required = [p for p in parameters if p.default is p.empty and p.kind is not p.KEYWORD_ONLY]
    kind = type(value).__name__
    with pytest.raises(InputError, match=rf"^{function.__name__}: \w+: found {kind}; expected \w"):
        function(*[value] * len(required))


def test_what_can_be_used_is_passed_on() -> None:
    @checked
    def scaled(factor: float, count: int | None, names: list[str], place: np.ndarray) -> Any:
        return factor, count, names, place

    given = (np.float32(2), np.int64(3), ["a"], [1.0, 2.0])
    assert scaled(*given) == given  # type: ignore[arg-type]
    assert scaled(1, None, names=[], place=0.0)[1] is None  # type: ignore[arg-type]
    with pytest.raises(InputError, match="count: found str; expected whole number"):
        scaled(1, "3", [], 0.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="missing a required argument"):
        scaled(1)  # type: ignore[call-arg]
