"""Simulated files: the same every time, refused where they cannot be."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from simulated import SUTA_URDF
from simulation_scenes import EXACT, Folder, with_noise

from suta_calib.cli.simulate import simulate as command
from suta_calib.errors import InputError, JobError, OutputError
from suta_calib.job import CalibrationJob
from suta_calib.job.new_job import new_job, write_job
from suta_calib.model.arm import ArmModel
from suta_calib.registry import shipped
from suta_calib.simulation import read_simulation, simulate, write_simulation
from suta_calib.terms import KINDS


@pytest.fixture
def folder(tmp_path: Path, suta_urdf: Path) -> Folder:
    return Folder(tmp_path, suta_urdf)


# ── Files ────────────────────────────────────────────────────────────────────────────────────
def bytes_in(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def run(*arguments: object) -> Any:
    result = CliRunner().invoke(command, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_the_same_seed_gives_the_same_bytes_and_another_one_others(folder: Folder) -> None:
    file = folder.file(with_noise("{seating_mm: 0.2, encoder_bits: 22, artefact: true}"))
    for name, seed in (("one", 3), ("two", 3), ("three", 4)):
        run(file, "--out", folder.path / name, "--seed", seed)
    one, two, three = (bytes_in(folder.path / name) for name in ("one", "two", "three"))
    assert one == two
    assert one.keys() == three.keys()
    assert not any(one[name] == three[name] for name in one)


def test_json_lists_the_files(folder: Folder) -> None:
    out = folder.path / "out"
    summary = json.loads(run(folder.file(), "--out", out, "--json").stdout)
    assert summary["seed"] == 3
    assert [row["samples"] for row in summary["files"]] == [6, 6, 12, 30]
    assert all((out / row["file"]).is_file() for row in summary["files"])


def test_the_truth_file_gives_the_truth_back(folder: Folder) -> None:
    outliers = "    outliers: {fraction: 0.4, size_mm: [3, 8]}\n    repeats: 2"
    made = folder.simulate(EXACT.replace("    repeats: 2", outliers))
    write_simulation(made, folder.path / "out")
    truth = yaml.safe_load((folder.path / "out/truth.yaml").read_text())
    assert truth["simulated"] is True
    for name, row in truth["parameters"].items():
        value = row["value_mm"] / 1e3 if "value_mm" in row else math.radians(row["value_deg"])
        assert value == pytest.approx(made.values[name], abs=1e-14)
    assert truth["parameters"]["joint_2.offset"]["error_deg"] == pytest.approx(4.1)
    for row in truth["outliers"]:
        cells = (folder.path / "out" / row["file"]).read_text().splitlines()[row["line"] - 1]
        assert cells.split(",")[-3:] == [row["placement"], row["repeat"], row["landmark"]]
    assert len(truth["outliers"]) == 4
    assert "simulated" in (folder.path / "out/README.md").read_text()


def test_files_of_another_origin_are_neither_mixed_in_nor_replaced(folder: Folder) -> None:
    made, out = folder.simulate(), folder.path / "out"
    (out / "calibration").mkdir(parents=True)
    (out / "calibration/P9.csv").write_text("old")
    with pytest.raises(OutputError, match=r"calibration: found P9\.csv"):
        write_simulation(made, out)
    (out / "calibration/P9.csv").unlink()
    (out / "README.md").write_text("# My data\n")
    with pytest.raises(OutputError, match=r"README\.md: found a page"):
        write_simulation(made, out)
    assert bytes_in(out) == {"README.md": b"# My data\n"}


def test_the_empty_samples_of_a_new_job_are_replaced_and_nothing_else_is(folder: Folder) -> None:
    made, out = folder.simulate(), folder.path / "out"
    (out / "calibration").mkdir(parents=True)
    blank, header = out / "calibration/samples.csv", ",".join(made.arm.joints)
    for kept in (f"{header}\n{header}\n", f"# mine\n{header}\n", "old\n"):
        blank.write_text(kept)
        with pytest.raises(OutputError, match=r"calibration: found samples\.csv"):
            write_simulation(made, out)
        assert bytes_in(out) == {"calibration/samples.csv": kept.encode()}
    for answer in ("text", "json"):
        blank.write_text(f"placement,repeat,landmark,{header}\n")
        told = run(folder.file(), "--out", out, *(["--json"] if answer == "json" else []))
        assert not blank.exists()
        assert str(blank) in told.stdout
    assert "removed" not in run(folder.file(), "--out", out).stdout


def test_the_sets_of_the_guide_can_be_rehearsed(repository: Path, tmp_path: Path) -> None:
    """Of every kind; from `init`'s own folder to a job that reads what the simulation wrote."""
    guide = (repository / "docs/guides/your_own_arm.md").read_text()
    sets = re.findall(r"^  calibration: (\{kind: (\w+).*\})$", guide, re.MULTILINE)
    assert {kind for _, kind in sets} == {*shipped(KINDS)}
    suta = ArmModel.from_urdf(SUTA_URDF, "tip")
    arm = f"{{urdf: {SUTA_URDF}, tip: tip}}"
    for row, kind in sets:
        out, sheet = tmp_path / kind, tmp_path / "simulation.yaml"
        write_job(new_job(suta, out, kinds=[kind]))
        row = row.replace("rehearsal/", f"{kind}/")
        sheet.write_text(f"arm: {arm}\nsets:\n  calibration: {row}\n  validation: {row}\n")
        write_simulation(simulate(read_simulation(sheet)), out)
        job = out / "calibration.yaml"
        text = job.read_text()
        for seen in ("corners", "profiles"):
            for name in ("calibration", "validation") if (out / seen).is_dir() else ():
                text = text.replace(f"{seen}: {seen}.csv", f"{seen}: {seen}/{name}.csv", 1)
        job.write_text(text)
        read = CalibrationJob.load(job)
        assert read.observations[0].kind == kind


