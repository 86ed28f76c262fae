"""Eccentric encoders, gains, play and yielding joints against known truth.

On random trees `test_trees` holds what they do, and its derivatives, against Pinocchio.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, dh_parameters, perturbed, random_readings, tracked_scene

from suta_calib.analysis.model_selection import choose_model
from suta_calib.errors import JobError, ParameterError, SamplesError, UrdfError
from suta_calib.job.schema import read_job
from suta_calib.measurements import SampleColumns, read_samples, write_samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet, Selection
from suta_calib.simulation import read_simulation, simulate, write_simulation
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Noise, TrackedPoint
from suta_calib.terms.poses import joint_ranges
from suta_calib.trust.explanation import explain

ARM = arm_named("suta")
PLAY = {"joint_2.gain": 2e-3, "joint_3.backlash": 1.5e-3}
ECC = ("ecc_c1", "ecc_s1", "ecc_c2", "ecc_s2")


def test_they_are_off_unless_a_pattern_names_them() -> None:
    arm = ARM
    for pattern in ("geometric", "*", "joint_*", "*.offset", "joint_3.*", "*[xyz]"):
        assert all(p.geometric for p in arm.select(pattern).values())
    assert len(arm.select("*.ecc_*")) == 24
    assert arm.select("joint_?.ecc_?1").names[:2] == ("joint_1.ecc_c1", "joint_1.ecc_s1")
    assert len(arm.select("*.compliance")) == 6
    assert arm.select("joint_3.ecc_s2", "joint_2.z").names == ("joint_2.z", "joint_3.ecc_s2")
    assert all(p.geometric for p in arm.parameters.values())


def test_the_kinematics_without_them_are_as_they_were() -> None:
    plain, more = (ARM.function(["joint_3.offset", *extra]) for extra in ((), ("joint_3.ecc_c1",)))
    assert plain.n_instructions() < more.n_instructions()
    zero = dict.fromkeys(ARM.nongeometric, 0.0)
    q = random_readings(ARM, np.random.default_rng(0), 3)
    for with_zero, without in zip(ARM.forward(q, zero), ARM.forward(q), strict=True):
        np.testing.assert_array_equal(with_zero, without)


def test_an_arm_without_masses_says_so(tmp_path: Path, suta_urdf: Path) -> None:
    text = re.sub(r"<inertial>.*?</inertial>", "", suta_urdf.read_text(), flags=re.DOTALL)
    (tmp_path / "light.urdf").write_text(text)
    arm = ArmModel.from_urdf(tmp_path / "light.urdf", "tip")
    refused = r"light\.urdf: joint_1\.compliance: found no mass .*joint_1"
    with pytest.raises(UrdfError, match=refused):
        arm.select("*.compliance")
    with pytest.raises(UrdfError, match=refused):
        arm.at({"joint_1.compliance": 1e-3})
    assert len(arm.select("*.ecc_*")) == 24


@pytest.mark.parametrize("key", ["ecc_c1", "compliance", "ecc_*"])
def test_a_joint_that_slides_has_none_and_it_is_said(key: str) -> None:
    arm = arm_named("tiago")
    (sliding,) = [j.name for j in arm.chain.moving if j.type == "prismatic"]
    with pytest.raises(
        ParameterError, match=f"'{sliding}.{re.escape(key)}', but {sliding} is prismatic"
    ):
        arm.select(f"{sliding}.{key}")


@pytest.mark.parametrize(("held", "name"), [(2, "ecc_c1"), (2, "gain"), (1, "coupling[joint_2]")])
def test_what_is_no_other_than_an_offset_is_held_and_explained(held: int, name: str) -> None:
    """A joint that does not move: what its reading is multiplied with is an offset."""
    name = f"joint_3.{name}"
    scene = tracked_scene(ARM, {}, 60)
    scene.q[:, held] = 0.4
    scene.position[:] = ARM.forward(scene.q)[1]
    problem = Problem([scene.exact(Noise(1e-4))], ARM.select("joint_3.offset", name))
    solution = solve(problem, SolverOptions(starts=1))
    assert solution.unidentified == (name,)
    assert solution.estimates["joint_3.offset"].given == (name,)
    (explanation,) = explain(problem, solution.x, solution.identification)
    assert explanation.fixed == name
    assert "has the same effect as joint_3.offset" in explanation.sentence
    assert explanation.remedy == f"turn joint_{held + 1} farther"


def test_a_compliance_without_torque_is_explained() -> None:
    problem = Problem(
        [tracked_scene(ARM, {}, 60).exact(Noise(1e-4))], ARM.select("joint_1.compliance", "tip.z")
    )
    solution = solve(problem, SolverOptions(starts=1))
    (explanation,) = explain(problem, solution.x, solution.identification)
    assert explanation.fixed == "joint_1.compliance"
    assert "gravity has no torque" in explanation.sentence


def test_a_gain_is_told_from_the_rest() -> None:
    """On a turning joint and on one that slides; a URDF does not hold it."""
    arm = arm_named("tiago")
    slides, turns = arm.joints[0], arm.joints[3]
    geometry = {f"{turns}.offset": 0.01}
    truth = geometry | {f"{turns}.gain": 0.004, f"{slides}.gain": -0.02}
    unknown = arm.select("*.gain", "*.offset")
    term = tracked_scene(arm, truth, 60).exact(Noise(1e-4))
    solution = solve(Problem([term], unknown), SolverOptions(starts=1))
    for name in (f"{turns}.gain", f"{slides}.gain"):
        estimate = solution.estimates[name]
        assert (estimate.unit, estimate.state) == ("1", "identified")
        assert estimate.value == pytest.approx(truth[name], abs=1e-8)
    assert arm.calibrated_urdf(truth) == arm.calibrated_urdf(geometry)


def both_sides(seed: int, directions: bool = True) -> TrackedPoint:
    """A tip seen to 0.1 mm: the second joint's gain is off, and the third has play."""
    scene = tracked_scene(ARM, {}, 60)
    random = np.random.default_rng(seed)
    direction = random.choice([-1.0, 1.0], scene.q.shape)
    _, position = ARM.forward(scene.q, PLAY, {"direction": direction})
    seen = replace(
        scene.exact().poses.samples,
        position=position + random.normal(0, 1e-4, position.shape),
        direction=direction if directions else None,
    )
    return scene.term(seen)


