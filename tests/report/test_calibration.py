"""A calibration on a console, on a page and in files."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from lxml import etree
from report_scenes import AWKWARD, console_text, with_accuracy

from suta_calib import units
from suta_calib.atomic import write_bytes_atomically
from suta_calib.errors import OutputError
from suta_calib.job.calibration import Calibration
from suta_calib.model.arm import ArmModel
from suta_calib.report import calibration_plots as plots
from suta_calib.report.calibration import _that_move, calibration_document
from suta_calib.report.console import rendered
from suta_calib.report.document import Document
from suta_calib.report.errors import by_kind, groups
from suta_calib.report.files import write_document
from suta_calib.report.observability import observability_document
from suta_calib.report.page import page_with
from suta_calib.report.spatial import WIDTH, projected
from suta_calib.trust.accuracy import gain_of
from suta_calib.trust.observability import observe
from suta_calib.words import combination, kept, listed


@cache
def document_of(result: Calibration) -> Document:
    """Its pictures are drawn once."""
    return calibration_document(result)


def told(result: Calibration, *, verbose: bool = False) -> str:
    return console_text(rendered(calibration_document(result), verbose=verbose))


def render_report(result: Calibration) -> str:
    return page_with(document_of(result), None)


def write_results(result: Calibration, folder: Path) -> dict[str, Path]:
    answer = write_document(document_of(result), folder)
    return {name: Path(path) for name, path in answer["files"].items()}


@pytest.fixture(scope="module")
def worse(result: Calibration) -> Calibration:
    """The calibrated arm is worse than the nominal one on held-out data."""
    term = result.accuracy.validation[0]
    swapped = [
        replace(b, residual_before=b.residual_after, residual_after=b.residual_before)
        for b in term.blocks
    ]
    terms = (replace(term, blocks=tuple(swapped)),)
    accuracy = replace(result.accuracy, validation=terms, gain=gain_of(terms))
    return with_accuracy(result, accuracy)


@pytest.fixture(scope="module")
def page(result: Calibration) -> str:
    return render_report(result)


class References(HTMLParser):
    """Collects everything a browser would fetch, run or jump to."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: list[str] = []
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attrs:
            if key in ("src", "href", "xlink:href", "data", "action"):
                self.found.append(value or "")
            if key == "id":
                self.ids.append(value or "")


def references(page: str) -> References:
    parser = References()
    parser.feed(page)
    return parser


def test_verdict_is_not_troubled_by_conventions(
    result: Calibration, unconverged: Calibration
) -> None:
    """Where an instrument stands anywhere, the first joint's offset is a convention."""
    assert result.assessment.level == "good"
    (note,) = result.assessment.notes
    assert "The instrument carries the scale" in note
    assert result.solution.unidentified == ("joint_1.offset",)
    assert "“redundant”: harmless" in render_report(result)
    assert unconverged.assessment.level == "bad"


def test_verdict_warns_of_a_calibration_that_made_it_worse(
    result: Calibration, worse: Calibration
) -> None:
    assert "worse" in " ".join(worse.assessment.notes)
    assert not worse.assessment.usable
    assert "worse" not in " ".join(result.assessment.notes)


@pytest.mark.parametrize(
    ("value", "unit", "sign", "wanted"),
    [
        (0.0012345, "m", False, "1.234"),
        (-1e-9, "m", True, "0.000"),
        (1e-9, "rad", True, "0.0000"),
        (math.radians(-1.5), "rad", True, "-1.5000"),
        (0.001, "m", True, "+1.000"),
        (math.nan, "m", False, units.NOTHING),
        (None, "rad", False, units.NOTHING),
    ],
)
def test_numbers_are_shown_in_mm_and_degrees(
    value: float | None, unit: units.Unit, sign: bool, wanted: str
) -> None:
    assert units.text(value, unit, sign=sign) == wanted


def test_combinations_read_as_sums() -> None:
    assert combination({"a.z": 1.0, "b.z": -1.0}) == "a.z − b.z"
    assert combination({"a.z": -2.5, "b.z": 1.0}, "b.z") == "b.z − 2.5·a.z"
    assert combination({"a.z": 0.13612, "b.z": 1.0}, "b.z") == "b.z + 0.14·a.z"
    assert combination({"a.z": 123.4, "b.z": 1.0}, "b.z") == "b.z + 123·a.z"
    assert units.percent(4.0, 1.0) == "75.0 %"
    assert units.percent(0.0, 1.0) == units.NOTHING


def test_what_an_estimate_is_relative_to_is_said_in_words() -> None:
    assert kept([]) == ""
    assert kept(["a.z"]) == "a.z keeps its nominal value"
    assert kept(["a.z", "b.z"]) == "a.z and b.z keep their nominal values"
    assert kept(list("abcde")) == "a, b, c and 2 more keep their nominal values"


