"""Joints that bend across their axes under gravity, and loads at the tip, against known truth.

On random trees `test_trees` holds poses and derivatives against Pinocchio's joint forces.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import arm_named, random_readings, tracked_scene
from simulation_scenes import Folder
from torso_robot import torso_robot, torso_robot_urdf

from suta_calib import Robot
from suta_calib.analysis.model_selection import choose_model
from suta_calib.errors import JobError, ParameterError, SamplesError, UrdfError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import SampleColumns, Samples, read_samples, write_samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.kinematics import Segment
from suta_calib.model.parameters import Selection
from suta_calib.report.model_selection import row_text
from suta_calib.simulation import write_simulation
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Noise, TrackedPoint
from suta_calib.terms.poses import joint_ranges
from suta_calib.trust.explanation import explain

ARM = arm_named("suta")
G = 9.81
# A lateral elasticity, and one about the axis.
BENT = {
    "joint_1.compliance_x": 6e-5,
    "joint_1.compliance_y": 4e-5,
    "joint_2.compliance": 1e-4,
    "joint_4.compliance_x": 2e-4,
}
ONCE = SolverOptions(starts=1)
BEAM = """<robot name="beam"><link name="base"/>
  <joint name="turn" type="{kind}"><parent link="base"/><child link="beam"/>
    <origin xyz="0 0 1"/><axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <link name="beam"><inertial><origin xyz="0.4 0 0"/><mass value="3"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="beam"/><child link="tip"/><origin xyz="0.8 0 0"/>
  </joint><link name="tip"/></robot>"""


def beam(kind: str = "revolute", axis: str = "0 0 1") -> ArmModel:
    """Three kilograms at 0.4 m from a joint."""
    return ArmModel.from_urdf(BEAM.format(kind=kind, axis=axis), "tip")


@pytest.mark.parametrize(
    ("axis", "across"),
    [
        ([0, 0, 1], ([1, 0, 0], [0, 1, 0])),
        ([0, 0, -1], ([1, 0, 0], [0, 1, 0])),
        ([1, 0, 0], ([0, 1, 0], [0, 0, 1])),
        ([0, -1, 0], ([0, 0, 1], [1, 0, 0])),
        ([0, 0.6, 0.8], ([1, 0, 0], [0, 0.8, -0.6])),
    ],
)
def test_the_axes_across_are_those_of_the_frame_in_cyclic_order(
    axis: list[float], across: tuple[list[float], list[float]]
) -> None:
    segment = Segment("j", "revolute", np.eye(3), np.zeros(3), np.array(axis, dtype=float))
    np.testing.assert_allclose(segment.across.T, across, atol=1e-15)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_beam_hangs_down_by_its_weight_and_by_what_it_carries(kind: str) -> None:
    """By the rule of levers: the weight times its distance from the joint, times the compliance."""
    arm, compliance = beam(kind), 1e-4
    loads = {"payload": np.array([[0.0, 0, 0, 0], [2.0, 0.1, 0, 0], [2.0, 0, 0, 0]])}
    q = np.zeros((3, 1))
    values = {"turn.compliance_y": compliance}
    angle = compliance * G * np.array([3 * 0.4, 3 * 0.4 + 2 * 0.9, 3 * 0.4 + 2 * 0.8])
    _, position = arm.forward(q, values, loads)
    np.testing.assert_allclose(position[:, 2], 1 - 0.8 * np.sin(angle), atol=1e-12)
    # Nobody says that it carries something, and about the other axes there is no torque.
    np.testing.assert_allclose(arm.forward(q, values)[1][:, 2], position[0, 2], atol=1e-15)
    straight = arm.forward(q, {"turn.compliance_x": compliance}, loads)[1]
    np.testing.assert_allclose(straight, [[0.8, 0, 1]] * 3, atol=1e-15)
    # The axes stand still on the parent link, where gravity always has the same torque about y.
    if kind == "revolute":
        turned = arm.forward([[np.pi / 2]], {"turn.compliance_x": compliance})[1]
        assert turned[0, 2] == pytest.approx(1 - 0.8 * np.sin(compliance * G * 3 * 0.4), abs=1e-12)
    heavier = arm.forward(q[0], values | {"turn.mass": 4.0})[1]
    assert heavier[2] == pytest.approx(1 - 0.8 * np.sin(compliance * G * 4 * 0.4), abs=1e-12)


def test_they_are_off_unless_a_pattern_names_them() -> None:
    assert len(ARM.select("*.compliance")) == 6
    assert len(ARM.select("*.compliance_*")) == 12
    assert len(ARM.select("*.compliance*")) == 18
    assert ARM.select("*.mass").names == tuple(f"joint_{k}.mass" for k in range(1, 7))
    assert not {p.key for p in ARM.select("geometric", "joint_*").values()} & {"mass"}


def loads(n: int, rng: np.random.Generator) -> np.ndarray:
    """Nothing, two or five kilograms 8 cm beyond the tip."""
    masses = rng.choice([0.0, 2.0, 5.0], n)
    return np.column_stack([masses, np.zeros((n, 2)), np.full(n, 0.08)])


def seen(
    seed: int, truth: dict[str, float], *, loaded: bool, sigma: float = 5e-5, told: bool = True
) -> TrackedPoint:
    """An instrument sees the tip of an arm that bends; samples say what it carried, or do not."""
    scene, rng = tracked_scene(ARM, {}, 80), np.random.default_rng(seed)
    load = loads(80, rng)
    _, position = ARM.forward(scene.q, truth, {"payload": load} if loaded else {})
    samples = replace(
        scene.exact().poses.samples,
        position=position + rng.normal(0, sigma, position.shape),
        payload=load if loaded and told else None,
    )
    return scene.term(samples)


@pytest.mark.parametrize("loaded", [True, False])
def test_a_solve_recovers_it_from_exact_data(loaded: bool) -> None:
    unknown = ARM.select("joint_*.offset", *BENT)
    scene = tracked_scene(ARM, {}, 80)
    load = {"payload": loads(80, np.random.default_rng(0))} if loaded else {}
    truth = BENT | {"joint_3.offset": 0.01}
    _, position = ARM.forward(scene.q, truth, load)
    samples = replace(scene.exact().poses.samples, position=position, **load)
    for hessian in ("gauss-newton", "exact"):
        options = SolverOptions(starts=1, hessian=hessian)
        found = solve(Problem([scene.term(samples, Noise(1e-4))], unknown), options)
        for name, value in truth.items():
            assert found.estimates[name].state == "identified"
            assert found.values[name] == pytest.approx(value, abs=1e-9)


def test_it_errs_as_it_says() -> None:
    """Over ten sets of noise, in units of the standard deviations (chi-squared, 50, 0.1 %)."""
    truth = BENT | {"joint_6.mass": 0.3}
    mass = Selection(("joint_6.mass",), bound_kg=1.0)
    unknown = ARM.select("joint_*.offset", *BENT, mass)
    pulls = []
    for seed in range(10):
        found = solve(Problem([seen(seed, truth, loaded=True)], unknown), ONCE)
        pulls += [(found.values[n] - v) / (found.estimates[n].std or 0) for n, v in truth.items()]
    assert 24.7 < np.sum(np.square(pulls)) < 86.7


def test_masses_alone_are_known_by_their_product_with_a_compliance() -> None:
    """All masses greater and all compliances smaller by as much: no deflection changes."""
    names = (
        "joint_4.compliance_x",
        "joint_4.compliance_y",
        *(f"joint_{k}.mass" for k in (4, 5, 6)),
    )
    truth = dict.fromkeys(names[:2], 5e-4)
    term = seen(0, truth, loaded=False)
    problem = Problem([term], ARM.select("joint_2.offset", *names))
    found = solve(problem, ONCE)
    held = [n for n in found.unidentified if n.endswith(".mass")]
    assert held
    assert not [n for n in found.unidentified if "compliance" in n]
    for name in names[:2]:
        assert set(found.estimates[name].given) <= {*held}
        assert found.estimates[name].given
    # The direction that is left open scales one against the other.
    q, there, factor = term.poses.samples.q, {n: found.values[n] for n in names}, 1.7
    scaled = {n: v * factor ** (1 if "compliance" in n else -1) for n, v in there.items()}
    np.testing.assert_allclose(ARM.forward(q, scaled)[1], ARM.forward(q, there)[1], atol=1e-13)
    told = [e for e in explain(problem, found.x, found.identification) if e.fixed in held]
    product = [e for e in told if "only their product" in e.sentence]
    assert product
    assert "payload_kg" in product[0].remedy
    # A prior of one mass, or known loads, tell them.
    prior = Selection(("joint_[456].mass",), prior_kg=0.05)
    with_prior = ARM.select("joint_2.offset", *names, prior)
    assert not solve(Problem([term], with_prior), ONCE).unidentified
    lighter = ARM.select("joint_2.offset", *names[:2], Selection(("joint_6.mass",), bound_kg=1.0))
    free = solve(Problem([seen(0, truth, loaded=True)], lighter), ONCE)
    assert not free.unidentified
    estimate = free.estimates["joint_6.mass"]
    assert estimate.value == pytest.approx(0.23, abs=4 * (estimate.std or 0))


def test_a_load_that_is_always_the_same_is_as_none() -> None:
    """At the tip's origin: masses that follow it along are told by their sum alone."""
    scene = tracked_scene(ARM, {}, 80)
    load = {"payload": np.tile([2.0, 0.0, 0.0, 0.0], (80, 1))}
    truth = {"joint_4.compliance_x": 5e-4, "joint_4.compliance_y": 5e-4}
    _, position = ARM.forward(scene.q, truth, load)
    samples = replace(scene.exact().poses.samples, position=position, payload=None)
    noise = np.random.default_rng(0).normal(0, 5e-5, position.shape)
    untold = scene.term(replace(samples, position=position + noise))
    told = scene.term(replace(samples, position=position + noise, **load))
    names = ARM.select("joint_2.offset", *truth)
    for term, right in ((told, True), (untold, False)):
        found = solve(Problem([term], names), ONCE)
        estimate = found.estimates["joint_4.compliance_x"]
        off = abs(estimate.value - 5e-4) / (estimate.std or 0)
        assert (off < 4) == right


