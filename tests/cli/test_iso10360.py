"""``suta-calib iso10360`` end to end: a job of its own, a calibration, bad input."""

from __future__ import annotations

import contextlib
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_job import Capture, answer, cli, printed, refused
from hypothesis import given
from hypothesis import strategies as st
from lxml import html

from suta_calib.errors import JobError
from suta_calib.job import AcceptanceJob
from suta_calib.job.limits import read_judged
from suta_calib.measurements import CsvTable, YamlSection, read_csv_table, read_yaml


@pytest.fixture
def folder(tmp_path: Path, repository: Path) -> Path:
    """The simulated acceptance test of data/accuracy in a folder of its own."""
    data = repository / "data" / "accuracy"
    for name in ("lengths", "articulation", "probing", "repeated"):
        shutil.copy(data / f"{name}.csv", tmp_path)
    shutil.copy(repository / "data" / "suta" / "artefact.yaml", tmp_path)
    shutil.copy(repository / "urdf" / "suta.urdf", tmp_path)
    text = (data / "iso10360.yaml").read_text().replace("../suta/artefact.yaml", "artefact.yaml")
    text = text.replace("../../urdf/suta.urdf", "suta.urdf")
    (tmp_path / "job.yaml").write_text(text)
    return tmp_path


def change(folder: Path, old: str, new: str, file: str = "job.yaml") -> None:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))


def decisions(found: dict[str, Any]) -> dict[str, str]:
    return {each["symbol"]: each["decision"] for each in found["characteristics"]}


def test_a_whole_acceptance_test_passes(folder: Path) -> None:
    found = answer("iso10360", folder / "job.yaml")
    symbols = ("E_Uni", "L_Dia", "P_Size", "P_Form", "repeatability")
    assert decisions(found) == dict.fromkeys(symbols, "pass")
    assert found["passed"] is True
    assert found["decision_rule"] == {"kind": "guarded", "factor": 2.0}
    assert found["lengths"]["count"] == 210
    assert len(found["lengths"]["rows"]["error_mm"]) == 210
    assert found["articulations"]["near"]["articulations"] == 5
    assert found["spheres"]["far"]["touches"] == 25
    assert found["mpe"]["length"] == "(200 + L/10) µm, at most 250 µm"
    assert found["simplified"]
    assert not list(folder.glob("*.json"))


def test_a_limit_that_is_broken_or_left_open_exits_with_1(folder: Path) -> None:
    worst = abs(answer("iso10360", folder / "job.yaml")["characteristics"][0]["value_mm"])
    change(folder, "{a_um: 200, k: 10, max_um: 250}", f"{{max_um: {1e3 * worst + 10:.3f}}}")
    found = answer("iso10360", folder / "job.yaml", code=1)
    assert decisions(found)["E_Uni"] == "undecided"
    assert found["passed"] is False
    change(folder, "decision_rule: guarded", "decision_rule: simple")
    assert answer("iso10360", folder / "job.yaml")["passed"] is True
    change(folder, "location_mm: 0.15", "location_mm: 0.01")
    assert decisions(answer("iso10360", folder / "job.yaml", code=1))["L_Dia"] == "fail"


def test_files_are_written_and_the_text_is_readable(folder: Path) -> None:
    text = printed("iso10360", folder / "job.yaml", "--out", folder / "out")
    assert "Passed: 5 of 5 limits are met" in text
    assert "guard band" in text
    names = {path.name for path in (folder / "out").iterdir()}
    assert names == {"iso10360.json", "iso10360.svg", "report.html"}
    page = html.fromstring((folder / "out" / "report.html").read_text())
    assert [each.get("id") for each in page.iter("section")] == ["iso10360"]


def test_every_file_is_read_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def counted(path: Path) -> CsvTable:
        read.append(path.name)
        return read_csv_table(path)

    monkeypatch.setattr("suta_calib.measurements.sample_files.read_csv_table", counted)
    AcceptanceJob.load(folder / "job.yaml")
    assert sorted(read) == ["articulation.csv", "lengths.csv", "probing.csv", "repeated.csv"]


def rewrite(file: Path, made: Callable[[int, list[list[str]]], list[str]]) -> None:
    """Every row by its number and all rows."""
    header, *lines = file.read_text().splitlines()
    rows = [line.split(",") for line in lines]
    made_of = [",".join(made(k, rows)) for k in range(len(rows))]
    file.write_text("\n".join([header, *made_of, ""]))


