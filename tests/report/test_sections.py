"""Sections that analyses add to a report: found again, replaced, escaped, nothing lost."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from lxml import html

from suta_calib.assessment import Assessment
from suta_calib.errors import OutputError
from suta_calib.report.document import Document, Figure, File, Text
from suta_calib.report.files import write_document
from suta_calib.report.listing import Column, Listing
from suta_calib.report.page import page_with

SVG = '<svg xmlns="http://www.w3.org/2000/svg" id="{}"><path d="M0 0"/></svg>'
LANDMARKS = Listing[tuple[str, float]](
    "",
    Column("", "landmark", lambda row: row[0]),
    Column("", "mm", lambda row: row[1], form=".1f"),
)


def picture(name: str) -> Figure:
    return Figure(lambda: SVG.format(name), "A picture")


SECTION = Document(
    "outliers",
    "Outliers",
    Assessment("care", "one of 15 landmarks", ("one <b>note</b>",)),
    [
        Text("a < b"),
        LANDMARKS.of([("S<2>", 1.2)]),
        picture("p"),
    ],
)


def sections(page: str) -> list[str]:
    return [str(each.get("id")) for each in html.fromstring(page).iter("section")]


def test_a_section_makes_a_page_of_its_own_with_everything_escaped() -> None:
    page = page_with(SECTION, None)
    tree = html.fromstring(page)
    assert sections(page) == ["outliers"]
    assert tree.xpath("//p/text()")[-1] == "a < b"
    assert tree.xpath("//td/text()") == ["S<2>", "1.2"]
    assert tree.xpath("//td[@class='n']/text()") == ["1.2"]
    assert tree.xpath("//main//li/text()") == ["one <b>note</b>"]
    assert "</span> One of 15 landmarks" in page
    assert len(tree.xpath("//figure//svg")) == 1
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "")


def test_a_section_stands_below_what_is_there_and_replaces_only_itself() -> None:
    page = page_with(SECTION, None)
    page = page_with(replace(SECTION, name="study", title="Study"), page)
    again = page_with(replace(SECTION, parts=[Text(r"second \1 time")]), page)
    assert sections(again) == ["outliers", "study"]
    assert r"second \1 time" in again
    assert "S&lt;2&gt;" not in again.split('id="study"')[0]
    assert page_with(replace(SECTION, parts=[Text(r"second \1 time")]), again) == again


def test_a_page_from_before_there_were_sections_is_kept() -> None:
    page = page_with(SECTION, "<html><body><p>old</p></body></html>")
    assert "<p>old</p>" in page
    assert sections(page) == ["outliers"]


def test_files_are_written_by_the_sections_name(tmp_path: Path) -> None:
    answer = write_document(SECTION.with_data(a=float("nan")), tmp_path / "new")
    assert set(answer["files"]) == {"outliers.svg", "report.html", "outliers.json"}
    assert json.loads((tmp_path / "new/outliers.json").read_text())["a"] is None
    parts = [picture("a"), picture("b"), File("plan.csv", lambda: "x\n")]
    answer = write_document(replace(SECTION, parts=parts), tmp_path / "new")
    assert {"outliers_1.svg", "outliers_2.svg", "plan.csv"} < set(answer["files"])


def test_a_folder_in_the_place_of_the_report_is_refused_before_anything_is_written(
    tmp_path: Path,
) -> None:
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OutputError, match=r"report\.html"):
        write_document(SECTION, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_a_verdict_is_the_worst_of_what_was_found() -> None:
    assert Assessment.of(bad=["x"], care=["y"]).level == "bad"
    assert not Assessment.of(bad=["x"], care=["y"]).usable
    assert Assessment.of(care=["y"]).word == "Take care"
    assert Assessment.of("fine") == Assessment("good", "fine")