def test_what_no_joint_yields_to_is_refused(tmp_path: Path, suta_urdf: Path) -> None:
    with pytest.raises(ParameterError, match=r"joint_3\.mass, but no compliance of a joint that c"):
        ARM.check_masses_felt(ARM.select("joint_3.mass", "joint_4.compliance_x"))
    ARM.check_masses_felt(ARM.select("joint_3.mass", "joint_2.compliance"))
    ARM.at({"joint_1.compliance_y": 1e-5}).check_masses_felt(ARM.select("*.mass"))
    robot = torso_robot()
    with pytest.raises(ParameterError, match=r"left_2\.mass, but no compliance"):
        robot.check_masses_felt(robot.select("left_2.mass", "right_1.compliance"))
    robot.check_masses_felt(robot.select("left_2.mass", "torso_2.compliance_x"))
    (tmp_path / "a.csv").write_text("target,x,y,z," + ",".join(ARM.joints) + "\n")
    (tmp_path / "calibration.yaml").write_text(
        f"arm: {{urdf: {suta_urdf}, tip: tip}}\n"
        "parameters:\n"
        "  - {select: ['*.offset'], bound_deg: 5}\n"
        "  - {select: [joint_3.mass], prior_kg: 0.1, bound_kg: 0.4}\n"
        "observations:\n  - {kind: tracked_point, samples: a.csv}\n"
    )
    with pytest.raises(JobError, match=r"calibration\.yaml.*joint_3\.mass, but no compl"):
        CalibrationJob.load(tmp_path / "calibration.yaml")


