"""Files that replace others together: a process that is killed in the middle leaves no mixture."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from suta_calib import atomic
from suta_calib.atomic import exchange_files, write_bytes_atomically
from suta_calib.errors import OutputError

BEFORE = {"arm.urdf": b"before", "old.svg": b"before", "pictures/1.png": b"before"}
AFTER = {"arm.urdf": b"after", "pictures/2.png": b"after", "new.csv": b"after"}
# The record of each run, last; and what the run before has and the next one does not write.
BEFORE, AFTER = BEFORE | {"result.json": b"before"}, AFTER | {"result.json": b"after"}
STALE = ("old.svg", "pictures/1.png")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def killed_at(call: int, function: Callable[[], Any], monkeypatch: pytest.MonkeyPatch) -> bool:
    """Run something in a process that is killed before its n-th change of a folder.

    Returns:
        Whether it was killed; otherwise it made fewer changes than that.
    """
    if (child := os.fork()) == 0:
        left = [call]

        def counted(plain: Callable[..., Any]) -> Callable[..., Any]:
            def change(*arguments: Any, **named: Any) -> Any:
                left[0] -= 1
                if left[0] < 0:
                    os._exit(9)
                return plain(*arguments, **named)

            return change

        for module, name in (
            (os, "replace"),
            (os, "unlink"),
            (os, "mkdir"),
            (os, "rmdir"),
            (os, "fsync"),
            (shutil, "rmtree"),
        ):
            monkeypatch.setattr(module, name, counted(getattr(module, name)))
        function()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("looks", ["reader", "writer"])
def test_a_killed_run_is_finished_or_undone_by_whoever_looks_next(
    looks: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = []
    for call in range(100):
        (folder := tmp_path / str(call)).mkdir()
        exchange_files(folder, BEFORE)
        killed = killed_at(call, lambda at=folder: exchange_files(at, AFTER, STALE), monkeypatch)
        # Until somebody looks: no record beside files that it does not tell of.
        record = contents(folder).get("result.json")
        for expected, name in ((BEFORE, b"before"), (AFTER, b"after")):
            if record == name:
                there = {k: v for k, v in contents(folder).items() if not k.startswith(".")}
                assert there == expected
        if looks == "reader":
            atomic.recover(folder)
        else:
            write_bytes_atomically(folder / "other.txt", b"")
            (folder / "other.txt").unlink()
        assert contents(folder) in (BEFORE, AFTER)
        results.append(contents(folder) == AFTER)
        if not killed:
            break
    # Killed early, nothing has changed; from the journal on, everything has.
    assert 0 < results.index(True) < len(results) - 3
    assert all(results[results.index(True) :])


def test_an_interrupt_in_the_middle_leaves_all_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    exchange_files(tmp_path, BEFORE)
    left, plain = [2], os.replace

    def interrupted(*arguments: Any) -> None:
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        plain(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(atomic.os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            exchange_files(tmp_path, AFTER, STALE)
    assert contents(tmp_path) == AFTER


def left_behind(folder: Path, journal: object, **files: bytes) -> Path:
    (stage := folder / f"{atomic.PREFIX}1{atomic.SUFFIX}").mkdir()
    (stage / atomic.JOURNAL).write_text(json.dumps(journal))
    for number, data in files.items():
        (stage / number.removeprefix("n")).write_bytes(data)
    return stage


@pytest.mark.parametrize(
    "journal",
    [
        {"files": ["../mine.txt", "result.json"], "stale": []},
        {"files": ["a.txt", "result.json"], "stale": ["../mine.txt"]},
        {"files": ["linked/mine.txt", "result.json"], "stale": []},
        {"files": ["{outside}/mine.txt", "result.json"], "stale": []},
        {"files": 3},
        [],
    ],
)
def test_a_journal_reaches_nothing_outside_its_folder(journal: Any, tmp_path: Path) -> None:
    (mine := tmp_path / "mine.txt").write_text("mine")
    (folder := tmp_path / "results").mkdir()
    (folder / "linked").symlink_to(tmp_path)
    text = json.dumps(journal).replace("{outside}", str(tmp_path))
    stage = left_behind(folder, json.loads(text), n0=b"theirs", n1=b"theirs")
    atomic.recover(folder)
    assert mine.read_text() == "mine"
    assert not (folder / "a.txt").exists()
    del stage


def test_what_another_process_is_writing_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(atomic, "_PATIENCE_S", 0.05)
    stage = left_behind(tmp_path, {"files": ["a", "b"], "stale": []}, n0=b"1", n1=b"2")
    holder = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    atomic.recover(tmp_path)
    assert (stage / "0").exists()
    # Unless that was long ago.
    os.utime(stage, (time.time() - 7200,) * 2)
    atomic.recover(tmp_path)
    assert contents(tmp_path) == {"a": b"1", "b": b"2"}
    os.close(holder)


def test_a_place_that_is_taken_is_named(tmp_path: Path) -> None:
    (tmp_path / "new.csv").mkdir()
    with pytest.raises(OutputError, match=r"new\.csv: not written"):
        exchange_files(tmp_path, AFTER)
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
