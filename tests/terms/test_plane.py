"""Unknown planes: what is particular to them, and every command over a job of them."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import answer, cli
from measuring_bench import Bench
from simulated import Spread, arm_named, dh_parameters, perturbed, plane_scene

from suta_calib.analysis.outliers import find_outliers
from suta_calib.analysis.study.trial import resimulated
from suta_calib.emulation import EmulatedArm
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import Samples
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import MeasuredPoses, Noise, TouchedPlane
from suta_calib.terms.given_pose import GivenPose
from suta_calib.trust.external_poses import external_poses

SIMULATION = """\
arm: {urdf: arm.urdf, tip: tip}
seed: 3
errors: [{select: ["*.offset"], std_deg: 0.5}]
noise: {seating_mm: 0.05}
sets:
  calibration:
    kind: plane
    planes:
      S1: {position_mm: [450, 50, -50], rotation_rpy_deg: [0, 6, 0]}
      S2: {position_mm: [-50, 450, 100], rotation_rpy_deg: [23, 0, 17]}
      S3: {position_mm: [-400, -200, 0], rotation_rpy_deg: [-6, -17, 0]}
      S4: {position_mm: [200, -450, 150], rotation_rpy_deg: [28, 17, 0]}
    directions: 12
    cone_deg: 40
    size_mm: 150
    probe_radius_mm: 10
  validation:
    kind: plane
    planes: {S1: {position_mm: [450, 50, -50], rotation_rpy_deg: [0, 6, 0]}}
    directions: 6
    cone_deg: 30
    probe_radius_mm: 10