def test_masses_have_a_unit_of_their_own_and_are_never_below_zero() -> None:
    row = Selection(("joint_3.mass",), bound_kg=5.0, prior_kg=0.1)
    mass = ARM.select(row, "joint_2.compliance")["joint_3.mass"]
    assert (mass.unit, mass.nominal, mass.lower, mass.upper) == ("kg", 0.59, 0.0, 5.59)
    assert mass.prior == 0.1
    free = ARM.select("joint_3.mass")["joint_3.mass"]
    assert (free.lower, free.plausible) == (0.0, pytest.approx(0.3 * 0.59))
    with pytest.raises(ParameterError, match=r"bound_kg or prior_kg for .*all compliances"):
        ARM.select(Selection(("joint_3.compliance_x",), bound_kg=1.0))


def test_what_a_urdf_lacks_is_said(suta_urdf: Path) -> None:
    text = re.sub(r"<inertial>.*?</inertial>", "", suta_urdf.read_text(), flags=re.DOTALL)
    light = ArmModel.from_urdf(text, "tip")
    with pytest.raises(UrdfError, match=r"joint_1\.compliance_x: found no mass in any link behind"):
        light.select("*.compliance_x")
    with pytest.raises(
        ParameterError, match=r"'joint_3\.mass', but the URDF has no mass that join"
    ):
        light.select("joint_3.mass")
    (sliding,) = [j.name for j in arm_named("tiago").chain.moving if j.type == "prismatic"]
    assert len(arm_named("tiago").select(f"{sliding}.compliance_*")) == 2


