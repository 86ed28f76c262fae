"""A few postures are chosen that would show most of what may have changed."""

from __future__ import annotations

import numpy as np
from checked_scene import checker

from suta_calib.analysis import planning
from suta_calib.check.design import design_check


def test_five_postures_are_chosen_that_show_more_than_any_five() -> None:
    solution = checker().solution
    situation = planning.Situation.of(solution.problem, solution)
    random = np.random.default_rng(3)
    readings = random.uniform(-1.2, 1.2, (24, len(situation.arm.joints)))
    places = [planning.Posture(f"A{k}", row) for k, row in enumerate(readings)]
    design = design_check(situation, checker(), 5, places)
    assert len({candidate.name for candidate in design.chosen}) == 5
    assert np.all(np.diff(design.evidence) > 0)
    any_five = design_check(situation, checker(), 5, places[:5])
    assert design.evidence[-1] > 1.05 * any_five.evidence[-1]
    shown = {power.what: power.amounts for power in design.power}
    assert shown["joint joint_3"]["rad"] < 2e-3