"""
JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters: [{select: ["joint_*.offset"], bound_deg: 5}, {select: [tip.y], bound_mm: 30}]
observations: [{kind: plane, probe_radius_mm: 10, samples: 'calibration/*.csv', huber_mm: 1}]
validation: [{kind: plane, probe_radius_mm: 10, samples: 'validation/*.csv'}]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    """A simulated job."""
    path = tmp_path_factory.mktemp("planes")
    (path / "arm.urdf").write_bytes((repository / "urdf" / "suta.urdf").read_bytes())
    (path / "simulation.yaml").write_text(SIMULATION)
    (path / "job.yaml").write_text(JOB)
    assert cli("simulate", path / "simulation.yaml", "--out", path) == 0
    return path


def test_planes_tell_the_arm(folder: Path) -> None:
    """What is told, how well, where the plane then stands; and that errors have a sign."""
    seen = answer("observe", folder / "job.yaml")
    assert seen["parameters"]["tip.y"]["state"] == "identified"
    found = answer("calibrate", folder / "job.yaml", "--out", folder / "results")
    assert found["unidentified"] == ["joint_1.offset"]
    for data, count in (("calibration", 48), ("validation", 6)):
        metrics = found["metrics"][data]
        assert metrics["after"]["count"] == count
        assert metrics["after"]["rms_mm"] < 0.08 < 0.5 < metrics["before"]["rms_mm"]
    # The plane stands where it was put, the ball's radius below the tip.
    normal = rotation_from_vector(np.radians([0, 6, 0]))[:, 2]
    height = 1e3 * found["parameters"]["plane[S1].z"]["value"]
    assert height == pytest.approx(normal @ [450, 50, -50], abs=1.0)
    with (folder / "results" / "residuals.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["kind"] == "plane"]
    assert len(rows) == 54
    numbers = [float(v) for row in rows for k, v in row.items() if k == "c1_after"]
    assert min(numbers) < 0 < max(numbers)


def test_a_touch_that_slipped_is_found(folder: Path, tmp_path: Path) -> None:
    text = (folder / "calibration" / "S2.csv").read_text().splitlines()
    cells = text[4].split(",")
    text[4] = ",".join([cells[0], str(float(cells[1]) + 0.01), *cells[2:]])
    samples = tmp_path / "calibration"
    samples.mkdir()
    for name in ("S1", "S2", "S3", "S4"):
        copied = (folder / "calibration" / f"{name}.csv").read_text()
        (samples / f"{name}.csv").write_text("\n".join(text) if name == "S2" else copied)
    (tmp_path / "arm.urdf").write_bytes((folder / "arm.urdf").read_bytes())
    job = "\n".join(line for line in JOB.splitlines() if "validation" not in line)
    (tmp_path / "job.yaml").write_text(job)
    loaded = CalibrationJob.load(tmp_path / "job.yaml")
    found = find_outliers(loaded.problem(), options=loaded.options())
    assert found.exclusion == [{"rows": ["S2.csv:5"]}]
    (tmp_path / "job.yaml").write_text(
        job.replace("huber_mm: 1", "exclude: {planes: [S3], rows: [S2.csv:5]}")
    )
    assert len(CalibrationJob.load(tmp_path / "job.yaml").observations[0].poses) == 35


def test_planes_are_measured(
    tmp_path: Path, repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = Bench.made(tmp_path, repository)
    text = bench.job.read_text().replace(
        "kind: fixed_point, samples: 'fixed_point", "kind: plane, samples: 'planes"
    )
    bench.job.write_text(text)
    hand = bench.emulation(bench.stops("O,M1,L1,S1", rest=0.01, move=0.5))
    with EmulatedArm(hand, patient=True) as emulator:
        emulator.write_device(bench.folder / "device.yaml")
        assert cli(*bench.command("--plane", "S1", "--continuous", 1, "--every", 0.1)) == 0
    capsys.readouterr()
    samples = bench.samples("planes/S1_1.csv", TouchedPlane.columns)
    assert set(samples.labels["plane"]) == {"S1"}
    assert cli(*bench.command("--point", "F1")) == 2
    assert "observations of kind" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("probe_radius_mm: 10, s", "probe_radius_mm: -1, s", "probe_radius_mm: found -1"),
        ("probe_radius_mm: 10, s", "probe_radius: 1, s", "did you mean 'probe_radius_mm'"),
        ("probe_radius_mm: 10, s", "artefact: a.yaml, s", "a key that plane does not use"),
        ("probe_radius_mm: 10, s", "sigma_deg: 1, s", "a key that plane does not use"),
        ("kind: plane, probe", "kind: fixed_point, probe", "a key that fixed_point does not use"),
        ("huber_mm: 1", "exclude: {planes: [S9]}", "exclude.planes: found 'S9'"),
    ],
)
def test_what_makes_no_sense_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], before: str, after: str, message: str
) -> None:
    (folder / "bad.yaml").write_text(JOB.replace(before, after, 1))
    assert cli("observe", folder / "bad.yaml") == 2
    error = capsys.readouterr().err
    assert message in error
    assert "bad.yaml" in error


def over(
    position: np.ndarray, rotation: np.ndarray | None = None, radius: float = 0.0
) -> TouchedPlane:
    """Touches of one plane by measured poses, the tip's z axis down by default."""
    n = len(position)
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (n, 1, 1)) if rotation is None else rotation
    samples = Samples.from_arrays([], np.zeros((n, 0)), labels={"plane": ["S"] * n})
    return TouchedPlane(MeasuredPoses(down, position, samples), Noise(1e-4), radius)


def test_too_few_touches_of_a_plane_are_refused() -> None:
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]])
    over(corners).check_enough()
    with pytest.raises(SamplesError, match=r"plane S touched 3 times.*at least 4"):
        over(corners[:3]).check_enough()
    with pytest.raises(SamplesError, match="plane S on one line"):
        over(np.linspace(0, 1, 6)[:, None] * [0.1, 0.2, 0.05]).check_enough()


