from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from lxml import etree
from rich.console import Console, RenderableType

from suta_calib.analysis.observability import observe
from suta_calib.errors import OutputError
from suta_calib.job import CalibrationJob, CalibrationResult
from suta_calib.model.arm import ArmModel
from suta_calib.report import plots, tables, units
from suta_calib.report.errors_by import by_kind, groups
from suta_calib.report.histogram import error_histogram
from suta_calib.report.html import render_report, write_report
from suta_calib.report.residuals import COLUMNS, residuals_csv
from suta_calib.report.result_json import accuracy_dict, result_dict
from suta_calib.report.verdict import judge
from suta_calib.report.write import write_results

TRUTH = {"joint_4.offset": 0.02, "joint_4.z": 0.5730, "tip.z": 0.0015}
NOISE = 2e-4
# A label no file name, page, plot or terminal may take for anything but text.
AWKWARD = "<b>&'$x$[red]"
JOB = """\
arm: {{urdf: {urdf}, tip: tip}}   # <script>alert(1)</script>
parameters:
  - {{select: ["joint_*.offset"], bound_deg: 15}}
  - {{select: [joint_4.z, tip.y, tip.z], bound_mm: 30}}
  - {{select: [joint_6.z], prior_mm: 0.001}}
  - {{select: [joint_5.z], fixed: true}}
observations:
  - {{kind: tracked_point, samples: calibration.csv, sigma_mm: 0.2, label: "{label}"}}
  - {{kind: fixed_point, samples: fixed.csv}}
validation:
  - {{kind: tracked_point, samples: validation.csv, label: "{label}"}}
solver: {{starts: 2, seed: 0, max_iterations: {iterations}}}
"""