def test_backlash_moves_the_joint_to_the_side_it_came_from() -> None:
    q, direction = np.full((3, 6), 0.3), np.zeros((3, 6))
    direction[:, 2] = [1, -1, 0]
    found = ARM.forward(q, {"joint_3.backlash": 2e-3}, {"direction": direction})[1]
    q[:, 2] += [-1e-3, 1e-3, 0.0]
    np.testing.assert_allclose(found, ARM.forward(q)[1], atol=1e-15)
    # Without directions it is in the middle of its play.
    middle = ARM.forward(q[2], {"joint_3.backlash": 2e-3})[1]
    np.testing.assert_allclose(middle, ARM.forward(q[2])[1], atol=1e-15)


def test_gain_and_backlash_err_as_they_say() -> None:
    """Over twelve sets of noise, in units of the standard deviations (chi-squared, 24, 0.1 %)."""
    unknown = ARM.select("joint_*.offset", *PLAY)
    pulls = []
    for seed in range(12):
        problem = Problem([both_sides(seed)], unknown)
        estimates = solve(problem, SolverOptions(starts=1)).estimates
        pulls += [(estimates[n].value - v) / (estimates[n].std or 0.0) for n, v in PLAY.items()]
    assert 7.4 < np.sum(np.square(pulls)) < 51.2


def test_backlash_is_found_where_samples_say_from_which_side() -> None:
    choice = choose_model([both_sides(0)], ARM.select("joint_*.offset"), families=False)
    assert set(choice.added) == set(PLAY)


def test_backlash_that_no_direction_shows_is_explained() -> None:
    problem = Problem([both_sides(0, directions=False)], ARM.select("joint_3.backlash", "tip.z"))
    solution = solve(problem, SolverOptions(starts=1))
    assert solution.estimates["joint_3.backlash"].state == "unidentified"
    told = {e.fixed: e for e in explain(problem, solution.x, solution.identification)}
    assert "from which side" in told["joint_3.backlash"].sentence
    assert "joint_3.direction" in told["joint_3.backlash"].remedy


def test_directions_are_read_back_and_nothing_else_is_one(tmp_path: Path) -> None:
    samples, file = both_sides(0).poses.samples, tmp_path / "a.csv"
    write_samples(file, samples)
    columns, ranges = SampleColumns(position=True), joint_ranges(ARM)
    again = read_samples([file], ranges, columns)
    assert again.direction is not None
    np.testing.assert_array_equal(again.direction, samples.direction)
    rows = file.read_text().splitlines()
    rows[3] = rows[3].rpartition(",")[0] + ",2"
    file.write_text("\n".join(rows))
    with pytest.raises(SamplesError, match=r"a\.csv:4.*found 2; expected 1 .it came from"):
        read_samples([file], ranges, columns)


@pytest.mark.parametrize(
    ("name", "row", "unit", "upper"),
    [
        ("joint_2.compliance", {"bound_rad_per_nm": 1e-3}, "rad/Nm", 1e-3),
        ("joint_2.ecc_c1", {"bound_rad": 0.01}, "rad", 0.01),
        ("joint_2.gain", {"bound_ratio": 0.02}, "1", 0.02),
        ("links.expansion", {"bound_per_k": 4e-5}, "1/K", 4e-5),
    ],
)
def test_bounds_and_priors_have_their_own_unit(
    name: str, row: dict[str, float], unit: str, upper: float
) -> None:
    ((key, size),) = row.items()
    prior = {key.replace("bound", "prior"): size / 5}
    parameter = ARM.select(Selection((name,), **row, **prior))[name]
    assert (parameter.unit, parameter.upper, parameter.prior) == (unit, upper, size / 5)