@pytest.mark.parametrize("normal", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [1, 2, -3]])
def test_the_start_is_the_plane_whichever_way_it_faces(normal: list[float]) -> None:
    """A ball on the side that the tip comes from: a table, a ceiling, walls."""
    rng = np.random.default_rng(0)
    n = np.array(normal) / np.linalg.norm(normal)
    a = np.linalg.svd(n[None])[2][1:]
    position = rng.uniform(-0.2, 0.2, (10, 2)) @ a + (0.3 + 0.02) * n
    rotation = np.tile(np.column_stack([a[0], np.cross(-n, a[0]), -n]), (10, 1, 1))
    term = over(position, rotation, radius=0.02)
    values = term.start_values({})
    turn = rotation_from_vector([values["plane[S].rx"], values["plane[S].ry"], 0.0])
    up = n if turn[:, 2] @ n > 0 else -n
    np.testing.assert_allclose(turn[:, 2], up, atol=1e-12)
    assert values["plane[S].z"] == pytest.approx(0.3 * float(up @ n), abs=1e-12)
    problem = Problem([term])
    (line,) = problem.linearise(np.array([values[n] for n in problem.names]), [1e-4])
    np.testing.assert_allclose(line.residual, 0.0, atol=1e-12)


def test_touches_on_both_sides_tell_the_ball() -> None:
    grid = np.array([[x, y, 0.0] for x in (0, 0.1) for y in (0, 0.1)])
    down = np.diag([1.0, -1.0, -1.0])
    position = np.concatenate([grid + np.array([0, 0, 0.01]), grid - np.array([0, 0, 0.01])])
    rotation = np.concatenate([np.tile(down, (4, 1, 1)), np.tile(np.eye(3), (4, 1, 1))])
    values = (term := over(position, rotation, radius=0.01)).start_values({})
    problem = Problem([term])
    (line,) = problem.linearise(np.array([values[n] for n in problem.names]), [1e-4])
    np.testing.assert_allclose(line.residual, 0.0, atol=1e-12)
    # A ball of another size would not do.
    assert not any(frame.given for frame in term.outside)


def test_a_ball_that_nothing_checks_is_said_and_spares_the_arm() -> None:
    """On one side of planes that stand anywhere, a wrong radius moves these and nothing else."""
    arm, radius, wrong = arm_named("suta"), 0.01, 0.002
    term = plane_scene(arm, {"joint_3.offset": 0.01}, radius=radius).exact(Noise(1e-4))
    assert isinstance(term, TouchedPlane)
    unknown, options = arm.select("joint_3.offset", "joint_5.offset"), SolverOptions(starts=1)
    right, off = (
        solve(Problem([replace(term, radius=r)], unknown), options)
        for r in (radius, radius + wrong)
    )
    assert {pose.given for pose in external_poses(off)} == {("probe_radius_mm",)}
    for name in unknown:
        assert off.values[name] == pytest.approx(right.values[name], abs=1e-8)
    for name in (p.name for p in term.own_parameters if p.key == "z"):
        assert abs(off.values[name] - right.values[name]) == pytest.approx(wrong, abs=1e-8)
    # Where planes stand is known, the arm would take it up.
    given = {name: GivenPose(np.zeros(3), np.eye(3)) for name in term.places[0]}
    assert not any(frame.given for frame in replace(term, given=given).outside)


def test_an_ideal_touch_has_no_error() -> None:
    arm = arm_named("suta")
    truth = perturbed(dh_parameters(arm), seed=1)
    scene = plane_scene(arm, truth, radius=0.02)
    term = scene.term(scene.samples(Spread(1e-3))[0])
    values = truth | term.start_values(truth)
    ideal = term.observed(values, term.poses)
    R, p = term.poses.at(values)
    moved = replace(term, poses=MeasuredPoses(R, ideal.position, term.poses.samples))
    assert np.abs(ideal.position - p).max() > 1e-4
    (again,) = resimulated([term], values, [0.0], np.random.default_rng(0))
    for repeated in (moved, again):
        problem = Problem([repeated], dh_parameters(arm))
        x = np.array([values.get(name, 0.0) for name in problem.names])
        (line,) = problem.linearise(x, [1e-4])
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-8)
