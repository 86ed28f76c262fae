"""U of a certificate holds the truth as often as it says, where an answer is fast."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from certified_answers import CASES, Held

# What is asked for, per cent.
BETWEEN = 93.0, 97.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pivot-8", "register-6", "iso10360", "certify"])
def test_intervals_hold_the_truth(name: str) -> None:
    case, held = CASES[name], dict[str, list[float]]()
    answers = min(case.answers, 400)
    for seed in range(answers):
        found: Held = case.answer(seed)
        for quantity, inside in found.items():
            held.setdefault(quantity, []).append(100.0 * float(np.mean(inside)))
    for shares in held.values():
        counting = 2.5 * float(np.std(shares, ddof=1)) / math.sqrt(answers)
        assert BETWEEN[0] - counting <= np.mean(shares) <= BETWEEN[1] + counting


def test_the_table_of_the_guide_keeps_what_is_asked_for(repository: Path) -> None:
    file = repository / "benchmarks" / "results" / "coverage.json"
    figures = json.loads(file.read_text(encoding="utf-8"))
    assert set(figures) <= set(CASES)
    table = (repository / "docs" / "guides" / "certificate_coverage_table.md").read_text("utf-8")
    for name, found in figures.items():
        assert found["answers"] >= 200
        assert CASES[name].data in table
        for share in found["held"].values():
            # As far as so few answers tell.
            assert BETWEEN[0] - share["counting_pct"] <= share["pct"]
            assert share["pct"] <= BETWEEN[1] + share["counting_pct"]
            assert f"{share['pct']:.1f} ± {share['counting_pct']:.1f}" in table
