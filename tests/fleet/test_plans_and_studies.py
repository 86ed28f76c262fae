"""Plans and studies of many jobs: as of commands of their own, taken again only where whole."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from cli_job import Capture, answer, cli, refused
from fleet_folders import contents, jobs_in

from suta_calib.fleet import JobResult, PlanNext, Study, Task, run_jobs, workers
from suta_calib.fleet.running import begun

CANDIDATES = """\
poses:
  A: {posture_deg: {joint_1: 10, joint_2: 70, joint_3: -60, joint_4: 10, joint_5: -90, joint_6: 0}}
  B: {posture_deg: {joint_1: 60, joint_2: 20, joint_3: 30, joint_4: -40, joint_5: 20, joint_6: 50}}
"""
# Of each command what makes it quick, the record that it writes, and its summary.
COMMANDS = {
    "plan": (("-n", "1", "--candidates", "candidates.yaml"), "plan"),
    "plan for a check": (("-n", "1", "--for", "check"), "plan_check"),
    "sizes": (("--trials", "2", "--sizes", "20,30"), "study"),
    "bootstrap": (("--trials", "3", "--kind", "bootstrap"), "bootstrap"),
    "drift": (("--trials", "4", "--kind", "drift", "--walk-deg", "0.01"), "drift"),
}


def command(name: str) -> tuple[str, tuple[str, ...], str]:
    options, record = COMMANDS[name]
    return "plan" if name.startswith("plan") else "study", options, record


@pytest.fixture
def robots(fleet: Path) -> Path:
    (fleet / "candidates.yaml").write_text(CANDIDATES)
    shutil.rmtree(fleet / "r4")
    return fleet


@pytest.mark.usefixtures("in_one_process", "undrawn")
@pytest.mark.parametrize("name", COMMANDS)
def test_each_is_that_of_a_command_of_its_own(name: str, robots: Path, capsys: Capture) -> None:
    verb, options, record = command(name)
    (robots / "r2" / "calibration.yaml").write_text("arm: [")
    assert cli(verb, *jobs_in(robots), *options) == 2
    out, err = capsys.readouterr()
    assert err == ""
    assert max(map(len, out.splitlines())) <= 80
    # What failed comes first.
    table = out[out.index("verdict") :]
    assert table.index("r2") < table.index("r1") < table.index("r3")
    summary = json.loads((robots / f"{record}_summary.json").read_text())
    assert summary["counts"]["failed"] == 1
    assert [job["name"] for job in summary["jobs"]] == ["r1", "r2", "r3"]
    with (robots / f"{record}_summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert "calibration.yaml:1: found text that is not YAML" in rows[1]["error"]
    assert not (robots / "r2" / "results").exists()
    many = contents(robots / "r1" / "results")
    shutil.rmtree(robots / "r1" / "results")
    own = ("--jobs", "1") if verb == "study" and name != "drift" else ()
    assert cli(verb, jobs_in(robots)[0], *options, *own, "--no-report") in (0, 1)
    assert contents(robots / "r1" / "results") == many
    assert f"{record}.json" in many


@pytest.mark.usefixtures("in_one_process")
@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "bootstrap"])
def test_what_is_whole_and_of_the_same_is_taken(name: str, robots: Path) -> None:
    verb, options, record = command(name)
    jobs = jobs_in(robots)[:2]
    assert answer(verb, *jobs, *options)["counts"]["failed"] == 0

    def resumed(*more: str) -> list[bool]:
        found = answer(verb, *jobs, *options, *more, "--resume")
        assert found["counts"]["failed"] == 0
        return [job["resumed"] for job in found["jobs"]]

    assert resumed() == [True, True]
    written = robots / "r1" / "results" / f"{record}.json"
    written.write_bytes(written.read_bytes()[:-20])
    assert resumed() == [False, True]
    if name == "plan":
        # Another candidate, and another option.
        (robots / "candidates.yaml").write_text(CANDIDATES.replace("joint_1: 60", "joint_1: 50"))
        assert resumed() == [False, False]
        assert resumed("--tilt", "30") == [False, False]
    if name in ("plan for a check", "drift"):
        samples = robots / "r2" / "calibration" / "a.csv"
        samples.write_text(samples.read_text().replace("0.1", "0.10", 1))
        assert resumed() == [True, False]


def test_processes_are_shared_between_few_jobs(
    robots: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares = list[int]()

    def counted(_: Any, tasks: Sequence[Task], **__: Any) -> Iterator[tuple[int, JobResult]]:
        for number, task in enumerate(tasks):
            shares.append(task.work.processes)
            yield number, begun(task.work, task.job)

    monkeypatch.setattr(workers, "work_through", counted)
    for processes in (1, 3, 5):
        run_jobs(Study(), jobs_in(robots)[:2], workers=processes)
    assert shares == [1, 1, 1, 1, 2, 2]


def test_elsewhere_a_plan_finds_its_files(robots: Path) -> None:
    plan = PlanNext(count=2, candidates=Path("candidates.yaml")).elsewhere()
    assert (plan.count, plan.candidates) == (2, robots / "candidates.yaml")


def test_wrong_usage(robots: Path) -> None:
    jobs = jobs_in(robots)
    assert "--unit" in refused("study", *jobs, "--kind", "drift", "--unit", "set")
    assert "no such file" in refused("plan", "nothing/*.yaml")
    assert "drives" not in refused("study", "none.yaml")


@pytest.mark.parametrize("name", ["plan", "sizes"])
def test_killed_in_the_middle_it_goes_on_with_resume(
    name: str, robots: Path, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes, as a user runs it; two of them write what one does."""
    monkeypatch.setenv("PYTHONPATH", str(repository))
    verb, options, record = command(name)
    run = [sys.executable, "-m", "suta_calib", verb, *jobs_in(robots), *options, "--json"]
    running = subprocess.Popen([*run, "--jobs", "1"], stdout=subprocess.PIPE)
    first, end = robots / "r1" / "results" / f"{record}.json", time.monotonic() + 500
    while not first.exists():
        assert running.poll() is None
        assert time.monotonic() < end
        time.sleep(0.01)
    os.kill(running.pid, signal.SIGKILL)
    running.communicate()
    assert not (robots / f"{record}_summary.json").exists()
    written = first.stat().st_ino
    done = subprocess.run(
        [*run, "--jobs", "2", "--resume"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    found = json.loads(done.stdout)
    assert found["jobs"][0]["resumed"]
    assert first.stat().st_ino == written
    assert not found["jobs"][2]["resumed"]
    by_two = contents(robots / "r3" / "results")
    shutil.rmtree(robots / "r3" / "results")
    own = ("--jobs", "1") if verb == "study" else ()
    assert cli(verb, jobs_in(robots)[2], *options, *own, "--no-report") == 0
    assert contents(robots / "r3" / "results") == by_two