@pytest.mark.parametrize(
    ("names", "row", "says"),
    [
        ("*.offset", {"bound_ratio": 0.01}, r"bound or prior for .*all angles"),
        ("*.compliance", {"bound_rad": 0.01}, r"bound_deg or prior_deg for .*all compliances"),
        ("links.expansion", {"bound_m": 1e-3}, r"bound_mm or prior_mm for links\.expansion"),
    ],
)
def test_sizes_of_another_unit_are_refused(names: str, row: dict[str, float], says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        ARM.select(Selection((names,), **row))


def test_a_job_gives_them_in_degrees(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text("<robot/>")
    (tmp_path / "a.csv").write_text("x\n")
    (tmp_path / "calibration.yaml").write_text(
        "arm: {urdf: arm.urdf, tip: tip}\n"
        "parameters:\n"
        "  - {select: ['*.ecc_*'], bound_deg: 1}\n"
        "  - {select: ['*.compliance'], bound_deg_per_nm: 0.1, prior_deg_per_nm: 0.02}\n"
        "  - {select: ['*.gain'], bound: 0.1, prior: 0.02}\n"
        "observations:\n  - {kind: fixed_point, samples: a.csv}\n"
    )
    ecc, compliance, gain = read_job(tmp_path / "calibration.yaml").parameters
    assert (gain.bound_ratio, gain.prior_ratio) == (0.1, 0.02)
    assert ecc.bound_rad == pytest.approx(math.radians(1))
    assert compliance.bound_rad_per_nm == pytest.approx(math.radians(0.1))
    assert compliance.prior_rad_per_nm == pytest.approx(math.radians(0.02))


def extended(arm: ArmModel, *patterns: str) -> ParameterSet:
    return ParameterSet([*dh_parameters(arm).values(), *arm.select(*patterns).values()])


def test_a_solve_recovers_them_from_exact_data() -> None:
    arm = arm_named("suta")
    unknown = extended(arm, "*.ecc_?1", "joint_2.compliance", "joint_4.compliance")
    truth = perturbed(dh_parameters(arm), 1)
    truth |= {"joint_3.ecc_c1": 3.5e-3, "joint_5.ecc_s1": -2e-3, "joint_2.compliance": 4e-4}
    term = tracked_scene(arm, truth, 60).exact(Noise(1e-4))
    solution = solve(Problem([term], unknown), SolverOptions(starts=1))
    assert solution.converged
    told = {n: e for n, e in solution.estimates.items() if e.state == "identified"}
    for name in ("joint_3.ecc_c1", "joint_3.ecc_s1", "joint_5.ecc_s1", "joint_2.compliance"):
        assert told[name].value == pytest.approx(truth.get(name, 0.0), abs=1e-7)


SIMULATION = """\
arm: {urdf: URDF, tip: tip}
errors:
  - {select: ["*.offset"], value_deg: 1}
  - {select: [joint_3.ecc_c1], value_deg: 0.2}
  - {select: ["joint_[24].compliance"], ROW}
  - {select: [joint_5.gain], value: 0.01}
sets:
  seen: {kind: tracked_point, samples: 12}
"""


def simulation(folder: Path, urdf: Path, row: str = "value_deg_per_nm: 0.03") -> Path:
    text = SIMULATION.replace("URDF", str(urdf)).replace("ROW", row)
    (folder / "simulation.yaml").write_text(text)
    return folder / "simulation.yaml"


def test_a_simulation_can_have_them_as_truth(tmp_path: Path, suta_urdf: Path) -> None:
    made = simulate(read_simulation(simulation(tmp_path, suta_urdf)))
    assert made.values["joint_3.ecc_c1"] == pytest.approx(math.radians(0.2))
    assert made.values["joint_4.compliance"] == pytest.approx(math.radians(0.03))
    assert made.values["joint_5.gain"] == 0.01
    assert "joint_1.ecc_c1" not in made.values
    samples = made.files[0].samples
    position = made.arm.forward(samples.q, made.values)[1]
    np.testing.assert_allclose(samples.position, position, atol=1e-12)
    geometry = {n: v for n, v in made.values.items() if made.arm.offered[n].geometric}
    assert np.abs(made.arm.forward(samples.q, geometry)[1] - position).max() > 1e-3
    write_simulation(made, tmp_path / "out")
    truth = (tmp_path / "out" / "truth.yaml").read_text()
    assert "joint_4.compliance: {value_deg_per_nm: 0.03, error_deg_per_nm: 0.03}" in truth
    assert "joint_5.gain: {value: 0.01, error: 0.01}" in truth


def test_a_simulation_says_which_size_is_missing(tmp_path: Path, suta_urdf: Path) -> None:
    file = simulation(tmp_path, suta_urdf, "value_mm: 1")
    text = file.read_text().replace('"joint_[24].compliance"', "joint_2.compliance")
    file.write_text(text)
    with pytest.raises(JobError, match="value_deg_per_nm or std_deg_per_nm"):
        simulate(read_simulation(file))
