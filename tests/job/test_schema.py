"""Job files: the documented example in SI, every refusal with line and key."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from suta_calib.arm_keys import ArmSpec
from suta_calib.errors import JobError
from suta_calib.job.schema import (
    JobSpec,
    ObservationSpec,
    SolverSpec,
    read_job,
)
from suta_calib.model.parameters import Selection
from suta_calib.trust import Rule
from suta_calib.units import from_deg, from_mm

EXAMPLE = """\
arm: {urdf: arm.urdf, tip: tip}
parameters:
  - {select: ["joint_*.offset"], bound_deg: 15}
  - {select: [joint_4.z, tip.y], bound_mm: 30, prior_mm: 1e-1}
  - {select: geometric, prior_deg: 0.5}
  - {select: joint_1.x, fixed: true}
observations:
  - {kind: pairwise_distance, artefact: artefact.yaml, samples: 'calibration/*.csv', huber_mm: 1.35}
  - {kind: tracked_point, label: tracker 2, sigma_mm: 0.05, huber_deg: 2, sigma_deg: 1,
     samples: [calibration/b.csv, 'calibration/*.csv']}
validation:
  - {kind: fixed_point, samples: 'validation/*.csv'}
solver: {starts: 8, seed: 3, hessian: exact, max_iterations: 50}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return with_files(tmp_path)


@pytest.fixture(scope="session")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_files(tmp_path_factory.mktemp("job")) / "job.yaml"


