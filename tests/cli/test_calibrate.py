"""Every command end to end on good input: files, figures, exit codes, streams."""

from __future__ import annotations

import io
import json
import os
import pty
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cli_job import (
    NOISE,
    TRUTH,
    Capture,
    answer,
    cli,
    made_worse,
    printed,
    refused,
    write_simulated_job,
)

from suta_calib.atomic import check_folder
from suta_calib.errors import OutputError, did_you_mean
from suta_calib.job.calibration import CalibrationJob
from suta_calib.model.arm import ArmModel

RESULTS = {"calibrated.urdf", "result.json", "residuals.csv", "inputs.zip", "report.html"}


def files_below(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


@dataclass(frozen=True)
class Calibrated:
    """A job that was calibrated into the folder beside it, and what was said."""

    job: Path
    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        found = json.loads((self.job.parent / "results" / "result.json").read_text())
        assert isinstance(found, dict)
        return found


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Calibrated:
    job = write_simulated_job(tmp_path_factory.mktemp("calibrated") / "job", suta_urdf)
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = cli("calibrate", job)
    return Calibrated(job, code, out.getvalue(), err.getvalue())


def test_calibrate_writes_beside_the_job(calibrated: Calibrated) -> None:
    assert (calibrated.code, calibrated.err) == (0, "")
    folder = calibrated.job.parent / "results"
    assert files_below(folder) == RESULTS
    assert calibrated.out.startswith("Good. Converged")
    assert str(folder / "report.html") in "".join(calibrated.out.splitlines()[-2:])


def test_without_a_report_nothing_is_drawn_and_none_of_the_run_before_is_left(
    job: Path, capsys: Capture
) -> None:
    assert cli("calibrate", job) == 0
    assert files_below(job.parent / "results") == RESULTS
    assert cli("calibrate", job, "--no-report") == 0
    assert files_below(job.parent / "results") == RESULTS - {"report.html"}
    assert "report.html" not in capsys.readouterr().out.splitlines()[-1]
    code = (
        "import atexit, sys\nfrom suta_calib.cli import main\n"
        f"sys.argv = ['suta-calib', 'calibrate', {str(job)!r}, '--no-report']\n"
        "atexit.register(lambda: print('jinja2' in sys.modules))\nmain()"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "False"


def test_calibrate_finds_the_truth(job: Path) -> None:
    found = answer("calibrate", job, "--out", job.parent / "new" / "folder")
    assert found["status"] == "converged"
    assert found["unidentified"] == found["redundant"] == ["joint_1.offset"]
    for name, true in TRUTH.items():
        estimate = found["parameters"][name]
        assert abs(estimate["value"] - true) < 5 * estimate["std"]
    after = found["metrics"]["validation"]["after"]
    assert after["count"] == 15
    assert after["rms_mm"] < 2 * 3**0.5 * 1e3 * NOISE
    assert files_below(job.parent / "new" / "folder") == RESULTS
    written = json.loads((job.parent / "new" / "folder" / "result.json").read_text())
    assert written.items() <= found.items()


def test_calibrate_that_does_not_converge_exits_with_1(job: Path) -> None:
    job.write_text(job.read_text().replace("starts: 2", "starts: 1, max_iterations: 1"))
    assert "not converged" in printed("calibrate", job, code=1)
    result = job.parent / "results" / "result.json"
    assert json.loads(result.read_text())["status"] == "not_converged"
    assert not result.with_name("calibrated.urdf").exists()


def test_observe_tells_what_the_data_can_determine(job: Path, capsys: Capture) -> None:
    before = files_below(job.parent)
    found = answer("observe", job)
    assert (found["rank"], found["asked"], found["samples"]) == (7, 8, 40)
    assert found["unidentified"] == ["joint_1.offset"]
    assert found["parameters"]["joint_1.offset"]["std"] is None
    assert [e["held"] for e in found["explanations"]] == ["joint_1.offset"]
    assert set(found["indices"]) == {"O1", "O2", "O3", "O4", "O5"}
    assert found["redundant"] == ["joint_1.offset"]
    assert found["verdict"]["level"] == "good"
    assert "7 of 8 unknowns" in found["verdict"]["sentence"]
    assert cli("observe", job) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "7 of 8 unknowns" in out
    assert "they never move the tip: joint_1.offset" in " ".join(out.split())
    assert files_below(job.parent) == before


def test_predicted_deviations_are_those_of_the_fit(calibrated: Calibrated) -> None:
    predicted = answer("observe", calibrated.job)["parameters"]
    for name, fitted in calibrated.result["parameters"].items():
        if fitted["state"] == "identified" and name in predicted:
            assert 0.5 < predicted[name]["std"] / fitted["std"] < 2.0, name


def test_validate_tells_the_calibrated_arm_from_the_nominal(calibrated: Calibrated) -> None:
    job, wanted = calibrated.job, calibrated.result["metrics"]["validation"]
    found = answer("validate", job.parent / "results" / "calibrated.urdf", job)["metrics"][
        "validation"
    ]
    for key in ("before", "after"):
        assert found[key] == pytest.approx(wanted[key], rel=1e-4), key
    assert found["after"]["rms_mm"] < 0.1 < found["before"]["rms_mm"]
    assert "0.0 %" in printed("validate", job.parent / "arm.urdf", job).replace("\n", "")


def test_validate_needs_no_unknowns(repository: Path) -> None:
    """Distances have no unknowns of their own, and in validation the arm is held."""
    job = repository / "data" / "suta" / "calibration.yaml"
    found = answer("validate", repository / "urdf" / "suta.urdf", job)["metrics"]["validation"]
    assert found["before"] == found["after"]


def test_validate_registers_what_the_observations_do_not_have(job: Path) -> None:
    """An instrument with another label stands elsewhere: its pose is fitted where it was used."""
    text = job.read_text()
    held_out = "samples: 'validation/*.csv'"
    job.write_text(text.replace(held_out, f"label: second, {held_out}"))
    own = answer("validate", job.parent / "arm.urdf", job)["metrics"]["validation"]["after"]
    job.write_text(text)
    shared = answer("validate", job.parent / "arm.urdf", job)["metrics"]["validation"]["after"]
    assert own["rms_mm"] < shared["rms_mm"]


BOTH = {"calibration/samples.csv", "validation/samples.csv"}


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        ((), {"artefact.yaml", *BOTH, "fixed_point/samples.csv"}),
        (("tracked_point",), BOTH),
        (("landmark", "tracked_point"), {"artefact.yaml", *BOTH, "tracked_point/samples.csv"}),
    ],
)
def test_init_writes_a_job_that_lacks_nothing_but_samples(
    tmp_path: Path, suta_urdf: Path, capsys: Capture, kinds: tuple[str, ...], expected: set[str]
) -> None:
    folder = tmp_path / "job"
    options = [option for kind in kinds for option in ("--kind", kind)]
    assert cli("init", suta_urdf, "--tip", "tip", "--out", folder, *options) == 0
    assert files_below(folder) == {"calibration.yaml"} | expected
    assert cli("observe", folder / "calibration.yaml") == 2
    assert "calibration/samples.csv:1: found a header without data" in capsys.readouterr().err


