from __future__ import annotations

import stat
from pathlib import Path

import pytest

from suta_calib.atomic import write_bytes_atomically
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
