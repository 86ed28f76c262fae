"""Sections that analyses add to a report: found again, replaced, escaped, nothing lost."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from lxml import etree, html

from suta_calib.assessment import Assessment
from suta_calib.errors import OutputError
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.plotting.look import BLUE, WIDTH
from suta_calib.report import page as page_module
from suta_calib.report.document import Document, Figure, File, Text
from suta_calib.report.files import write_document
from suta_calib.report.listing import Column, Listing
from suta_calib.report.page import page_with, themed
from suta_calib.report.panels import separated
from suta_calib.report.svg import picture as picture_of
from suta_calib.report.svg import svg_text

SVG = '<svg xmlns="http://www.w3.org/2000/svg" id="{}"><path d="M0 0"/></svg>'
LANDMARKS = Listing[tuple[str, float]](
    "", Column("", "landmark", lambda row: row[0]), Column("", "mm", lambda row: row[1], form=".1f")
)


def picture(name: str) -> Figure:
    return Figure(lambda: SVG.format(name), "A picture")


SECTION = Document(
    "outliers",
    "Outliers",
    Assessment("care", "one of 15 landmarks", ("one <b>note</b>",)),
    [Text("a < b"), LANDMARKS.of([("S<2>", 1.2)]), picture("p")],
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


def test_a_list_of_contents_is_of_more_than_one() -> None:
    page = page_with(SECTION, None)
    assert '<nav class="contents"></nav>' in page
    page = page_with(replace(SECTION, name="study", title="Study: sizes"), page, "job.yaml")
    links = html.fromstring(page).xpath("//nav//a")
    assert [link.text for link in links] == ["Outliers", "Study"]
    assert [link.get("href") for link in links] == ["#outliers-top", "#study-top"]
    assert "job.yaml" in page.split('id="study"')[1]


def test_labels_to_paste_are_read_back_as_they_are() -> None:
    levels = {"landmarks": ["S2", "007", "yes", "a: b", "it's"], "rows": ["a.csv:12"]}
    written = yaml_text(levels, one_line=True)
    assert "\n" not in written
    assert yaml.safe_load(f"exclude: {written}") == {"exclude": levels}


def test_a_page_is_dated_by_what_it_is_of() -> None:
    """Of one answer alone by that answer's last run; of several by that of the first."""
    old = "2001-01-01 00:00 UTC"

    def aged(page: str) -> str:
        return re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", old, page)

    alone = aged(page_with(SECTION, None))
    assert old in alone
    assert old not in page_with(SECTION, alone)
    both = aged(page_with(replace(SECTION, name="study"), alone))
    assert old in page_with(SECTION, both)


def test_figures_are_as_wide_as_the_text_and_no_narrower_than_can_be_read() -> None:
    with picture_of("plot", (WIDTH, 2.0)) as figure:
        figure.subplots()
        root = etree.fromstring(svg_text(figure, "plot", "A plot").encode())
    limits = dict(part.split(":") for part in root.get("style", "").split(";"))
    widest, narrowest = (float(limits[f"{end}-width"].removesuffix("px")) for end in ("max", "min"))
    text = 62 * 15 - 2 * 1.25 * 15  # of the page's style: 62 rem less its padding, px
    assert widest >= text
    # Of nine points, px, as a narrow page enlarges them.
    style = (Path(page_module.__file__).parent / "templates" / "style.css").read_text(
        encoding="utf-8"
    )
    (enlarged,) = re.findall(r'svg\[data-wide\]:[^@]*?size: 9px"\] { font-size: ([0-9.]+)px', style)
    letters = float(enlarged) * narrowest / (72 * WIDTH)
    assert narrowest <= 500 - 2 * 0.8 * 15  # less its padding
    assert letters >= 9.5


