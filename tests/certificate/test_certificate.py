"""Certificates: every figure is the answer's, on paper and as JSON; what is missing is said."""

from __future__ import annotations

import io
import json
import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import yaml
from cli_job import answer, cli, printed, refused
from hypothesis import given
from hypothesis import strategies as st
from pypdf import PdfReader

from suta_calib.certificate import (
    Certificate,
    CertifiedValue,
    Decision,
    certificate_of,
    dcc_record,
    pdf_bytes,
    read_details,
)
from suta_calib.certificate.answer import known_answers
from suta_calib.certificate.details import EXAMPLE, details_to_fill_in
from suta_calib.certificate.issued import RECORDS, facts_of
from suta_calib.certificate.lengths import LengthUncertainty, stated_uncertainty
from suta_calib.errors import InputError, UnusableResultError
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.trust.uncertainty_budget import COVERAGE

# What each command is given, and the JSON that it writes.
COMMANDS = {
    "calibrate": ("examples/so101_printed_sheet/calibration.yaml", "--out"),
    "pivot": ("data/poses/pivot.csv", "--out"),
    "hand-eye": ("data/poses/hand_eye.csv", "--out"),
    "register": ("data/poses/register_a.csv", "data/poses/register_b.csv", "--out"),
    "iso10360": ("data/accuracy/iso10360.yaml", "--out"),
    "repeatability": (
        *("data/accuracy/visits.csv", "--urdf", "urdf/suta.urdf", "--tip", "tip"),
        "--out",
    ),
    "certify": (
        *("data/artefact/points.csv", "--nominal", "data/suta/artefact.yaml"),
        "--report",
    ),
    "detect": (
        *(f"data/workcell/pictures/{k:02d}.jpg" for k in range(8)),
        *("--board", "data/workcell/board.yaml"),
        "--report",
    ),
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Callable[[str], Path]:
    """The folder of results of a command, computed once."""
    folder, made = tmp_path_factory.mktemp("answers"), dict[str, Path]()

    def of(command: str) -> Path:
        if command not in made:
            words = [
                str(repository / word) if (repository / word).exists() else word
                for word in COMMANDS[command]
            ]
            made[command] = folder / command
            assert cli(command, *words, made[command]) == 0
        return made[command]

    return of


@pytest.fixture
def details(tmp_path: Path) -> Path:
    path = tmp_path / "details.yaml"
    path.write_text(EXAMPLE.replace("limits: {validation_rms_mm: 0.5}\n", ""), encoding="utf-8")
    return path


def paper_of(pdf: bytes) -> str:
    return "\n".join(page.extract_text() for page in PdfReader(io.BytesIO(pdf)).pages)


def figures_elsewhere(certificate: Certificate, words: str, answer: Any) -> list[str]:
    """Figures in the tables of a paper that are no number of an answer, rounded as printed.

    U is k times a standard uncertainty; the angles of a pose are those of its matrix.
    """
    numbers, poses = list[float](), list[Any]()

    def collect(part: Any) -> None:
        if isinstance(part, dict):
            for name, one in part.items():
                collect(one)
                if name.endswith("_interval_mm"):
                    # U is the way to its farther end.
                    value = part[name.replace("_interval", "")]
                    numbers.extend(abs(end - value) for end in one)
        elif isinstance(part, list):
            if len(part) == 4 and all(isinstance(row, list) and len(row) == 4 for row in part):
                poses.append(np.asarray(part, dtype=float))
            for one in part:
                collect(one)
        elif isinstance(part, int | float):
            numbers.append(float(part))

    collect(answer)
    for pose in poses:
        numbers += [*np.degrees(rpy_from_rotation(pose[:3, :3])), *(1e3 * pose[:3, 3])]
    # Parameters are in SI there, and scales in parts of a million.
    known = np.array([f * n for n in numbers for f in (1.0, 1e3, math.degrees(1.0), 1e-4)])
    factors = {one.factor for g in certificate.content.groups for one in g.quantities}
    factors |= {budget.factor for budget in certificate.content.budgets} | {1.0}
    # A half interval, and how well so many rows tell a root mean square.
    found = np.unique(np.outer([*factors, *(2.0 * f for f in factors)], known))
    budgeted = certificate.content.budgets
    derived = [1e3 * b.freedom for b in budgeted] + [b.freedom for b in budgeted]
    derived += [b.combined.freedom for b in budgeted]
    derived += [b.factor for b in budgeted] + [*factors, 100.0 * COVERAGE]
    for one in certificate.content.judged.values():
        derived += [per * (one.expanded or 0.0) for per in (1.0, 1e3, math.degrees(1.0))]
    found = np.concatenate([found, np.array(derived)])
    begin = words.index("\nResults\n")
    return [
        figure
        for figure in re.findall(
            r"(?<![\w.,])-?\d+\.\d+(?![\w.])", words[begin : words.index("\nNotes\n")]
        )
        if not (
            abs(abs(found) - abs(float(figure))) <= 0.51 * 10.0 ** -len(figure.split(".")[1])
        ).any()
    ]


def test_every_kind_of_answer_is_tried() -> None:
    # Of cameras on one body and of further eyes: test_eyes_on_paper.
    assert {*COMMANDS, "rig"} == set(known_answers())


@pytest.mark.parametrize("command", COMMANDS)
def test_paper_and_json_say_what_the_answer_says(
    command: str, answers: Callable[[str], Path], details: Path
) -> None:
    certificate = certificate_of(answers(command), read_details(details))
    record, words = dcc_record(certificate), paper_of(pdf_bytes(certificate))
    json.dumps(record, allow_nan=False)
    for group in certificate.content.groups:
        assert group.quantities
        assert " ".join(group.title.split()) in " ".join(words.split())
    (said,) = record["measurementResults"]["measurementResult"]
    assert len(said["results"]["result"]) == len(certificate.content.groups)
    # Of every reference the uncertainty is stated, or that it is stated nowhere.
    assert certificate.content.references
    for reference in certificate.content.references:
        assert " ".join(reference.sentence.split()) in " ".join(words.split())
    # Every figure of the results is in the answer's own JSON.
    answer = json.loads((certificate.result).read_text(encoding="utf-8"))
    assert figures_elsewhere(certificate, words, answer) == []
    assert len(figures_elsewhere(certificate, words, {"numbers": [0.123456]})) > 5
    for part in ("Measurand", "Method", "Conditions", "Reference standards", "Results"):
        assert part in words
    for part in ("Uncertainty", "Software and data", "Signatures", "page 1 of"):
        assert part.lower() in words.lower()
    for digest in certificate.inputs.values():
        assert digest in words
    # Nothing is lost for a font that lacks a sign.
    assert "\ufffd" not in words


def test_the_figures_of_a_calibration_are_those_of_its_result(
    answers: Callable[[str], Path],
) -> None:
    folder = answers("calibrate")
    result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    certificate = certificate_of(folder)
    quantities = {q.name: q for g in certificate.content.groups for q in g.quantities}
    estimated = {n: p for n, p in result["parameters"].items() if p["std"] is not None}
    assert estimated
    for name, parameter in estimated.items():
        if name in quantities:
            assert quantities[name].value == parameter["value"]
            assert quantities[name].std == parameter["std"]
    (budget,) = result["uncertainty"]
    assert certificate.content.budgets[0].expanded * 1e3 == pytest.approx(budget["expanded_mm"])
    squares = sum(part["std_mm"] ** 2 for part in budget["contributions"])
    assert math.sqrt(squares) == pytest.approx(budget["std_mm"])
    rms = result["metrics"]["validation"]["after"]["rms_mm"]
    assert certificate.content.judged["validation_rms_mm"].value * 1e3 == pytest.approx(rms)
    count = result["metrics"]["validation"]["after"]["count"]
    freedom = min(part["freedom"] or math.inf for part in budget["contributions"])
    std = certificate.content.judged["validation_rms_mm"].std
    assert std is not None
    assert std * 1e3 == pytest.approx(rms / math.sqrt(2.0 * min(count, freedom)))
    words = paper_of(pdf_bytes(certificate))
    assert f"{rms:.3f} mm" in words


def test_the_parts_of_a_pivot_s_budget_give_its_std(answers: Callable[[str], Path]) -> None:
    result = json.loads((answers("pivot") / "result.json").read_text(encoding="utf-8"))
    (budget,) = result["uncertainty"]
    tip = math.sqrt(sum(std**2 for std in result["tip_std_mm"]) / 3.0)
    assert budget["std_mm"] == pytest.approx(tip)
    kinds = [part["evaluation"] for part in budget["contributions"]]
    assert kinds[:2] == ["A", "B"]


def test_the_command_writes_both_files_and_says_what_is_missing(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    out = tmp_path / "certificate.pdf"
    said = printed("certificate", answers("pivot"), "--out", out)
    assert "does not state its number, the laboratory" in " ".join(said.split())
    assert "no metrological traceability" in " ".join(said.split())
    assert out.read_bytes().startswith(b"%PDF-")
    assert json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))["schemaVersion"]
    letter = PdfReader(io.BytesIO(_written(answers("pivot"), tmp_path, "letter"))).pages[0]
    assert (letter.mediabox.width, letter.mediabox.height) == (612, 792)


