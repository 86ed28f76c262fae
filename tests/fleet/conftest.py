"""A job that was calibrated, and a folder of robots made from it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from cli_job import cli, write_simulated_job

from suta_calib.fleet import workers


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """A job that was calibrated by a command of its own."""
    job = write_simulated_job(tmp_path_factory.mktemp("made") / "job", suta_urdf)
    assert cli("calibrate", job, "--no-report") == 0
    return job


@pytest.fixture
def fleet(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of four robots, with relative paths as a user has them."""
    for name in ("r1", "r2", "r3", "r4"):
        shutil.copytree(made.parent, tmp_path / name, ignore=shutil.ignore_patterns("results"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def in_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs are done here, one after the other: starting workers takes seconds."""

    def here(work: Callable[[Any], Any], tasks: Sequence[Any], **_: Any) -> Iterator[Any]:
        yield from reversed([(k, work(task)) for k, task in enumerate(tasks)])

    monkeypatch.setattr(workers, "work_through", here)