def test_init_takes_the_only_end_of_an_arm_as_the_tip(
    tmp_path: Path, suta_urdf: Path, capsys: Capture
) -> None:
    assert cli("init", suta_urdf, "--out", tmp_path / "job") == 0
    assert "the tip is tip, at the end of the only chain" in capsys.readouterr().err
    assert 'tip: "tip"' in (tmp_path / "job" / "calibration.yaml").read_text()


def test_init_job_runs_once_samples_are_filled_in(
    tmp_path: Path, job: Path, suta_urdf: Path, capsys: Capture
) -> None:
    folder = tmp_path / "new"
    assert cli("init", suta_urdf, "--tip", "tip", "--out", folder, "--kind", "tracked_point") == 0
    joints = ArmModel.from_urdf(suta_urdf, "tip").joints
    for name in ("calibration", "validation"):
        file = folder / name / "samples.csv"
        assert file.read_text() == ",".join(("x", "y", "z", *joints)) + "\n"
        file.write_bytes((job.parent / name / "a.csv").read_bytes())
    capsys.readouterr()
    assert answer("observe", folder / "calibration.yaml")["rank"] > 10
    assert CalibrationJob.load(folder / "calibration.yaml").spec.solver.starts == 8


def test_init_overwrites_nothing(tmp_path: Path, suta_urdf: Path, capsys: Capture) -> None:
    (tmp_path / "artefact.yaml").write_text("mine")
    assert cli("init", suta_urdf, "--tip", "tip", "--out", tmp_path) == 2
    assert str(tmp_path / "artefact.yaml") in capsys.readouterr().err
    assert files_below(tmp_path) == {"artefact.yaml"}
    assert (tmp_path / "artefact.yaml").read_text() == "mine"