def test_the_urdf_holds_the_geometry_alone() -> None:
    geometry = {"joint_4.z": 0.3}
    assert ARM.calibrated_urdf(geometry | BENT) == ARM.calibrated_urdf(geometry)
    mass = ARM.offered["joint_3.mass"]
    assert mass.in_urdf(0.59)
    assert not mass.in_urdf(0.6)
    assert not ARM.offered["joint_3.compliance_x"].in_urdf(1e-6)


def test_loads_are_read_back(tmp_path: Path) -> None:
    samples, file = seen(0, BENT, loaded=True).poses.samples, tmp_path / "a.csv"
    write_samples(file, samples)
    columns, ranges = SampleColumns(position=True), joint_ranges(ARM)
    again = read_samples([file], ranges, columns)
    assert again.payload is not None
    np.testing.assert_array_equal(again.payload, samples.payload)
    np.testing.assert_array_equal(again.conditions["payload"], samples.payload)
    some = Samples.concatenate([again.take([0, 1]), again.take([5])])
    np.testing.assert_array_equal(some.payload, samples.payload[[0, 1, 5]])
    text = file.read_text()
    in_mm = text.replace("payload_z", "payload_z_mm", 1).replace(",0.08\n", ",80\n")
    file.write_text(in_mm)
    converted = read_samples([file], ranges, columns)
    np.testing.assert_allclose(converted.payload, samples.payload, atol=1e-15)
    # Its mass alone: at the tip.
    lines = [line.rsplit(",", 3)[0] for line in text.splitlines()]
    file.write_text("\n".join(lines))
    alone = read_samples([file], ranges, columns)
    np.testing.assert_array_equal(alone.payload[:, 0], samples.payload[:, 0])
    assert not alone.payload[:, 1:].any()


@pytest.mark.parametrize(
    ("header", "cells", "said"),
    [
        ("payload_kg", "-2", r"a\.csv:3: column 'payload_kg': found -2; expected a mass in kg, 0"),
        ("payload_kg", "nan", r"a\.csv:3: column 'payload_kg': found 'nan'"),
        ("payload_kg,payload_x,payload_y,payload_z", "1,2,3,1e9", r"within 1e\+06 m"),
        ("payload_x,payload_y,payload_z", "0,0,0", r"a\.csv:1: found only the columns payload_x, "),
        (
            "payload_kg,payload_x_mm",
            "1,2",
            "expected payload_kg alone, or payload_kg, payload_x_mm",
        ),
        ("payload_kg,payload_x,payload_x_mm,payload_y,payload_z", "1,2,3,4,5", "either payload_x"),
    ],
)
def test_loads_that_cannot_be_are_refused(
    tmp_path: Path, header: str, cells: str, said: str
) -> None:
    readings = ",".join("0" * 6)
    zeros = ",".join("0" * len(cells.split(",")))
    rows = [f"{','.join(ARM.joints)},x,y,z,{header}"]
    rows += [f"{readings},0,0,0,{given}" for given in (zeros, cells)]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(SamplesError, match=said):
        read_samples([tmp_path / "a.csv"], joint_ranges(ARM), SampleColumns(position=True))


def test_loads_of_arrays() -> None:
    q = random_readings(ARM, np.random.default_rng(0), 3)
    position = np.zeros((3, 3))
    made = TrackedPoint.from_arrays(ARM, q, position=position, target="A", payload=[0, 1, 2])
    np.testing.assert_array_equal(made.poses.samples.payload[:, 0], [0, 1, 2])
    full = np.array([[1.0, 0.1, 0.2, 0.3]] * 3)
    made = TrackedPoint.from_arrays(ARM, q, position=position, target="A", payload=full)
    np.testing.assert_array_equal(made.poses.samples.payload, full)
    for wrong, said in (
        ([0, np.nan, 1], r"payload\[1, 0\]: found nan; expected a finite number"),
        ([0, -1, 1], r"payload\[1, 0\]: found -1; expected a mass in kg, 0 or more"),
        (np.zeros((3, 3)), r"payload: found shape \(3, 3\)"),
    ):
        with pytest.raises(SamplesError, match=said):
            TrackedPoint.from_arrays(ARM, q, position=position, target="A", payload=wrong)


