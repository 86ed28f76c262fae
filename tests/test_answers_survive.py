"""An answer that was found is told, whatever part of judging, explaining or drawing it fails."""

from __future__ import annotations

import ast
import importlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from certified_artefact import raw_points, truth
from cli_job import cli, write_simulated_job
from few_joints import few_joints
from pose_scenes import PAIR, POSE, pair_numbers, pivot_numbers, point_numbers, write_csv

from suta_calib import ArmModel, Problem
from suta_calib.assessment import Assessment, NotExplainedWarning, attempt, judged
from suta_calib.certification import CertificationOptions, certify
from suta_calib.errors import SamplesError
from suta_calib.job import CalibrationJob
from suta_calib.job.calibration import Calibration
from suta_calib.measurements import Samples
from suta_calib.registry import shipped
from suta_calib.report import calibration_document
from suta_calib.report.document import Figure, File
from suta_calib.report.files import write_document
from suta_calib.terms import KINDS, ArmPoses, TrackedPoint
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.rich_data import RichData

ASSESSMENT = "suta_calib.trust.assessment"
EXAMINATION = "suta_calib.trust.calibration_examination"
EXPLANATION = "suta_calib.trust.explanation"
REPORT = "suta_calib.report.calibration"
# Every judge, and what explains: where it fails, the answer is no longer called good.
JUDGES = [
    *(f"{EXAMINATION}.{name}" for name in ("contradictions", "contradicted_beliefs", "changes")),
    *(f"{EXAMINATION}.{name}" for name in ("thinned", "lack_of_fit", "effective_unknowns")),
    *(f"{EXAMINATION}.{name}" for name in ("explain", "judge_priors", "strongest_cause")),
    *(f"{EXAMINATION}.{name}" for name in ("scale_effects", "Residuals.tests")),
    *(f"{ASSESSMENT}.{name}" for name in ("_named_cause", "_on_gain", "_on_scale")),
    f"{ASSESSMENT}._on_widening",
    "suta_calib.job.calibration.assess_calibration",
    *(f"{EXPLANATION}.{name}" for name in ("RichData", "_redundant", "tip_motion", "_spread")),
    "suta_calib.trust.rich_data.RichData._information",
    "suta_calib.job.calibration.read_where_fitted",
    "suta_calib.trust.accuracy.gain_of",
    "suta_calib.trust.accuracy.added_by_estimates",
]
# What is only shown: the answer is as good without it.
SHOWN = [
    *(f"{REPORT}.{name}" for name in ("held_out_rows", "explained", "noise_of")),
    *(f"{REPORT}.{name}" for name in ("priors_of", "groups", "repeatability_of")),
    *(f"suta_calib.report.{name}" for name in ("histogram_svg", "changes_svg")),
    f"{EXAMINATION}.external_poses",
    "suta_calib.job.calibration.calibration_scene",
]


def broken(*_: Any, **__: Any) -> Any:
    raise IndexError("index 0 is out of bounds")


def breaks(patch: pytest.MonkeyPatch, path: str, instead: Any = broken) -> None:
    """Let a function, or a method of a class, raise."""
    owner, name = path.rsplit(".", 1)
    try:
        place: Any = importlib.import_module(owner)
    except ModuleNotFoundError:
        module, inside = owner.rsplit(".", 1)
        place = getattr(importlib.import_module(module), inside)
    patch.setattr(place, name, instead)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    return write_simulated_job(tmp_path_factory.mktemp("job"), suta_urdf)


@pytest.fixture(scope="module")
def result(job: Path) -> Calibration:
    found = CalibrationJob.load(job).run()
    assert found.assessment.level == "good"
    return found


def again(result: Calibration) -> Calibration:
    """The same, of which nothing is known yet but the solution."""
    examined = CalibrationExamination.of(replace(result.solution), result.job.validation)
    return Calibration(result.job, examined)


