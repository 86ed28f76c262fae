"""Work on many things, each in a worker process: whatever ends one, the others are done."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import dask
import pytest
from fleet_work import at_work, doubled, ended_once

from suta_calib.errors import InputError
from suta_calib.fleet.workers import Crash, work_through


def until(true: Callable[[], object], seconds: float = 500.0) -> None:
    """Wait for it."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def is_there(process: int) -> bool:
    """Whether a process runs, or waits to be buried."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{process}/stat")
    return not state.exists() or ") Z " not in state.read_text()


def test_a_process_that_ends_costs_only_what_it_worked_on() -> None:
    others = set(multiprocessing.active_children())
    numbers = [1, -1, 2, 0, 3, 4]
    found = dict(work_through(doubled, numbers, workers=2))
    assert {k: found[k] for k in (0, 2, 4, 5)} == {0: 2, 2: 4, 4: 6, 5: 8}
    killed, ended = found[1], found[3]
    assert isinstance(killed, Crash)
    assert isinstance(ended, Crash)
    assert (killed.reason, ended.reason) == ("SIGKILL(-9)", "EXIT(3)")
    assert set(multiprocessing.active_children()) <= others


def test_what_ended_a_process_is_tried_once_more_alone(tmp_path: Path) -> None:
    marks = [tmp_path / "a", tmp_path / "b"]
    assert dict(work_through(ended_once, marks, workers=2)) == {0: "a", 1: "b"}


def test_of_nothing_no_process_is_started() -> None:
    assert [*work_through(doubled, [], workers=2)] == []


@pytest.mark.parametrize("how", ["Ctrl-C", "kill -9"])
def test_no_worker_outlives_whoever_started_it(how: str, tmp_path: Path, repository: Path) -> None:
    mark = tmp_path / "mark"
    script = (
        "from pathlib import Path\nfrom fleet_work import at_work\n"
        "from suta_calib.fleet.workers import work_through\n"
        f"if __name__ == '__main__':\n    list(work_through(at_work, [Path({str(mark)!r})]))\n"
    )
    (tmp_path / "script.py").write_text(script)
    paths = [str(repository), str(Path(at_work.__code__.co_filename).parent)]
    running = subprocess.Popen(
        [sys.executable, tmp_path / "script.py"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    until(lambda: mark.exists() and mark.read_text())
    worker = int(mark.read_text())
    # As a terminal does, to all of them; or to one alone.
    if how == "Ctrl-C":
        os.killpg(running.pid, signal.SIGINT)
    else:
        running.kill()
    _, said = running.communicate()
    until(lambda: not is_there(worker))
    assert said.count("Traceback") == (how == "Ctrl-C")


def test_on_a_cluster_too() -> None:
    distributed = pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, dashboard_address=":0", silence_logs=60
        ) as running,
    ):
        address = running.scheduler_address
        assert dict(work_through(doubled, [1, 2, 3], dask=address)) == {0: 2, 1: 4, 2: 6}
        found = dict(work_through(doubled, [-1], dask=address))
        assert isinstance(found[0], Crash)
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "0.5s"}),
        pytest.raises(InputError, match="no scheduler"),
    ):
        list(work_through(doubled, [1], dask="tcp://127.0.0.1:1"))
