"""YAML as plain data with lines; files that are not YAML are refused with theirs."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st

from suta_calib.errors import InputError, JobError
from suta_calib.measurements import YamlSection, read_yaml


@pytest.fixture(scope="session")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("yaml") / "file.yaml"


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_values_and_lines(tmp_path: Path) -> None:
    text = (
        b"\xef\xbb\xbf# a comment\n"
        b"a: {b: 1e-3, c: 1_000}\n"
        b"list:\n"
        b"  - x: [true, no, ~, .5, '1']\n"
        b"  - 2026-01-01\n"
        b"01: &anchor {k: -.inf}\n"
        b"null: *anchor\n"
    )
    document = read_yaml(write(tmp_path, text))
    assert document.data == {
        "a": {"b": 0.001, "c": 1000},
        "list": [{"x": [True, "no", None, 0.5, "1"]}, "2026-01-01"],
        "01": {"k": float("-inf")},
        "null": {"k": float("-inf")},
    }
    assert document.line_of("a", "b") == 2
    assert document.line_of("list", 0, "x", 3) == 4
    assert document.line_of("list", 1) == 5
    assert document.line_of("list", 1, "absent", "deeper") == 5
    assert document.line_of("null") == 7


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("# nothing\n", None, "an empty file"),
        ("just words\n", 1, "no keys at the top level"),
        ("a: 1\nb: {c: 1,\n  c: 2}\n", 3, "the key 'c' twice"),
        ("a: 1\nb: [1, 2\nc: 3\n", 3, "not YAML"),
        ("a: 1\n---\nb: 2\n", 2, "not YAML"),
        ("a: 1\n\tb: 2\n", 2, "not YAML"),
        ("a: \x00\n", 1, "zero bytes"),
        (b"a: 1\nb: \xff\n", 2, "not UTF-8"),
        ("a: 1\nb: &x [*x]\n", 2, "a reference to itself"),
        ("a: 1\n? [1, 2]\n: 3\n", 2, "a list or mapping as a key"),
        ("a: 1\nb: !!int x\n", 2, "found 'x'; expected a decimal number"),
        ("a: " + 600 * "[" + 600 * "]", None, "nested too deeply"),
    ],
)
def test_refused(tmp_path: Path, text: str | bytes, line: int | None, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(JobError, match=message) as caught:
        read_yaml(path, JobError)
    place = f"{path}: " if line is None else f"{path}:{line}: "
    assert str(caught.value).startswith(place)
    assert "\n" not in str(caught.value)


def test_no_such_file_or_a_folder(tmp_path: Path) -> None:
    for path, found in ((tmp_path / "none.yaml", "no such file"), (tmp_path, "a folder")):
        with pytest.raises(JobError) as caught:
            read_yaml(path, JobError)
        assert str(caught.value).startswith(f"{path}: found {found}")


def test_odd_names_stay_on_one_line(tmp_path: Path) -> None:
    section = YamlSection(read_yaml(write(tmp_path, '"a\\nb": 1\n')), InputError)
    with pytest.raises(InputError) as caught:
        section.check_keys(("known",))
    assert "\n" not in str(caught.value)


@given(content=st.one_of(st.binary(), st.text().map(str.encode)))
def test_arbitrary_content(scratch: Path, content: bytes) -> None:
    scratch.write_bytes(content)
    try:
        document = read_yaml(scratch)
    except InputError as error:
        assert str(scratch) in str(error)  # noqa: PT017 (whether it raises depends on the example)
        return
    assert all(document.line_of(key) is not None for key in document.data)


tokens = st.sampled_from([*"-:?[]{},&*!|>%@`#'\"~ \n\t", "a", "1", "...", "---", "<<", "!!", ": "])


@given(parts=st.lists(tokens, max_size=30))
def test_arbitrary_yaml_tokens(scratch: Path, parts: list[str]) -> None:
    test_arbitrary_content.hypothesis.inner_test(scratch, "".join(parts).encode())


numbers = st.text("0123456789abefoxinINF+-._~nulTRUE:", max_size=8)


@given(parts=st.lists(st.one_of(tokens, numbers), max_size=20))
def test_what_libyaml_and_python_both_read_they_read_alike(scratch: Path, parts: list[str]) -> None:
    # The tag "!" alone is read as "" or as nothing.
    assume("!" not in "".join(parts))
    scratch.write_text("a: " + "".join(parts), encoding="utf-8")
    results = []
    for libyaml in (True, False):
        with pytest.MonkeyPatch.context() as patched, suppress(InputError):
            patched.setattr(yaml, "__with_libyaml__", libyaml)
            document = read_yaml(scratch)
            results.append((repr(document.data), document.lines))
    assert results == results[:1] * len(results)


@pytest.mark.parametrize("text", ["a: " + "[" * 100_000, "- " * 100_000 + "a", "{a: " * 100_000])
def test_what_is_nested_in_thousands_ends_nothing(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match="nested too deeply"):
        read_yaml(write(tmp_path, text))


def test_without_libyaml_the_same_is_read(
    repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in sorted((repository / "data" / "suta").glob("*.yaml")):
        quick = read_yaml(file)
        with monkeypatch.context() as patched:
            patched.setattr(yaml, "__with_libyaml__", False)
            assert read_yaml(file) == quick


def test_files_are_those_of_all_patterns_each_once(tmp_path: Path) -> None:
    for name in ("b.csv", "a.csv", "c.txt"):
        (tmp_path / name).touch()
    text = "one: a.csv\nseveral: [b.csv, '*.csv']\nnone: ['*.csv', '*.tsv']\n"
    section = YamlSection(read_yaml(write(tmp_path, text), JobError), JobError)
    assert section.files("one") == (tmp_path / "a.csv",)
    assert [path.name for path in section.files("several")] == ["b.csv", "a.csv"]
    with pytest.raises(JobError, match=r"file\.yaml:3: none: found no file that matches '\*\.tsv'"):
        section.files("none")


def test_a_file_that_says_little_and_means_much_is_refused(tmp_path: Path) -> None:
    """Nine aliases of nine aliases of …: a billion values in a few lines."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10)]
    with pytest.raises(
        InputError, match="too many values; expected at most 200,000 values"
    ) as caught:
        read_yaml(write(tmp_path, "\n".join(lines)))
    assert caught.value.line is not None
    with pytest.raises(InputError, match="nested too deeply"):
        read_yaml(write(tmp_path, "a: " + "[" * 60 + "]" * 60))
    with pytest.raises(InputError, match="9,000,005 characters; expected at most 8,000,000"):
        read_yaml(write(tmp_path, "a: '" + "x" * 9_000_000 + "'"))
    aliases = write(tmp_path, "a: &a {x: 1}\nb: [*a, *a]")
    assert read_yaml(aliases).data == {"a": {"x": 1}, "b": [{"x": 1}, {"x": 1}]}
