"""A plug that always sits off its socket's axis in the same way: found, or said not to be found."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_job import cli
from simulated import Scene, arm_named, artefact, artefact_scene, placements, readings_for

from suta_calib.analysis.study.trial import resimulated
from suta_calib.errors import ArtefactError, JobError, ParameterError
from suta_calib.geometry.numbers import (
    rotation_from_rpy,
    rotation_from_vector,
    vector_from_rotation,
)
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.schema import read_job
from suta_calib.measurements import Artefact, Samples
from suta_calib.model.parameters import Selection
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import ArmPoses, Noise, PairwiseDistance, Seating, Term, TouchedLandmark

SHIFT = (0.2e-3, -0.15e-3)
TURN = math.radians(1.2)
SEATING = Seating(0.3e-3, math.radians(2))
NOISE = 0.02e-3


def seated_scene(certified: Artefact, *, turn: float = TURN) -> Scene:
    """The SUTA as drawn, its tip always seated off the axis and turned."""
    arm = arm_named("suta").of_grade("certified")
    scene = artefact_scene("landmark", arm, {}, certified, placements(4))
    position = scene.position + scene.rotation @ np.array([*SHIFT, 0.0])
    rotation = scene.rotation @ rotation_from_vector([0.0, 0.0, turn])
    q = readings_for(arm, {}, position, rotation, scene.q)
    return replace(scene, q=q, position=position, rotation=rotation)


def same_yaw(count: int = 8) -> Artefact:
    """All flats in one direction."""
    marks = artefact(count, oriented=True).landmarks
    down = rotation_from_rpy([math.pi, 0.0, 0.3])
    return Artefact("simulated", {n: replace(m, rotation=down) for n, m in marks.items()})


def term_of(
    scene: Scene, kind: type[Term], seating: Seating | None, seed: int | None = None
) -> Term:
    samples: Samples = scene.samples()[0]
    if seed is not None:
        rng = np.random.default_rng(seed)
        noisy = samples.q + 2e-5 * rng.standard_normal(samples.q.shape)
        samples = Samples.from_arrays(samples.joints, noisy, labels=samples.labels)
    poses, marks = ArmPoses(scene.arm, samples), scene.artefact
    assert marks is not None
    if kind is TouchedLandmark:
        return TouchedLandmark(poses, marks, Noise(NOISE), Noise(1e-4), seating)
    return PairwiseDistance(poses, marks, Noise(NOISE), seating)


def solved(*terms: Term, select: tuple[str, ...] = ("joint_4.z",)) -> Solution:
    arm = arm_named("suta").of_grade("certified")
    row = Selection(select, bound_m=0.03 if any(not n.endswith("offset") for n in select) else None)
    return solve(Problem(terms, arm.select(row)), SolverOptions(starts=1))


@pytest.mark.parametrize("kind", [PairwiseDistance, TouchedLandmark])
def test_the_residual_is_zero_at_the_truth(kind: type[Term]) -> None:
    term = term_of(seated_scene(artefact(oriented=True)), kind, Seating(0.3e-3, 0.1))
    truth = dict(zip(("seating.x", "seating.y", "seating.rz"), (*SHIFT, TURN), strict=True))
    problem = Problem([term])
    values = problem.values(problem.start()) | truth
    if kind is TouchedLandmark:  # the placements' start is a registration of what is off its axis
        scene = seated_scene(artefact(oriented=True))
        for k, (R, p) in enumerate(placements(4)):
            vector = vector_from_rotation(R)
            keys = ("x", "y", "z", "rx", "ry", "rz")
            pairs = zip(keys, (*p, *vector), strict=True)
            values |= {f"placement[P{k}].{key}": float(v) for key, v in pairs}
        assert scene.kind == "landmark"
    x = np.array([values[name] for name in problem.names])
    for line in problem.linearise(x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-9)


@pytest.mark.parametrize("kind", [PairwiseDistance, TouchedLandmark])
def test_derivatives_are_central_differences(kind: type[Term]) -> None:
    problem = Problem([term_of(seated_scene(artefact(oriented=True)), kind, SEATING)])
    x = problem.start() + 1e-4
    sigmas = problem.assumed_sigmas()
    lines = problem.linearise(x, sigmas)
    by_own = [line.by_own.copy() for line in lines]
    for which, (line, derivative) in enumerate(zip(lines, by_own, strict=True)):
        for column in np.unique(line.view.own_columns)[-3:]:
            step = 1e-7 * (np.arange(len(x)) == column)
            up, down = (
                problem.linearise(x + s * step, sigmas)[which].residual.copy() for s in (1, -1)
            )
            expected = (up - down) / 2e-7
            found = np.zeros_like(expected)
            rows, slots = np.nonzero(line.view.own_columns == column)
            found[rows] = derivative[rows, :, slots]
            np.testing.assert_allclose(found, expected, atol=1e-6)


def test_flats_that_differ_tell_the_shift_and_orientations_the_turn() -> None:
    solution = solved(
        term_of(seated_scene(artefact(oriented=True)), TouchedLandmark, SEATING, seed=1)
    )
    for name, truth in (("seating.x", SHIFT[0]), ("seating.y", SHIFT[1]), ("seating.rz", TURN)):
        e = solution.estimates[name]
        assert e.state == "identified"
        assert e.std is not None
        assert abs(e.value - truth) < 4 * e.std
        assert e.std < 0.2 * abs(truth)


def test_distances_tell_the_shift_where_flats_differ() -> None:
    scene = seated_scene(artefact(oriented=True))
    solution = solved(term_of(scene, PairwiseDistance, SEATING, seed=1))
    e = solution.estimates
    assert set(e) == {"joint_4.z", "seating.x", "seating.y"}
    assert {e["seating.x"].state, e["seating.y"].state} == {"identified"}
    assert e["seating.x"].value == pytest.approx(SHIFT[0], abs=4 * (e["seating.x"].std or 0))


def test_distances_between_parallel_flats_tell_nothing_but_the_prior() -> None:
    scene = seated_scene(same_yaw())
    solution = solved(term_of(scene, PairwiseDistance, SEATING, seed=1))
    for key in "xy":
        e = solution.estimates[f"seating.{key}"]
        assert e.state == "prior"
        assert e.value == pytest.approx(0.0, abs=1e-6)
        assert e.std == pytest.approx(SEATING.clearance / math.sqrt(2), rel=1e-3)


def test_the_shift_is_the_tips_own_where_that_is_unknown_too() -> None:
    """Only their sum can be told: the clearance says how far the tip may be off its drawing."""
    scene = seated_scene(artefact(oriented=True), turn=0.0)
    terms = (term_of(scene, TouchedLandmark, s, seed=1) for s in (Seating(0.3e-3), None))
    both, alone = (solved(term, select=("joint_4.z", "tip.x")) for term in terms)
    tip, shift = both.estimates["tip.x"], both.estimates["seating.x"]
    assert shift.value - tip.value == pytest.approx(SHIFT[0], abs=2e-5)
    # What a hole of this clearance is usually off by, along one of two directions.
    assert shift.state == "prior"
    assert tip.std == pytest.approx(shift.std, rel=1e-2)
    assert 0.99 * 0.3e-3 / math.sqrt(2) < (tip.std or 0.0) < 0.3e-3
    assert alone.estimates["tip.x"].state == "identified"
    assert alone.estimates["tip.x"].value == pytest.approx(-SHIFT[0], abs=2e-5)


def test_ignoring_the_seating_costs_accuracy() -> None:
    scene = seated_scene(artefact(oriented=True))
    with_it, without = (solved(term_of(scene, TouchedLandmark, s, seed=1)) for s in (SEATING, None))
    assert without.noise[0] > 3 * with_it.noise[0]


@pytest.mark.parametrize("kind", [PairwiseDistance, TouchedLandmark])
def test_simulated_again_it_sits_as_it_did(kind: type[Term]) -> None:
    term = term_of(seated_scene(artefact(oriented=True)), kind, SEATING, seed=1)
    problem = Problem([term])
    sat = dict(zip(("seating.x", "seating.y", "seating.rz"), (*SHIFT, TURN), strict=True))
    values = problem.values(problem.start()) | sat
    (again,) = resimulated([term], values, [0.0] * len(term.blocks), np.random.default_rng(0))
    x = np.array([values[name] for name in problem.names])
    for line in Problem([again]).linearise(x, problem.assumed_sigmas()):
        np.testing.assert_allclose(line.residual, 0.0, atol=1e-8)


def test_it_is_kept_by_parts_and_needs_orientations() -> None:
    scene = seated_scene(artefact(oriented=True))
    for kind in (PairwiseDistance, TouchedLandmark):
        part = term_of(scene, kind, SEATING).take(np.arange(16))
        assert "seating.x" in {p.name for p in part.own_parameters}
    bare = {n: replace(m, rotation=None) for n, m in artefact().landmarks.items()}
    with pytest.raises(ArtefactError, match="no rotation_rpy_deg of landmark 'L1'"):
        term_of(replace(scene, artefact=Artefact("bare", bare)), PairwiseDistance, SEATING)
    for sizes in ((-1e-3, 0.0), (0.0, 0.0), (math.nan, 0.1)):
        with pytest.raises(ParameterError, match="seating"):
            Seating(*sizes)


JOB = """\
arm: {urdf: arm.urdf, tip: tip}
parameters: [{select: [joint_4.z], bound_mm: 30}]
observations: [{kind: KIND, artefact: a.yaml, samples: '*/*.csv', seating: SEATING}]
"""


@pytest.mark.parametrize(
    ("kind", "seating", "said"),
    [
        ("pairwise_distance", "{clearance_mm: 0.3, rotation_deg: 2}", "rotation_deg.*does not use"),
        ("fixed_point", "{clearance_mm: 0.3}", "does not use"),
        ("landmark", "{clearance: 0.3}", "unknown key.*clearance_mm"),
        ("landmark", "{clearance_mm: -1}", "a positive number"),
        ("landmark", "0.3", "a mapping"),
    ],
)
def test_a_job_says_what_is_wrong(tmp_path: Path, kind: str, seating: str, said: str) -> None:
    (tmp_path / "arm.urdf").write_text("<robot/>")
    (tmp_path / "a.yaml").write_text("landmarks: {}\n")
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "a.csv").write_text("x\n")
    text = JOB.replace("KIND", kind).replace("SEATING", seating)
    if kind == "fixed_point":
        text = text.replace("artefact: a.yaml, ", "")
    (tmp_path / "job.yaml").write_text(text)
    with pytest.raises(JobError, match=said):
        read_job(tmp_path / "job.yaml")


SIMULATION = """\
arm: {urdf: URDF, tip: tip}
sets:
  calibration:
    kind: landmark
    artefact: a.yaml
    seating: {x_mm: 0.2, y_mm: -0.1, rz_deg: 1.5}
    noise: {seating_mm: 0.01, seating_deg: 0.01}
    placements:
      P1: {position_mm: [437.5, 12.5, 0], rotation_rpy_deg: [0, 0, -105]}
      P2: {position_mm: [412.5, 37.5, 0], rotation_rpy_deg: [0, 0, 30]}
