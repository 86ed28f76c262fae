"""Bad input: one line that names the place, exit code 2, and no output."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_job import Capture, cli, refused
from torso_robot import torso_robot_urdf

ARTEFACT = """\
name: block
landmarks:
  A: {position_mm: [0, 0, 0]}
  B: {position_mm: [100, 0, 0]}
"""
Spoil = Callable[[Path], None]


@pytest.fixture
def folder(job: Path) -> Path:
    """A job that runs, in its own folder, until a test spoils it."""
    return job.parent


def replaced(file: str, old: str, new: str) -> Spoil:
    def spoil(folder: Path) -> None:
        text = (folder / file).read_text(encoding="utf-8")
        assert re.search(old, text), f"{old} is not in {file}"
        (folder / file).write_text(re.sub(old, new, text, count=1), encoding="utf-8")

    return spoil


def content(file: str, text: str | bytes) -> Spoil:
    def spoil(folder: Path) -> None:
        (folder / file).write_bytes(text.encode() if isinstance(text, str) else text)

    return spoil


def missing(file: str) -> Spoil:
    return lambda folder: (folder / file).unlink()


def rows(file: str, keep: int) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = (folder / file).read_text().splitlines()
        (folder / file).write_text("\n".join(lines[: keep + 1]) + "\n")

    return spoil


def cell(file: str, line: int, column: str, value: str) -> Spoil:
    def spoil(folder: Path) -> None:
        lines = [row.split(",") for row in (folder / file).read_text().splitlines()]
        lines[line - 1][lines[0].index(column)] = value
        (folder / file).write_text("\n".join(map(",".join, lines)) + "\n")

    return spoil


def with_artefact(artefact: str, landmarks: tuple[str, ...] = ("A", "B")) -> Spoil:
    """The job over an artefact's landmarks instead of an instrument's positions."""

    def spoil(folder: Path) -> None:
        (folder / "artefact.yaml").write_text(artefact)
        job = (
            (folder / "calibration.yaml")
            .read_text()
            .replace("kind: tracked_point", "kind: pairwise_distance, artefact: artefact.yaml")
        )
        (folder / "calibration.yaml").write_text(job)
        for name in ("calibration", "validation"):
            file = folder / name / "a.csv"
            header, *lines = file.read_text().splitlines()
            labelled = [
                f"{row},P{k // 2},1,{landmarks[k % len(landmarks)]}" for k, row in enumerate(lines)
            ]
            file.write_text("\n".join([f"{header},placement,repeat,landmark", *labelled]) + "\n")

    return spoil


CSV, JOB, URDF = "calibration/a.csv", "calibration.yaml", "arm.urdf"
LOOP = (
    '<joint name="closing" type="fixed"><parent link="tip"/><child link="link_3"/></joint></robot>'
)
# What is spoilt → what the one line must say.
BAD: dict[str, tuple[Spoil, str]] = {
    "urdf missing": (missing(URDF), r"calibration\.yaml:1: .*arm\.urdf"),
    "urdf empty": (content(URDF, ""), r"arm\.urdf.*empty|arm\.urdf.*found"),
    "urdf malformed": (replaced(URDF, "</robot>", "</robt>"), r"arm\.urdf:\d+"),
    "urdf no robot": (content(URDF, "<mesh/>"), r"arm\.urdf.*mesh.*robot"),
    "urdf loop": (replaced(URDF, "</robot>", LOOP), r"arm\.urdf.*link_3"),
    "urdf mimic": (
        replaced(URDF, r'(<joint name="joint_4"[^>]*>)', r'\1<mimic joint="joint_9"/>'),
        r"arm\.urdf:\d+: joint .joint_4.*mimic",
    ),
    "urdf floating": (
        replaced(URDF, 'name="joint_4" type="revolute"', 'name="joint_4" type="floating"'),
        r"arm\.urdf:\d+: joint .joint_4.*floating",
    ),
    "urdf numbers": (
        replaced(URDF, 'xyz="0 0 0.571"', 'xyz="0 0 nan"'),
        r"arm\.urdf:\d+: joint .joint_4.*nan",
    ),
    "yaml empty": (content(JOB, ""), r"calibration\.yaml"),
    "yaml malformed": (content(JOB, "arm: {urdf: [\n"), r"calibration\.yaml:\d+"),
    "yaml not utf-8": (content(JOB, b"arm: \xff\xfe\n"), r"calibration\.yaml:1.*UTF-8"),
    "yaml list": (content(JOB, "- 1\n"), r"calibration\.yaml"),
    "csv missing": (missing(CSV), r"calibration\.yaml:6: .*samples.*calibration/\*\.csv"),
    "csv empty": (content(CSV, ""), r"a\.csv"),
    "csv header only": (rows(CSV, 0), r"a\.csv:1.*without data"),
    "csv ragged": (replaced(CSV, r"\n", "\n1,2,3\n"), r"a\.csv:2"),
    "csv binary": (content(CSV, b"\x00\xff\x01"), r"a\.csv"),
    "unknown tip": (replaced(JOB, "tip: tip", "tip: tipp"), r"tipp.*tip"),
    "unknown base": (replaced(JOB, "tip: tip", "tip: tip, base: floor"), r"base.*floor"),
    "unknown joint": (replaced(JOB, r"joint_\*\.offset", "joint_9.offset"), r":3.*joint_9\.offset"),
    "unknown parameter": (replaced(JOB, r"joint_6\.z", "joint_6.w"), r":4.*joint_6\.w"),
    "unknown key": (replaced(JOB, "solver:", "sovler:"), r"calibration\.yaml:\d+.*sovler"),
    "unknown key in row": (replaced(JOB, "sigma_mm", "sigma_m"), r"calibration\.yaml:6.*sigma_m"),
    "unknown kind": (replaced(JOB, "tracked_point", "tracked"), r"calibration\.yaml:6.*tracked"),
    "contradictory bound": (replaced(JOB, "bound_mm: 30", "bound_mm: -3"), r":4.*bound_mm.*-3"),
    "bound in the wrong unit": (replaced(JOB, "bound_deg: 15", "bound_mm: 15"), r":3.*bound_deg"),
    "bound and fixed": (
        replaced(JOB, "bound_mm: 30", "bound_mm: 30, fixed: true"),
        r":4.*bound_mm",
    ),
    "joint column missing": (replaced(CSV, "joint_3", "joint_x"), r"a\.csv:1.*joint_3"),
    "nan reading": (cell(CSV, 4, "joint_2", "nan"), r"a\.csv:4.*joint_2.*nan"),
    "infinite reading": (cell(CSV, 5, "joint_2", "inf"), r"a\.csv:5.*joint_2.*inf"),
    "word for a reading": (cell(CSV, 3, "joint_2", "abc"), r"a\.csv:3.*joint_2.*abc"),
    "degrees": (cell(CSV, 2, "joint_1", "94.5"), r"a\.csv:2.*joint_1.*94\.5.*rad.*degrees"),
    "solver": (replaced(JOB, "starts: 2", "starts: 0"), r"calibration\.yaml:\d+.*starts"),
    "unknown landmark": (with_artefact(ARTEFACT, ("A", "C")), r"a\.csv:3.*C"),
    "one landmark": (with_artefact(ARTEFACT, ("A",)), r"two different landmarks"),
    "duplicate landmark": (
        with_artefact(ARTEFACT + "  A: {position_mm: [1, 2, 3]}\n"),
        r"artefact\.yaml:5.*A",
    ),
    "coincident landmarks": (
        with_artefact(ARTEFACT.replace("100", "0")),
        r"artefact\.yaml:4.*same position",
    ),
    "artefact malformed": (with_artefact("landmarks: [1, 2"), r"artefact\.yaml:\d+"),
    "artefact without unit": (
        with_artefact(ARTEFACT.replace("position_mm", "position")),
        r"artefact\.yaml:3.*position_mm",
    ),
}


@pytest.mark.parametrize(("spoil", "says"), BAD.values(), ids=BAD)
@pytest.mark.parametrize("command", ["calibrate", "observe"])
def test_bad_input_is_one_line_and_no_output(
    folder: Path, spoil: Spoil, says: str, command: str
) -> None:
    spoil(folder)
    before = sorted(folder.rglob("*"))
    line = refused(command, folder / JOB, "--json")
    assert re.search(says, line), line
    assert sorted(folder.rglob("*")) == before


def test_a_job_that_is_not_there(tmp_path: Path) -> None:
    for command in ("calibrate", "observe"):
        assert "no such file" in refused(command, tmp_path / "none.yaml")
        assert "a folder" in refused(command, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("below", ["", "results", "results/deep"])
def test_an_output_folder_that_is_a_file(
    folder: Path, below: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def solving(*_: object) -> None:
        raise AssertionError("it began to solve")

    monkeypatch.setattr("suta_calib.job.calibration.CalibrationJob.run", solving)
    taken = folder / "taken"
    taken.write_text("mine")
    assert str(taken) in refused("calibrate", folder / JOB, "--out", taken / below)
    assert taken.read_text() == "mine"


def test_fewer_samples_than_the_job_can_use(folder: Path) -> None:
    rows(CSV, 2)(folder)
    before = sorted(folder.rglob("*"))
    line = refused("calibrate", folder / JOB, "--json")
    assert re.search(r"tracked_point.*found 2 samples; expected at least 3", line)
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("n", [3, 4])
def test_data_that_any_values_would_fit_are_refused(folder: Path, n: int, capsys: Capture) -> None:
    """Nine or twelve equations, even after holding what cannot be told, leave no residual."""
    rows(CSV, n)(folder)
    assert cli("observe", folder / JOB) == 0
    capsys.readouterr()
    assert "more equations than unknowns" in refused("calibrate", folder / JOB)
    assert not (folder / "results").exists()


def test_few_equations_are_no_traceback(folder: Path, capsys: Capture) -> None:
    rows(CSV, 5)(folder)
    assert cli("calibrate", folder / JOB, "--json") in (0, 1)
    assert "Traceback" not in capsys.readouterr().err


def test_validate_refuses_another_arm(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.urdf"
    text = (folder / URDF).read_text()
    other.write_text(text.replace('"joint_3"', '"elbow"'))
    assert "elbow" in refused("validate", other, folder / JOB)
    other.write_text(text.replace('"tip"', '"stylus"'))
    assert re.search(r"other\.urdf.*tip", refused("validate", other, folder / JOB))
    assert "no such file" in refused("validate", tmp_path / "none.urdf", folder / JOB)


def test_validate_needs_validation_data(folder: Path) -> None:
    replaced(JOB, r"validation:\n.*\n", "")(folder)
    assert "validation" in refused("validate", folder / URDF, folder / JOB)


def test_init_refuses_what_it_cannot_use(folder: Path, tmp_path: Path, suta_urdf: Path) -> None:
    out = tmp_path / "new"
    start = ("init", suta_urdf, "--out", out)
    several = tmp_path / "several.urdf"
    several.write_text(torso_robot_urdf())
    said = refused("init", several, "--out", out)
    assert "found no --tip" in said
    assert "the chains of the file end at 'left_hand', 'right_hand'" in said
    assert "tipp" in refused(*start, "--tip", "tipp")
    assert "one of" in refused(*start, "--tip", "tip", "--kind", "touch")
    twice = ("--kind", "landmark", "--kind", "landmark")
    assert "twice" in refused(*start, "--tip", "tip", *twice)
    taken = tmp_path / "taken"
    taken.write_text("mine")
    assert "no folder" in refused("init", suta_urdf, "--tip", "tip", "--out", taken)
    assert not out.exists()


def test_a_joint_that_is_called_as_a_column_is_refused_before_a_file_is_made(
    tmp_path: Path, suta_urdf: Path
) -> None:
    urdf, out = tmp_path / "arm.urdf", tmp_path / "new"
    urdf.write_text(suta_urdf.read_text(encoding="utf-8").replace('"joint_1"', '"x"'))
    kind = ("--kind", "tracked_point")
    said = refused("init", urdf, "--tip", "tip", "--out", out, *kind)
    assert "a joint named 'x'" in said
    assert "rename the joint" in said
    file = tmp_path / "simulation.yaml"
    file.write_text(
        "arm: {urdf: arm.urdf, tip: tip}\nsets: {calibration: {kind: tracked_point, samples: 9}}\n"
    )
    assert "a joint named 'x'" in refused("simulate", file, "--out", out)
    assert not out.exists()
    assert cli("init", urdf, "--tip", "tip", "--out", out, "--kind", "fixed_point") == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["calibrte", "job.yaml"], "calibrte"),
        (["calibrate"], "JOB"),
        (["calibrate", "job.yaml", "--fast"], "--fast"),
        (["observe", "a.yaml", "b.yaml"], "unexpected"),
    ],
)
def test_bad_usage(arguments: list[str], says: str) -> None:
    assert says in refused(*arguments)