def test_factors_that_do_nothing_at_the_tip_are_left_out(result: Calibration) -> None:
    direction = {"joint_4.offset": 1.0, "joint_4.z": 0.1, "tip.y": 1e-5, "tip.z": -1e-3}
    left = _that_move(result.solution, direction)
    assert list(left) == ["joint_4.offset", "joint_4.z"]


def test_names_are_listed_and_the_rest_counted() -> None:
    assert listed(["a", "b"]) == "a, b"
    assert listed(["a", "b", "c"], 2) == "a, b and 1 more"


# console


def test_console_says_the_verdict_first_and_all_with_verbose(result: Calibration) -> None:
    short, full = told(result), told(result, verbose=True)
    for text in (short, full):
        assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
        assert text.startswith("Good. Converged")
        assert "RMS on 15 validation positions" in "".join(text.splitlines()[:3])
        assert "Largest changes" in text
    assert len(short.splitlines()) <= 32
    assert "--verbose shows" in short
    for detail in ("improvement", "base[rig].x", "within 68 %"):
        assert (detail in full, detail in short) == (True, False)
    row = next(line for line in full.splitlines() if "joint_4.z  " in line)
    assert "571.000" in row
    assert "identified" in row


def test_console_of_an_unconverged_run_shows_no_values(unconverged: Calibration) -> None:
    text = told(unconverged)
    assert "Do not use" in text
    assert "not converged" in text
    assert "joint_4.z" not in text


def test_console_shows_what_can_be_determined(result: Calibration) -> None:
    observability = observe(result.solution.problem)
    text = console_text(rendered(observability_document(observability)))
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
    row = next(line for line in text.splitlines() if "joint_1.offset" in line)
    assert "redundant" in row
    assert observability.sentence in " ".join(text.split())


# plots and page


def test_plots_are_svg_with_units(result: Calibration) -> None:
    errors = by_kind(result.accuracy.validation)[0]
    found = [
        plots.histogram_svg(errors.before, errors.after, errors.unit, errors.name, "h"),
        plots.groups_svg(groups(result.accuracy.calibration, "point"), "point", "g"),
        plots.changes_svg(result.solution.changes, "c"),
        plots.singular_values_svg(np.array([1e3, 1.0, 0.0]), 10.0, ["a.z − b.z"], "s"),
        plots.correlations_svg(["a", AWKWARD], np.array([[1.0, -0.9], [-0.9, 1.0]]), "m"),
    ]
    units_shown = ["mm", "mm", "deg", "no unit", "no unit"]
    for svg, unit in zip(found, units_shown, strict=True):
        root = etree.fromstring(svg)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert unit in "".join(root.itertext())
    assert AWKWARD in "".join(etree.fromstring(found[1]).itertext())


@pytest.mark.parametrize("after", [[0.0], [0.0, 0.0, 0.0], [1e-12, 5e-3], [1e-3] * 5])
def test_histogram_of_extreme_errors(result: Calibration, after: list[float]) -> None:
    errors = by_kind(result.accuracy.validation)[0]
    extreme = np.array(after)
    svg = plots.histogram_svg(3 * extreme, extreme, errors.unit, errors.name, "extreme")
    etree.fromstring(svg)


def test_plots_leave_matplotlib_as_it_was(page: str) -> None:
    assert mpl.rcParams["svg.fonttype"] != "none"


def test_page_stands_alone(page: str) -> None:
    seen = references(page)
    assert seen.found
    assert [r for r in seen.found if not r.startswith("#")] == []
    assert not {"link", "img", "iframe", "object"} & set(seen.tags)
    # One saves figures, one turns the arm.
    assert seen.tags.count("script") == 2
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", page)
    assert len(page.encode()) < 1_000_000
    assert not re.search(r"url\((?!['\"]?#)", page)
    assert "@import" not in page
    assert len(seen.ids) == len(set(seen.ids))
    assert {r[1:] for r in seen.found} <= set(seen.ids)


def test_page_says_what_matters_and_escapes_the_rest(page: str, result: Calibration) -> None:
    assert "joint_1.offset" in page
    assert result.solution.sentence[1:] in page
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert AWKWARD not in page
    assert "&lt;b&gt;" in page


def test_page_of_an_unconverged_run_shows_no_values(unconverged: Calibration) -> None:
    page = render_report(unconverged)
    assert "Do not use" in page
    assert "Change from nominal" not in page


# files

BESIDE = {"result.json", "residuals.csv", "inputs.zip", "report.html"}


