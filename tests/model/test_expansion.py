"""Lengths that grow with warmth, against Pinocchio, differences, and known truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from simulated import arm_named, random_readings, tracked_scene
from simulation_scenes import Folder
from two_arms import ROBOT

from suta_calib.analysis.model_selection import choose_model
from suta_calib.errors import JobError, SamplesError
from suta_calib.measurements import SampleColumns, Samples, read_samples, write_samples
from suta_calib.model.arm import ArmModel
from suta_calib.report.model_selection import row_text
from suta_calib.simulation import write_simulation
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, TrackedPoint
from suta_calib.terms.poses import joint_ranges
from suta_calib.trust.explanation import explain

ARM = arm_named("suta")
ALUMINIUM = 23e-6
COMMON = "links.expansion"


@pytest.fixture(params=["suta", "panda", "two arms"])
def arm(request: pytest.FixtureRequest, tmp_path: Path) -> ArmModel:
    """A chain that descends, one of other lengths, and one that climbs and follows its fingers."""
    if request.param != "two arms":
        return arm_named(request.param)
    (tmp_path / "robot.urdf").write_text(ROBOT)
    return ArmModel.from_urdf(tmp_path / "robot.urdf", "f3", "left")


def test_a_warm_arm_is_pinocchios_with_longer_links(arm: ArmModel, tmp_path: Path) -> None:
    warmth, rng = 12.0, np.random.default_rng(0)
    own = {n: 2e-3 * rng.standard_normal() for n in arm.nongeometric if n.endswith(".expansion")}
    assert COMMON in own
    longer = {
        name: p.nominal * (1 + warmth * (own[COMMON] + own.get(f"{p.owner}.expansion", 0.0)))
        for name, p in arm.parameters.items()
        if p.key in ("x", "y", "z")
    }
    arm.write_urdf(tmp_path / "longer.urdf", longer)
    grown = ArmModel.from_urdf(tmp_path / "longer.urdf", arm.tip, arm.chain.base)
    data, model = grown.model.createData(), grown.model
    ends = [model.getFrameId(n, pin.FrameType.BODY) for n in (arm.chain.base, arm.chain.tip_link)]
    q = random_readings(arm, rng, 4)
    told = {"warmth": np.full((4, 1), warmth)}
    for row, R, p in zip(q, *arm.forward(q, own, told), strict=True):
        pin.framesForwardKinematics(model, data, grown.configuration(row))
        base, tip = (data.oMf[k] for k in ends)
        expected = base.actInv(tip)
        np.testing.assert_allclose(R, expected.rotation, atol=1e-12)
        np.testing.assert_allclose(p, expected.translation, atol=1e-12)
    # Nobody says how warm it is, or it is as warm as on its drawing.
    cold = arm.forward(q)[1]
    np.testing.assert_allclose(arm.forward(q, own)[1], cold, atol=1e-15)
    np.testing.assert_allclose(arm.forward(q, own, {"warmth": np.zeros((4, 1))})[1], cold)


def test_derivatives_are_those_of_differences(arm: ArmModel) -> None:
    rng = np.random.default_rng(1)
    names = [n for n in arm.offered if ".compliance" not in n]
    values = {n: p.nominal + 0.01 * rng.standard_normal() for n, p in arm.offered.items()}
    theta = np.array([values[n] for n in names])
    q, directions = random_readings(arm, rng, 1)[0], rng.choice([-1.0, 1.0], len(arm.joints))
    function = arm.function(names, ("direction", "warmth"))

    def tip(x: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(np.array(each) for each in function(x, q, directions, 7.0))

    _, _, jacobian = tip(theta)
    for column, step in zip(jacobian, 1e-6 * np.eye(len(names)), strict=True):
        slope = (tip(theta + step)[1] - tip(theta - step)[1]).ravel() / 2e-6
        np.testing.assert_allclose(column[:3], slope, atol=1e-7)


def warm_and_cold(seed: int, *, told: bool = True) -> TrackedPoint:
    """A tip seen to 0.05 mm on several days; the arm is of aluminium, and one length is off."""
    scene = tracked_scene(ARM, {}, 60)
    rng = np.random.default_rng(seed)
    temperature = rng.uniform(14.0, 34.0, len(scene.q))
    truth = {COMMON: ALUMINIUM, "joint_4.z": 0.5713}
    warmth = {"warmth": temperature[:, None] - 20.0}
    _, position = ARM.forward(scene.q, truth, warmth)
    seen = replace(
        scene.exact().poses.samples,
        position=position + rng.normal(0, 5e-5, position.shape),
        temperature=temperature if told else None,
    )
    return scene.term(seen)


def test_it_errs_as_it_says() -> None:
    """Over twelve sets of noise, in units of the standard deviations (chi-squared, 12, 0.1 %)."""
    unknown = ARM.select("joint_*.offset", "joint_4.z", COMMON)
    pulls = []
    for seed in range(12):
        found = solve(Problem([warm_and_cold(seed)], unknown), SolverOptions(starts=1))
        e = found.estimates[COMMON]
        pulls.append((e.value - ALUMINIUM) / (e.std or 0.0))
    assert 2.2 < np.sum(np.square(pulls)) < 32.9


def test_it_is_found_worth_having_where_samples_say_how_warm_it_was() -> None:
    choice = choose_model([warm_and_cold(0)], ARM.select("joint_*.offset", "joint_4.z"))
    assert choice.added == (COMMON,)
    (row,) = choice.rows
    assert row_text(row) == f"- {{select: [{COMMON}], bound_ppm_per_k: 100}}"


def test_it_is_held_and_explained_where_they_do_not() -> None:
    problem = Problem([warm_and_cold(0, told=False)], ARM.select("joint_4.z", COMMON))
    solution = solve(problem, SolverOptions(starts=1))
    assert solution.estimates[COMMON].state == "unidentified"
    (told,) = (
        e for e in explain(problem, solution.x, solution.identification) if e.fixed == COMMON
    )
    assert "when the arm was warm and when it was cold" in told.sentence
    assert "column temperature" in told.remedy


def test_both_forms_of_the_problem_know_of_it() -> None:
    problem = Problem([warm_and_cold(0)], ARM.select("joint_4.z", COMMON))
    exact, fast = (
        solve(problem, SolverOptions(starts=1, hessian=each)).values
        for each in ("exact", "gauss-newton")
    )
    assert exact[COMMON] == pytest.approx(fast[COMMON], rel=1e-5)


WARM = f"""
arm: {{urdf: URDF, tip: tip}}
seed: 4
errors:
  - {{select: ["joint_*.offset"], std_deg: 1}}
  - {{select: [{COMMON}], value_ppm_per_k: 23}}
