"""Many robots checked and followed at once: each as by a command of its own."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cli_job import TRUTH, Capture, answer, cli, refused, simulated
from fleet_work import doubled
from joblib.externals.loky.process_executor import BrokenProcessPool

from suta_calib.cli._follow_view import FollowView
from suta_calib.errors import InputError
from suta_calib.fleet import (
    CheckRobots,
    FollowedRobot,
    check_robots,
    follow_robots,
    following,
    read_robots,
)
from suta_calib.fleet.workers import Crash, outcome, seats
from suta_calib.measurements import write_samples
from suta_calib.model.arm import ArmModel

HEAD = "robot,result,samples\n"
SLIPPED = {**TRUTH, "joint_3.offset": TRUTH["joint_3.offset"] + 0.003}


@pytest.fixture
def robots(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A list of three robots, the second of which slipped."""
    arm, rows = ArmModel.from_urdf(made.parent / "arm.urdf", "tip"), list[str]()
    for k in (1, 2, 3):
        shutil.copytree(made.parent / "results", tmp_path / f"r{k}" / "results")
        truth = SLIPPED if k == 2 else TRUTH
        write_samples(tmp_path / f"r{k}" / "check.csv", simulated(arm, 8, 50 + k, truth))
        rows.append(f"r{k},r{k}/results,r{k}/check.csv\n")
    (tmp_path / "fleet.csv").write_text(HEAD + "".join(rows))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def by_name(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in found["robots"]}


def lines_of(robots: Path, name: str) -> list[dict[str, Any]]:
    history = robots / name / "results" / "checks.jsonl"
    return (
        [json.loads(line) for line in history.read_text().splitlines()] if history.exists() else []
    )


@pytest.mark.usefixtures("in_one_process")
def test_each_is_checked_as_by_a_command_of_its_own(robots: Path, capsys: Capture) -> None:
    assert cli("check", "--fleet", "fleet.csv") == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith("Look at 1 of 3 robots. 1 of 3 robots changed")
    # What is to be expected by chance, and what makes it as rare for all together.
    said = " ".join(out.split())
    assert "of 3 sound robots 0.03 on average are said to have changed" in said
    assert "--false-alarm 0.0033" in said
    found = by_name(json.loads((robots / "check_summary.json").read_text()))
    assert [found[name]["verdict"] for name in ("r1", "r2", "r3")] == ["good", "bad", "good"]
    for name in found:
        own = answer("check", f"{name}/results", f"{name}/check.csv", code=int(name == "r2"))
        first, second = lines_of(robots, name)
        assert first.pop("time") <= second.pop("time")
        assert first == second
        assert found[name]["p"] == own["p"]
        assert found[name]["rows"] == own["rows"] == 8
        assert found[name]["rms_mm"] == pytest.approx(first["rms_mm"])
    assert "joint joint_3" in found["r2"]["changed"]


@pytest.mark.usefixtures("in_one_process", "undrawn")
def test_one_that_cannot_be_checked_stops_no_other(robots: Path) -> None:
    rows = (robots / "r1" / "check.csv").read_text().splitlines(keepends=True)
    (robots / "nan.csv").write_text("".join([*rows[:3], "nan" + rows[3][rows[3].index(",") :]]))
    (robots / "empty.csv").write_text("")
    (robots / "result.json").write_text("[1]")
    bad = {
        "nan": ("r1/results", "nan.csv", "nan.csv:4: column 'joint_1': found 'nan'"),
        "empty": ("r1/results", "empty.csv", "empty.csv: found an empty file"),
        "missing": ("r1/results", "none.csv", "none.csv: found no such file"),
        "no result": ("nowhere", "r1/check.csv", "nowhere: found no such file"),
        "another": ("result.json", "r1/check.csv", "result.json"),
    }
    text = "".join(f"{name},{result},{rows}\n" for name, (result, rows, _) in bad.items())
    (robots / "bad.csv").write_text((robots / "fleet.csv").read_text() + text)
    found = answer("check", "--fleet", "bad.csv", "--no-history", "--out", "out", code=2)
    assert found["counts"] == {"failed": 5, "bad": 1, "care": 0, "good": 2}
    for name, (_, _, error) in bad.items():
        assert error in by_name(found)[name]["error"]
        assert not (robots / "out" / name).exists()
    written = {path.name for path in (robots / "out" / "r2").iterdir()}
    assert written == {"check.json", "report.html"}
    assert not (robots / "check_summary.json").exists()
    assert not lines_of(robots, "r1")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "fleet.csv: found an empty file"),
        (HEAD, "fleet.csv:1: found a header without data"),
        ("robot,result\nr1,r1/results\n", "fleet.csv:1: column 'samples'"),
        ("robot,result,sample\nr1,r1/results,x\n", "fleet.csv:1: found a column 'sample'"),
        (HEAD + "r1,r1/results,\n", "fleet.csv:2: column 'samples': found an empty cell"),
        (HEAD + "r1,r1/results,x\n\nr1,r2/results,y\n", "fleet.csv:4: column 'robot': found robot"),
        (HEAD + "a,r1/results,x\n../b,r2/results,y\n", "fleet.csv:3: column 'robot': found '../b'"),
        (HEAD + "r1,r1/results,;\n", "fleet.csv:2: column 'samples': found ';'"),
    ],
)
def test_a_malformed_list_is_refused_by_its_line(robots: Path, text: str, said: str) -> None:
    (robots / "fleet.csv").write_text(text)
    assert said in refused("check", "--fleet", "fleet.csv")
    assert not (robots / "check_summary.json").exists()