def test_results_are_written_and_the_urdf_is_the_solution(
    result: Calibration, tmp_path: Path
) -> None:
    files = write_results(result, tmp_path / "a" / "results")
    assert set(files) == {"calibrated.urdf", *BESIDE}
    assert {p.name for p in (tmp_path / "a" / "results").iterdir()} == set(files)
    calibrated = ArmModel.from_urdf(files["calibrated.urdf"], "tip")
    q = np.random.default_rng(4).uniform(-1, 1, (5, 6))
    wanted = result.job.arm.forward(q, result.solution.values)
    for one, other in zip(calibrated.forward(q), wanted, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    assert json.loads(files["result.json"].read_text("utf-8"))["status"] == "converged"


def test_an_unconverged_run_writes_no_urdf_and_removes_nothing(
    unconverged: Calibration, tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    files = write_results(unconverged, tmp_path)
    assert set(files) == {"result.json", "report.html"}
    assert {p.name for p in tmp_path.iterdir()} == {*files, "mine.txt"}


def test_the_urdf_of_a_calibration_that_made_it_worse_has_another_name(
    worse: Calibration, tmp_path: Path
) -> None:
    files = write_results(worse, tmp_path)
    assert set(files) == {"not_usable.urdf", *BESIDE}
    assert not json.loads(files["result.json"].read_text("utf-8"))["verdict"]["usable"]
    assert "The result is in not_usable.urdf" in " ".join(told(worse).split())
    assert "No calibrated.urdf" in files["report.html"].read_text("utf-8")


def test_a_folder_that_cannot_be_used_is_one_clear_error(
    result: Calibration, tmp_path: Path
) -> None:
    taken = tmp_path / "results"
    taken.write_text("a file")
    with pytest.raises(OutputError, match="results"):
        write_results(result, taken)
    with pytest.raises(OutputError, match="results"):
        write_results(result, taken / "deeper")
    assert taken.read_text() == "a file"


def test_a_failing_write_leaves_the_old_file(
    result: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "report.html"
    target.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        write_bytes_atomically(target, render_report(result).encode())
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


# the first screen


def test_the_page_begins_with_what_came_out(page: str, result: Calibration) -> None:
    tree = etree.HTML(page)
    (headline,) = tree.xpath("//p[@class='headline']")
    assert headline.text == result.headline
    order = [tree.xpath(f"count({path}/preceding::*)") for path in FIRST_SCREEN]
    assert order == sorted(order)
    contents = [link.get("href")[1:] for link in tree.xpath("//nav//a")]
    assert contents == [heading.get("id") for heading in tree.xpath("//h2")]
    assert "Parameters" in tree.xpath("//nav//a/text()")
    about = {row[0].text: row[1].text for row in tree.xpath("//section//table[1]//tr[count(td)=2]")}
    assert result.job.arm.chain.path.name in about["arm"]
    assert str(len(result.job.observations[0].poses)) in about["fitted"]
    assert "suta_calib" in about["made with"]


FIRST_SCREEN = (
    "//h1",
    "//nav",
    "//p[@class='headline']",
    "//div[contains(@class, 'verdict')]",
    "//figure[@class='scene']",
    "//td[text()='arm']",
    "//h2[text()='Errors']",
)


def test_what_is_held_stands_once_with_its_reason(page: str, result: Calibration) -> None:
    tree = etree.HTML(page)
    (row,) = tree.xpath("//main//tr[td[1]='joint_1.offset']")
    name, nominal, unit, state, why = ("".join(cell.itertext()) for cell in row)
    assert (name, nominal, unit, state) == ("joint_1.offset", "0.0000", "deg", "redundant")
    assert why.startswith("turns the whole arm about the base's z axis")
    (row,) = tree.xpath("//main//tr[td[1]='joint_5.z']")
    assert "".join(row[-1].itertext()) == "fixed in the job"
    (table,) = tree.xpath("//h2[text()='Parameters']/following-sibling::div[1]//table")
    names = table.xpath(".//tbody/tr/td[1]/text()")
    assert "joint_1.offset" not in names
    assert set(names) < set(result.job.parameters)


def test_the_scene_on_the_page_is_what_was_computed(page: str, result: Calibration) -> None:
    """What the script turns is in mm, and the still picture is its projection."""
    (told,) = re.findall(r'turnable\(.*?"scene"\), (\{.*\})\);', page)
    scene = json.loads(told)
    parts = result.scene().parts
    drawn = scene["parts"][-len(parts) :]
    for part, record in zip(parts, drawn, strict=True):
        if "axes" in part.look:
            continue
        np.testing.assert_allclose(np.array(record["p"]), units.mm(part.points), atol=0.051)
    middle, scale = np.array(scene["middle"]), scene["scale"]
    paths = etree.HTML(page).xpath("//figure[@class='scene']/svg/g/path/@d")
    assert len(paths) == len(scene["parts"])
    links = next(k for k, part in enumerate(parts) if part.look == "links")
    numbers = np.array(re.findall(r"-?[\d.]+", paths[-len(parts) :][links]), dtype=float)
    wanted = projected(np.array(drawn[links]["p"]) - middle, scale)
    np.testing.assert_allclose(numbers.reshape(-1, 2), wanted, atol=0.11)
    assert np.abs(numbers.reshape(-1, 2)[:, 0]).max() <= WIDTH / 2
