"""Where trials run does not change what they give, and what is done stays done."""

from __future__ import annotations

import gc
import math
import multiprocessing
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
import pytest
from cli_job import cli
from hypothesis import given, settings
from hypothesis import strategies as st
from study_scene import SUTA, planned, suta_job

from suta_calib.analysis.study import runner as study_runner
from suta_calib.analysis.study.plan import StudyLog, StudyPlan, run_study
from suta_calib.analysis.study.trial import Trial
from suta_calib.errors import InputError, JobError, MissingExtraError, SamplesError
from suta_calib.processes import interrupts_withheld

ASKED: dict[str, dict[str, Any]] = {
    "size": {"kind": "size", "sizes": (1, 4), "trials": 5},
    "bootstrap": {"kind": "bootstrap", "trials": 4},
    "monte-carlo": {"kind": "monte-carlo", "trials": 4},
}
IDENTITY = {"kind": "size", "seed": "0", "job": "abc"}
NAMES = ("joint_1.offset", "tip.z")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "study.trials.csv"


@pytest.fixture
def logged(path: Path) -> Path:
    """A log with one trial."""
    with StudyLog(path, IDENTITY, NAMES) as log:
        log.append(Trial(1, 0, "", 1e-3))
    return path


@contextmanager
def interrupted(task: int) -> Iterator[list[tuple[int, ...]]]:
    """An interrupt in place of this process's trial of that number; those that it began."""
    run_trial, begun = study_runner.run_trial, list[tuple[int, ...]]()

    def run(data: Any, *at: int) -> Trial:
        begun.append(at)
        if len(begun) > task:
            raise KeyboardInterrupt
        return run_trial(data, *at)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(study_runner, "run_trial", run)
        with pytest.raises(KeyboardInterrupt):
            yield begun


def plan_of(kind: str) -> StudyPlan:
    return planned(suta_job(), **ASKED[kind])


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a Dask cluster: two threads of another process."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=True, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running.scheduler_address


@pytest.mark.parametrize("kind", ASKED)
def test_one_worker_two_workers_and_dask_give_the_same_numbers(kind: str, cluster: str) -> None:
    """To the last bit: floats are compared as they are."""
    plan = plan_of(kind)
    alone = run_study(plan)
    assert len(alone) == len(plan.tasks)
    assert all(not trial.problem for trial in alone)
    assert run_study(plan, workers=2) == alone
    assert run_study(plan, dask=cluster) == alone


def test_the_command_prints_the_same_json_wherever_it_runs(
    cluster: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = []
    for where in (("--jobs", "1"), ("--jobs", "2"), ("--dask", cluster)):
        asked = ("--trials", "3", "--sizes", "2,5", "--out", tmp_path, "--json", *where)
        assert cli("study", SUTA / "calibration.yaml", *asked) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0].count("mean_mm") == 2
    assert printed[0] == printed[1] == printed[2]


def test_this_process_takes_part_and_an_interrupt_of_it_ends_the_others(path: Path) -> None:
    plan, others = planned(sizes=(2, 3), trials=10), set(multiprocessing.active_children())
    with interrupted(2) as mine, StudyLog(path, IDENTITY, ()) as log:
        run_study(plan, log, workers=2)
    assert set(multiprocessing.active_children()) <= others
    with StudyLog(path, IDENTITY, ()) as log:
        assert set(mine[:2]) <= set(log.finished())
        ran = [
            (t.size, t.number) for t in study_runner.run_trials(plan.data, plan.tasks, workers=2)
        ]
        assert sorted(ran) == plan.tasks
        assert run_study(plan, log, resume=True, workers=2) == run_study(plan)


def test_what_is_sent_to_workers_holds_no_compiled_function() -> None:
    content = pickle.dumps(plan_of("monte-carlo").data)
    assert b"casadi" not in content
    assert len(content) < 1_000_000