"""


def test_from_simulation_to_result(tmp_path: Path, suta_urdf: Path, repository: Path) -> None:
    (tmp_path / "arm.urdf").write_bytes(suta_urdf.read_bytes())
    (tmp_path / "a.yaml").write_bytes((repository / "data/suta/artefact.yaml").read_bytes())
    (tmp_path / "simulation.yaml").write_text(SIMULATION.replace("URDF", "arm.urdf"))
    assert cli("simulate", tmp_path / "simulation.yaml", "--out", tmp_path) == 0
    assert "rz_deg: 1.5" in (tmp_path / "truth.yaml").read_text()
    text = JOB.replace("KIND", "landmark").replace("*/*", "calibration/*")
    text = text.replace(
        "SEATING", "{clearance_mm: 0.3, rotation_deg: 2}, sigma_mm: 0.02, sigma_deg: 0.02"
    )
    (tmp_path / "job.yaml").write_text(text)
    held_out = "validation: [{kind: landmark, artefact: a.yaml, samples: 'calibration/*.csv'}]\n"
    (tmp_path / "forgotten.yaml").write_text(text + held_out)
    result = CalibrationJob.load(tmp_path / "forgotten.yaml").run()
    assert "validation row of landmark has no seating" in " ".join(result.assessment.notes)
    found = CalibrationJob.load(tmp_path / "job.yaml").run().solution.values
    assert found["seating.x"] == pytest.approx(0.2e-3, abs=2e-5)
    assert found["seating.y"] == pytest.approx(-0.1e-3, abs=2e-5)
    assert math.degrees(found["seating.rz"]) == pytest.approx(1.5, abs=0.05)