@pytest.mark.parametrize("path", JUDGES)
def test_a_judge_that_fails_costs_good_and_nothing_else(
    path: str, result: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    breaks(monkeypatch, path)
    with pytest.warns(NotExplainedWarning, match="IndexError: index 0 is out of bounds"):
        document = calibration_document(again(result))
    written = document.json()
    assert written["verdict"]["level"] == "care"
    said = [*written["verdict"]["notes"], *(str(part) for part in document.parts)]
    assert any("Not " in note and "please report it" in note for note in said)
    whole = calibration_document(result).json()["parameters"]
    assert {n: p["value"] for n, p in written["parameters"].items()} == {
        n: p["value"] for n, p in whole.items()
    }


@pytest.mark.parametrize("path", SHOWN)
def test_what_cannot_be_shown_costs_no_answer(
    path: str, result: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    breaks(monkeypatch, path)
    with pytest.warns(NotExplainedWarning):
        write_document(calibration_document(again(result)), tmp_path)
    written = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert written["verdict"]["level"] == "good"
    assert (tmp_path / "calibrated.urdf").is_file()
    assert "please report it" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_what_did_not_converge_stays_unusable(
    result: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    breaks(monkeypatch, f"{ASSESSMENT}._cause")
    minimum = replace(result.solution.minimum, converged=False)
    stopped = replace(result.solution, minimum=minimum)
    examined = CalibrationExamination.of(stopped, result.job.validation)
    with pytest.warns(NotExplainedWarning):
        found = Calibration(result.job, examined).assessment
    assert found.level == "bad"
    assert any(note.startswith("Not judged: other readings") for note in found.notes)


@pytest.mark.filterwarnings("ignore::suta_calib.assessment.NotExplainedWarning")
def test_commands_end_with_the_answer_whatever_fails(
    job: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    breaks(monkeypatch, f"{EXPLANATION}._cases")
    breaks(monkeypatch, "suta_calib.report.histogram_svg")
    text = job.read_text(encoding="utf-8").replace("joint_6.z]", "joint_6.z, tip.rx]")
    job = job.with_name("more.yaml")
    job.write_text(text, encoding="utf-8")
    assert cli("observe", job) == 0
    assert "tip.rx is not determined by these data. Not explained" in capsys.readouterr().out
    assert cli("calibrate", job, "--out", tmp_path) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Take care" in printed
    assert "Not explained: why parameters are held (IndexError" in printed
    assert (tmp_path / "calibrated.urdf").is_file()


WRONG = "suta_calib.trust.hypotheses"
MOVED = f"{WRONG}.moved_at_a_row.Moved.weigh"


@pytest.mark.filterwarnings("ignore::suta_calib.assessment.NotExplainedWarning")
@pytest.mark.parametrize(
    ("command", "parts"),
    [
        ("pivot", [f"{WRONG}.bent_tip.BentTip.weigh", MOVED]),
        (
            "hand-eye",
            [f"{WRONG}.depth_scale.DepthScale.weigh", MOVED],
        ),
        (
            "register",
            [
                f"{WRONG}.strained_points.StrainedPoints.weigh",
                MOVED,
            ],
        ),
    ],
)
def test_answers_on_poses_survive_their_judges(
    command: str, parts: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = {
        "pivot": [(POSE, pivot_numbers(["left"] * 30))],
        "hand-eye": [(PAIR, pair_numbers(20, "eye-in-hand"))],
        "register": [(("x", "y", "z"), each) for each in point_numbers(12)],
    }[command]
    files = [write_csv(tmp_path / f"{k}.csv", *table) for k, table in enumerate(tables)]
    for part in parts:
        with monkeypatch.context() as patch:
            breaks(patch, part)
            breaks(patch, f"suta_calib.report.{command.replace('-', '_')}_plot")
            assert cli(command, *files, "--out", tmp_path / "out") == 0
        written = json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))
        assert written["verdict"]["level"] == "care"
        assert any("Not judged" in note for note in written["verdict"]["notes"])


@pytest.mark.parametrize("name", ["faults", "uneven_tops", "over_ground"])
def test_a_certificate_survives_its_judges(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    breaks(monkeypatch, f"suta_calib.certification.procedure.{name}")
    with pytest.warns(NotExplainedWarning):
        found = certify(raw_points(tmp_path), CertificationOptions(drawing=truth()))
    assert found.assessment.level == "care"
    assert np.isfinite(found.covariance).all()


def test_every_assessment_is_kept_from_failing(repository: Path) -> None:
    """An answer of a new command is judged as all others are."""
    bare = []
    for file in sorted((repository / "suta_calib").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name == "assessment":
                names = {each.id for each in node.decorator_list if isinstance(each, ast.Name)}
                bare += [] if "judged" in names else [f"{file}:{node.lineno}"]
    assert not bare


@pytest.mark.parametrize("error", [MemoryError(), KeyboardInterrupt(), SystemExit(3)])
def test_an_interrupt_and_a_lack_of_memory_are_no_failures(error: BaseException) -> None:
    def interrupted() -> int:
        raise error

    with pytest.raises(type(error)):
        attempt("judged: it", interrupted, 1)

    def within_casadi() -> int:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    with pytest.raises(SystemError):
        attempt("judged: it", within_casadi, 1)


def test_an_assessment_that_fails_is_care() -> None:
    class Answer:
        unjudged = ("Not judged: the half of it.",)

        @property
        @judged
        def assessment(self) -> Assessment:
            raise ZeroDivisionError("division by zero")

    with pytest.warns(NotExplainedWarning):
        found = Answer().assessment
    assert found.level == "care"
    assert found.notes[0].startswith("Not judged: whether this answer may be used (ZeroDiv")
    assert found.notes[1] == "Not judged: the half of it."


def test_words_of_a_refusal_are_no_fault_of_the_program() -> None:
    def refused() -> int:
        raise SamplesError("no corner in any picture", "corners of the board", where="camera_view")

    notes = list[str]()
    with pytest.warns(NotExplainedWarning):
        assert attempt("explained: joint_1.x", refused, 7, notes) == 7
    (note,) = notes
    assert note == (
        "Not explained: joint_1.x (camera_view: found no corner in any picture; expected corners "
        "of the board). The answer stands without it."
    )


def test_in_tests_no_failure_is_silent() -> None:
    """The project's own tests make errors of warnings: clean jobs can carry no such note."""
    with pytest.raises(NotExplainedWarning):
        attempt("explained: joint_1.x", broken, None)


def test_a_picture_or_a_file_that_fails_is_words(tmp_path: Path) -> None:
    from suta_calib.report.document import Document

    figure, file = Figure(broken, "Errors"), File("a.csv", broken)
    answer = Document("thing", "A thing", Assessment("good"), [figure, file])
    with pytest.warns(NotExplainedWarning):
        written = write_document(answer, tmp_path)
    assert "Not drawn: Errors (IndexError" in (tmp_path / "thing.svg").read_text(encoding="utf-8")
    assert not (tmp_path / "a.csv").exists()
    assert "Not written: a.csv" in written["verdict"]["notes"][0]
    with pytest.raises(IndexError):
        write_document(replace(answer, parts=[file], written="files"), tmp_path)


def test_what_an_arm_cannot_reach_or_see_tells_nothing(tmp_path: Path) -> None:
    """Advice is tried with every kind, also one whose camera never has its board in sight."""
    (tmp_path / "arm.urdf").write_text(few_joints(1), encoding="utf-8")
    arm = ArmModel.from_urdf(tmp_path / "arm.urdf", "tip")
    q = np.linspace(-0.5, 0.5, 20)[:, None]
    _, position = arm.forward(q)
    samples = Samples.from_arrays(arm.joints, q, position=position)
    problem = Problem([TrackedPoint(ArmPoses(arm, samples))], arm.select("tip.y"))
    rich = RichData(problem, problem.start())
    told = {
        (name, oriented): rich.tells(kind, oriented)
        for name, kind in shipped(KINDS).items()
        for oriented in (False, True)
    }
    assert all(np.isfinite(each).all() for each in told.values())
    assert not told["camera_view", True].any()
    assert told["tracked_point", True].any()