def test_a_wide_figure_is_cut_between_its_panels_and_loses_nothing() -> None:
    """Two rows of a legend and two panels, and of one: a page has each alone, all in place."""
    with picture_of("plot", (1.3 * WIDTH, 4.0)) as figure:
        panels = figure.subplot_mosaic([["a", "b"], ["c", "c"]])
        for key, axes in panels.items():
            axes.plot([0, 1], label="a line")
            axes.set_title(f"panel {key}")
        figure.legend(*panels["a"].get_legend_handles_labels(), loc="outside upper left")
        drawn = svg_text(figure, "plot", "Three of <them>")
    (shown,) = html.fragments_fromstring(separated(drawn))
    assert (shown.get("id"), shown.get("aria-label")) == ("plot", "Three of <them>")
    rows = [row.findall("svg") for row in shown.findall("div")]
    assert [len(row) for row in rows] == [1, 2, 1]
    pieces = [piece for row in rows for piece in row]
    texts = ["".join(piece.itertext()) for piece in pieces]
    for words, at in (("a line", 0), ("panel a", 1), ("panel b", 2), ("panel c", 3)):
        assert [words in text for text in texts] == [k == at for k in range(4)]
    # Without a seam: every point of the figure in one part.
    boxes = np.array([[float(v) for v in piece.get("viewbox").split()] for piece in pieces])
    _, _, width, height = map(float, etree.fromstring(drawn.encode()).get("viewBox", "").split())
    assert (boxes[:, 2] * boxes[:, 3]).sum() == pytest.approx(width * height, rel=1e-3)
    assert boxes[1, :2] + [boxes[1, 2], 0.0] == pytest.approx(boxes[2, :2], abs=0.11)
    # What is referred to is there, once.
    ids = shown.xpath(".//@id")
    assert len(ids) == len(set(ids))
    assert set(re.findall(r"url\(#([^)]*)\)", separated(drawn))) <= set(ids)
    # One panel, or several below each other, are as they were.
    with picture_of("plot", (1.3 * WIDTH, 4.0)) as figure:
        figure.subplots(2, 1)
        single = svg_text(figure, "plot", "A plot")
    assert separated(single) == single


def test_a_table_says_how_wide_a_page_it_needs_and_names_its_cells_where_it_has_less() -> None:
    wide = Listing[tuple[str, float]](
        "",
        Column("", "parameter", lambda row: row[0]),
        *(Column("", f"a number {k}", lambda row: row[1], form=".3f") for k in range(6)),
    )
    answer = replace(SECTION, parts=[wide.of([("joint_1.x", 1.0)]), LANDMARKS.of([("S", 1.0)])])
    first, second = html.fromstring(page_with(answer, None)).findall(".//table")
    steps = [int(table.get("class").removeprefix("over-")) for table in (first, second)]
    assert steps[1] < 400 < steps[0] < 1000
    names, *numbers = first.findall(".//td")
    assert names.get("data-head") is None
    assert [cell.get("data-head") for cell in numbers] == [f"a number {k}" for k in range(6)]
    assert f"(max-width: {steps[0]}px) {{" in page_with(answer, None)


def test_figures_take_the_colours_of_the_page_unless_colours_are_numbers() -> None:
    with picture_of("plot", (WIDTH, 2.0)) as figure:
        axes = figure.subplots()
        axes.plot([0, 1], color=BLUE)
        plain = svg_text(figure, "plot", "A plot")
        axes.pcolormesh([[0.0, 0.5], [0.7, 1.0]])
        mapped = svg_text(figure, "plot", "A plot")
    style = page_with(SECTION, None).split("<style>")[1].split("</style>")[0]
    used = set(re.findall(r"var\(--([a-z]+)\)", themed(plain)))
    assert {"ink", "paper", "blue"} <= used
    assert all(style.count(f"--{name}: #") >= 2 for name in used)  # by day and by night
    assert not re.findall(r"#[0-9a-fA-F]{6}\b", themed(plain))
    assert themed(mapped) == mapped.replace("<svg ", '<svg data-mapped="" ', 1)
