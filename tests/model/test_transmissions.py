"""Joints that a URDF's transmissions couple, and what an arm is offered for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from simulated import tracked_scene

from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import read_chain
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.extended_problem import offered_names

ROS_1 = """\
<transmission name="elbow">
  <type>transmission_interface/{kind}</type>
  <!-- <joint name="joint_9"/> -->
  <actuator name="a"><role>actuator1</role><mechanicalReduction>50</mechanicalReduction></actuator>
  <joint name="joint_3"><role>joint2</role><mechanicalReduction>1</mechanicalReduction></joint>
  <joint name="joint_2"><role>joint1</role><mechanicalReduction>1</mechanicalReduction></joint>
</transmission>
"""
ROS_2 = """\
<ros2_control name="hardware" type="system">
  <transmission name="elbow">
    <plugin>transmission_interface/{kind}</plugin>
    <actuator name="a" role="actuator1"/>
    <joint name="joint_3" role="joint2"><mechanical_reduction>1</mechanical_reduction></joint>
    <joint name="joint_2" role="joint1"><mechanical_reduction>1</mechanical_reduction></joint>
  </transmission>
</ros2_control>
"""
WITHOUT_ROLES = """\
<transmission name="elbow"><type>{kind}</type><joint name="joint_2"/><joint name="joint_3"/>
</transmission>
"""
FOUR_BAR, DIFFERENTIAL = "FourBarLinkageTransmission", "DifferentialTransmission"


@pytest.fixture
def urdf(tmp_path: Path, repository: Path) -> Path:
    """Where the SUTA with something more in its file is written."""
    path = tmp_path / "arm.urdf"
    path.write_text((repository / "urdf" / "suta.urdf").read_text())
    return path


def with_more(urdf: Path, more: str) -> Path:
    urdf.write_text(urdf.read_text().replace("</robot>", f"{more}</robot>"))
    return urdf


@pytest.mark.parametrize("written", [ROS_1, ROS_2, WITHOUT_ROLES], ids=["1", "2", "no roles"])
@pytest.mark.parametrize(
    ("kind", "coupled"),
    [
        (FOUR_BAR, {"joint_3": ("joint_2",)}),
        (DIFFERENTIAL, {"joint_2": ("joint_3",), "joint_3": ("joint_2",)}),
        ("SimpleTransmission", {}),
        ("", {}),
    ],
)
def test_who_moves_whom(
    urdf: Path, written: str, kind: str, coupled: dict[str, tuple[str, ...]]
) -> None:
    path = with_more(urdf, written.format(kind=kind))
    chain = read_chain(path, "tip")
    assert chain.coupled == coupled
    offered = offered_names(ArmModel.from_urdf(path, "tip"))
    found = {n for key, names in offered.items() if key[1] == "coupling" for n in names}
    pairs = {(joint, other) for joint, others in coupled.items() for other in others}
    # Neighbours in the chain may be coupled, whatever the URDF says.
    pairs |= {
        (f"joint_{a}", f"joint_{b}") for a in range(1, 7) for b in (a - 1, a + 1) if 0 < b < 7
    }
    assert found == {f"{joint}.coupling[{other}]" for joint, other in pairs}


@pytest.mark.parametrize(
    "more",
    [
        "<transmission/>",
        f"<transmission><type>{FOUR_BAR}</type><joint name='joint_2'/></transmission>",
        f"<transmission><type>{FOUR_BAR}</type><joint/><joint name='joint_2'/></transmission>",
        f"<transmission><type>{DIFFERENTIAL}</type><joint name='a'/><joint name='a'/>"
        "</transmission>",
    ],
)
def test_what_names_no_two_joints_couples_nothing(urdf: Path, more: str) -> None:
    assert read_chain(with_more(urdf, more), "tip").coupled == {}


def test_a_joint_that_another_ones_motor_moves_too_is_suspected(urdf: Path) -> None:
    arm = ArmModel.from_urdf(with_more(urdf, ROS_1.format(kind=FOUR_BAR)), "tip")
    term = tracked_scene(arm, {"joint_3.coupling[joint_2]": 2e-3}, 80).exact(Noise(1e-4))
    unknown = arm.select("joint_4.z", "joint_2.offset", "joint_3.offset")
    first = CalibrationExamination.of(
        solve(Problem([term], unknown), SolverOptions(starts=1))
    ).score_tests[0]
    assert (first.joint, first.family) == ("joint_3", "coupling")
    assert first.suspicious
    np.testing.assert_allclose(first.estimate, [2e-3], rtol=0.05)
