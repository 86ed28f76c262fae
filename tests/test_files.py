"""Glob patterns, and text that is written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from reading import write

from suta_calib.errors import OutputError, SamplesError
from suta_calib.measurements import expand, files, write_text


# ── patterns and writing ─────────────────────────────────────────────────────────────────────
def test_expand_sorts_and_takes_relative_absolute_and_literal_names(tmp_path: Path) -> None:
    (tmp_path / "d" / "e.csv").mkdir(parents=True)  # a folder is not a file
    names = ["b.csv", "a.csv", "d/c.csv", "run[1].csv"]
    for name in names:
        write(tmp_path, "", name)
    b, a, c, run = (tmp_path / name for name in names)
    assert expand("*.csv", tmp_path) == [a, b, run]
    assert expand("**/*.csv", tmp_path) == [a, b, c, run]
    assert expand(f"{tmp_path}/d/*.csv", tmp_path / "elsewhere") == [c]
    assert expand("run[1].csv", tmp_path) == [run]
    with pytest.raises(SamplesError) as caught:
        expand("none/*.csv", tmp_path)
    assert "'none/*.csv'" in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@given(pattern=st.text(st.characters(exclude_characters="/", codec="utf-8")))
def test_expand_takes_any_pattern(scratch: Path, pattern: str) -> None:
    folder = scratch.parent / "empty"
    folder.mkdir(exist_ok=True)
    try:
        expand(pattern, folder)
    except SamplesError as error:
        assert str(folder) in str(error)  # noqa: PT017 (whether it raises depends on the example)


def touched(path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    path.touch()


def test_a_pattern_that_goes_through_the_whole_computer_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Looking at a hundred thousand entries takes a second; at all of a disk, for ever."""
    monkeypatch.setattr(files, "MOST_ENTRIES", 50)
    for k in range(60):
        touched(tmp_path / f"{k % 7}/{k}.csv")
    for pattern in ("**/*.csv", "*/*.csv", "**", "*/**/x.csv"):
        with pytest.raises(SamplesError, match="more than 50 files"):
            expand(pattern, tmp_path)
    assert len(expand("3/*.csv", tmp_path)) == 9


def test_a_link_that_leads_back_is_gone_through_once(tmp_path: Path) -> None:
    touched(tmp_path / "a/x.csv")
    (tmp_path / "a" / "back").symlink_to(tmp_path)
    assert expand("**/*.csv", tmp_path) == [tmp_path / "a" / "x.csv"]
    elsewhere = tmp_path.parent / f"{tmp_path.name}-elsewhere"
    touched(elsewhere / "y.csv")
    (tmp_path / "day").symlink_to(elsewhere)
    assert expand("**/y.csv", tmp_path) == [tmp_path / "day" / "y.csv"]


def test_hidden_files_are_not_meant(tmp_path: Path) -> None:
    for name in (".x.csv", ".git/y.csv", "z.csv"):
        touched(tmp_path / name)
    assert expand("**/*.csv", tmp_path) == [tmp_path / "z.csv"]
    assert expand(".*.csv", tmp_path) == [tmp_path / ".x.csv"]


def test_write_text_is_whole_or_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "10 µm\n")
    assert path.read_bytes() == "10 µm\n".encode()
    with pytest.raises(OutputError, match=r"none.a\.txt"):
        write_text(tmp_path / "none" / "a.txt", "")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="folder"):
        write_text(tmp_path / "folder", "")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.txt", "folder"]