def with_files(folder: Path) -> Path:
    """The files that the example names."""
    for name in ("calibration/b.csv", "calibration/a.csv", "validation/c.csv"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    for name in ("arm.urdf", "artefact.yaml"):
        (folder / name).touch()
    return folder


def job(folder: Path, text: str) -> JobSpec:
    path = folder / "job.yaml"
    path.write_text(text, encoding="utf-8")
    return read_job(path)


def test_a_job_may_set_when_evidence_is_reported(folder: Path) -> None:
    assert job(folder, EXAMPLE).rule == Rule()
    text = EXAMPLE + "rule: {false_alarm: 1e-4, far_better: 5}\n"
    assert job(folder, text).rule == Rule(false_alarm=1e-4, far_better=5.0)
    with pytest.raises(JobError, match=r"rule\.share.*found 1\.5; expected a number from 0 to 1"):
        job(folder, EXAMPLE + "rule: {share: 1.5}\n")


def test_the_documented_example(folder: Path) -> None:
    read = job(folder, EXAMPLE)
    a, b = folder / "calibration" / "a.csv", folder / "calibration" / "b.csv"
    assert read.path == folder / "job.yaml"
    assert read.arm == ArmSpec(folder / "arm.urdf", "tip", None)
    assert read.parameters == (
        Selection(("joint_*.offset",), bound_rad=from_deg(15.0), line=3),
        Selection(("joint_4.z", "tip.y"), bound_m=0.03, prior_m=from_mm(0.1), line=4),
        Selection(("geometric",), prior_rad=from_deg(0.5), line=5),
        Selection(("joint_1.x",), fixed=True, line=6),
    )
    assert read.observations == (
        ObservationSpec(
            "pairwise_distance",
            ("calibration/*.csv",),
            (a, b),
            folder / "artefact.yaml",
            huber_m=pytest.approx(1.35e-3),
            line=8,
        ),
        ObservationSpec(
            "tracked_point",
            ("calibration/b.csv", "calibration/*.csv"),
            (b, a),
            label="tracker 2",
            huber_rad=pytest.approx(math.radians(2)),
            sigma_m=pytest.approx(5e-5),
            sigma_rad=pytest.approx(math.radians(1)),
            line=9,
        ),
    )
    assert [row.kind for row in read.validation] == ["fixed_point"]
    assert read.solver == SolverSpec(8, 3, "exact", 50)


def test_what_may_be_left_out(folder: Path) -> None:
    text = EXAMPLE[: EXAMPLE.index("validation")].replace("tip: tip", "tip: tip, base: b")
    read = job(folder, text)
    assert read.arm.base == "b"
    assert read.validation == ()
    assert read.solver == SolverSpec(1, 0, "gauss-newton", 200)


def test_what_is_given_may_be_fixed(folder: Path) -> None:
    """Beside a prior or a noise level the word keeps its size; alone it keeps the value."""
    prior = EXAMPLE.replace(ROW, ROW + ", prior_mm: 1, bound_mm: 3")
    assert job(folder, prior).parameters[3] == Selection(
        ("joint_1.x",), bound_m=3e-3, prior_m=1e-3, fixed=True, line=6
    )
    noise = EXAMPLE.replace("sigma_mm: 0.05", "sigma_mm: 0.05, fixed: true")
    first, second = job(folder, noise).observations
    assert (first.sigma_fixed, second.sigma_fixed) == (False, True)


def test_the_arm_may_be_held_whole(folder: Path) -> None:
    read = job(folder, EXAMPLE.replace(section("parameters"), "parameters: []\n"))
    assert read.parameters == ()


def test_paths_may_be_absolute(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    text = EXAMPLE
    for name in ("arm.urdf", "artefact.yaml", "calibration/", "validation/"):
        text = text.replace(name, f"{folder}/{name}")
    read = job(tmp_path_factory.mktemp("elsewhere"), text)
    assert read.arm.urdf == folder / "arm.urdf"
    assert read.observations[0].sample_files == job(folder, EXAMPLE).observations[0].sample_files


def section(name: str) -> str:
    """The example's text of one top-level key."""
    keys = re.findall(r"(?m)^\w+:[^\n]*\n(?: [^\n]*\n)*", EXAMPLE)
    return next(text for text in keys if text.startswith(name))


ROW = "select: joint_1.x, fixed: true"
FIXED_POINT = "kind: fixed_point, samples: 'validation/*.csv'"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        # keys
        ("solver:", "slover:", 13, "slover: found an unknown key; .* did you mean 'solver'?"),
        ("tip: tip", "tip: tip, bse: b", 1, "arm.bse: found an unknown key; .* mean 'base'?"),
        (ROW, "select: a, fxed: true", 6, r"parameters\[3\].fxed: .* did you mean 'fixed'?"),
        ("huber_mm", "huber_m", 8, r"observations\[0\].huber_m: .* did you mean 'huber_mm'?"),
        ("seed: 3", "sede: 3", 13, "solver.sede: .* did you mean 'seed'?"),
        ("seed: 3", "starts: 3", 13, "the key 'starts' twice"),
        # what is missing or empty
        (section("arm"), "", None, "arm: found no such key"),
        (
            section("parameters"),
            "",
            None,
            "parameters: found no such key; .*the parameters to estimate",
        ),
        (section("observations"), "", None, "observations: found no such key"),
        ("urdf: arm.urdf, ", "", 1, "arm.urdf: found no such key"),
        (", tip: tip", "", 1, "arm.tip: found no such key"),
        ("tip: tip", "tip: ", 1, "arm.tip: found nothing; expected text"),
        ("tip: tip", "tip: 7", 1, "arm.tip: found 7; expected text; put it in quotes"),
        (
            "arm: {urdf: arm.urdf, tip: tip}",
            "arm: arm.urdf",
            1,
            "arm: found 'arm.urdf'; expected a",
        ),
        (section("parameters"), "parameters: a.x\n", 2, "parameters: found 'a.x'; expected a list"),
        (section("observations"), "observations: []\n", 7, "observations: found an empty list"),
        (section("validation"), "validation:\n", 11, "validation: found nothing; expected a list"),
        (section("solver"), "solver: {}\n", 13, "solver: found an empty mapping"),
        (ROW, "fixed: true", 6, r"parameters\[3\].select: found no such key"),
        (ROW, "select: []", 6, r"parameters\[3\].select: found an empty list"),
        (ROW, "select: [a.x, 3]", 6, r"parameters\[3\].select\[1\]: found 3"),
        ("- {" + ROW + "}", "- joint_1.x", 6, r"parameters\[3\]: found 'joint_1.x'; .* mapping"),
        # numbers
        ("bound_deg: 15", "bound_deg: 0", 3, "bound_deg: found 0; expected a positive number"),
        ("bound_mm: 30", "bound_mm: -30", 4, r"parameters\[1\].bound_mm: found -30"),
        ("prior_mm: 1e-1", "prior_mm: .nan", 4, "prior_mm: found nan; expected a finite number"),
        ("prior_deg: 0.5", "prior_deg: .inf", 5, "prior_deg: found inf; expected a finite"),
        ("prior_deg: 0.5", "prior_deg: '0.5'", 5, "prior_deg: found '0.5'; expected a number"),
        ("prior_deg: 0.5", "prior_deg: true", 5, "prior_deg: found true; expected a number"),
        ("prior_deg: 0.5", "prior_deg: [1]", 5, "prior_deg: found a list; expected a number"),
        ("huber_mm: 1.35", "huber_mm: 0.0", 8, r"observations\[0\].huber_mm: found 0.0"),
        ("sigma_mm: 0.05", "sigma_mm: -1", 9, r"observations\[1\].sigma_mm: found -1"),
        ("starts: 8", "starts: 0", 13, "solver.starts: found 0; expected a whole number from 1"),
        ("starts: 8", "starts: 1.5", 13, "solver.starts: found 1.5"),
        ("starts: 8", "starts: true", 13, "solver.starts: found true"),
        ("seed: 3", "seed: -1", 13, "solver.seed: found -1; expected a whole number from 0"),
        ("max_iterations: 50", "max_iterations: many", 13, "max_iterations: found 'many'"),
        ("exact", "exakt", 13, "solver.hessian: found 'exakt'; .* did you mean 'exact'?"),
        # contradictions
        (ROW, ROW + ", bound_mm: 1", 6, r"parameters\[3\].bound_mm: .* beside fixed: true"),
        (
            FIXED_POINT,
            FIXED_POINT + ", fixed: true",
            12,
            "fixed: .* expected sigma_mm or sigma_deg",
        ),
        (ROW, "select: a.x, fixed: 'yes'", 6, "fixed: found 'yes'; expected true or false"),
        # kinds and files
        ("fixed_point", "fixed_pont", 12, r"validation\[0\].kind: .* did you mean 'fixed_point'?"),
        ("kind: fixed_point, ", "", 12, r"validation\[0\].kind: found no such key"),
        (", artefact: artefact.yaml", "", 8, r"observations\[0\].artefact: .* pairwise_distance"),
        (FIXED_POINT, FIXED_POINT + ", artefact: a.yaml", 12, "artefact: found a key that fixed_p"),
        (
            FIXED_POINT,
            FIXED_POINT + ", huber_deg: 1",
            12,
            "huber_deg: found a key that fixed",
        ),
        ("arm.urdf", "arms.urdf", 1, r"arm.urdf: found no file .*arms\.urdf"),
        ("arm.urdf", "calibration", 1, "arm.urdf: found no file .*calibration"),
        ("artefact.yaml", 300 * "a", 8, r"observations\[0\].artefact: found no file"),
        ("artefact.yaml", "artefct.yaml", 8, r"observations\[0\].artefact: .*artefct\.yaml"),
        ("validation/*.csv", "v/*.csv", 12, r"validation\[0\].samples: .* matches 'v/\*\.csv' in "),
        ("'validation/*.csv'", "[]", 12, r"validation\[0\].samples: found an empty list"),
        ("samples: 'validation/*.csv'", "label: a", 12, r"validation\[0\].samples: found no such"),
    ],
)
def test_refused(folder: Path, old: str, new: str, line: int | None, message: str) -> None:
    assert old in EXAMPLE
    with pytest.raises(JobError, match=message) as caught:
        job(folder, EXAMPLE.replace(old, new, 1))
    place = "" if line is None else f":{line}"
    assert str(caught.value).startswith(f"{folder / 'job.yaml'}{place}: ")
    assert "\n" not in str(caught.value)


# ── any input: a job or a JobError ───────────────────────────────────────────────────────────
def read_or_refuse(path: Path) -> None:
    try:
        read = read_job(path)
    except JobError as error:
        assert str(path) in str(error)  # noqa: PT017 (whether it raises depends on the example)
        return
    assert read.observations


@given(content=st.binary())
def test_arbitrary_bytes(scratch: Path, content: bytes) -> None:
    scratch.write_bytes(content)
    read_or_refuse(scratch)


@settings(max_examples=50)
@given(at=st.integers(0, len(EXAMPLE)), cut=st.integers(0, 30), insert=st.text(max_size=6))
def test_arbitrary_edits(scratch: Path, at: int, cut: int, insert: str) -> None:
    text = EXAMPLE[:at] + insert + EXAMPLE[at + cut :]
    scratch.write_text(text, encoding="utf-8")
    read_or_refuse(scratch)


def test_measured_jobs_are_read(shared: Path) -> None:
    for path in sorted(shared.glob("real/*/calibration.yaml")):
        read = read_job(path)
        assert read.parameters[0].select == ("geometric",)
        assert read.observations
        assert read.validation