@pytest.mark.parametrize("jitter", [0.0, 1e-9])
def test_copies_are_no_touches(folder: Path, jitter: float) -> None:
    """Readings that were written again, with other labels or last digits, prove nothing."""

    def copied(k: int, rows: list[list[str]]) -> list[str]:
        labels = rows[k][6:]
        first = next(row for row in rows if row[6:] == labels)
        later = [row for row in rows if row[6:] == labels].index(rows[k]) % 5
        source = rows[rows.index(first) + later]
        return [*(repr(float(each) + k * jitter) for each in source[:6]), *labels]

    rewrite(folder / "probing.csv", copied)
    found = answer("iso10360", folder / "job.yaml", code=1)
    assert decisions(found)["P_Form"] == "undecided"
    notes = " ".join(found["verdict"]["notes"])
    assert "probing: 40 of 50 touches repeat another touch" in notes
    assert "5 of near, 5 of far touches; the standard requires 25" in notes

    rewrite(folder / "repeated.csv", lambda k, rows: [*rows[0][:6], *rows[k][6:]])
    assert "29 of 30 touches repeat another touch" in refuses(folder)


def test_coarse_encoders_may_read_the_same_again(folder: Path, capsys: Capture) -> None:
    step = 2 * math.pi / 2**14
    for name in ("lengths", "articulation", "probing", "repeated"):
        rewrite(
            folder / f"{name}.csv",
            lambda k, rows: [
                *(repr(round(float(each) / step) * step) for each in rows[k][:6]),
                *rows[k][6:],
            ],
        )
    assert cli("iso10360", folder / "job.yaml", "--json") in (0, 1)
    assert "copies" not in capsys.readouterr().out


def test_parts_of_the_test_may_be_left_out(folder: Path) -> None:
    (folder / "job.yaml").write_text(
        "arm: {urdf: suta.urdf, tip: tip}\nrepeatability: {samples: repeated.csv}\n"
    )
    found = answer("iso10360", folder / "job.yaml", "--out", folder / "out")
    assert decisions(found) == {"repeatability": "no limit"}
    assert found["passed"] is None
    assert found["lengths"] is None


def test_spheres_may_be_probed_in_the_articulations(folder: Path) -> None:
    text = (folder / "probing.csv").read_text().replace("sphere", "articulation", 1)
    rows = text.splitlines()
    lines = [f"{rows[0]},point", *(f"{row},S" for row in rows[1:26])]
    # One sphere, whose touches are dealt out to five articulations.
    lines[1:] = [row.replace("near", f"a{k % 5}") for k, row in enumerate(lines[1:])]
    (folder / "spheres.csv").write_text("\n".join(lines) + "\n")
    (folder / "job.yaml").write_text(
        "arm: {urdf: suta.urdf, tip: tip}\n"
        "articulation: {samples: spheres.csv, probed: sphere}\n"
        "mpe: {location_mm: 0.3}\n"
    )
    found = answer("iso10360", folder / "job.yaml")
    assert found["articulations"]["S"]["articulations"] == 5
    assert found["articulations"]["S"]["location_mm"] < 0.3
    # Every fifth touch of that spiral lies on one side of the sphere.
    assert "uncertainty of a sphere's centre is up to" in " ".join(found["verdict"]["notes"])


@pytest.fixture
def calibration(folder: Path) -> Path:
    """A calibration with held-out lengths and fitted fixed points."""
    (folder / "calibration.yaml").write_text(
        "arm: {urdf: suta.urdf, tip: tip}\n"
        'parameters: [{select: ["*.offset"], bound_deg: 5}]\n'
        "observations: [{kind: fixed_point, samples: articulation.csv}]\n"
        "validation: [{kind: pairwise_distance, artefact: artefact.yaml, samples: lengths.csv}]\n"
    )
    return folder / "calibration.yaml"


def test_a_calibration_gives_figures_without_decision(calibration: Path) -> None:
    found = answer("iso10360", calibration)
    assert decisions(found) == {"E_Uni": "no limit", "L_Dia": "no limit"}
    notes = " ".join(found["verdict"]["notes"])
    assert "Give the calibrated one with --urdf" in notes
    assert "not validation data" in notes
    own = answer("iso10360", calibration.parent / "job.yaml")
    assert found["lengths"]["rms_mm"] == pytest.approx(own["lengths"]["rms_mm"])


def test_a_job_may_judge_a_calibration(calibration: Path) -> None:
    (calibration.parent / "limits.yaml").write_text(
        "job: calibration.yaml\nmpe: {length: {a_um: 250}}\n"
    )
    found = answer(
        "iso10360", calibration.parent / "limits.yaml", "--urdf", calibration.parent / "suta.urdf"
    )
    assert decisions(found) == {"E_Uni": "pass", "L_Dia": "no limit"}
    assert "--urdf" not in " ".join(found["verdict"]["notes"])


