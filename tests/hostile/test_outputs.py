"""Full disks, interrupts and odd terminals: what was there stays, and nothing half-written is."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from cli_job import Capture, cli, refused
from hostile_scene import GIVEN, command_line
from pose_answers import XYZ
from pose_scenes import point_numbers, write_csv
from rich.console import Console

from suta_calib import atomic
from suta_calib.atomic import inputs_kept, note_input, only_writer
from suta_calib.cli._app import COMMANDS
from suta_calib.errors import OutputError
from suta_calib.report import files
from suta_calib.report.console import rendered
from suta_calib.report.document import Document
from suta_calib.report.listing import Table

# Their answers are as any other's here, and take seconds.
LONG = ("extend", "outliers", "plan")
NO_ANSWER = ("demo", "init", "simulate", "emulate", "view")
WRITING = [name for name, given in GIVEN.items() if given.out and not given.needs_device]
ANSWERS = [
    name for name in WRITING if name not in ("demo", "init", "simulate", "emulate", "view", *LONG)
]
STOPS: dict[str, Callable[[], BaseException]] = {
    "full disk": lambda: OSError(28, "No space left on device"),
    "Ctrl-C": KeyboardInterrupt,
}


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


class Stopping:
    """A function that is called a few times, and then stops whoever calls it."""

    def __init__(self, function: Callable[..., Any], times: int, stop: Callable[[], Any]) -> None:
        self._function, self.left, self._stop = function, times, stop

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        self.left -= 1
        if self.left < 0:
            raise self._stop()
        return self._function(*arguments, **named)


@pytest.fixture(scope="module")
def answers(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Document]:
    """What a command answers, computed once."""
    known: dict[str, Document] = {}

    def answer(command: str) -> Document:
        if command not in known:
            with pytest.MonkeyPatch.context() as patch:
                shown = "suta_calib.cli._output.rendered"
                patch.setattr(shown, lambda it, **_: known.setdefault(command, it) and "")
                out = tmp_path_factory.mktemp("out") / "out"
                assert cli(*command_line(command, scene, out)) in (0, 1)
        return known[command]

    return answer


@pytest.mark.parametrize("command", ANSWERS)
def test_an_answer_is_written_whole_or_the_one_before_stays(
    command: str,
    answers: Callable[[str], Document],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Stopped before each of its files is on the disk, in turn by one and by the other."""
    stops, sync = [*STOPS.values()], os.fsync
    answer = answers(command)
    files.write_document(answer, tmp_path)
    before = contents(tmp_path)
    for written in range(len(before)):
        stop = stops[(written + ANSWERS.index(command)) % len(stops)]
        monkeypatch.setattr(atomic.os, "fsync", Stopping(sync, written, stop))
        with pytest.raises((OutputError, KeyboardInterrupt)):
            files.write_document(answer, tmp_path)
        assert contents(tmp_path) == before


@pytest.mark.parametrize("command", ANSWERS)
def test_an_input_among_the_results_stays(
    command: str, answers: Callable[[str], Document], tmp_path: Path
) -> None:
    """A job whose arm is the calibrated.urdf of the run before, say."""
    answer = answers(command)
    names = set(files.write_document(answer, tmp_path)["files"]) - {files.REPORT}
    for name in names:
        (tmp_path / name).write_bytes(b"read by the same command")
        before = contents(tmp_path)
        with inputs_kept():
            note_input(tmp_path / name)
            with pytest.raises(OutputError, match=f"{name}: found an input of the same command"):
                files.write_document(answer, tmp_path)
        assert contents(tmp_path) == before


def test_a_simulation_does_not_overwrite_itself(
    scene: Path, tmp_path: Path, capsys: Capture
) -> None:
    text = (scene / "simulation.yaml").read_text().replace("arm.urdf", str(scene / "arm.urdf"))
    (tmp_path / "truth.yaml").write_text(text)
    assert cli("simulate", tmp_path / "truth.yaml", "--out", tmp_path) == 2
    assert "truth.yaml: found an input of the same command" in capsys.readouterr().err
    assert contents(tmp_path) == {"truth.yaml": text.encode()}


@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize(
    "command", ["init", "simulate", "certify", "zero-offsets", "emulate", "view"]
)
def test_files_that_are_no_answer_are_whole_too(
    command: str, stop: str, scene: Path, tmp_path: Path, capsys: Capture
) -> None:
    whole = tmp_path / "whole" / "out"
    whole.parent.mkdir()
    assert cli(*command_line(command, scene, whole)) == 0
    (folder := tmp_path / "stopped").mkdir()
    capsys.readouterr()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(atomic.os, "fsync", Stopping(os.fsync, 1, STOPS[stop]))
        code = cli(*command_line(command, scene, folder / "out"))
    if len(contents(whole.parent)) > 1:
        assert code == (2 if stop == "full disk" else 130)
        error = capsys.readouterr().err.splitlines()[-1]
        assert "No space left on device" in error or "interrupted" in error
    made = contents(folder)
    assert {name: contents(whole.parent)[name] for name in made} == made or command == "emulate"
    assert not [name for name in made if name.endswith(".tmp")]