def write_csv(path: Path, header: list[str], rows: list[list[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])


def tracked_samples(arm: ArmModel, path: Path, count: int, seed: int) -> None:
    """Simulated: random readings, seen by an instrument that stands elsewhere and looks turned."""
    random = np.random.default_rng(seed)
    q = random.uniform(-1.2, 1.2, (count, len(arm.joints)))
    _, position = arm.forward(q, TRUTH)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    seen = position @ turn.T + [0.3, -0.2, 0.1] + random.normal(0, NOISE, position.shape)
    rows = [[*r, *s] for r, s in zip(q.tolist(), seen.tolist(), strict=True)]
    write_csv(path, [*arm.joints, "x", "y", "z"], rows)


def fixed_samples(arm: ArmModel, path: Path) -> None:
    """Simulated: the same reading again and again with encoder noise, at two points."""
    random = np.random.default_rng(9)
    rows: list[list[object]] = []
    for point in (AWKWARD, "F2"):
        q = random.uniform(-1, 1, len(arm.joints))
        for _ in range(6):
            rows.append([*(q + random.normal(0, 1e-4, len(q))).tolist(), point])
    write_csv(path, [*arm.joints, "point"], rows)


def make_job(folder: Path, urdf: Path, iterations: int = 200) -> CalibrationJob:
    arm = ArmModel.from_urdf(urdf, "tip")
    tracked_samples(arm, folder / "calibration.csv", 40, 1)
    tracked_samples(arm, folder / "validation.csv", 15, 2)
    fixed_samples(arm, folder / "fixed.csv")
    job = folder / "calibration.yaml"
    text = JOB.format(urdf=urdf, label="rig", iterations=iterations)
    job.write_text(text, encoding="utf-8")
    return CalibrationJob.load(job)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> CalibrationResult:
    return make_job(tmp_path_factory.mktemp("job"), suta_urdf).run()


@pytest.fixture(scope="module")
def unconverged(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> CalibrationResult:
    found = make_job(tmp_path_factory.mktemp("job"), suta_urdf, iterations=1).run()
    assert not found.solution.converged
    return found


@pytest.fixture(scope="module")
def page(result: CalibrationResult) -> str:
    return render_report(result)


def console_text(shown: RenderableType) -> str:
    console = Console(width=100, file=io.StringIO(), color_system=None)
    console.print(shown)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


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


# result.json


def test_json_has_what_the_format_promises(result: CalibrationResult) -> None:
    content = json.loads(json.dumps(result_dict(result), allow_nan=False))
    assert content["status"] == "converged"
    assert content["verdict"] == result.solution.verdict
    assert content["job"] == "calibration.yaml"
    assert {"build", "solve"} <= set(content["timing_s"])
    assert {"suta_calib", "pin", "casadi", "numpy", "python"} <= set(content["versions"])
    for part in content["metrics"].values():
        for state in ("before", "after"):
            assert set(part[state]) == {"rms_mm", "mean_mm", "std_mm", "max_mm", "count"}
    kinds = [row["kind"] for row in content["metrics"]["calibration"]["by_term"]]
    assert kinds == ["tracked_point", "fixed_point"]
    assert content["metrics"]["calibration"]["by_term"][0]["label"] == "rig"
    assert len(content["solver"]["starts"]) == 2
    assert [n["given"] for n in content["noise"]] == [True, False]


def test_json_values_are_the_solution_in_si(result: CalibrationResult) -> None:
    content = result_dict(result)["parameters"]
    assert list(content) == list(result.solution.problem.names)
    for name, estimate in result.solution.estimates.items():
        assert content[name]["value"] == estimate.value
        assert content[name]["std"] == estimate.std
        assert content[name].get("given", []) == list(estimate.given)
    z = content["joint_4.z"]
    assert (z["unit"], z["nominal"], z["state"]) == ("m", 0.571, "identified")
    assert abs(z["value"] - TRUTH["joint_4.z"]) < 4 * z["std"]
    assert z["bounds"] == pytest.approx([0.541, 0.601])
    assert content["joint_6.z"]["prior"] == pytest.approx(1e-6)


def test_json_states_follow_the_rules(result: CalibrationResult) -> None:
    content = result_dict(result)
    parameters = content["parameters"]
    assert parameters["joint_6.z"]["state"] == "prior"
    assert parameters["joint_5.z"]["state"] == "fixed"
    # The unknown pose of the instrument makes up for a turn of the first joint.
    assert "joint_1.offset" in content["unidentified"]
    for name, p in parameters.items():
        assert (p["std"] is not None) == (p["state"] in ("identified", "prior")), name
        assert (name in content["unidentified"]) == (p["state"] == "unidentified")
        if p["state"] in ("unidentified", "fixed"):
            assert p["value"] == p["nominal"]


def test_json_metrics_are_those_of_the_first_kind_in_mm(result: CalibrationResult) -> None:
    errors = result.accuracy.validation[0].blocks[0].after
    after = result_dict(result)["metrics"]["validation"]["after"]
    assert after["rms_mm"] == pytest.approx(1e3 * math.sqrt(np.mean(errors**2)))
    assert after["max_mm"] == pytest.approx(1e3 * errors.max())
    assert after["count"] == 15
    # Noise of 0.2 mm per axis, and the truth within reach.
    assert 0.2 < after["rms_mm"] < 0.6


def test_json_adds_one_figure_for_orientations(result: CalibrationResult) -> None:
    term = result.accuracy.validation[0]
    turned = np.full((3, 1), math.radians(2.0))
    rotation = replace(
        term.blocks[0],
        name="rotation",
        unit="rad",
        labels=("a", "b", "c"),
        rows=np.arange(3)[:, None],
        residual_before=turned,
        residual_after=turned / 4,
    )
    found = accuracy_dict([replace(term, blocks=(*term.blocks, rotation))])
    assert found["before"]["rms_deg"] == pytest.approx(2.0)
    assert found["after"]["rms_deg"] == pytest.approx(0.5)
    assert found["after"]["count"] == 15
    assert set(found["after"]) == {"rms_mm", "mean_mm", "std_mm", "max_mm", "count", "rms_deg"}


def test_json_lists_only_real_combinations(result: CalibrationResult) -> None:
    for direction in result_dict(result)["unobservable"]:
        assert len(direction) >= 2
        assert set(direction) <= set(result.solution.problem.names)


def test_json_correlations_are_of_the_estimated_arm_parameters(result: CalibrationResult) -> None:
    found = result_dict(result)["correlations"]
    matrix = np.array(found["matrix"])
    states = {n: result.solution.estimates[n].state for n in found["parameters"]}
    assert not [n for n in states if n.startswith(("base", "fixed_point"))]
    assert set(states.values()) <= {"identified", "prior"}
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    np.testing.assert_allclose(matrix, matrix.T)


def test_unconverged_json_carries_no_values(unconverged: CalibrationResult) -> None:
    content = json.loads(json.dumps(result_dict(unconverged), allow_nan=False))
    assert content["status"] == "not_converged"
    for p in content["parameters"].values():
        assert (p["value"], p["std"], p["state"]) == (None, None, "not_converged")
    for part in content["metrics"].values():
        assert part["before"]["rms_mm"] > 0
        assert part["after"]["rms_mm"] is None


def test_json_without_validation_has_nulls_not_nan(result: CalibrationResult) -> None:
    job = replace(result.job, spec=replace(result.job.spec, validation=()))
    alone = replace(result, job=job, accuracy=replace(result.accuracy, validation=()))
    part = json.loads(json.dumps(result_dict(alone), allow_nan=False))["metrics"]["validation"]
    assert part["after"] == {
        **dict.fromkeys(("rms_mm", "mean_mm", "std_mm", "max_mm")),
        "count": 0,
    }
    assert "no validation data" in " ".join(judge(alone).notes)
    assert "no such data" in console_text(tables.accuracy_table(alone.accuracy))
    render_report(alone)


# residuals.csv


def test_residuals_are_all_there_and_add_up(result: CalibrationResult) -> None:
    rows = list(csv.DictReader(io.StringIO(residuals_csv(result))))
    assert len(rows) == 40 + 12 + 15
    assert list(rows[0]) == list(COLUMNS)
    assert rows[0]["samples"].endswith("calibration.csv:2")
    assert {r["label"] for r in rows if r["kind"] == "tracked_point"} == {"rig"}
    assert AWKWARD in {r["what"] for r in rows}
    held_out = [float(r["error_after"]) for r in rows if r["set"] == "validation"]
    wanted = 1e3 * result.accuracy.validation[0].blocks[0].after
    np.testing.assert_allclose(held_out, wanted, rtol=1e-5)
    for row in rows:
        components = [float(row[f"c{k}_after"]) for k in (1, 2, 3)]
        assert math.hypot(*components) == pytest.approx(float(row["error_after"]), rel=1e-4)


# grouping and judging


def test_errors_are_grouped_by_label(result: CalibrationResult) -> None:
    found = groups(result.accuracy.calibration, "point")
    assert {name: len(e) for name, e in found.items()} == {AWKWARD: 6, "F2": 6}
    assert set(groups(result.accuracy.validation, "file")) == {"validation.csv"}
    assert [e.kind for e in by_kind(result.accuracy.calibration)] == [
        "tracked_point",
        "fixed_point",
    ]


def test_verdict_names_what_must_be_known(
    result: CalibrationResult, unconverged: CalibrationResult
) -> None:
    careful = judge(result)
    assert careful.level == "caution"
    assert "joint_1.offset" in " ".join(careful.notes)
    assert judge(unconverged).level == "bad"


def test_verdict_warns_of_a_calibration_that_made_it_worse(result: CalibrationResult) -> None:
    term = result.accuracy.validation[0]
    swapped = [
        replace(b, residual_before=b.residual_after, residual_after=b.residual_before)
        for b in term.blocks
    ]
    worse = replace(result.accuracy, validation=(replace(term, blocks=tuple(swapped)),))
    assert "worse" in " ".join(judge(replace(result, accuracy=worse)).notes)
    assert "worse" not in " ".join(judge(result).notes)


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
    assert units.combination({"a.z": 1.0, "b.z": -1.0}) == "a.z − b.z"
    assert units.combination({"a.z": -2.5, "b.z": 1.0}, "b.z") == "b.z − 2.5·a.z"
    assert units.percent(4.0, 1.0) == "75.0 %"
    assert units.percent(0.0, 1.0) == units.NOTHING


# console


def test_console_fits_100_columns_and_shows_names_as_they_are(result: CalibrationResult) -> None:
    short = console_text(tables.summary(result))
    full = console_text(tables.summary(result, verbose=True))
    for text in (short, full):
        assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
        assert "joint_4.z" in text
        assert "improvement" in text
    assert "base[rig].x" in full
    assert "base[rig].x" not in short
    assert "--verbose" in short
    assert "--verbose" not in full
    row = next(line for line in short.splitlines() if "joint_4.z" in line)
    assert "571.000" in row
    assert "identified" in row


def test_console_of_an_unconverged_run_shows_no_values(unconverged: CalibrationResult) -> None:
    text = console_text(tables.summary(unconverged))
    assert "Do not use" in text
    assert "not converged" in text
    assert "joint_4.z" not in text


def test_console_shows_what_can_be_determined(result: CalibrationResult) -> None:
    observability = observe(result.solution.problem)
    text = console_text(tables.observability_table(observability))
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
    row = next(line for line in text.splitlines() if "joint_1.offset" in line)
    assert "unidentified" in row
    assert observability.verdict in console_text(tables.observability_words(observability))


# plots and page


def test_plots_are_svg_with_units(result: CalibrationResult) -> None:
    errors = by_kind(result.accuracy.validation)[0]
    estimated = [e for e in result.solution.estimates.values() if e.std]
    found = [
        error_histogram(errors, "h"),
        plots.grouped_errors(groups(result.accuracy.calibration, "point"), "point", "g"),
        plots.parameter_changes(estimated, "c"),
        plots.singular_values(np.array([1e3, 1.0, 0.0]), ["a.z − b.z"], "s"),
        plots.correlation_map(["a", AWKWARD], np.array([[1.0, -0.9], [-0.9, 1.0]]), "m"),
    ]
    units_shown = ["mm", "mm", "deg", "dimensionless", "dimensionless"]
    for svg, unit in zip(found, units_shown, strict=True):
        root = etree.fromstring(svg)
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert unit in "".join(root.itertext())
    assert AWKWARD in "".join(etree.fromstring(found[1]).itertext())


@pytest.mark.parametrize("after", [[0.0], [0.0, 0.0, 0.0], [1e-12, 5e-3], [1e-3] * 5])
def test_histogram_of_extreme_errors(result: CalibrationResult, after: list[float]) -> None:
    errors = by_kind(result.accuracy.validation)[0]
    extreme = replace(errors, before=np.array(after) * 3, after=np.array(after))
    etree.fromstring(error_histogram(extreme, "extreme"))


def test_plots_leave_matplotlib_as_it_was(page: str) -> None:
    assert mpl.rcParams["svg.fonttype"] != "none"


def test_page_stands_alone(page: str) -> None:
    seen = references(page)
    assert seen.found
    assert [r for r in seen.found if not r.startswith("#")] == []
    assert not {"script", "link", "img", "iframe", "object"} & set(seen.tags)
    assert not re.search(r"url\((?!['\"]?#)", page)
    assert "@import" not in page
    assert len(seen.ids) == len(set(seen.ids))
    assert {r[1:] for r in seen.found} <= set(seen.ids)


def test_page_says_what_matters_and_escapes_the_rest(page: str, result: CalibrationResult) -> None:
    assert "joint_1.offset" in page
    assert result.solution.verdict[1:] in page
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert AWKWARD not in page
    assert "&lt;b&gt;" in page


def test_page_of_an_unconverged_run_shows_no_values(unconverged: CalibrationResult) -> None:
    page = render_report(unconverged)
    assert "Do not use" in page
    assert "Change from nominal" not in page


# files


def test_results_are_written_and_the_urdf_is_the_solution(
    result: CalibrationResult, tmp_path: Path
) -> None:
    files = write_results(result, tmp_path / "a" / "results")
    assert set(files) == {"calibrated.urdf", "result.json", "residuals.csv", "report.html"}
    assert {p.name for p in (tmp_path / "a" / "results").iterdir()} == set(files)
    calibrated = ArmModel.from_urdf(files["calibrated.urdf"], "tip")
    q = np.random.default_rng(4).uniform(-1, 1, (5, 6))
    wanted = result.job.arm.forward(q, result.solution.values)
    for one, other in zip(calibrated.forward(q), wanted, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    assert json.loads(files["result.json"].read_text("utf-8"))["status"] == "converged"


def test_an_unconverged_run_writes_no_urdf_and_removes_nothing(
    unconverged: CalibrationResult, tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    files = write_results(unconverged, tmp_path)
    assert set(files) == {"result.json", "report.html"}
    assert {p.name for p in tmp_path.iterdir()} == {*files, "mine.txt"}


def test_a_folder_that_cannot_be_used_is_one_clear_error(
    result: CalibrationResult, tmp_path: Path
) -> None:
    taken = tmp_path / "results"
    taken.write_text("a file")
    with pytest.raises(OutputError, match="results"):
        write_results(result, taken)
    with pytest.raises(OutputError, match="results"):
        write_results(result, taken / "deeper")
    assert taken.read_text() == "a file"


def test_a_failing_write_leaves_the_old_file(
    result: CalibrationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "report.html"
    target.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        write_report(result, target)
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
