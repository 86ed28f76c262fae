"""A folder of results: what stands in it is of one run."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from suta_calib.assessment import Assessment
from suta_calib.atomic import exchange_files
from suta_calib.errors import OutputError
from suta_calib.exchange.result import content_digest
from suta_calib.report.document import Document, File, Text
from suta_calib.report.files import write_document

GOOD = Assessment.of()


def answer(value: float, **files: str) -> Document:
    parts = [File(name.replace("_", "."), lambda text=text: text) for name, text in files.items()]
    return Document("tip", "Tip", GOOD, parts, {"a": value}, "result")


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_files_are_all_there_or_none(tmp_path: Path) -> None:
    out = tmp_path / "out"
    written = write_document(answer(1.5, x_txt="é\n"), out)
    assert written["files"] == {n: str(out / n) for n in ("x.txt", "report.html", "result.json")}
    assert (out / "x.txt").read_text(encoding="utf-8") == "é\n"
    assert json.loads((out / "result.json").read_text()) == written
    (out / "y.txt").mkdir()
    with pytest.raises(OutputError, match=r"y\.txt.*found a folder"):
        write_document(answer(2.5, x_txt="new", y_txt="new"), out)
    assert (out / "x.txt").read_text(encoding="utf-8") == "é\n"
    assert json.loads((out / "result.json").read_text())["a"] == 1.5
    assert names(out) == {"x.txt", "y.txt", "report.html", "result.json"}


def test_what_a_run_before_left_behind_is_removed(tmp_path: Path) -> None:
    write_document(answer(1.5, x_txt="1", y_txt="1", z_txt="1"), tmp_path)
    (tmp_path / "z.txt").write_text("somebody's own by now")
    (tmp_path / "other.txt").write_text("never ours")
    write_document(answer(2.5, x_txt="2"), tmp_path)
    assert names(tmp_path) == {"x.txt", "z.txt", "other.txt", "report.html", "result.json"}


def test_what_was_written_before_runs_had_hashes_is_removed_too(tmp_path: Path) -> None:
    before = {"files": {name: name for name in ("calibrated.urdf", "../x.txt", "result.json")}}
    (tmp_path / "out").mkdir()
    (tmp_path / "out/result.json").write_text(json.dumps(before))
    for name in ("out/calibrated.urdf", "x.txt"):
        (tmp_path / name).write_text("old")
    write_document(answer(1.5), tmp_path / "out")
    assert names(tmp_path / "out") == {"report.html", "result.json"}
    assert (tmp_path / "x.txt").exists()


def test_each_file_is_told_with_its_run_and_what_it_was_made_from(tmp_path: Path) -> None:
    digest = sha256(b"job").hexdigest()
    told = write_document(answer(1.5, x_txt="1"), tmp_path, {"a/job.yaml": digest})["run"]
    assert told["inputs"] == {"a/job.yaml": digest}
    assert told["sha256"] == {"x.txt": sha256(b"1").hexdigest()}
    again = write_document(answer(1.5, x_txt="1"), tmp_path, {"a/job.yaml": digest})["run"]
    assert again == told
    assert told["content"] == content_digest(
        {"a": 1.5} | json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    )
    other = write_document(answer(1.5, x_txt="2"), tmp_path, {"a/job.yaml": digest})["run"]
    assert other["id"] != told["id"]
    shown = Document("study", "Study", GOOD, [Text("seen")])
    run = write_document(shown, tmp_path, {"a/job.yaml": digest})["run"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"Run {run['id']} from job.yaml (SHA-256 {digest[:12]})." in page


@pytest.mark.parametrize("broken", ["not json", "[]", '{"files": 3}', '{"files": {}, "run": 1}'])
def test_a_result_that_is_none_is_replaced(tmp_path: Path, broken: str) -> None:
    (tmp_path / "result.json").write_text(broken)
    assert write_document(answer(1.5), tmp_path)["a"] == 1.5


def test_a_full_disk_leaves_the_run_before_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_document(answer(1.5, x_txt="1", y_txt="1"), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    synced, sync = [], os.fsync

    def full(descriptor: int) -> None:
        synced.append(descriptor)
        if len(synced) > 1:
            raise OSError(28, "No space left on device")
        sync(descriptor)

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        write_document(answer(2.5, x_txt="2"), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_whoever_finds_the_record_finds_the_files_it_tells_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The computer stops at any moment of the exchange."""
    for stops_at in range(4):
        folder = tmp_path / str(stops_at)
        folder.mkdir()
        for run in ("1", "2"):
            contents = {"x": run.encode(), "y": run.encode(), "record": run.encode()}
            moved: list[object] = []

            def stopping(source: Path, to: Path) -> None:
                if run == "2" and len(moved) == stops_at:  # noqa: B023
                    raise KeyboardInterrupt
                moved.append(to)  # noqa: B023
                source.rename(to)

            monkeypatch.setattr("os.replace", stopping)
            try:
                exchange_files(folder, contents)
            except KeyboardInterrupt:
                continue
        found = {path.name: path.read_text() for path in folder.iterdir()}
        # The first is the journal's: before it stands, nothing has changed.
        assert found.get("record") == ("1" if stops_at == 0 else None)
        assert "record" not in found or set(found.values()) == {"1"}


def test_a_report_is_of_one_job(tmp_path: Path) -> None:
    def written(name: str, job: str, *, opens: bool = False) -> set[str]:
        said = Document(name, name, GOOD, [Text(f"{name} of {job}")])
        said = replace(said, written="opening") if opens else said
        write_document(said, tmp_path, {f"some/{job}.yaml": "0" * 64})
        return {path.name for path in tmp_path.glob("*.html")}

    def page(name: str) -> str:
        return (tmp_path / name).read_text(encoding="utf-8")

    assert written("result", "a", opens=True) == {"report.html"}
    assert written("study", "a") == {"report.html"}
    assert written("study", "b") == {"report.html", "report-b.html"}
    assert written("plan", "b") == {"report.html", "report-b.html"}
    assert "study of a" in page("report.html")
    assert "of b" not in page("report.html")
    assert "study of b" in page("report-b.html")
    assert "plan of b" in page("report-b.html")
    assert "study of a" not in page("report-b.html")
    # A calibration begins anew.
    assert written("result", "c", opens=True) == {"report.html", "report-b.html"}
    assert "study of a" not in page("report.html")


def test_a_page_that_held_one_answer_only_is_replaced_by_that_of_another_job(
    tmp_path: Path,
) -> None:
    for job in "ab":
        said = Document("study", "study", GOOD, [Text(f"study of {job}")])
        write_document(said, tmp_path, {f"{job}.yaml": "0" * 64})
    (page,) = tmp_path.glob("*.html")
    assert "study of b" in page.read_text(encoding="utf-8")
    assert "study of a" not in page.read_text(encoding="utf-8")
