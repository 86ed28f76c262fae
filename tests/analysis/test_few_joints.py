"""Arms of one to eight joints: what they can be asked for, simulated, planned and mapped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from few_joints import ARTEFACT, few_joints, simulation
from simulated import tracked_scene

from suta_calib.analysis.planning import PlanOptions, Pool, Situation, plan
from suta_calib.analysis.tip_map import TipMapOptions, tip_map_of_solution
from suta_calib.arrays import FloatArray
from suta_calib.errors import JobError
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import read_simulation, simulate
from suta_calib.simulation.inverse_kinematics import InverseKinematics
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise


def arm_of(joints: int, folder: Path) -> ArmModel:
    path = folder / "arm.urdf"
    path.write_text(few_joints(joints))
    return ArmModel.from_urdf(path, "tip")


def made(folder: Path, joints: int, kind: str) -> tuple[FloatArray, FloatArray]:
    """Orientations and places of the tip in the first file that is simulated of an arm."""
    arm_of(joints, folder)
    found = simulate(read_simulation(simulation(folder, kind)))
    return found.arm.forward(found.files[0].samples.q, found.values)


@pytest.mark.parametrize(
    ("joints", "most"),
    [(1, ""), (2, ""), (3, "position"), (4, "position"), (5, "axis"), (8, "pose")],
)
def test_what_an_arm_can_reach(tmp_path: Path, joints: int, most: str) -> None:
    kinematics = InverseKinematics(arm_of(joints, tmp_path), {})
    order = ["pose", "axis", "position"]
    reached = [each for each in order if kinematics.attainable[each]]
    assert reached == (order[order.index(most) :] if most else [])
    assert kinematics.most("pose") == (most or "position")
    assert kinematics.most("position") == "position"


def test_joints_in_one_plane_are_fewer_than_they_are(tmp_path: Path) -> None:
    """Three parallel axes bring the tip to any place of a plane, and to none beside it."""
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(few_joints(3).replace("0 0 1", "0 1 0"))
    assert not any(InverseKinematics(ArmModel.from_urdf(urdf, "tip"), {}).attainable.values())


@pytest.mark.parametrize("joints", [3, 4, 5, 7])
def test_a_point_is_touched_as_the_arm_can(tmp_path: Path, joints: int) -> None:
    _, position = made(tmp_path, joints, "fixed_point")
    np.testing.assert_allclose(position, np.tile([0.35, 0.05, 0.25], (6, 1)), atol=1e-9)


def test_how_the_tip_sits_is_asked_only_where_it_is_looked_at(tmp_path: Path) -> None:
    (tmp_path / "artefact.yaml").write_text(ARTEFACT)
    _, position = made(tmp_path, 4, "pairwise_distance")
    np.testing.assert_allclose(position[1] - position[0], [0.1, 0, 0], atol=1e-9)
    with pytest.raises(JobError, match=r"an arm of 4 joints.*remove rotation_rpy_deg"):
        made(tmp_path, 4, "landmark")


def test_an_arm_that_gets_nowhere_is_told_to_be_seen(tmp_path: Path) -> None:
    with pytest.raises(JobError, match=r"an arm of 2 joints.*simulate an instrument"):
        made(tmp_path, 2, "fixed_point")


@pytest.mark.parametrize("joints", [2, 4, pytest.param(8, marks=pytest.mark.slow)])
def test_plans_and_maps(tmp_path: Path, joints: int) -> None:
    arm = arm_of(joints, tmp_path)
    scene = tracked_scene(arm, {}, 30)
    term = scene.exact(Noise(1e-4))
    solution = solve(Problem([term], arm.select("*.offset", "tip.x")), SolverOptions(starts=1))
    situation = Situation.of(solution.problem, solution)
    found = plan(situation, PlanOptions(count=2, pool=Pool(placements=4, points=4, poses=20)))
    assert found.after.tip <= found.before.tip
    mapped = tip_map_of_solution(solution, TipMapOptions(grid=9))
    assert 0 < mapped.registered.rms < 1e-3
    assert mapped.drawn.shape == (joints + 2, 3)
    # The maps are of places where the tip gets to, and there are some.
    for section in mapped.sections:
        assert (section.absolute[np.isfinite(section.absolute)] < 1e-2).all()
    assert np.isfinite(mapped.sections[0].absolute).any()


def test_the_drawn_arm_is_that_of_the_readings(tmp_path: Path) -> None:
    """Also where the base is another link than the root, and the chain climbs."""
    up, down = arm_of(5, tmp_path), ArmModel.from_urdf(tmp_path / "arm.urdf", "l0", "tip")
    q = np.array([0.3, -0.4, 0.5, 0.6, -0.7])
    drawn, inverted = up.skeleton(q).points, down.skeleton(q[::-1]).points
    R, p = up.forward(q)
    np.testing.assert_allclose(inverted[::-1] @ R.T + p, drawn, atol=1e-12)