@pytest.mark.parametrize("command", [name for name in GIVEN if GIVEN[name].reads])
def test_an_interrupt_while_it_reads(
    command: str, scene: Path, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for read in range(len(GIVEN[command].reads)):
        note = Stopping(atomic.note_input, read, KeyboardInterrupt)
        for module in ("measurements.files", "model.urdf_tree", "exchange.cells"):
            monkeypatch.setattr(f"suta_calib.{module}.note_input", note)
        assert cli(*command_line(command, scene, tmp_path / "out")) == 130
        assert capsys.readouterr().err.splitlines()[-1].startswith("suta-calib: interrupted")
        assert not contents(tmp_path)


@pytest.mark.parametrize("command", [name for name in GIVEN if GIVEN[name].out])
def test_a_place_that_cannot_be_written(
    command: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file where a folder should be, and a folder that this user may not write into."""
    (tmp_path / "file").write_text("a file")
    (tmp_path / "locked").mkdir()
    may = os.access
    monkeypatch.setattr(
        atomic.os, "access", lambda path, how: Path(path).name != "locked" and may(path, how)
    )
    for place in ("file", "locked"):
        out = tmp_path / place / "out"
        stderr = refused(*command_line(command, scene, out))
        assert len(re.findall("^suta-calib: error: ", stderr, re.MULTILINE)) == 1
        assert str(out.parent) in stderr
    assert contents(tmp_path) == {"file": b"a file"}


@pytest.mark.parametrize("command", GIVEN)
def test_a_working_folder_that_is_gone(
    command: str, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (gone := tmp_path / "gone").mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert cli(*command_line(command, Path(), Path("out"))) == 2
    stdout, stderr = capsys.readouterr()
    assert (stdout, stderr.count("\n")) == ("", 1), stderr
    assert re.search(r"error: (\S+\.\w+: )?found ", stderr), stderr


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A standard output that nobody reads any more."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as pipe:
        monkeypatch.setattr(sys, "stdout", pipe)
        yield
        # What is left in its buffer goes nowhere, as it does in a process.
        os.dup2(os.open(os.devnull, os.O_WRONLY), write)


@pytest.mark.usefixtures("closed")
def test_help_that_nobody_reads_is_no_error(capsys: Capture) -> None:
    for command in ("", *COMMANDS):
        assert cli(*filter(None, (command,)), "--help") == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("command", ANSWERS)
def test_answers_on_narrow_terminals_of_few_letters(
    command: str, answers: Callable[[str], Document]
) -> None:
    """Forty columns and ASCII: every number is in one piece, every name but for its dots."""
    answer = answers(command)
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="replace")
    Console(file=stream, width=40, markup=False, emoji=False).print(rendered(answer), crop=False)
    stream.flush()
    told = stream.buffer.getvalue().decode()  # type: ignore[attr-defined]
    for part in answer.shown("console"):
        if isinstance(part, Table):
            words = {word for row in part.cells for cell in row for word in cell.split()}
            pieces = {piece for word in words for piece in re.split(r"(?<=\.)(?=[^\W\d])", word)}
            assert not [w for w in pieces if w.isascii() and w not in told], told


def test_two_studies_do_not_write_one_log(scene: Path, tmp_path: Path, capsys: Capture) -> None:
    with only_writer(tmp_path / "study.trials.csv"):
        assert cli(*command_line("study", scene, tmp_path)) == 2
    assert f"found process {os.getpid()} writing it" in capsys.readouterr().err
    assert not contents(tmp_path)


def test_a_user_without_a_home(scene: Path, tmp_path: Path) -> None:
    line = command_line("register", scene, tmp_path / "out")
    environment = {"PATH": os.defpath, "PYTHONPATH": str(Path.cwd()), "HOME": "/nowhere"}
    process = [sys.executable, "-m", "suta_calib", *line, "--json"]
    done = subprocess.run(process, env=environment, capture_output=True, check=False, text=True)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


@pytest.fixture(scope="module")
def in_mm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Points in mm where metres are expected: a result that must not be used."""
    folder = tmp_path_factory.mktemp("in_mm")
    for name, points in zip(("a.csv", "b.csv"), point_numbers(12), strict=True):
        write_csv(folder / name, XYZ, 1e3 * points)
    return folder


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("streams", "answer", "code"),
    [
        (">&- 2>/dev/null", "good", 0),
        ("<&- >&- 2>&-", "bad", 1),
        ("2>&- >/dev/null", "refused", 2),
        ("2>/dev/full >/dev/null", "refused", 2),
        ("| true", "good", 0),
        ("| true", "bad", 1),
        (">/dev/full", "good", 2),
    ],
)
def test_streams_that_cannot_be_written_change_no_exit_code(
    streams: str, answer: str, code: int, scene: Path, in_mm: Path
) -> None:
    """But for a full one that holds the answer: where that is lost, the command has failed."""
    folder = scene if answer == "good" else in_mm
    second = folder / ("gone.csv" if answer == "refused" else "b.csv")
    line = f"{sys.executable} -m suta_calib register {folder / 'a.csv'} {second}"
    done = subprocess.run(
        ["bash", "-c", f"{line} {streams}; exit ${{PIPESTATUS[0]}}"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        check=False,
        text=True,
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
    full = "suta-calib: error: standard output: not written: No space left on device\n"
    assert (full in done.stderr) is (streams == ">/dev/full")
