"""Sound checks of every kind are quiet, also of an arm that no model describes, with outliers."""

from __future__ import annotations

import pytest

from benchmarks.check_study import KINDS, interval, sound_checks

CHECKS = 60


@pytest.mark.slow
@pytest.mark.parametrize("lacking", [False, True])
@pytest.mark.parametrize("name", KINDS)
def test_false_alarms_are_as_rare_as_asked(name: str, *, lacking: bool) -> None:
    """One in a hundred, and with so few checks hardly ever five."""
    checks = [*sound_checks(name, CHECKS, lacking=lacking, outliers=lacking)]
    wrong = sum(not check.unchanged for check in checks)
    assert interval(wrong, len(checks))[0] < 0.02
