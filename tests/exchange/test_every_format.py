"""What every format must do: describe itself, be recognised, and refuse what is malformed."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import pytest
from foreign_samples import FILES, SAMPLES, Sample
from hypothesis import given, settings
from hypothesis import strategies as st

from suta_calib.errors import InputError, SutaCalibError
from suta_calib.exchange import export_formats, import_formats, read_foreign
from suta_calib.exchange.option import Described, Option
from suta_calib.exchange.reader import recognised
from suta_calib.registry import shipped

FORMATS: list[Described] = [
    *shipped(import_formats()).values(),
    *shipped(export_formats()).values(),
]


def test_every_format_that_is_read_has_a_sample() -> None:
    assert set(SAMPLES) == set(shipped(import_formats()))


@pytest.mark.parametrize("form", FORMATS, ids=lambda each: each.name)
def test_a_format_describes_itself(form: Described) -> None:
    assert form.summary
    assert len(form.summary) < 100
    assert form.example
    assert all(option.help for option in form.options)


def test_options_of_one_name_are_one_option() -> None:
    """The command line has each once: it must mean the same to all."""
    for formats in (import_formats(), export_formats()):
        known: dict[str, Option] = {}
        for form in formats.values():
            for option in form.options:
                assert known.setdefault(option.name, option) == option, option.name


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_is_recognised(name: str, tmp_path: Path) -> None:
    assert recognised(SAMPLES[name](tmp_path).path).name == name


MALFORMED = {
    "empty": b"",
    "blank": b" \n\t\n",
    "binary": bytes(range(256)) * 8,
    "a page": b"<html><body>504 Gateway Timeout</body></html>\n",
    "an entity": b'<!DOCTYPE a [<!ENTITY b "bbbb">]><a>&b;</a>',
    "JSON": json.dumps({"a": [1, 2]}).encode(),
    "nested JSON": b"[" * 100_000,
    "words": b"once upon a time\nthere was a file\n",
}


@pytest.mark.parametrize("how", MALFORMED)
@pytest.mark.parametrize("name", FILES)
def test_malformed_files_are_refused(name: str, how: str, tmp_path: Path) -> None:
    sample = SAMPLES[name](tmp_path)
    sample.path.write_bytes(MALFORMED[how])
    with pytest.raises(SutaCalibError) as refused:
        read_foreign(sample.path, name, **sample.options)
    assert str(sample.path) in str(refused.value)
    assert len(str(refused.value)) < 1000


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_that_is_not_there(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing-there: found no such file"):
        read_foreign(tmp_path / "nothing-there", name)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_name_that_no_file_can_have(name: str, tmp_path: Path) -> None:
    for path in (tmp_path / ("x" * 300), Path("a\0b")):
        with pytest.raises(InputError):
            read_foreign(path, name, **SAMPLES[name](tmp_path).options)
        with pytest.raises(InputError):
            read_foreign(path)


@cache
def made(name: str, folder: Path) -> tuple[Sample, Path, bytes]:
    """A sample, the file of it that is spoilt, and what that holds."""
    folder = folder / f"fuzz-{name}"
    folder.mkdir()
    sample = SAMPLES[name](folder)
    path = sample.path
    if path.is_dir():
        path = max(path.rglob("*.*"), key=lambda each: each.stat().st_size)
    return sample, path, path.read_bytes()


@pytest.mark.parametrize("name", SAMPLES)
@settings(max_examples=40)
@given(data=st.data())
def test_whatever_a_file_holds_it_is_read_or_refused(
    name: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A sample in which bytes were replaced, taken out or doubled: no other exception than ours."""
    sample, path, whole = made(name, tmp_path_factory.getbasetemp())
    start = data.draw(st.integers(0, len(whole)))
    length = data.draw(st.integers(0, 40))
    piece = data.draw(
        st.one_of(
            st.binary(max_size=12),
            st.sampled_from([b",", b"\n", b"nan", b"1e999", b"-", b"\xff", b"0", b"{}", b'"']),
        )
    )
    path.write_bytes(whole[:start] + piece + whole[start + length :])
    problem = None
    try:
        assert read_foreign(sample.path, name, **sample.options).text()
    except SutaCalibError as refused:
        problem = str(refused)
    assert problem is None or len(problem) < 1500


@pytest.mark.parametrize("name", FILES)
def test_a_file_without_end_is_not_read_to_its_end(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("suta_calib.exchange.cells.MOST_BYTES", 1000)
    monkeypatch.setattr("suta_calib.exchange.readers.plus_sequence.MOST_BYTES", 1000)
    sample = SAMPLES[name](tmp_path)
    content = sample.path.read_bytes()
    if name == "plus-sequence":
        content = content.partition(b"ElementDataFile")[0]
    sample.path.write_bytes(content * (2 + 2000 // len(content)))
    with pytest.raises(SutaCalibError, match=r"more than|without its end"):
        read_foreign(sample.path, name, **sample.options)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_refused(tmp_path: Path) -> None:
    """Its beginning, which says of which format it is, cannot be read twice."""
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match=r"pipe\.csv: found a pipe; expected a file"):
        read_foreign(tmp_path / "pipe.csv")


def test_a_device_that_never_ends(tmp_path: Path) -> None:
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero")
    with pytest.raises(InputError, match="an empty file"):
        read_foreign("/dev/zero")