def test_a_list_names_files_from_its_own_folder(robots: Path) -> None:
    rows = f"a,r1/results,r1/*.csv;r2/check.csv\nb,{robots / 'r2'},r3/check.csv\n"
    (robots / "more.csv").write_text(HEAD + rows)
    first, second = read_robots(robots / "more.csv", Path("out"))
    assert first.samples == (robots / "r1" / "check.csv", robots / "r2" / "check.csv")
    assert (second.path, second.folder) == (robots / "r2", Path("out/b"))
    with pytest.raises(InputError, match="one file, which grows"):
        read_robots(robots / "more.csv", follow=True)


def test_wrong_usage(robots: Path) -> None:
    for given, said in (
        (("--fleet", "fleet.csv", "r1/results"), "leave out RESULT and SAMPLES"),
        (("--fleet", "fleet.csv", "--repair"), "--repair"),
        (("--fleet", "fleet.csv", "--seconds", "3"), "--seconds is for --follow"),
        (("r1/results", "r1/check.csv", "--jobs", "2"), "list them with --fleet"),
        (("r1/results",), "Missing argument 'SAMPLES'"),
    ):
        assert said in refused("check", *given)


def test_each_is_followed_as_by_a_command_of_its_own(robots: Path) -> None:
    """One decides, one waits for its file, one has a broken row, one a row that is half written."""
    rows = (robots / "r1" / "check.csv").read_text()
    (robots / "nan.csv").write_text(rows.replace("\n", "\nnan,", 4))
    (robots / "half.csv").write_text(rows[:-30])
    lines = rows.splitlines(keepends=True)
    (robots / "later.csv").write_text("".join([*lines[:5], "nan," + lines[5]]))
    names = {"later": "later", "nan": "nan", "waits": "none", "half": "half"}
    more = "".join(f"{name},r1/results,{file}.csv\n" for name, file in names.items())
    (robots / "more.csv").write_text((robots / "fleet.csv").read_text() + more)
    given = ("--follow", "--seconds", "0.1")
    found = answer("check", "--fleet", "more.csv", *given, "--jobs", "1", code=2)
    each = by_name(found)
    assert [each[name]["verdict"] for name in ("r1", "r2", "r3", "nan", "waits", "half")] == [
        *("good", "bad", "good", "failed", "failed", "good"),
    ]
    assert "nan.csv:2" in each["nan"]["error"]
    assert "none.csv: found no such file" in each["waits"]["error"]
    assert each["half"]["rows"] == 7
    # Rows before a broken one count.
    later = each["later"]
    assert (later["verdict"], later["rows"]) == ("failed", 4)
    assert "later.csv:6" in later["error"]
    (robots / "four.csv").write_text("".join(lines[:5]))
    own = answer("check", "r1/results", "four.csv", *given, "--no-history", code=0)
    assert later["p"] == own["p"]
    for name, code in (("r1", 0), ("r2", 1)):
        own = answer("check", f"{name}/results", f"{name}/check.csv", *given, code=code)
        assert (each[name]["rows"], each[name]["p"]) == (own["rows"], own["p"])
        assert [line["p"] for line in lines_of(robots, name)][-1] == own["p"]


