"""A length of the arm in another unit is the cause, where the data tell it from other units."""

from __future__ import annotations

import pytest
from simulated import dh_parameters
from terms_cases import SIGMA, noises, scene

from suta_calib import ArmPoses, Problem, SolverOptions, solve
from suta_calib.trust.rereading import Rereading, explaining_reading

ONCE = SolverOptions(starts=1, max_iterations=50)


def cause(name: str, length: str, factor: float) -> tuple[float, Rereading | None]:
    """Of data of an arm, one of whose lengths stands in another unit; and that length, mm."""
    s = scene(name)
    right = s.arm.parameters[length].nominal
    arm = s.arm.at({length: factor * right})
    term = s.term(s.samples(SIGMA)[0], *noises(SIGMA, False))
    wrong = term.over_poses(ArmPoses(arm, term.poses.samples))
    return 1e3 * right, explaining_reading(solve(Problem([wrong], dh_parameters(arm)), ONCE))


@pytest.mark.parametrize("name", ["tracked_point", "hand_eye"])
@pytest.mark.parametrize("factor", [10.0, 0.01])
def test_a_length_in_another_unit_is_named(name: str, factor: float) -> None:
    right, found = cause(name, "joint_4.z", factor)
    assert found is not None
    assert found.description == (
        f"joint_4.z is {right:.6g} mm and not {factor * right:.6g} mm: a wrong unit in the URDF"
    )
    assert found.after < 0.1 * found.before


def test_a_length_in_its_own_unit_is_not() -> None:
    _, found = cause("tracked_point", "joint_4.z", 1.0)
    assert found is None