def refuses(folder: Path, *more: object) -> str:
    line = refused("iso10360", folder / "job.yaml", "--out", folder / "out", *more)
    assert not (folder / "out").exists()
    return line


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("decision_rule: guarded", "decision_rule: guardd", "did you mean 'guarded'"),
        ("a_um: 200", "a_mm: 0.2", "unknown key"),
        ("a_um: 200, ", "", "k without a_um"),
        ("k: 10", "k: 0", "positive"),
        ("location_mm: 0.15", "location_mm: -1", "positive"),
        ("probing: {samples", "proving: {samples", "did you mean 'probing'"),
        ("diameter_mm: 25, ", "", "diameter_mm"),
        ("samples: lengths.csv", "samples: 'l*.tsv'", "no file that matches"),
        ("tip: tip", "tip: top", "top"),
        ("artefact: artefact.yaml", "artefact: nothing.yaml", "nothing.yaml"),
        ("decision_rule: guarded", "decision_rule: simple\ncoverage_factor: 2", "simple rule"),
        ("samples: articulation.csv", "samples: repeated.csv, probed: sphere", "articulation"),
        ("arm: {urdf: suta.urdf, tip: tip}", "job: job.yaml", "one or the other"),
    ],
)
def test_bad_keys_are_one_line(folder: Path, old: str, new: str, said: str) -> None:
    change(folder, old, new)
    assert said in refuses(folder)


def cell(file: Path, line: int, column: str, value: str) -> None:
    rows = [row.split(",") for row in file.read_text().splitlines()]
    rows[line - 1][rows[0].index(column)] = value
    file.write_text("\n".join(map(",".join, rows)) + "\n")


@pytest.mark.parametrize(
    ("file", "line", "column", "value", "said"),
    [
        ("lengths", 7, "joint_1", "-37.7", "looks like degrees"),
        ("lengths", 4, "landmark", "Q9", "Q9"),
        ("articulation", 1, "point", "punkt", "point"),
        ("probing", 3, "sphere", "third", "sphere 'third'"),
        ("repeated", 3, "point", "other", "1 visits to point 'other'"),
    ],
)
def test_bad_cells_are_one_line(
    folder: Path, file: str, line: int, column: str, value: str, said: str
) -> None:
    cell(folder / f"{file}.csv", line, column, value)
    assert said in refuses(folder)


def test_an_arm_and_data_are_asked_for(folder: Path) -> None:
    change(folder, "arm: {urdf: suta.urdf", "arm: {urdf: other.urdf")
    assert "other.urdf" in refuses(folder)
    (folder / "job.yaml").write_text("arm: {urdf: suta.urdf, tip: tip}\n")
    assert "no measurements" in refuses(folder)


def test_limits_for_what_is_not_tested_are_refused(folder: Path) -> None:
    (folder / "job.yaml").write_text(
        "arm: {urdf: suta.urdf, tip: tip}\nrepeatability: {samples: repeated.csv}\n"
        "mpe: {size_mm: 0.1}\n"
    )
    assert "a limit without a test" in refuses(folder)


def test_a_calibration_without_lengths_is_refused(calibration: Path) -> None:
    text = calibration.read_text().splitlines()
    hand_eye = "observations: [{kind: landmark, artefact: artefact.yaml, samples: lengths.csv}]"
    calibration.write_text("\n".join([*text[:2], hand_eye]) + "\n")
    assert "neither pairwise_distance nor fixed_point" in refused("iso10360", calibration)


VALUES = st.sampled_from(["1", "-1", "0", ".nan", "1e30", "abc", "[]", "{}", "true", "simple"])
KEYS = st.sampled_from(["length", "location_mm", "a_um", "k", "max_um", "size", "length_mm"])


def mapping(values: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    parts = st.dictionaries(KEYS, values, max_size=3)
    return parts.map(lambda each: "{" + ", ".join(f"{k}: {v}" for k, v in each.items()) + "}")


@given(mapping(VALUES | mapping(VALUES)), mapping(VALUES), VALUES, VALUES)
def test_any_limits_are_read_or_refused(scratch: Path, mpe, stated, rule, factor) -> None:
    scratch.write_text(
        f"lengths: x\narticulation: x\nprobing: x\nmpe: {mpe}\nuncertainty: {stated}\n"
        f"decision_rule: {rule}\ncoverage_factor: {factor}\n"
    )
    top = YamlSection(read_yaml(scratch, JobError), JobError)
    # Whatever else it raised would be no message for a user.
    with contextlib.suppress(JobError):
        assert "rule" in read_judged(top)