@pytest.mark.parametrize("tip", [(), ("--tip", "elbow")])
def test_init_names_the_ends_of_the_arm_to_who_does_not_know_its_tip(
    tip: tuple[str, ...], tmp_path: Path
) -> None:
    urdf = tmp_path / "two.urdf"
    joint = (
        '<joint name="{0}" type="revolute"><parent link="base"/><child link="{0}_hand"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    links = "".join(f'<link name="{name}"/>' for name in ("base", "left_hand", "right_hand"))
    joints = "".join(map(joint.format, ("left", "right")))
    urdf.write_text(f'<robot name="two">{links}{joints}</robot>')
    said = refused("init", urdf, *tip, "--out", tmp_path / "job")
    assert "the chains of the file end at 'left_hand', 'right_hand'" in said
    assert not (tmp_path / "job").exists()


def test_a_hint_never_repeats_what_was_written() -> None:
    assert did_you_mean("tip", ["tip", "tap"]) == "did you mean 'tap'?"
    assert did_you_mean("tip", ["tip"]) == ""
    assert did_you_mean("TIP", ["tip"]) == "did you mean 'tip'?"
    assert refused("calibrat").count("calibrate") == 1
    assert "--help lists them" in refused("nothing-like-it")


def test_the_bare_command_prints_help(capsys: Capture) -> None:
    assert cli() == 0
    bare = capsys.readouterr()
    assert bare.out == printed("--help")
    assert bare.err == ""


def test_help_and_version() -> None:
    assert "calibrate" in printed("--help")
    assert printed("--version").startswith("suta-calib")
    for command in ("calibrate", "observe", "validate", "init", "simulate"):
        assert "Usage: suta-calib " + command in printed(command, "--help")


def test_help_does_not_load_the_heavy_libraries(repository: Path) -> None:
    script = (
        "import sys; from suta_calib.cli._app import run; code = run(['--help']);"
        "heavy = {'numpy', 'casadi', 'pinocchio', 'rich'} & set(sys.modules);"
        "sys.exit(code or (f'loaded {heavy}' if heavy else 0))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=repository, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_warnings_are_one_line_on_stderr(job: Path) -> None:
    samples = job.parent / "calibration" / "a.csv"
    header, *rows = samples.read_text().splitlines()
    samples.write_text("\n".join([f"{header},qx,qy,qz,qw", *(f"{r},0,0,0,1.5" for r in rows)]))
    held_out = job.parent / "validation" / "a.csv"
    header, *rows = held_out.read_text().splitlines()
    held_out.write_text("\n".join([f"{header},qx,qy,qz,qw", *(f"{r},0,0,0,1" for r in rows)]))
    done = subprocess.run(
        [sys.executable, "-m", "suta_calib", "observe", job, "--json"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    json.loads(done.stdout)
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("suta-calib: warning: ")


@pytest.mark.parametrize("seen", [1, pytest.param(9, marks=pytest.mark.slow)])
def test_an_interrupt_leaves_nothing_half_written(job: Path, seen: int) -> None:
    """As soon as the terminal shows that it is being solved, and while it goes on."""
    job.write_text(job.read_text().replace("starts: 2", "starts: 1000, hessian: exact"))
    here, there = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "suta_calib", "calibrate", job],
        cwd=Path(__file__).parents[2],
        env=os.environ | {"TERM": "xterm", "COLUMNS": "80"},
        stdout=subprocess.PIPE,
        stderr=there,
        text=True,
    ) as running:
        os.close(there)
        said = b""
        while said.count(b"solving") < seen:
            said += os.read(here, 4096)
        os.kill(running.pid, signal.SIGINT)
        out, _ = running.communicate()
        # At the end of what a terminal got reading it is an error.
        with suppress(OSError):
            while more := os.read(here, 4096):
                said += more
    os.close(here)
    assert running.returncode == 130, said
    assert out == ""
    last = said.decode().splitlines()[-1]
    assert last.endswith("suta-calib: interrupted; no incomplete files were left")
    assert "Traceback" not in said.decode()
    assert not (job.parent / "results").exists()


def wrapped(inner: BaseException) -> SystemError:
    error = SystemError("a result with an exception set")
    error.__context__ = inner
    return error


@pytest.mark.parametrize("cause", [KeyboardInterrupt(), wrapped(KeyboardInterrupt()), None])
def test_an_interrupt_that_a_library_wraps_is_one(
    job: Path, cause: BaseException | None, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise SystemError("a result with an exception set") from cause

    monkeypatch.setattr("suta_calib.job.calibration.CalibrationJob.run", interrupted)
    if cause is None:
        with pytest.raises(SystemError):
            cli("calibrate", job)
        return
    assert cli("calibrate", job) == 130
    assert capsys.readouterr().err.startswith("suta-calib: interrupted")


def test_a_closed_pipe_is_no_traceback(job: Path) -> None:
    done = subprocess.run(
        f"{sys.executable} -m suta_calib observe {job} | true",
        shell=True,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_write_protected_folder_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_folder(tmp_path / "new" / "deep")
    # Root may write anywhere: what the system would say to anybody else.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="write-protected"):
        check_folder(tmp_path / "new" / "deep")


def test_an_answer_that_must_not_be_used_is_refused_when_it_is_read_back(job: Path) -> None:
    verdict = answer("calibrate", made_worse(job), code=1)["verdict"]
    assert (verdict["level"], verdict["usable"]) == ("bad", False)
    folder = job.parent / "results"
    result, urdf = folder / "result.json", folder / "not_usable.urdf"
    assert files_below(folder) == RESULTS - {"calibrated.urdf"} | {"not_usable.urdf"}
    assert json.loads(result.read_text())["verdict"] == verdict
    said = refused("validate", urdf, job, "--result", result)
    assert f"{result}: verdict: found a result that must not be used" in said
    assert "worse than the nominal arm on the validation data" in said
    assert (
        answer("validate", urdf, job, "--result", result, "--anyway")["verdict"]["level"] == "care"
    )
    box = ("--urdf", job.parent / "arm.urdf", "--tip", "tip", "--region", "150,600,-300,300,0,400")
    assert "must not be used" in refused("tip-map", result, *box)


@pytest.mark.filterwarnings("always::suta_calib.errors.SutaCalibWarning")
def test_an_empty_folder_of_validation_does_not_stop_a_first_run(
    job: Path, tmp_path: Path, capsys: Capture
) -> None:
    (folder,) = {path.parent for path in job.parent.glob("validation/*.csv")}
    for path in folder.glob("*.csv"):
        path.unlink()
    assert cli("calibrate", job, "--out", tmp_path / "o") == 0
    out, err = capsys.readouterr()
    assert "found no validation data (validation/*.csv): the folder is empty" in err
    assert "There are no validation data" in out
    # The copy of the inputs knows of the folder.
    moved = job.parent.rename(tmp_path / "gone")
    assert cli("export", tmp_path / "o", "--format", "urdf", "--out", tmp_path / "a.urdf") == 0
    # One that is not there is a slip of the pen.
    (moved / "validation").rmdir()
    assert cli("calibrate", moved / job.name) == 2
    assert "no file that matches 'validation/*.csv'" in capsys.readouterr().err
