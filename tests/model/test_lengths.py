"""Lengths of an arm in other units."""

from __future__ import annotations

from simulated import arm_named

from suta_calib.model.lengths import other_lengths


def test_every_length_and_every_origin_is_tried_in_other_units() -> None:
    """An origin with two lengths or more also as a whole; what is zero in every unit, not."""
    arm = arm_named("suta").with_tip_moved([0.01, 0.0, 0.02])
    found = [*other_lengths(arm)]
    nominal = {n: p.nominal for n, p in arm.parameters.items()}
    for each in found:
        (factor,) = {round(v / nominal[n], 9) for n, v in each.values.items()}
        assert factor in (10.0, 100.0, 1000.0, 0.1, 0.01, 0.001)
        assert all(name.startswith(each.owner) for name in each.values)
    tried = {frozenset(each.values) for each in found}
    lengths = {n for n, p in arm.parameters.items() if p.unit == "m" and abs(p.nominal) > 1e-6}
    assert {frozenset([name]) for name in lengths} <= tried
    assert any(len(names) > 1 for names in tried)
    assert len(found) == 6 * len(tried)
    assert len({each.sentence for each in found}) == len(found)