def test_workers_get_the_data_where_no_file_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Then they come with each batch."""
    plan = planned(sizes=(3,), trials=4)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    assert run_study(plan, workers=2) == run_study(plan)


def test_progress_counts_every_trial() -> None:
    told: list[tuple[int, int]] = []
    run_study(plan_of("size"), progress=lambda done, total: told.append((done, total)))
    assert told == [(k, 10) for k in range(1, 11)]


def test_an_address_without_a_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    cried: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", cried.append)
    with dask.config.set({"distributed.comm.timeouts.connect": "0.5s"}):
        for address in ("tcp://127.0.0.1:1", "nowhere", "udp://x:1"):
            with pytest.raises(InputError, match=f"--dask {address}.*no scheduler"):
                run_study(plan_of("size"), dask=address)
    gc.collect()
    assert not cried


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be blocked here")
def test_processes_started_for_a_study_do_not_hear_an_interrupt() -> None:
    ask = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    with interrupts_withheld():
        told = subprocess.run([sys.executable, "-c", ask], capture_output=True, check=True)
    assert told.stdout.strip() == b"True"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_dask_is_an_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"suta_calib\[dask\]"):
        run_study(plan_of("size"), dask="tcp://127.0.0.1:1")


# ── The log ──────────────────────────────────────────────────────────────────────────────────
@settings(max_examples=40)
@given(
    trials=st.lists(
        st.builds(
            Trial,
            st.integers(1, 99),
            st.integers(0, 999),
            st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=9),
            st.floats(0, 1),
            st.dictionaries(st.sampled_from(NAMES), st.tuples(st.floats(-9, 9), st.floats(0, 9))),
        ),
        unique_by=lambda t: (t.size, t.number),
        min_size=1,
        max_size=5,
    )
)
def test_trials_are_read_as_they_were_written(scratch: Path, trials: list[Trial]) -> None:
    scratch.unlink(missing_ok=True)
    with StudyLog(scratch, IDENTITY, NAMES) as log:
        for trial in trials:
            log.append(trial)
    found = StudyLog(scratch, IDENTITY, NAMES).finished()
    assert list(found.values()) == trials


def test_a_resumed_study_runs_only_what_is_missing(path: Path) -> None:
    plan, told = plan_of("size"), list[int]()
    with StudyLog(path, IDENTITY, plan.names) as log:
        whole = run_study(plan, log)
    lines = path.read_text().splitlines(keepends=True)
    # Seven trials were done when the power failed in the middle of a line.
    path.write_text("".join(lines[:9]) + lines[9][: len(lines[9]) // 2])
    with StudyLog(path, IDENTITY, plan.names) as log:
        again = run_study(plan, log, resume=True, progress=lambda done, _: told.append(done))
    assert again == whole
    assert told == [8, 9, 10]
    assert sorted(path.read_text().splitlines()) == sorted(line.strip() for line in lines)


def test_more_trials_may_be_asked_for_later(path: Path) -> None:
    few = planned(sizes=(2,), trials=2)
    many = planned(sizes=(2, 3), trials=3)
    with StudyLog(path, IDENTITY, ()) as log:
        run_study(few, log)
    with StudyLog(path, IDENTITY, ()) as log:
        assert run_study(many, log, resume=True) == run_study(many)
    assert len(path.read_text().splitlines()) == 2 + 6


def test_an_interrupt_loses_only_what_was_running(path: Path) -> None:
    plan = plan_of("size")
    with interrupted(7), StudyLog(path, IDENTITY, ()) as log:
        run_study(plan, log)
    with StudyLog(path, IDENTITY, ()) as log:
        assert len(log.finished()) == 7
        assert run_study(plan, log, resume=True) == run_study(plan)


@pytest.mark.parametrize("end", ["", "# suta-calib stu", "WHOLE FIRST LINE"])
def test_a_file_without_a_trial_is_begun_again(logged: Path, end: str) -> None:
    path = logged
    first = path.read_text().splitlines(keepends=True)[0]
    path.write_text(first if end == "WHOLE FIRST LINE" else first + end)
    with StudyLog(path, IDENTITY, NAMES) as log:
        assert log.finished() == {}
        log.append(Trial(2, 0, "", 1e-3))
    assert list(StudyLog(path, IDENTITY, NAMES).finished()) == [(2, 0)]


@pytest.mark.parametrize("what", ["seed", "job", "kind"])
def test_trials_of_another_study_are_refused(logged: Path, what: str) -> None:
    before = logged.read_bytes()
    with pytest.raises(JobError, match=rf"trials\.csv:1: .*another study \({what} differs\)"):
        StudyLog(logged, IDENTITY | {what: "other"}, NAMES).finished()
    assert logged.read_bytes() == before


def test_a_file_that_is_no_log_is_refused(path: Path) -> None:
    path.write_text("size,trial\n1,2\n")
    with pytest.raises(JobError, match="another study"):
        StudyLog(path, IDENTITY, NAMES).finished()


@pytest.mark.parametrize(("old", "new"), [("0.001", "x"), ("\n1,0", "\n1,-"), ("\n1,0,", "\n")])
def test_a_spoilt_line_is_named(logged: Path, old: str, new: str) -> None:
    logged.write_text(logged.read_text().replace(old, new))
    with pytest.raises(SamplesError, match=r"trials\.csv:3"):
        StudyLog(logged, IDENTITY, NAMES).finished()


def test_without_resuming_a_log_is_begun_anew(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "study.trials.csv"
    for trial in (Trial(1, 0, "", 1e-3), Trial(2, 0, "no, not at all", math.nan)):
        with StudyLog(path, IDENTITY, NAMES) as log:
            assert run_study(planned(sizes=(1,), trials=1), log)
            log.append(trial)
    text = path.read_text()
    assert '"no, not at all"' in text
    assert len(text.splitlines()) == 4
