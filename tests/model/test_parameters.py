"""Parameters, and the rows of a job that select them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated import arm_named

from suta_calib.errors import ParameterError
from suta_calib.model.parameters import Parameter, ParameterSet, Selection


def test_bounds_must_contain_nominal() -> None:
    Parameter("a", "x", "m", 1.0, lower=1.0, upper=2.0)
    with pytest.raises(ParameterError, match=r"a\.x: found bounds 1\.1 … 2 .* nominal value 1;"):
        Parameter("a", "x", "m", 1.0, lower=1.1, upper=2.0)


@given(st.floats(-1, 1), st.floats(1e-6, 10))
def test_a_bound_is_a_half_width_about_nominal(nominal: float, bound: float) -> None:
    p = Parameter("a", "x", "m", nominal).bounded(bound, None)
    assert (p.lower, p.upper) == (nominal - bound, nominal + bound)
    assert p.plausible == pytest.approx(bound, abs=1e-12)
    assert p.prior is None


def test_without_a_bound_what_is_plausible_is_the_units() -> None:
    length, angle = Parameter("a", "x", "m", 3.0), Parameter("a", "rx", "rad", 0.0)
    assert (length.lower, length.upper) == (-math.inf, math.inf)
    assert (length.plausible, angle.plausible) == (0.05, pytest.approx(math.radians(10)))
    assert Parameter("a", "x", "m", 0.0, plausible=0.2).plausible == 0.2
    assert length.scale > 0


def test_a_set_keeps_its_order_and_suggests_names() -> None:
    parameters = ParameterSet([Parameter(*n, "m") for n in ("bx", "ax", "cy")])
    assert parameters.names == ("b.x", "a.x", "c.y") == tuple(parameters)
    assert len(parameters) == 3
    assert "a.x" in parameters
    with pytest.raises(ParameterError, match=r"found 'a\.z'.*did you mean.*a\.x"):
        parameters["a.z"]
    with_prior = ParameterSet([Parameter("a", "x", "m", 0.0, prior=2.0), parameters["c.y"]])
    assert with_prior.array("prior")[0] == 2.0
    assert math.isnan(with_prior.array("prior")[1])


def test_an_arm_offers_six_parameters_a_joint_and_an_offset_where_it_moves() -> None:
    arm = arm_named("suta")
    assert len(arm.parameters) == 6 * 7 + 6
    units = {n: p.unit for n, p in arm.parameters.items()}
    assert units["joint_1.offset"] == units["tip.rx"] == "rad"
    assert units["tip.y"] == "m"
    assert arm.parameters["joint_4.z"].nominal == 0.571
    assert arm.parameters["tip.y"].nominal == -0.253
    assert arm.parameters["joint_3.rx"].nominal == 0.0
    assert "tip_joint.x" not in arm.parameters
    assert "tip.offset" not in arm.parameters


def test_one_glob_may_stand_alone() -> None:
    arm = arm_named("panda")
    alone, listed = Selection("*.offset", bound_rad=0.1), Selection(("*.offset",), bound_rad=0.1)
    assert arm.select(alone) == arm.select(listed)


def test_a_prismatic_joints_offset_is_a_length() -> None:
    tiago = arm_named("tiago")
    assert tiago.parameters["torso_lift_joint.offset"].unit == "m"
    assert tiago.parameters["arm_1_joint.offset"].unit == "rad"


def test_geometric_means_placements_of_moving_joints_and_of_the_tip() -> None:
    arm = arm_named("panda")
    chosen = arm.select("geometric").names
    owners = {arm.parameters[name].owner for name in chosen}
    assert owners == {*arm.joints, "panda_hand"}
    assert len(chosen) == 6 * 8
    assert not any(name.endswith(".offset") for name in chosen)


def test_globs_do_not_reach_fixed_joints_but_their_full_names_do() -> None:
    arm = arm_named("panda")
    assert "panda_joint8.z" in arm.parameters
    assert "panda_joint8.z" not in arm.select("panda_joint*.z").names
    assert arm.select("panda_joint8.z").names == ("panda_joint8.z",)


def test_later_rows_win_and_the_order_is_the_arms() -> None:
    arm = arm_named("suta")
    chosen = arm.select(
        Selection(("tip.y", "joint_*.offset"), bound_m=0.1, bound_rad=0.2),
        Selection(("joint_2.offset",), bound_rad=0.01, prior_rad=0.005),
        Selection(("joint_[34].offset",), fixed=True),
        Selection(("joint_4.offset",), bound_rad=0.1),
    )
    assert chosen.names == (*(f"joint_{k}.offset" for k in range(1, 7)), "tip.y")
    assert (chosen["joint_1.offset"].upper, chosen["joint_1.offset"].prior) == (0.2, None)
    assert (chosen["joint_2.offset"].upper, chosen["joint_2.offset"].prior) == (0.01, 0.005)
    assert not chosen["joint_3.offset"].free
    assert "joint_3.offset" not in chosen.free()
    assert chosen["joint_4.offset"].free
    assert chosen["tip.y"].lower == pytest.approx(-0.353)


@pytest.mark.parametrize(
    ("pattern", "says"),
    [
        *((pattern, "matches no parameter") for pattern in ("joint_9.*", "*.offsets", "")),
        ("joint_1.ofset", r"matches no parameter.*did you mean joint_1\.offset"),
        ("geometrc", "did you mean geometric"),
    ],
)
def test_a_pattern_that_matches_nothing_is_refused(pattern: str, says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        arm_named("suta").select(pattern)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (Selection(("tip.y",), bound_rad=0.1, line=7), "line 7: .*deg.*all lengths"),
        (Selection(("joint_*.offset",), prior_m=0.1, line=8), "line 8: .*mm.*all angles"),
    ],
)
def test_a_bound_or_prior_in_a_unit_nothing_has_is_refused(row: Selection, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        arm_named("suta").select(row)
