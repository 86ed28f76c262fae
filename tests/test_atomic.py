from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from suta_calib.atomic import (
    check_outputs,
    exchange_files,
    inputs_kept,
    note_input,
    only_writer,
    write_bytes_atomically,
)
from suta_calib.errors import OutputError


def test_writing_is_all_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.txt"
    write_bytes_atomically(path, b"first")
    assert stat.S_IMODE(path.stat().st_mode) & 0o444 == 0o444

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("suta_calib.atomic.os.fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        write_bytes_atomically(path, b"second")
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_files_in_a_folder_of_the_folder_come_with_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the last of them does not fit, neither the first is there nor its folder."""
    contents = {"pictures/1.png": b"one", "pictures/2.png": b"two", "rows.csv": b"rows"}

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("suta_calib.atomic.os.fsync", full)
        with pytest.raises(OutputError, match="No space left on device"):
            exchange_files(tmp_path, contents)
    assert list(tmp_path.iterdir()) == []
    exchange_files(tmp_path, contents)
    exchange_files(tmp_path, {"pictures/1.png": b"new", "rows.csv": b"less"}, ["pictures/2.png"])
    assert sorted(tmp_path.rglob("*.*")) == [tmp_path / "pictures/1.png", tmp_path / "rows.csv"]
    assert (tmp_path / "pictures/1.png").read_bytes() == b"new"


def test_places_that_cannot_be_written_are_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for place in (tmp_path / "no" / "x", tmp_path / "file" / "x", tmp_path):
        with pytest.raises(OutputError, match=str(place)):
            write_bytes_atomically(place, b"data")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_file_is_replaced_not_rewritten(tmp_path: Path) -> None:
    path = tmp_path / "result.txt"
    path.write_bytes(b"first")
    with path.open("rb") as reader:
        write_bytes_atomically(path, b"second")
        assert reader.read() == b"first"
    assert path.read_bytes() == b"second"


def test_a_file_has_one_writer_at_a_time(tmp_path: Path) -> None:
    path, link = tmp_path / "out.csv", tmp_path / "link.csv"
    link.symlink_to(path)
    with only_writer(path):
        with pytest.raises(OutputError, match=f"found process {os.getpid()} writing it"):
            only_writer(link).__enter__()
        with only_writer(tmp_path / "other.csv"):
            pass
    with only_writer(link):
        assert sorted(each.name for each in tmp_path.iterdir()) == ["link.csv"]


def test_a_lock_goes_with_its_process(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    code = "from suta_calib.atomic import only_writer\n"
    code += f"with only_writer({str(path)!r}):\n    print('held', flush=True); input()"
    command = [sys.executable, "-c", code]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match=str(process.pid)):
            only_writer(path).__enter__()
        process.kill()
    with only_writer(path):
        pass


def test_outputs_are_no_inputs_and_not_each_other(tmp_path: Path) -> None:
    arm, out = tmp_path / "arm.urdf", tmp_path / "sub" / ".." / "arm.urdf"
    (tmp_path / "sub").mkdir()
    arm.write_text("")
    with pytest.raises(OutputError, match="found an input of the same command"):
        check_outputs([out], [None, arm])
    with pytest.raises(OutputError, match="found another output"):
        check_outputs([arm, out], [])
    check_outputs([tmp_path / "a", tmp_path / "b"], [arm])


def test_what_was_read_is_neither_replaced_nor_removed(tmp_path: Path) -> None:
    path, link = tmp_path / "arm.urdf", tmp_path / "link.urdf"
    path.write_bytes(b"read")
    link.symlink_to(path)
    with inputs_kept():
        note_input(path)
        for name in ("arm.urdf", "link.urdf"):
            with pytest.raises(OutputError, match="found an input of the same command"):
                exchange_files(tmp_path, {"before": b"", name: b"new"})
        with pytest.raises(OutputError, match="found an input of the same command"):
            exchange_files(tmp_path, {"before": b""}, ["arm.urdf"])
        assert sorted(each.name for each in tmp_path.iterdir()) == ["arm.urdf", "link.urdf"]
        exchange_files(tmp_path, {"arm.urdf": b"read"})
        with only_writer(link):
            exchange_files(tmp_path, {"arm.urdf": b"edited"})
    write_bytes_atomically(path, b"another command")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("linked", [False, True])
def test_what_is_no_regular_file_is_not_replaced(linked: bool, tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    target = link if linked else pipe
    with pytest.raises(OutputError, match="expected a regular file"):
        write_bytes_atomically(target, b"a")
    with pytest.raises(OutputError, match="expected a regular file"):
        exchange_files(tmp_path, {"a": b"a", target.name: b"b"})
    assert pipe.is_fifo()
    assert {path.name for path in tmp_path.iterdir()} == {"pipe", "link"}
    # A link to a file is as ever.
    link.unlink()
    link.symlink_to(tmp_path / "file")
    (tmp_path / "file").write_bytes(b"b")
    write_bytes_atomically(link, b"a")
    assert link.read_bytes() == b"a"