def test_with_another_load_it_does_not_rest_where_it_did() -> None:
    q = np.repeat(random_readings(ARM, np.random.default_rng(0), 2), 2, axis=0)
    payload = np.zeros((4, 4))
    payload[:, 0] = [0.0, 1.0, 2.0, 2.0]
    samples = Samples.from_arrays(ARM.joints, q, payload=payload)
    poses = ArmPoses(ARM, samples)
    assert poses.rests.tolist() == [0, 1, 2, 2]
    assert poses.postures.tolist() == [0, 0, 1, 1]
    assert poses.take([0, 1]).rests.tolist() == [0, 1]
    bare = ArmPoses(ARM, replace(samples, payload=None))
    assert bare.rests.tolist() == [0, 0, 1, 1]


def test_it_is_found_worth_having_only_where_the_arm_bends() -> None:
    truth = {"joint_1.compliance_x": 3e-4, "joint_1.compliance_y": 3e-4}
    unknown = ARM.select("joint_*.offset", "geometric")
    for bent in (True, False):
        for seed in (0, 1):
            term = seen(seed, truth if bent else {}, loaded=False, sigma=1e-4)
            choice = choose_model([term], unknown)
            assert choice.added == (tuple(truth) if bent else ())
            if bent:
                (row,) = choice.rows
                assert row_text(row) == (
                    "- {select: [joint_1.compliance_x, joint_1.compliance_y], "
                    "bound_deg_per_nm: 0.2}"
                )
                assert choice.solution.values["joint_1.compliance_x"] == pytest.approx(
                    3e-4, abs=4 * (choice.solution.estimates["joint_1.compliance_x"].std or 0)
                )


@pytest.mark.slow
@pytest.mark.parametrize("bent", [True, False])
def test_it_is_found_in_most_of_twenty_seeds(bent: bool) -> None:
    truth = {"joint_1.compliance_x": 3e-4, "joint_1.compliance_y": 3e-4}
    unknown = ARM.select("joint_*.offset", "geometric")
    added = [
        choose_model([seen(seed, truth if bent else {}, loaded=False, sigma=1e-4)], unknown).added
        for seed in range(20)
    ]
    assert sum(set(truth) <= {*names} if bent else not names for names in added) >= 19
    # What is added beside it is a false alarm, too.
    assert sum({*names} > set(truth) for names in added) <= 2


SIMULATION = """
arm: {urdf: URDF, tip: tip}
seed: 4
errors:
  - {select: ["joint_*.offset"], std_deg: 1}
  - {select: [joint_1.compliance_x, joint_4.compliance_y], value_deg_per_nm: 0.01}
  - {select: [joint_3.mass], value_kg: 0.2}
sets:
  tracked:
    kind: tracked_point
    samples: 60
    payload_kg: [0, 2, 5]
    payload_position_mm: [0, 10, 80]
    base_in_instrument: {position_mm: [1000, 2000, 300], rotation_rpy_deg: [10, 20, 30]}
"""