def test_files_that_grow_and_begin_anew_are_followed_to_their_end(robots: Path) -> None:
    """Until somebody ends it; one file comes late, and one is put aside and begun anew."""
    head, *rows = (robots / "r1" / "check.csv").read_text().splitlines(keepends=True)
    late = robots / "r1" / "check.csv"
    text, seen = head + "".join(rows), list[list[FollowedRobot]]()
    late.unlink()

    def show(told: Any) -> None:
        seen.append([*told])
        counts = [robot.rows for robot in told]
        if counts == [0, 2, 8]:
            late.write_text(text)
        if counts == [8, 2, 8]:
            late.write_text(head + rows[0])

    def over() -> bool:
        return bool(seen) and seen[-1][0].rows == 9

    listed = read_robots(Path("fleet.csv"))
    fleet = follow_robots(CheckRobots(history=False), listed, show=show, over=over)
    found = [(row.rows, row.verdict) for row in fleet.results]
    assert found == [(9, "good"), (2, "bad"), (8, "good")]
    assert {row[0].state for row in seen} >= {"waiting", "sound"}
    assert seen[-1][1].state == "changed"


def test_a_worker_that_ends_costs_no_robot(robots: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins again with the first row; a robot that ends it each time is named."""
    ended = list[str]()

    @contextmanager
    def places(*_: Any) -> Any:
        def submit(work: Callable[[Any], Any], given: Any) -> Future[Any]:
            future, name = Future[Any](), given.robot.name
            if work.__name__ == "_decide" and (name == "r3" or (name == "r1" and not ended)):
                ended.append(name)
                future.set_exception(
                    BrokenProcessPool("exit codes of the workers are {SIGKILL(-9)}")
                )
            else:
                future.set_result(work(given))
            return future

        yield [submit]

    monkeypatch.setattr(following, "seats", places)
    fleet = follow_robots(CheckRobots(history=False), read_robots(Path("fleet.csv")), seconds=0.1)
    first, second, third = fleet.results
    assert (first.verdict, first.rows) == ("good", 8)
    assert second.verdict == "bad"
    assert "ended twice (SIGKILL(-9))" in third.error


def test_who_waits_for_a_process_that_another_ends_is_not_blamed(
    robots: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are worked on in one process, which r2 ends whenever its rows are looked at."""
    waiting, over = list[tuple[Future[Any], Callable[[Any], Any], Any]](), threading.Event()

    def submit(work: Callable[[Any], Any], given: Any) -> Future[Any]:
        future = Future[Any]()
        waiting.append((future, work, given))
        return future

    def worker() -> None:
        # So that all three wait at a time.
        while not over.wait(0.05):
            batch, ended = [waiting.pop(0) for _ in range(len(waiting))], False
            for future, work, given in batch:
                if ended or (work is following._decide and given.robot.name == "r2"):
                    ended = True
                    following._at_work.clear()
                    future.set_exception(BrokenProcessPool("ended"))
                else:
                    future.set_result(work(given))

    @contextmanager
    def places(*_: Any) -> Any:
        thread = threading.Thread(target=worker)
        thread.start()
        try:
            yield [submit]
        finally:
            over.set()
            thread.join()

    monkeypatch.setattr(following, "seats", places)
    fleet = follow_robots(CheckRobots(history=False), read_robots(Path("fleet.csv")), seconds=0.1)
    assert [(row.rows, row.verdict) for row in fleet.results] == [
        *((8, "good"), (None, "failed"), (8, "good")),
    ]
    assert "ended twice" in fleet.results[1].error


def test_the_robots_of_a_worker_that_is_killed_lose_no_row(robots: Path) -> None:
    """Killed while it waits: with the next row, or at the end, they begin again."""
    others, killed = set(multiprocessing.active_children()), list[int]()

    def show(told: Any) -> None:
        if not killed and [robot.rows for robot in told] == [8, 2, 8]:
            for worker in set(multiprocessing.active_children()) - others:
                killed.append(worker.pid or 0)
                os.kill(killed[-1], signal.SIGKILL)

    fleet = follow_robots(
        *(CheckRobots(history=False), read_robots(Path("fleet.csv"))),
        workers=2,
        show=show,
        over=lambda: bool(killed),
    )
    assert len(killed) == 2
    assert [(row.rows, row.verdict) for row in fleet.results] == [
        *((8, "good"), (2, "bad"), (8, "good")),
    ]


def test_when_time_is_up_rows_that_were_read_are_looked_at(
    robots: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, only = list[str](), read_robots(Path("fleet.csv"))[:1]
    monkeypatch.setattr(following, "_LINES", 2)
    fleet = follow_robots(CheckRobots(history=False), only, seconds=1e-9, say=said.append)
    assert said == ["time is up: 4 rows are still looked at"]
    assert fleet.results[0].rows == 8


def test_a_seat_is_always_the_same_process_until_that_ends() -> None:
    with seats(2) as (first, second):
        numbers = [first(os.path.realpath, f"/proc/{'self'}") for _ in range(2)]
        other = second(os.path.realpath, "/proc/self")
        assert outcome(numbers[0]) == outcome(numbers[1]) != outcome(other)
        assert isinstance(outcome(first(doubled, -1)), Crash)
        assert outcome(first(doubled, 4)) == 8


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_or_sigterm_ends_all_with_what_is_known(
    how: signal.Signals, robots: Path, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes, as a user runs it: two of them find what one does."""
    monkeypatch.setenv("PYTHONPATH", str(repository))
    shutil.copy(robots / "r2" / "check.csv", robots / "r1" / "check.csv")
    (robots / "r3" / "check.csv").unlink()
    given = ("check", "--fleet", "fleet.csv", "--follow")
    alone = by_name(answer(*given, "--seconds", "0.1", "--jobs", "1", code=2))
    running = subprocess.Popen(
        [sys.executable, "-m", "suta_calib", *given, "--jobs", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    watch = threading.Timer(500, running.kill)
    watch.start()
    assert running.stdout is not None
    waited = {"r1", "r2"}
    while waited:
        # On a busy machine lines of how many there are come before.
        line = running.stdout.readline()
        assert line
        waited -= {name for name in waited if line.startswith(f"{name}: changed after 2 rows: The")}
    # Known as soon as it is decided, each by a line of its own.
    assert [len(lines_of(robots, name)) for name in ("r1", "r2", "r3")] == [2, 2, 0]
    # As a terminal, `timeout` and systemd do, to all of them.
    os.killpg(running.pid, how)
    out, err = running.communicate()
    watch.cancel()
    assert (running.returncode, err) == (2, "")
    assert "2 of 3 robots changed, 1 could not be checked" in out
    found = by_name(json.loads((robots / "check_summary.json").read_text()))
    for name in ("r1", "r2"):
        assert (found[name]["p"], found[name]["rows"]) == (alone[name]["p"], 2)
    assert "found no such file from the beginning to the end" in found["r3"]["error"]


def test_what_is_shown_of_many(capsys: Capture) -> None:
    """Where there is no terminal a line for what happens to a robot, once."""
    sound = FollowedRobot("a", "sound", 4, evidence=0.2, limit=100.0)
    changed = FollowedRobot("b", "changed", 6, evidence=300.0, limit=100.0)
    with FollowView(quiet=False) as view:
        view.show([sound, changed])
        for _ in range(2):
            view.show([sound, replace(changed, note="The base changed.")])
        view.show([replace(sound, state="failed", note="a.csv:6: found 'nan'"), changed])
    assert capsys.readouterr().out.splitlines() == [
        "b: changed after 6 rows: The base changed.",
        "a: stopped after 4 rows: a.csv:6: found 'nan'",
    ]


def test_on_a_cluster_too(robots: Path) -> None:
    distributed = pytest.importorskip("distributed")
    listed, work = read_robots(Path("fleet.csv")), CheckRobots(history=False)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=False, dashboard_address=":0", silence_logs=60
    ) as running:
        address = running.scheduler_address
        checked = check_robots(work, listed, dask=address)
        followed = follow_robots(work, listed, dask=address, seconds=0.1)
    assert [row.verdict for row in checked.results] == ["good", "bad", "good"]
    assert [row.rows for row in followed.results] == [8, 2, 8]