noise: {{instrument_mm: 0.05}}
sets:
  tracked:
    kind: tracked_point
    samples: 60
    temperature: [14, 34]
    base_in_instrument: {{position_mm: [1000, 2000, 300], rotation_rpy_deg: [10, 20, 30]}}
"""


def test_it_is_simulated_and_found_again(tmp_path: Path, suta_urdf: Path) -> None:
    folder = Folder(tmp_path, suta_urdf)
    made = folder.simulate(WARM)
    assert made.values[COMMON] == pytest.approx(ALUMINIUM)
    write_simulation(made, tmp_path / "out")
    columns, ranges = SampleColumns(position=True), joint_ranges(ARM)
    samples = read_samples([tmp_path / "out" / "tracked" / "samples.csv"], ranges, columns)
    assert samples.temperature is not None
    assert 14 <= samples.temperature.min() < 16
    assert 32 < samples.temperature.max() <= 34
    unknown = ARM.select("joint_*.offset", COMMON)
    term = TrackedPoint(ArmPoses(ARM, samples))
    found = solve(Problem([term], unknown), SolverOptions(starts=1)).estimates[COMMON]
    assert found.state == "identified"
    assert abs(found.value - ALUMINIUM) < 3.3 * (found.std or 0.0) < 0.5 * ALUMINIUM
    # All else is drawn as without it.
    (cool,) = folder.simulate(WARM.replace("    temperature: [14, 34]\n", "")).files
    assert cool.samples.temperature is None
    (warm,) = (file.samples for file in made.files)
    np.testing.assert_array_equal(cool.samples.q, warm.q)
    assert cool.samples.position is not None
    assert warm.position is not None
    grown = (
        ARM.forward(warm.q, made.values, warm.conditions)[1] - ARM.forward(warm.q, made.values)[1]
    )
    apart = np.linalg.norm(cool.samples.position - warm.position, axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(grown, axis=1), atol=1e-12)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("[34, 14]", r"found \[34, 14\]; expected \[lowest, highest\] in °C, from -60 to 150"),
        ("[287, 307]", r"found \[287, 307\]"),
        ("20", r"tracked\.temperature: found 20"),
    ],
)
def test_temperatures_that_no_file_could_say_are_refused(
    tmp_path: Path, suta_urdf: Path, given: str, said: str
) -> None:
    with pytest.raises(JobError, match=said):
        Folder(tmp_path, suta_urdf).simulate(WARM.replace("[14, 34]", given))


def test_geometry_is_what_a_urdf_can_hold() -> None:
    assert COMMON not in ARM.select("*")
    assert set(ARM.select("*.expansion")) == {n for n in ARM.nongeometric if "expansion" in n}


def test_temperatures_are_read_back(tmp_path: Path) -> None:
    samples, file = warm_and_cold(0).poses.samples, tmp_path / "a.csv"
    write_samples(file, samples)
    columns, ranges = SampleColumns(position=True), joint_ranges(ARM)
    again = read_samples([file], ranges, columns)
    assert again.temperature is not None
    assert samples.temperature is not None
    np.testing.assert_array_equal(again.temperature, samples.temperature)
    some = Samples.concatenate([again.take([0, 1]), again.take([5])])
    np.testing.assert_allclose(some.conditions["warmth"][:, 0], samples.temperature[[0, 1, 5]] - 20)
    rows = file.read_text().splitlines()
    kelvin = rows[3].rpartition(",")[0] + ",293.15"
    file.write_text("\n".join([*rows[:3], kelvin, *rows[4:]]))
    with pytest.raises(
        SamplesError, match=r"a\.csv:4: column 'temperature': .*kelvin: subtract 273\.15"
    ):
        read_samples([file], ranges, columns)
    other = tmp_path / "b.csv"
    other.write_text("\n".join(row.rpartition(",")[0] for row in rows))
    write_samples(file, samples)
    with pytest.raises(
        SamplesError, match=r"b\.csv: found no column 'temperature', although .*a\.csv"
    ):
        read_samples([file, other], ranges, columns)