def test_an_output_folder_that_cannot_be_made_is_refused(folder: Folder) -> None:
    (folder.path / "out").write_text("a file")
    with pytest.raises(OutputError, match="which is no folder"):
        run(folder.file(), "--out", folder.path / "out")


# ── Refusals ─────────────────────────────────────────────────────────────────────────────────
def test_limits_that_leave_no_room_are_none(folder: Folder) -> None:
    """Exporters write two zeros for a joint without limits: it moves."""
    urdf = folder.path / "arm.urdf"
    text = re.sub(
        r'(<joint name="joint_3".*?)lower="[^"]*" upper="[^"]*"',
        r'\1lower="0" upper="0"',
        folder.urdf.read_text(),
        flags=re.DOTALL,
    )
    urdf.write_text(text)
    tracked = "arm: {urdf: arm.urdf, tip: tip}\nsets: {c: {kind: tracked_point, samples: 3}}\n"
    made = folder.simulate(tracked)
    assert np.ptp(made.files[0].samples.q[:, 2]) > 0.1


def test_a_placement_out_of_reach_is_named(folder: Folder) -> None:
    text = EXACT.replace("[412.5, 37.5, 0]", "[1412.5, 37.5, 0]")
    with pytest.raises(JobError) as caught:
        folder.simulate(text)
    message = str(caught.value)
    line = next(k for k, row in enumerate(text.splitlines(), 1) if "P2:" in row)
    assert f"simulation.yaml:{line}: sets.calibration.placements.P2: " in message
    assert "landmark 'A' of placement 'P2' out of the arm's reach (closest: " in message


def test_a_point_out_of_reach_is_named(folder: Folder) -> None:
    far = EXACT.replace("[400, 0, 100]", "[1400, 0, 100]")
    with pytest.raises(JobError, match=r"sets\.fixed_point\.points\.F1: found 0 directions"):
        folder.simulate(far.replace("directions: 12", "directions: 1"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: fixed_point", "kind: fixed_pint", r"sets\.fixed_point\.kind: found 'fixed_pint'"),
        ("cone_deg: 40", "cone_deg: 200", r"cone_deg: found 200"),
        ("cone_deg: 40", "cone: 40", r"sets\.fixed_point\.cone: found an unknown key"),
        ("repeats: 2", "repeats: 0", r"repeats: found 0"),
        ("directions: 12", "directions: true", r"directions: found true"),
        ("std_deg: 1}", "std_deg: -1}", r"errors\[1\]\.std_deg: found -1"),
        ("value_deg: 4.1", "value_deg: 4.1, std_deg: 1", r"errors\[2\]: found a value and a std"),
        (", value_deg: 4.1", "", r"errors\[2\]: found no size"),
        ("value_deg: 4.1", "value_mm: 4.1", r"errors\[2\]: found no size .* joint_2\.offset"),
        ('"*.offset"', '"*.ofset"', r"errors\[1\]\.select: found '\*\.ofset'"),
        ("artefact: artefact.yaml", "artefact: none.yaml", r"artefact: found no file"),
        ("seed: 3", "seed: -3", r"seed: found -3"),
        ("seed: 3", "posture_deg: {joint_9: 3}", r":3: posture_deg\.joint_9: found no joint"),
        ("seed: 3", "posture_mm: {joint_1: 3}", r":3: posture_mm\.joint_1: found a reading in m"),
        ("seed: 3", "noise: {encoder_bits: 60}", r"encoder_bits: found 60"),
        ("seed: 3", "noise: {seating_mm: .nan}", r"noise\.seating_mm: found nan"),
        ("P1: {position_mm: [437.5, 12.5, 0]", "../P1: {position_mm: [1, 2, 3]", r"'\.\./P1'"),
        ("tip: tip", "tip: nose", r"found 'nose'"),
        ("samples: 30", "samples: 30\n    artefact: artefact.yaml", r"artefact: found an unknown"),
        ("repeats: 2", "outliers: {fraction: 2, size_mm: [1, 2]}", r"fraction: found 2"),
        ("repeats: 2", "outliers: {fraction: 0.1, size_mm: [3, 2]}", r"size_mm: found \[3, 2\]"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(
    folder: Folder, old: str, new: str, message: str
) -> None:
    assert old in EXACT
    with pytest.raises(InputError, match=message) as caught:
        run(folder.file(EXACT.replace(old, new, 1)), "--out", folder.path / "out")
    assert "\n" not in str(caught.value)
    assert not (folder.path / "out").exists()


# ── The SUTA's own data ──────────────────────────────────────────────────────────────────────
def test_the_data_in_the_repository_are_what_the_simulation_makes(
    repository: Path, tmp_path: Path
) -> None:
    data = repository / "data/suta"
    made = simulate(read_simulation(data / "simulation.yaml"))
    for name in ("calibration", "validation"):
        files = [file for file in made.files if file.path.startswith(name)]
        assert [len(file.samples) for file in files] == [45] * 5
    for path in write_simulation(made, tmp_path):
        kept = data / path.relative_to(tmp_path)
        if path.suffix != ".csv":
            assert kept.is_file()
            continue
        assert kept.read_text().splitlines()[0] == path.read_text().splitlines()[0]
        # Equal but for a step of the encoder, which another processor's rounding may tip over.
        columns = {"delimiter": ",", "skip_header": 1, "usecols": range(6)}
        one, other = (np.genfromtxt(file, **columns) for file in (kept, path))
        np.testing.assert_allclose(one, other, atol=1.01 * 2 * np.pi / 2**22, rtol=0)