def _written(folder: Path, tmp_path: Path, paper: str) -> bytes:
    out = tmp_path / f"{paper}.pdf"
    assert cli("certificate", folder, "--paper", paper, "--out", out) == 0
    return out.read_bytes()


def test_fonts_are_embedded_and_the_same_answer_is_the_same_file(
    answers: Callable[[str], Path],
) -> None:
    certificate = certificate_of(answers("pivot"))
    first = pdf_bytes(certificate)
    assert first == pdf_bytes(certificate)
    fonts: Any = PdfReader(io.BytesIO(first)).pages[0]["/Resources"]
    for font in fonts["/Font"].values():
        (below,) = font.get_object()["/DescendantFonts"]
        assert "/FontFile2" in below.get_object()["/FontDescriptor"]


def test_details_are_on_the_paper(answers: Callable[[str], Path], details: Path) -> None:
    certificate = certificate_of(answers("pivot"), read_details(details))
    words = " ".join(paper_of(pdf_bytes(certificate)).split())
    for part in ("2026-001", "measuring arm", "serial 0001", "19.8 to 20.4 °C", "received on"):
        assert part in words
    assert certificate.missing == ()
    assert certificate.assessment.level == "good"


def test_the_file_to_fill_in_is_read(tmp_path: Path, answers: Callable[[str], Path]) -> None:
    path = tmp_path / "new.yaml"
    assert cli("certificate", "--new-details", path) == 0
    assert path.read_text(encoding="utf-8") == details_to_fill_in()
    assert read_details(path).number == "to be given"
    assert "its number" in certificate_of(answers("pivot"), read_details(path)).missing
    filled = "\n".join(
        line.removeprefix("# ") for line in path.read_text(encoding="utf-8").splitlines()[3:]
    )
    assert yaml.safe_load(filled) == {**yaml.safe_load(EXAMPLE), "number": "to be given"}


