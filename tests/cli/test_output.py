"""What every command that answers has in common: where it writes, and how it ends."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import click
import numpy as np
import pytest
from cli_job import Capture, cli

from suta_calib.assessment import Assessment
from suta_calib.cli._app import app
from suta_calib.cli._options import PATH, WRITTEN, job_argument, out_option
from suta_calib.cli._output import answer_command, console, print_json, results_folder
from suta_calib.errors import OutputError
from suta_calib.report.document import Document, File


@answer_command
@job_argument
@out_option
@click.option("--points", type=PATH)
@click.option("--made", type=WRITTEN)
def told(job: Path, points: Path | None, made: Path | None) -> Document:
    """What JOB says."""
    del points, made
    text = job.read_text()
    judged = Assessment.of(bad=["it is bad"] if text == "bad" else [])
    parts = [File("good.urdf", lambda: str(results_folder()))] if judged.usable else []
    return Document("told", "Told", judged, parts, {"text": text}, "result")


def run(*arguments: object) -> int:
    """The exit code of `told`."""
    return int(told.main(list(map(str, arguments)), standalone_mode=False) or 0)


@pytest.fixture
def job(tmp_path: Path) -> Path:
    path = tmp_path / "calibration.yaml"
    path.write_text("good")
    return path


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_bad_answer_takes_the_place_of_all_of_a_good_one(job: Path) -> None:
    assert run(job) == 0
    results = job.parent / "results"
    assert names(results) == {"good.urdf", "report.html", "result.json"}
    job.write_text("bad")
    assert run(job) == 1
    assert names(results) == {"report.html", "result.json"}


def test_an_answer_says_what_it_was_made_from(job: Path, capsys: Capture, tmp_path: Path) -> None:
    points, made = tmp_path / "points.csv", tmp_path / "made.yaml"
    points.write_text("x,y,z")
    made.write_text("written by the run before")
    assert run(job, "--points", points, "--made", made, "--json") == 0
    inputs = json.loads(capsys.readouterr().out)["run"]["inputs"]
    assert inputs == {str(path): sha256(path.read_bytes()).hexdigest() for path in (job, points)}


def test_each_job_has_a_folder_of_its_own(job: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("other")
    for path in (job, other, job, other):
        assert run(path) == 0
    for folder, text in (("results", "good"), ("results-other", "other")):
        assert json.loads((tmp_path / folder / "result.json").read_text())["text"] == text
        assert (tmp_path / folder / "good.urdf").read_text() == str(tmp_path / folder)


def test_whose_a_folder_is_is_found_without_reading_all_of_it(job: Path, tmp_path: Path) -> None:
    """Somebody else's files may be of any size and number, and need not be files."""
    other = tmp_path / "other.yaml"
    other.write_text("x" * 1_000_000)
    assert run(other) == 0
    results = tmp_path / "results"
    os.mkfifo(results / "pipe.json")
    with (results / "vast.json").open("wb") as file:
        file.truncate(1 << 40)
    assert run(job) == 0
    assert names(results) == {"good.urdf", "report.html", "result.json", "pipe.json", "vast.json"}
    assert names(tmp_path / "results-calibration") == {"good.urdf", "report.html", "result.json"}


def test_a_job_under_another_name_keeps_its_folder(job: Path, tmp_path: Path) -> None:
    assert run(job) == 0
    assert run(job.rename(tmp_path / "other.yaml")) == 0
    assert names(tmp_path) == {"other.yaml", "results"}


def test_a_folder_that_is_asked_for_is_taken_before_the_job_or_after_it(
    job: Path, tmp_path: Path
) -> None:
    assert run("--out", tmp_path / "a", job) == 0
    assert run(job, "--out", tmp_path / "b") == 0
    assert (
        names(tmp_path / "a")
        == names(tmp_path / "b")
        == {"good.urdf", "report.html", "result.json"}
    )
    (tmp_path / "c").write_text("no folder")
    with pytest.raises(OutputError, match="which is no folder"):
        run(job, "--out", tmp_path / "c")


def test_what_stands_in_the_folder_by_another_hand_is_no_hindrance(job: Path) -> None:
    results = job.parent / "results"
    results.mkdir()
    for name, text in (("a.json", "[]"), ("b.json", "{"), ("c.json", '{"run": {"inputs": {}}}')):
        (results / name).write_text(text)
    assert run(job) == 0
    assert "result.json" in names(results)


def test_too_little_memory_is_a_refusal(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    def greedy(*_: object, **__: object) -> None:
        np.empty((1 << 40, 1 << 10))

    monkeypatch.setattr(app, "main", greedy)
    assert cli() == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "too little memory for these data (Unable to allocate 8.00 PiB" in err


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
def test_any_encoding_will_do(
    encoding: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What cannot be encoded is written in plain letters; JSON says it all the same."""
    said = {"text": "±0.1 µm → “joint”, Δ, \U0001f4a5, \udcff"}

    def talk(*_: object, **options: object) -> None:
        click.echo(said["text"])
        console().print(said["text"], "─" * 3)
        print_json(said)
        click.echo(said["text"], err=True)

    streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="") for _ in range(2)]
    for name, stream in zip(("stdout", "stderr"), streams, strict=True):
        monkeypatch.setattr(f"sys.{name}", stream)
    monkeypatch.setattr(app, "main", talk)
    assert cli() == 0
    out, err = (stream.buffer for stream in streams)  # type: ignore[attr-defined]
    for stream in streams:
        stream.flush()
    text = out.getvalue().decode(encoding)
    first, _, told = text.partition("{")
    if encoding == "ascii":
        assert first.startswith('+-0.1 um -> "joint", ?, ?, ?')
    assert json.loads("{" + told)["text"][:-1] == said["text"][:-1]
    assert err.getvalue().decode(encoding) == first.splitlines(keepends=True)[0]


@pytest.mark.parametrize("environment", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C"}])
def test_a_process_with_another_encoding_ends_without_a_traceback(
    environment: dict[str, str], tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "suta_calib", "observe", str(tmp_path / "µ→.yaml")]
    done = subprocess.run(
        command, env=os.environ | environment, capture_output=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.count(b"\n") == 1
    assert b"found no such file" in done.stderr