def test_it_is_simulated_and_found_again(tmp_path: Path, suta_urdf: Path) -> None:
    folder = Folder(tmp_path, suta_urdf)
    made = folder.simulate(SIMULATION)
    assert made.values["joint_3.mass"] == pytest.approx(0.79)
    write_simulation(made, tmp_path / "out")
    truth = (tmp_path / "out" / "truth.yaml").read_text()
    assert "joint_3.mass: {value_kg: 0.79, error_kg: 0.2}" in truth
    assert "joint_1.compliance_x: {value_deg_per_nm: 0.01" in truth
    columns, ranges = SampleColumns(position=True), joint_ranges(ARM)
    samples = read_samples([tmp_path / "out" / "tracked" / "samples.csv"], ranges, columns)
    assert set(samples.payload[:, 0]) == {0, 2, 5}
    assert (samples.payload[:, 1:] == [0, 0.01, 0.08]).all()
    names = ("joint_1.compliance_x", "joint_4.compliance_y", "joint_3.mass")
    mass = Selection(names[2:], bound_kg=1.0)
    unknown = ARM.select("joint_*.offset", *names[:2], mass)
    found = solve(Problem([TrackedPoint(ArmPoses(ARM, samples), Noise(1e-5))], unknown), ONCE)
    for name in names:
        assert found.values[name] == pytest.approx(made.values[name], rel=1e-5)
    # All else is drawn as without loads.
    plain = re.sub(r"    payload.*\n", "", SIMULATION)
    (bare,) = folder.simulate(plain).files
    assert bare.samples.payload is None
    np.testing.assert_array_equal(bare.samples.q, samples.q)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[0, 2, 5]", "[0, -2]", r"payload_kg\[1\]: found -2; expected a mass in kg, 0 or more"),
        ("[0, 2, 5]", "[]", "payload_kg: found 0 values; expected a list"),
        ("[0, 2, 5]", "3", "payload_kg: found 3; expected a list"),
        ("value_kg: 0.2", "value_kg: -2", r"found a mass of -1\.41 kg for joint_3\.mass"),
        ("value_kg: 0.2", "value_mm: 2", "value_kg or std_kg"),
    ],
)
def test_simulations_that_cannot_be_are_refused(
    tmp_path: Path, suta_urdf: Path, old: str, new: str, said: str
) -> None:
    with pytest.raises(JobError, match=said):
        Folder(tmp_path, suta_urdf).simulate(SIMULATION.replace(old, new))


def test_chains_of_one_robot_may_carry_different_masses() -> None:
    """What hangs on a shared joint is not the same for each of its chains."""
    hand = '"left_hand"><inertial><origin xyz="0 0 -0.1"/><mass value="'
    text = torso_robot_urdf().replace(f'{hand}1"', f'{hand}4"')
    robot = Robot.from_urdf(text, {"left": ("left_hand", None), "right": ("right_hand", None)})
    assert "torso_2.compliance_x" in robot.select("*.compliance_*")


def test_an_arm_on_a_wall_hangs_down_along_the_gravity_that_is_given() -> None:
    arm, values = beam().with_gravity([0, 9.81, 0]), {"turn.compliance": 1e-4}
    _, position = arm.forward([[0.0]], values)
    angle = 1e-4 * G * 3 * 0.4
    np.testing.assert_allclose(position[0], [0.8 * np.cos(angle), 0.8 * np.sin(angle), 1])
    # Values and columns of a robot keep it.
    np.testing.assert_allclose(arm.at(values).forward([[0.0]])[1], position, atol=1e-15)
    robot = torso_robot()
    turned, bent = robot.with_gravity([1, 0, 0]), {"torso_2.compliance_x": 1e-4}
    q = np.random.default_rng(0).uniform(-1, 1, len(robot.joints))
    here, there = (r.laid_out["left"].forward(q, bent)[1] for r in (robot, turned))
    assert np.linalg.norm(here - there) > 1e-5
    for wrong in ([0, 0, 0], [0, 0], [0, 0, np.nan]):
        with pytest.raises(ParameterError, match=r"gravity.*x, y, z of a direction"):
            arm.with_gravity(wrong)


def test_a_job_says_where_gravity_points(tmp_path: Path, suta_urdf: Path) -> None:
    folder = Folder(tmp_path, suta_urdf)
    wall = SIMULATION.replace("tip: tip}", "tip: tip, gravity: [1, 1, 1]}")
    made = folder.simulate(wall)
    write_simulation(made, tmp_path)
    text = (
        f"arm: {{urdf: {suta_urdf}, tip: tip, gravity: [2, 2, 2]}}\n"
        "parameters:\n"
        "  - {select: ['joint_*.offset', joint_1.compliance_x, joint_4.compliance_y]}\n"
        "  - {select: [joint_3.mass], bound_kg: 1}\n"
        "observations:\n  - {kind: tracked_point, samples: tracked/samples.csv}\n"
    )
    (tmp_path / "calibration.yaml").write_text(text)
    found = solve(CalibrationJob.load(tmp_path / "calibration.yaml").problem(), ONCE)
    for name in ("joint_1.compliance_x", "joint_4.compliance_y", "joint_3.mass"):
        assert found.values[name] == pytest.approx(made.values[name], rel=1e-4)
    (tmp_path / "calibration.yaml").write_text(text.replace("[2, 2, 2]", "[0, 0, 0]"))
    with pytest.raises(JobError, match=r"calibration\.yaml:1.*gravity.*length zero"):
        CalibrationJob.load(tmp_path / "calibration.yaml")