@pytest.mark.parametrize(("limit", "outcome"), [(100.0, "conforms"), (1e-6, "does not conform")])
def test_limits_are_decided(
    limit: float, outcome: str, answers: Callable[[str], Path], tmp_path: Path
) -> None:
    path = tmp_path / "d.yaml"
    path.write_text(f"limits: {{validation_rms_mm: {limit}}}\n", encoding="utf-8")
    out = tmp_path / "c.pdf"
    found = answer("certificate", answers("calibrate"), "--details", path, "--out", out)
    assert [row["outcome"] for row in found["decisions"]] == [outcome]
    assert outcome in paper_of(out.read_bytes())


@given(st.floats(-10, 10), st.floats(0, 5), st.floats(0.01, 10))
def test_a_guard_band_accepts_and_rejects_only_beyond_the_uncertainty(
    value: float, std: float, limit: float
) -> None:
    decided = Decision.of(CertifiedValue("q", value, "m", std), limit)
    surely_inside = abs(value) + 2 * std <= limit
    surely_outside = abs(value) - 2 * std > limit
    expected = "conforms" if surely_inside else "no decision"
    assert decided.outcome == ("does not conform" if surely_outside else expected)


def test_an_unknown_u_is_no_zero_and_decides_nothing(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    out = tmp_path / "c.pdf"
    words = ("certificate", answers("iso10360"), "--out", out)
    decided = {row["name"]: row for row in answer(*words)["decisions"]}
    assert decided["repeatability"]["outcome"] == "no decision"
    assert decided["repeatability"]["expanded_mm"] is None
    assert decided["E_Uni"]["outcome"] == "conforms"
    assert re.search(r"repeatability +0\.061 +– +0\.100 +no decision: U unknown", printed(*words))
    assert "0.061 – 0.1 mm no decision: U unknown" in " ".join(paper_of(out.read_bytes()).split())
    # Whatever its size, a value without U is not decided on; U itself is.
    for value in (0.0, 1.0):
        assert Decision.of(CertifiedValue("q", value, "m"), 0.5).words == "no decision: U unknown"
        of_itself = Decision.of(CertifiedValue("U", value, "m", is_uncertainty=True), 0.5)
        assert of_itself.outcome == ("does not conform" if value else "conforms")
        assert of_itself.because == "limit of U itself"


def test_a_u_that_lacks_a_source_is_not_decided_on(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    record = json.loads((answers("hand-eye") / "result.json").read_text(encoding="utf-8"))
    path, file = tmp_path / "d.yaml", tmp_path / "result.json"
    del record["run"]
    outcomes = []
    for ppm, limit in ((20.0, 10.0), (None, 10.0), (None, 1e-6)):
        path.write_text(f"limits: {{U_X_mm: {limit}, U_X_deg: 10, rms_mm: 100}}\n", "utf-8")
        file.write_text(json.dumps(record | {"scale_ppm": ppm}), encoding="utf-8")
        certificate = certificate_of(tmp_path, read_details(path))
        outcomes.append([decision.words for decision in certificate.decisions])
    itself, lacks = (
        "conforms: limit of U itself",
        "no decision: U lacks the uncertainty of the target",
    )
    assert outcomes[:2] == [[itself, itself, "conforms"], [lacks, itself, "conforms"]]
    # What is missing makes U only larger.
    assert outcomes[2][0] == "does not conform: limit of U itself"


@pytest.mark.parametrize(
    ("stated", "said", "decided"),
    [
        ("10 um/m (k = 2)", "", "conforms: limit of U itself"),
        ("20 ppm", "", "conforms: limit of U itself"),
        ("2 um + 3 um/m (k = 2)", "for lengths above 54 mm only", "conforms: limit of U itself"),
        (
            "0.1 mm",
            "for lengths above 5,000 mm only",
            "no decision: U lacks the uncertainty of the standard ball bar",
        ),
        (
            "21 um/m",
            "with a smaller one",
            "no decision: U lacks the uncertainty of the standard ball bar",
        ),
        (
            "15 µm + 60 µm/m (k=2)",
            "with a smaller one",
            "no decision: U lacks the uncertainty of the standard",
        ),
    ],
)
def test_a_standard_s_uncertainty_is_compared_with_u(
    stated: str, said: str, decided: str, answers: Callable[[str], Path], tmp_path: Path
) -> None:
    path = tmp_path / "d.yaml"
    for of in ("", "of: tracker, "):
        path.write_text(
            f"standards: [{{name: ball bar, {of}uncertainty: {stated}}},\n"
            "  {name: thermometer, uncertainty: 0.1 K (k = 2)}]\nlimits: {U_tip_mm: 100}\n",
            encoding="utf-8",
        )
        certificate = certificate_of(answers("pivot"), read_details(path))
        words = " ".join(paper_of(pdf_bytes(certificate)).split())
        assert certificate.decisions[0].words.startswith(decided)
        assert said in words
        assert ("U does not include the uncertainty of the standard ball bar" in words) == (
            "smaller" in said
        )
        assert bool(certificate.standards_not_included) == bool(said)


@given(st.floats(0.1, 1e3), st.floats(0.1, 1e3), st.floats(1, 5), st.floats(0.01, 10))
def test_a_stated_uncertainty_is_what_it_says(a: float, b: float, k: float, length: float) -> None:
    read = stated_uncertainty(f"{a:.3f} um + {b:.3f} um/m (k = {k:.2f})").std
    assert read is not None
    expected = 1e-6 * (round(a, 3) + round(b, 3) * length) / round(k, 2)
    assert read.constant + read.per_length * length == pytest.approx(expected)
    # Where one is no more than another, by their values.
    other = LengthUncertainty(5e-6, 50e-6)
    least, most = read.lengths_within(other)
    within = read.constant + read.per_length * length <= 5e-6 + 50e-6 * length
    if min(abs(length - least), abs(length - most)) > 1e-9 or math.isnan(least):
        assert within == (least <= length <= most)


def test_advice_is_for_the_console_alone(answers: Callable[[str], Path]) -> None:
    note = (
        "tip.y keeps its URDF value. If that is wrong by 1 mm, so is the tip. To determine more: "
        "touch one point. ± includes 20 ppm (--scale-ppm). Run suta-calib extend: it helps. "
        "Estimate these dimensions (select: geometric, with prior_mm and prior_deg)."
    )
    assert facts_of(note) == (
        "tip.y keeps its URDF value. If that is wrong by 1 mm, so is the tip. ± includes 20 ppm."
    )
    certificate = certificate_of(answers("pivot"))
    assert "--scale-ppm" in " ".join(certificate.content.notes)
    assert "--scale-ppm" not in paper_of(pdf_bytes(certificate))
    assert certificate.content.notes[0].split(" (--")[0] in certificate.notes[0]


def test_the_combined_row_has_its_degrees_of_freedom(answers: Callable[[str], Path]) -> None:
    certificate = certificate_of(answers("register"))
    budget = certificate.content.budgets[0]
    scatter = budget.contributions[0]
    assert scatter.student
    assert budget.factor == 2.0
    expected = budget.std**4 / (scatter.std**4 / scatter.freedom)
    assert budget.combined.freedom == pytest.approx(expected)
    words = " ".join(paper_of(pdf_bytes(certificate)).split())
    assert f" {scatter.freedom:.0f}* " in words
    assert f" {expected:.0f}* " in words


def test_a_standard_without_its_uncertainty_is_named(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    path = tmp_path / "d.yaml"
    path.write_text("standards: [{name: scale bar}, {name: B, uncertainty: 1 um}]\n", "utf-8")
    certificate = certificate_of(answers("pivot"), read_details(path))
    said = "The uncertainty of scale bar is not stated"
    assert said in " ".join(certificate.assessment.notes)
    assert said in " ".join(paper_of(pdf_bytes(certificate)).split())


def test_a_rule_without_a_guard_band_is_stated(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    record = json.loads((answers("iso10360") / "iso10360.json").read_text(encoding="utf-8"))
    del record["run"]
    record["decision_rule"] = {"kind": "simple", "factor": 2.0}
    (tmp_path / "iso10360.json").write_text(json.dumps(record), encoding="utf-8")
    words = " ".join(paper_of(pdf_bytes(certificate_of(tmp_path))).split())
    assert "simple acceptance without a guard band" in words
    assert "a guard band as wide as U" not in words
    record["characteristics"][0]["expanded_uncertainty_mm"] = None
    (tmp_path / "iso10360.json").write_text(json.dumps(record), encoding="utf-8")
    certificate = certificate_of(tmp_path)
    standards = " ".join(one.sentence for one in certificate.content.references)
    assert "its uncertainty is not stated, and U does not include it" in standards
    assert certificate.decisions[0].words == "no decision: U unknown"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("limits: {validation_rms: 1}\n", "validation_rms_mm"),
        ("limits: {validation_rms_mm: -1}\n", "positive"),
        ("limits: {validation_rms_mm: .nan}\n", "number"),
        ("numbr: 3\n", "number"),
        ("number: 3\n", "put it in quotes"),
        ("environment: {temperature_c: [21, 20]}\n", "smaller number first"),
        ("environment: {temperature_c: [20]}\n", "2 numbers"),
        ("standards: [{serial: a}]\n", "name"),
        ("standards:\n  - name: a\n    uncertainty: 15 bananas\n", "d.yaml:3"),
        ("standards: [{name: a, uncertainty: 15}]\n", "put it in quotes"),
        ("standards: [{name: a, uncertainty: -2 um}]\n", "2 um (k = 2)"),
        ("standards: [{name: a, uncertainty: \u0663 um}]\n", "2 um (k = 2)"),
        ("standards: [{name: a, uncertainty: 2 um (k = 0)}]\n", "k from 1 to 20"),
        ("standards: [{name: a, uncertainty: 2 um + 1 K}]\n", "15 um + 6 um/m (k = 2)"),
        ("standards:\n  - name: a\n    of: moon\n", "d.yaml:3"),
        ("standards: [{name: a, of: moon}]\n", "one of artefact"),
        ("standards: [{name: a, of: artefact, uncertainty: 1 K}]\n", "which is no length"),
        ('number: "1"\ndate: "2027-13-45"\n', "d.yaml:2"),
        ('date: "in winter"\n', "a day such as 2026-11-27"),
        ('date: "2026-11-26 to 2026-11-27"\n', "a day such as"),
        ("measured_on: 2026-11-27 to 2026-11-26\n", "the earlier day first"),
        ('measured_on: "2026-11-27"\ndate: "2026-11-26"\n', "no day before 2026-11-27"),
        ('measured_on: "2026-11-27"\nreceived_on: "2026-11-28"\n', "no day before 2026-11-28"),
        ("environment: {temperature_c: [293, 293.5]}\n", "-50 to 80 °C"),
        ("environment:\n  humidity_pct: [40, 140]\n", "d.yaml:2"),
        ("", "empty"),
        ("number: [\n", "YAML"),
    ],
)
def test_malformed_details_are_refused(
    text: str, said: str, answers: Callable[[str], Path], tmp_path: Path
) -> None:
    path, out = tmp_path / "d.yaml", tmp_path / "c.pdf"
    path.write_text(text, encoding="utf-8")
    error = refused("certificate", answers("calibrate"), "--details", path, "--out", out)
    assert "d.yaml" in error
    assert said in error
    assert not out.exists()


def test_an_answer_that_was_changed_or_must_not_be_used_gets_none(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(answers("pivot"), folder)
    with (folder / "residuals.csv").open("a", encoding="utf-8") as file:
        file.write("\n")
    with pytest.raises(InputError, match=r"residuals.csv, which was changed"):
        certificate_of(folder)
    shutil.copy(answers("pivot") / "residuals.csv", folder)
    assert certificate_of(folder).content.budgets
    record = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    better = (
        record | {"tip_mm": [0.0, 0.0, 0.0]},
        record | {"verdict": record["verdict"] | {"sentence": "sure"}},
    )
    for edited in better:
        (folder / "result.json").write_text(json.dumps(edited), encoding="utf-8")
        with pytest.raises(InputError, match="an answer that was changed since it was written"):
            certificate_of(folder)
    # Written in another way it says the same.
    (folder / "result.json").write_text(json.dumps(record, sort_keys=True), encoding="utf-8")
    assert certificate_of(folder).content.budgets
    record["verdict"] |= {"level": "bad", "usable": False}
    (folder / "result.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(UnusableResultError):
        certificate_of(folder)
    (folder / "result.json").write_text('{"tip_mm": [1, 2]}', encoding="utf-8")
    with pytest.raises(InputError, match="compute it again"):
        certificate_of(folder)
    (folder / "result.json").write_text('{"a": 1}', encoding="utf-8")
    with pytest.raises(InputError, match="no certificate"):
        certificate_of(folder)


@pytest.mark.parametrize("command", ["hand-eye", "register", "iso10360", "pivot"])
def test_an_answer_that_was_edited_is_taken_for_nothing_else(
    command: str, answers: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(answers(command), folder)
    (file,) = (folder / name for name in RECORDS if (folder / name).is_file())
    record = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(record | {"more": 1}, indent=1), encoding="utf-8")
    error = refused("certificate", folder, "--out", tmp_path / "c.pdf")
    assert "changed since it was written" in error
    assert "looks like" not in error


def test_the_paper_needs_a_name_of_its_own(answers: Callable[[str], Path], tmp_path: Path) -> None:
    for out in (tmp_path / "c.json", tmp_path / "c.txt", tmp_path / "none" / "c.pdf"):
        assert cli("certificate", answers("pivot"), "--out", out) == 2
    assert cli("certificate", answers("pivot")) == 2
    assert cli("certificate", "--out", tmp_path / "c.pdf") == 2


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("上海测量所", "the sign 上 (CJK UNIFIED IDEOGRAPH-4E0A) in: 上海测量所"),
        ("arm \U0001f9be", "MECHANICAL ARM"),
        ("מעבדה", "from left to right"),
        ("مختبر", "from left to right"),
    ],
)
def test_signs_that_paper_would_not_show_are_refused(
    name: str, said: str, answers: Callable[[str], Path], tmp_path: Path
) -> None:
    path, out = tmp_path / "d.yaml", tmp_path / "c.pdf"
    path.write_text(f"laboratory: {{name: {name}}}\n", encoding="utf-8")
    error = refused("certificate", answers("pivot"), "--details", path, "--out", out)
    assert said in error
    assert "d.yaml" in error
    assert "--font" in error
    assert not out.exists()


def test_a_font_of_one_s_own_prints_more_signs(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    fonts, out = Path(mpl.get_data_path()) / "fonts" / "ttf", tmp_path / "c.pdf"
    # A script of Unicode that STIX has, and DejaVu Sans lacks.
    (tmp_path / "d.yaml").write_text("laboratory: {name: \U0001d4d0bc}\n", encoding="utf-8")
    words = ("certificate", answers("pivot"), "--details", tmp_path / "d.yaml", "--out", out)
    assert "MATHEMATICAL BOLD SCRIPT" in refused(*words)
    assert "no font" in refused(*words, "--font", tmp_path / "d.yaml")
    assert cli(*words, "--font", fonts / "STIXGeneral.ttf") == 0
    assert "\U0001d4d0bc" in paper_of(out.read_bytes())


def test_long_names_and_letters_of_many_languages_are_printed(
    answers: Callable[[str], Path], tmp_path: Path
) -> None:
    long, path, out = "x" * 600, tmp_path / "d.yaml", tmp_path / "c.pdf"
    name = "Ινστιτούτο Łódź Ångström Поверка e\u0301"
    path.write_text(
        f"number: {long}\nlaboratory: {{name: {name}}}\nitem: {{name: {long}}}\n",
        encoding="utf-8",
    )
    assert cli("certificate", answers("pivot"), "--details", path, "--out", out) == 0
    words = paper_of(out.read_bytes())
    assert words.replace("\n", "").count("x") >= 2 * len(long)
    assert "Ινστιτούτο Łódź Ångström Поверка é" in words
    path.write_text(f"item: {{name: {long * 10}}}\n", encoding="utf-8")
    error = refused("certificate", answers("pivot"), "--details", path, "--out", out)
    assert "6000 characters" in error


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text[: len(text) // 2], "JSON"),
        (lambda _: "[1, 2]", "object"),
        (lambda text: text.replace('"tip_mm": [', '"tip_mm": ["a", '), "pivot"),
        (lambda text: text.replace('"counts"', '"Counts"'), "counts"),
        (lambda text: text.replace('"evaluation": "A"', '"evaluation": "C"'), "evaluation"),
        (lambda text: text.replace('"expanded_mm"', '"std_mm": 1, "expanded_mm"'), "do not give"),
        (lambda text: text.replace('"uncertainty": [', '"uncertainty": [3, '), "pivot"),
        (lambda _: json.dumps({"by_update_rate": []}), "repeatability, iso10360"),
        (lambda _: json.dumps({"moved": 1}), "give the result.json"),
    ],
)
def test_an_answer_that_was_damaged_is_refused(
    change: Callable[[str], str], said: str, answers: Callable[[str], Path], tmp_path: Path
) -> None:
    path = tmp_path / "result.json"
    text = (answers("pivot") / "result.json").read_text(encoding="utf-8")
    path.write_text(change(text), encoding="utf-8")
    out = tmp_path / "c.pdf"
    error = refused("certificate", path, "--out", out)
    assert said in error
    assert "result.json" in error
    assert not out.exists()
