"""Eccentric encoders and yielding joints against Pinocchio, differences, and known truth."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from simulated import ARMS, arm_named, dh_parameters, perturbed, random_readings, tracked_scene

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


def gravity_torque(arm: ArmModel, q: np.ndarray) -> np.ndarray:
    """What gravity does to each joint of the chain, by Pinocchio, (n, joints)."""
    data = arm.model.createData()
    found = []
    for row in q:
        configuration = pin.neutral(arm.model)
        for name, reading in zip(arm.joints, row, strict=True):
            joint = arm.model.joints[arm.model.getJointId(name)]
            state = [reading] if joint.nq == 1 else [math.cos(reading), math.sin(reading)]
            configuration[joint.idx_q : joint.idx_q + joint.nq] = state
        fixed = pin.computeGeneralizedGravity(arm.model, data, configuration)
        order = [arm.model.joints[arm.model.getJointId(name)].idx_v for name in arm.joints]
        found.append(-fixed[order])
    return np.array(found)


def yielding(arm: ArmModel) -> list[str]:
    """Joints whose compliance can be asked for: revolute, with a mass beyond."""
    found = []
    for name, parameter in arm.nongeometric.items():
        if parameter.key == "compliance":
            try:
                arm.select(name)
            except UrdfError:
                continue
            found.append(parameter.owner)
    return found


@pytest.mark.parametrize("name", ARMS)
def test_they_turn_the_joint_by_what_the_equation_says(name: str) -> None:
    arm = arm_named(name)
    rng = np.random.default_rng(4)
    q = random_readings(arm, rng, 12)
    values = {n: 0.01 * rng.standard_normal() for n in arm.nongeometric if ".ecc_" in n}
    values |= {f"{joint}.compliance": 2e-3 * rng.standard_normal() for joint in yielding(arm)}
    torque = gravity_torque(arm, q)
    moved = q.copy()
    for k, joint in enumerate(arm.joints):
        ecc = [values.get(f"{joint}.{key}", 0.0) for key in ECC]
        angle = q[:, k]
        waves = (np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle))
        moved[:, k] += sum(c * w for c, w in zip(ecc, waves, strict=True))
        moved[:, k] += values.get(f"{joint}.compliance", 0.0) * torque[:, k]
    R, p = arm.forward(q, values)
    R_expected, p_expected = arm.forward(moved)
    np.testing.assert_allclose(R, R_expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(p, p_expected, rtol=0, atol=1e-12)


def test_gravity_is_that_of_the_root_link_also_where_the_chain_begins_higher() -> None:
    arm = arm_named("tiago")
    assert len(yielding(arm)) == 7  # the lifting torso slides, and has none
    q = random_readings(arm, np.random.default_rng(1), 4)
    assert np.abs(gravity_torque(arm, q)[:, 1:]).max() > 1.0


@pytest.mark.parametrize("name", ["suta", "panda"])
def test_derivatives_are_central_differences(name: str) -> None:
    arm = arm_named(name)
    rng = np.random.default_rng(0)
    names = [n for n in arm.nongeometric if not n.endswith("compliance")]
    names += [f"{joint}.compliance" for joint in yielding(arm)] + ["tip.x"] * (name == "suta")
    names += [f"{arm.joints[1]}.offset", f"{arm.joints[2]}.rx"]
    function = arm.function(names)
    theta = np.array([arm.offered[n].nominal for n in names]) + 0.02 * rng.standard_normal(
        len(names)
    )
    q = random_readings(arm, rng, 1)[0]
    R, _, jacobian = (np.array(a) for a in function(theta, q))
    R = R.reshape(3, 3, order="F")
    for k, h in enumerate(1e-6 * np.eye(len(names))):
        (Ra, pa, _), (Rb, pb, _) = (map(np.array, function(theta + s * h, q)) for s in (-1, 1))
        np.testing.assert_allclose(jacobian[k, :3], ((pb - pa) / 2e-6).ravel(), atol=1e-7)
        spin = (Rb - Ra).reshape(3, 3, order="F") / 2e-6 @ R.T
        np.testing.assert_allclose(jacobian[k, 3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-7)


def test_they_are_off_unless_a_pattern_names_them() -> None:
    arm = arm_named("suta")
    for pattern in ("geometric", "*", "joint_*", "*.offset", "joint_3.*", "*[xyz]"):
        assert all(p.geometric for p in arm.select(pattern).values())
    assert len(arm.select("*.ecc_*")) == 24
    assert arm.select("joint_?.ecc_?1").names[:2] == ("joint_1.ecc_c1", "joint_1.ecc_s1")
    assert len(arm.select("*.compliance")) == 6
    assert arm.select("joint_3.ecc_s2", "joint_2.z").names == ("joint_2.z", "joint_3.ecc_s2")
    assert all(p.geometric for p in arm.parameters.values())


def test_the_kinematics_without_them_are_as_they_were() -> None:
    arm = arm_named("suta")
    plain = arm.function(["joint_3.offset"])
    assert (
        plain.n_instructions() < arm.function(["joint_3.offset", "joint_3.ecc_c1"]).n_instructions()
    )
    zero = dict.fromkeys(arm.nongeometric, 0.0)
    q = random_readings(arm, np.random.default_rng(0), 3)
    for with_zero, without in zip(arm.forward(q, zero), arm.forward(q), strict=True):
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
    with pytest.raises(ParameterError, match=f"'{sliding}.{re.escape(key)}', and {sliding} slides"):
        arm.select(f"{sliding}.{key}")


def test_what_shows_nothing_is_explained() -> None:
    arm = arm_named("suta")
    scene = tracked_scene(arm, {}, 60)
    scene.q[:, 2] = 0.4
    scene.position[:] = arm.forward(scene.q)[1]
    unknown = arm.select("joint_1.compliance", "joint_3.offset", "joint_3.ecc_c1")
    problem = Problem([scene.exact(Noise(1e-4))], unknown)
    solution = solve(problem, SolverOptions(starts=1))
    told = {e.fixed: e for e in explain(problem, solution.x, solution.identification)}
    assert "gravity has no torque" in told["joint_1.compliance"].sentence
    assert "does the same as joint_3.offset" in told["joint_3.ecc_c1"].sentence
    assert told["joint_3.ecc_c1"].remedy == "turn joint_3 farther"


def test_a_gain_scales_the_reading_and_is_told_from_the_rest() -> None:
    """On a turning joint and on one that slides; a URDF does not hold it."""
    arm = arm_named("tiago")
    slides, turns = arm.joints[0], arm.joints[3]
    truth = {f"{turns}.gain": 0.004, f"{turns}.offset": 0.01, f"{slides}.gain": -0.02}
    q = random_readings(arm, np.random.default_rng(2), 40)
    read = q * (1.0 + np.array([truth.get(f"{joint}.gain", 0.0) for joint in arm.joints]))
    geometry = {f"{turns}.offset": 0.01}
    for found, expected in zip(arm.forward(q, truth), arm.forward(read, geometry), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-13)
    unknown = arm.select("*.gain", "*.offset")
    term = tracked_scene(arm, truth, 60).exact(Noise(1e-4))
    solution = solve(Problem([term], unknown), SolverOptions(starts=1))
    for name in (f"{turns}.gain", f"{slides}.gain"):
        estimate = solution.estimates[name]
        assert (estimate.unit, estimate.state) == ("1", "identified")
        assert estimate.value == pytest.approx(truth[name], abs=1e-8)
    assert arm.calibrated_urdf(truth) == arm.calibrated_urdf(geometry)


def test_a_gain_that_nothing_shows_is_explained() -> None:
    arm = arm_named("suta")
    scene = tracked_scene(arm, {}, 60)
    scene.q[:, 2] = 0.4
    scene.position[:] = arm.forward(scene.q)[1]
    problem = Problem([scene.exact(Noise(1e-4))], arm.select("joint_3.offset", "joint_3.gain"))
    solution = solve(problem, SolverOptions(starts=1))
    (told,) = explain(problem, solution.x, solution.identification)
    assert told.fixed == "joint_3.gain"
    assert "does the same as joint_3.offset" in told.sentence
    assert told.remedy == "turn joint_3 farther"


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
    assert "both sides" in told["joint_3.backlash"].sentence
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


def test_bounds_and_priors_have_their_own_unit() -> None:
    arm = arm_named("suta")
    row = Selection(("joint_2.compliance",), bound_rad_per_nm=1e-3, prior_rad_per_nm=2e-4)
    parameter = arm.select(row)["joint_2.compliance"]
    assert (parameter.unit, parameter.upper, parameter.prior) == ("rad/Nm", 1e-3, 2e-4)
    ecc = arm.select(Selection(("joint_2.ecc_c1",), bound_rad=0.01))["joint_2.ecc_c1"]
    assert (ecc.unit, ecc.upper) == ("rad", 0.01)
    gain = arm.select(Selection(("joint_2.gain",), bound_ratio=0.02))["joint_2.gain"]
    assert (gain.unit, gain.upper) == ("1", 0.02)
    with pytest.raises(ParameterError, match=r"bound or prior for .*all angles"):
        arm.select(Selection(("*.offset",), bound_ratio=0.01))
    with pytest.raises(ParameterError, match=r"bound_deg or prior_deg for .*all compliances"):
        arm.select(Selection(("*.compliance",), bound_rad=0.01))


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


def test_what_cannot_be_told_apart_from_an_offset_is_held_and_named() -> None:
    """A joint that hardly moves: its eccentricity is an offset."""
    arm = arm_named("suta")
    truth = {"joint_3.offset": 0.01}
    scene = tracked_scene(arm, truth, 60)
    scene.q[:, 2] = 0.4
    scene.position[:] = arm.forward(scene.q, truth)[1]
    unknown = arm.select("joint_3.offset", "joint_3.ecc_c1")
    solution = solve(Problem([scene.exact(Noise(1e-4))], unknown), SolverOptions(starts=1))
    assert solution.unidentified == ("joint_3.ecc_c1",)
    assert solution.estimates["joint_3.offset"].given == ("joint_3.ecc_c1",)


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
