"""Many jobs in one command: the results of each are its own, and a broken one stops no other."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cli_job import Capture, answer, cli, made_worse, printed, refused
from fleet_folders import contents, jobs_in
from rich.console import Console

from suta_calib.atomic import JOURNAL, PREFIX, SUFFIX
from suta_calib.fleet import (
    Calibrate,
    CalibratedJob,
    FleetSummary,
    Task,
    fleet_document,
    fleet_jobs,
    run_jobs,
    workers,
)
from suta_calib.fleet import calibrating as module
from suta_calib.fleet.running import done_to
from suta_calib.fleet.workers import Crash
from suta_calib.job.calibration import CalibrationJob
from suta_calib.report.console import rendered

RESULTS = {"calibrated.urdf", "result.json", "residuals.csv", "inputs.zip"}


@pytest.mark.usefixtures("in_one_process")
def test_results_are_those_of_a_command_of_its_own(fleet: Path) -> None:
    summary = run_jobs(Calibrate(), jobs_in(fleet))
    assert [result.name for result in summary.results] == ["r1", "r2", "r3", "r4"]
    assert (summary.assessment.level, summary.exit_code) == ("good", 0)
    for job in jobs_in(fleet)[:2]:
        many = contents(job.parent / "results")
        assert many.keys() == RESULTS
        shutil.rmtree(job.parent / "results")
        assert cli("calibrate", job, "--no-report") == 0
        assert contents(job.parent / "results") == many


def broken_jobs(fleet: Path) -> dict[str, str]:
    """Makes three of the four bad, each in its own way; what is said of each."""
    (fleet / "r1" / "calibration.yaml").write_text("arm: [")
    samples = fleet / "r2" / "calibration" / "a.csv"
    header, first, *rest = samples.read_text().splitlines()
    nan = ",".join(["nan", *first.split(",")[1:]])
    samples.write_text("\n".join([header, nan, *rest]) + "\n")
    (fleet / "r3" / "calibration" / "a.csv").unlink()
    return {
        "r1": "calibration.yaml:1: found text that is not YAML",
        "r2": "a.csv:2: column 'joint_1': found 'nan'",
        "r3": "no file that matches 'calibration/*.csv'",
        "empty": "found no such file",
    }


@pytest.mark.usefixtures("in_one_process")
def test_a_broken_job_stops_no_other(fleet: Path, capsys: Capture) -> None:
    said = broken_jobs(fleet)
    (fleet / "empty").mkdir()
    jobs = [*jobs_in(fleet), Path("empty/calibration.yaml"), Path("r4") / ".." / jobs_in(fleet)[3]]
    assert cli("calibrate", *jobs) == 2
    out, err = capsys.readouterr()
    assert err == ""
    said_first = "Look at 4 of 5 jobs. 4 of 5 jobs gave no answer; 1 may be used: 1 good"
    assert out.startswith(said_first)
    assert "No answer: r1, r2, r3, empty." in out
    assert "Written to .: summary.csv, summary.json" in out
    assert max(map(len, out.splitlines())) <= 80
    found = json.loads((fleet / "summary.json").read_text())
    assert found["counts"] == {"failed": 4, "bad": 0, "care": 0, "good": 1}
    assert "is computed once" in " ".join(found["verdict"]["notes"])
    with (fleet / "summary.csv").open(newline="") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["r1", "r2", "r3", "r4", "empty"]
    assert rows["r4"]["job"] == "r4/calibration.yaml"
    assert (rows["r1"]["estimated"], rows["r1"]["count"]) == ("", "")
    assert rows["r1"]["reason"] == rows["r1"]["error"]
    for name, error in said.items():
        assert rows[name]["verdict"] == "failed"
        assert error in rows[name]["error"]
        assert not (fleet / name / "results").exists()
    record = json.loads((fleet / "r4" / "results" / "result.json").read_text())
    after = record["metrics"]["validation"]["after"]
    assert (rows["r4"]["verdict"], rows["r4"]["data"]) == ("good", "validation")
    assert float(rows["r4"]["rms_after"]) == after["rms_mm"]
    # Broken jobs are found broken again, and nothing else is done.
    assert cli("calibrate", "r*/calibration.yaml", "--resume") == 2
    assert "1 results were there and whole" in capsys.readouterr().out


@pytest.mark.usefixtures("in_one_process")
def test_the_exit_code_is_that_of_the_worst(fleet: Path) -> None:
    made_worse(fleet / "r2" / "calibration.yaml")
    found = answer("calibrate", *jobs_in(fleet)[1:], code=1)
    assert found["counts"] == {"failed": 0, "bad": 1, "care": 0, "good": 2}
    assert (found["verdict"]["level"], found["verdict"]["usable"]) == ("bad", False)
    assert (fleet / "r2" / "results" / "not_usable.urdf").exists()
    assert "2 jobs: 2 good" in printed("calibrate", *jobs_in(fleet)[2:], "--resume")


def test_a_fault_of_the_package_is_one_row(
    fleet: Path, monkeypatch: pytest.MonkeyPatch, in_one_process: None
) -> None:
    run = CalibrationJob.run

    def faulty(job: CalibrationJob, *more: Any) -> Any:
        name = job.spec.path.parent.name
        if name == "r1":
            raise ZeroDivisionError("by nothing")
        if name == "r2":
            raise MemoryError("9 GB")
        if name == "r3":
            raise OSError(28, "No space left on device", "somewhere")
        return run(job, *more)

    monkeypatch.setattr(CalibrationJob, "run", faulty)
    summary = run_jobs(Calibrate(), jobs_in(fleet))
    errors = [result.error for result in summary.results]
    assert "ZeroDivisionError at test_fleet.py" in errors[0]
    assert "please report it" in errors[0]
    assert "too little memory (9 GB)" in errors[1]
    assert errors[2] == "somewhere: No space left on device"
    assert [summary.of("failed"), errors[3]] == [["r1", "r2", "r3"], ""]


def test_a_job_that_ends_its_process_is_named(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "work_through", lambda *_, **__: iter([(0, Crash("SIGKILL"))]))
    summary = run_jobs(Calibrate(), jobs_in(fleet)[:1])
    assert summary.of("failed") == ["r1"]
    assert "ended twice (SIGKILL)" in summary.results[0].error


@pytest.mark.usefixtures("in_one_process")
def test_every_job_has_a_folder_of_its_own(fleet: Path) -> None:
    second = fleet / "r1" / "second.yaml"
    shutil.copy(fleet / "r1" / "calibration.yaml", second)
    paths = [Path("r1/calibration.yaml"), Path("r1/second.yaml"), Path("r2/calibration.yaml")]
    places = {job.name: str(job.folder) for job in fleet_jobs(paths)}
    assert places == {
        "r1/calibration.yaml": "r1/results",
        "r1/second.yaml": "r1/results-second",
        "r2": "r2/results",
    }
    below = {job.name: str(job.folder) for job in fleet_jobs(paths, Path("out"))}
    assert below == {name: f"out/{name}" for name in places}
    assert answer("calibrate", *paths, "--out", "out")["counts"]["good"] == 3
    assert {p.name for p in Path("out").iterdir()} == {"r1", "r2", "summary.csv", "summary.json"}
    assert not (fleet / "r1" / "results").exists()
    # From the summary's folder, wherever the command was given.
    (first, *_) = json.loads(Path("out/summary.json").read_text())["jobs"]
    assert (first["job"], first["folder"]) == ("../r1/calibration.yaml", "r1/calibration.yaml")
    # By itself it finds the same place.
    assert {job.folder.name for job in fleet_jobs(paths[1:2])} == {"results"}
    assert cli("calibrate", *paths, "--no-report") == 0
    assert {job.folder.name for job in fleet_jobs(paths[1:2])} == {"results-second"}


def test_a_fleet_may_have_one_job(fleet: Path, in_one_process: None) -> None:
    found = answer("calibrate", "r1/calibration.yaml", "--jobs", "2")
    assert [job["name"] for job in found["jobs"]] == ["r1"]
    assert (fleet / "r1" / "summary.csv").exists()
    assert "no such file" in refused("calibrate", "nothing/*.yaml")


@pytest.mark.usefixtures("in_one_process")
def test_a_report_is_written_if_it_is_asked_for(fleet: Path) -> None:
    job = jobs_in(fleet)[0]
    assert not run_jobs(Calibrate(), [job]).results[0].resumed
    assert run_jobs(Calibrate(), [job], resume=True).results[0].resumed
    assert not run_jobs(Calibrate(report=True), [job], resume=True).results[0].resumed
    assert (fleet / job.parent / "results" / "report.html").exists()
    assert run_jobs(Calibrate(report=True), [job], resume=True).results[0].resumed
    # A result with more than is asked for is whole.
    assert run_jobs(Calibrate(), [job], resume=True).results[0].resumed


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-20])


def changed(path: Path) -> None:
    path.write_text(path.read_text().replace("0.", "0.0", 1))


def copied(path: Path) -> None:
    shutil.copy(path, path.with_name("b.csv"))


DAMAGE: dict[str, tuple[str, Callable[[Path], object]]] = {
    "record half-written": ("results/result.json", cut),
    "record of something else": ("results/result.json", lambda path: path.write_text("[1]")),
    "table half-written": ("results/residuals.csv", cut),
    "arm missing": ("results/calibrated.urdf", Path.unlink),
    "copy half-written": ("results/inputs.zip", cut),
    "samples changed": ("calibration/a.csv", changed),
    "samples added": ("validation/a.csv", copied),
    "arm changed": ("arm.urdf", lambda path: path.write_text(path.read_text() + "<!-- -->")),
    "job changed": ("calibration.yaml", lambda path: path.write_text(path.read_text() + "\n")),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_not_whole_or_not_the_same_is_computed_again(
    damage: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(made.parent, tmp_path / "job")
    monkeypatch.setattr(CalibrationJob, "run", pytest.fail)
    (job,) = fleet_jobs([tmp_path / "job" / "calibration.yaml"])
    # Where it was moved to, its paths are others.
    shutil.rmtree(job.folder)
    monkeypatch.undo()
    assert done_to(Task(Calibrate(), job)).verdict == "good"
    ran = list[CalibrationJob]()
    run = CalibrationJob.run
    monkeypatch.setattr(CalibrationJob, "run", lambda self, *_: ran.append(self) or run(self))
    assert done_to(Task(Calibrate(), job, resume=True)).resumed
    assert not ran
    name, spoil = DAMAGE[damage]
    spoil(tmp_path / "job" / name)
    result = done_to(Task(Calibrate(), job, resume=True))
    assert (result.error, result.resumed, len(ran)) == ("", False, 1)
    assert done_to(Task(Calibrate(), job, resume=True)).resumed


def test_results_of_other_versions_are_computed_again(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (job,) = fleet_jobs([made])
    assert done_to(Task(Calibrate(), job, resume=True)).resumed
    monkeypatch.setattr(module, "versions", lambda: {"suta_calib": "another"})
    assert not done_to(Task(Calibrate(), job, resume=True)).resumed


def test_an_exchange_that_was_broken_off_is_finished(made: Path, tmp_path: Path) -> None:
    """All files were on the disk when the power went, and half of them in their places."""
    (job,) = fleet_jobs([made])
    whole, stage = contents(job.folder), job.folder / f"{PREFIX}abc{SUFFIX}"
    stage.mkdir()
    names = [*sorted(whole.keys() - {"result.json"}), "result.json"]
    for number, name in enumerate(names[2:], start=2):
        (job.folder / name).rename(stage / str(number))
    (stage / JOURNAL).write_text(json.dumps({"files": names, "stale": []}))
    assert done_to(Task(Calibrate(), job, resume=True)).resumed
    assert contents(job.folder) == whole


def test_killed_in_the_middle_it_goes_on_with_resume(
    fleet: Path, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes, as a user runs it."""
    monkeypatch.setenv("PYTHONPATH", str(repository))
    command = [sys.executable, "-m", "suta_calib", "calibrate", *jobs_in(fleet), "--json"]
    running = subprocess.Popen([*command, "--jobs", "1"], stdout=subprocess.PIPE)
    first, end = fleet / "r1" / "results" / "result.json", time.monotonic() + 500
    while not first.exists():
        assert running.poll() is None
        assert time.monotonic() < end
        time.sleep(0.01)
    os.kill(running.pid, signal.SIGKILL)
    running.communicate()
    assert not (fleet / "summary.json").exists()
    written = first.stat().st_ino
    done = subprocess.run(
        [*command, "--jobs", "2", "--resume"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    found = json.loads(done.stdout)
    assert [job["verdict"] for job in found["jobs"]] == ["good"] * 4
    assert found["jobs"][0]["resumed"]
    assert first.stat().st_ino == written
    assert not found["jobs"][3]["resumed"]
    assert {path.name for path in first.parent.iterdir()} == RESULTS


def test_sigterm_leaves_a_summary_of_what_is_done(
    fleet: Path, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes, each of which `timeout` and systemd tell to end."""
    monkeypatch.setenv("PYTHONPATH", str(repository))
    command = [sys.executable, "-m", "suta_calib", "calibrate", *jobs_in(fleet), "--report"]
    running = subprocess.Popen(
        [*command, "--jobs", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    first, end = fleet / "r1" / "results" / "result.json", time.monotonic() + 500
    while not first.exists():
        assert running.poll() is None
        assert time.monotonic() < end
        time.sleep(0.01)
    os.killpg(running.pid, signal.SIGTERM)
    _, err = running.communicate()
    assert running.returncode == 143, err
    assert "of 4 jobs are done; continue with --resume" in err
    assert "interrupted by SIGTERM" in err
    assert "leaked" not in err
    assert "Traceback" not in err


def test_an_interrupt_says_how_to_go_on(
    fleet: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    done = list[Any]()

    def interrupted(work: Callable[[Any], Any], tasks: Any, **_: Any) -> Any:
        yield from done
        raise KeyboardInterrupt

    monkeypatch.setattr(workers, "work_through", interrupted)
    assert cli("calibrate", *jobs_in(fleet)) == 130
    assert "0 of 4 jobs are done; continue with --resume" in capsys.readouterr().err
    assert not (fleet / "summary.json").exists()
    done.append((2, Crash("SIGKILL")))
    assert cli("calibrate", *jobs_in(fleet)) == 130
    out, err = capsys.readouterr()
    assert "1 of 4 jobs are done; continue with --resume" in err
    assert "Interrupted: 3 jobs are not done, and not listed." in out
    found = json.loads((fleet / "summary.json").read_text())
    assert [job["name"] for job in found["jobs"]] == ["r3"]


def test_a_missing_file_beside_the_jobs_is_refused_before_any_begins(
    fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "work_through", pytest.fail)
    said = refused("plan", *jobs_in(fleet), "--candidates", "nowhere.csv")
    assert "nowhere.csv: found no such file" in said


def test_a_base_that_was_moved_is_the_reason(fleet: Path, in_one_process: None) -> None:
    samples = fleet / "r1" / "calibration" / "a.csv"
    head, *rows = samples.read_text().splitlines()
    moved = [row.rsplit(",", 1) for row in rows[20:]]
    late = [f"{before},{float(z) + 0.004}" for before, z in moved]
    samples.write_text("\n".join([head, *rows[:20], *late]) + "\n")
    (row,) = run_jobs(Calibrate(), jobs_in(fleet)[:1]).results
    assert (row.verdict, row.reason) == ("bad", row.faults[0])
    assert any("was moved by 4.0" in note and "a.csv:22" in note for note in row.faults)
    assert set(row.faults) < set(row.notes)


def test_what_names_a_fault_is_said_first_and_alike_together() -> None:
    untold, moved = "tip.y could not be determined.", "The base was moved by 4.00 mm at a.csv:9."
    row = CalibratedJob("a", "a.yaml", "a", verdict="care", notes=(untold,))
    rows = [
        row,
        replace(row, name="b"),
        replace(row, name="c", notes=(untold, moved), faults=(moved,)),
        replace(row, name="d", verdict="good", notes=("All is well.",)),
    ]
    answer = fleet_document(FleetSummary(tuple(rows), 1.0))
    console = Console(width=100, highlight=False)
    with console.capture() as shown:
        console.print(rendered(answer))
    text = shown.get()
    assert text.startswith("Take care. 4 jobs: 1 good, 3 with care")
    assert f"c: {moved} (and 1 more note)" in text
    assert f"a, b: {untold}" in text
    assert text.index("c: The base") < text.index("a, b:")
    found = answer.json()["jobs"]
    assert [job["note_count"] for job in found] == [1, 1, 2, 1]
    assert [job["reason"] for job in found] == [untold, untold, moved, ""]
    assert [job["faults"] for job in found] == [[], [], [moved], []]
