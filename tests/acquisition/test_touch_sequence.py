"""What is to be measured: plans from jobs, files that grow, landmarks told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from acquisition_scenes import Attempt, check_against, device, file_of, plan_of, visit
from device_stand_in import reading

from suta_calib.acquisition.guided import Guided
from suta_calib.acquisition.run import Run, SamplesFile
from suta_calib.acquisition.seating_check import SeatingCheck
from suta_calib.acquisition.session import ArmReadings
from suta_calib.acquisition.stops import StopFinder
from suta_calib.acquisition.touch_sequence import read_arm, read_row, repeated, touched
from suta_calib.arrays import FloatArray
from suta_calib.errors import (
    ArtefactError,
    InputError,
    JobError,
    OutputError,
    SamplesError,
    UrdfError,
)
from suta_calib.measurements import read_csv_table
from suta_calib.model.arm import ArmModel
from suta_calib.terms import FixedPoint


# ── Files ──────────────────────────────────────────────────────────────────────────────────────
def test_a_file_keeps_what_is_not_its_own(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        '# by hand\nrepeat,a,note,placement,landmark,b\n1,0.5,"x, y",P2,O,0.25\n', encoding="utf-8"
    )
    file = SamplesFile(path, ["a", "b"], ["placement", "repeat", "landmark"], {"placement": "P1"})
    file.put({"placement": "P1", "repeat": "1", "landmark": "O"}, np.array([0.1, -0.2]))
    text = path.read_text()
    assert text == (
        '# by hand\nrepeat,a,note,placement,landmark,b\n1,0.5,"x, y",P2,O,0.25\n1,0.1,,P1,O,-0.2\n'
    )
    with pytest.raises(SamplesError, match=r"a.csv:4: .*already there.*--resume"):
        SamplesFile(path, ["a", "b"], ["placement", "repeat", "landmark"], {"placement": "P1"})
    resumed = SamplesFile(
        path, ["a", "b"], ["placement", "repeat", "landmark"], {"placement": "P1"}, resume=True
    )
    resumed.put({"placement": "P1", "repeat": "1", "landmark": "O"}, np.array([0.3, 0.4]), at=0)
    assert path.read_text() == text.replace("1,0.1,,P1,O,-0.2", "1,0.3,,P1,O,0.4")


def test_a_file_of_another_arm_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,placement\n1,P1\n")
    with pytest.raises(SamplesError, match="column 'a'"):
        SamplesFile(path, ["a"], ["placement"], {"placement": "P2"})


# ── Plans ──────────────────────────────────────────────────────────────────────────────────────
def job_with(folder: Path, observations: str, urdf: Path, artefact: Path) -> Path:
    job = folder / "calibration.yaml"
    text = f"arm: {{urdf: {urdf}, tip: tip}}\nobservations:\n{observations}\n"
    job.write_text(text.replace("ARTEFACT", str(artefact)), encoding="utf-8")
    return job


OBSERVATIONS = """\
  - {kind: fixed_point, samples: 'fixed/run_*.csv'}
  - {kind: landmark, artefact: ARTEFACT, samples: ['deep/**/*.csv', 'x.csv']}
  - {kind: pairwise_distance, artefact: ARTEFACT, samples: 'all.csv'}
validation:
  - {kind: pairwise_distance, artefact: ARTEFACT, samples: 'validation/*.csv'}"""


@pytest.mark.parametrize(
    ("which", "found", "file"),
    [
        (None, "observations[1]", "deep/P1_2.csv"),
        ("2", "observations[2]", "all.csv"),
        ("observations[0]", "observations[0]", "fixed/run_P1_2.csv"),
        ("pairwise_distance", "observations[2]", "all.csv"),
        ("validation", "validation[0]", "validation/P1_2.csv"),
        ("validation[0]", "validation[0]", "validation/P1_2.csv"),
    ],
)
def test_a_row_is_chosen_and_names_its_file(
    tmp_path: Path, suta_urdf: Path, repository: Path, which: str, found: str, file: str
) -> None:
    artefact = repository / "data/suta/artefact.yaml"
    job = job_with(tmp_path, OBSERVATIONS, suta_urdf, artefact)
    row = read_row(job, which, ["pairwise_distance", "landmark"])
    assert row.where == found
    assert row.file("P1", "2") == tmp_path / file


@pytest.mark.parametrize("which", ["3", "validation[1]", "landmarks", "observations[x]"])
def test_a_row_that_is_not_there_is_refused(
    tmp_path: Path, suta_urdf: Path, repository: Path, which: str
) -> None:
    job = job_with(tmp_path, OBSERVATIONS, suta_urdf, repository / "data/suta/artefact.yaml")
    with pytest.raises(JobError, match=r"--observation: found .*observations\[1\] \(landmark\)"):
        read_row(job, which, ["landmark"])


@pytest.mark.parametrize("seated", [True, False])
def test_a_plug_whose_bias_is_sought_is_turned_to_its_stop_at_every_landmark(
    tmp_path: Path, arm: ArmModel, suta_urdf: Path, repository: Path, seated: bool
) -> None:
    bias = ", seating: {clearance_mm: 0.05, rotation_deg: 1}" if seated else ""
    row = f"  - {{kind: landmark, artefact: ARTEFACT, samples: '*.csv'{bias}}}"
    job = job_with(tmp_path, row, suta_urdf, repository / "data/suta/artefact.yaml")
    plan = touched(arm, read_row(job, None, ["landmark"]), "P1", "1", ["O", "M1"])
    said = list[str]()
    run = Run(plan, file_of(plan, tmp_path / "P1.csv"), said.append)
    guided = Guided(run, StopFinder(arm.joints, 1.0), 1.0)
    guided.press("s")
    assert [("O (1 of 2)" in line, "M1 (2 of 2)" in line) for line in said[-2:]] == [
        (True, False),
        (False, True),
    ]
    for line in said[-2:]:
        assert ("turn the plug counter-clockwise until it stops; " in line) == seated


def test_bad_jobs_are_refused(tmp_path: Path, suta_urdf: Path, job: Path, arm: ArmModel) -> None:
    bad = job_with(tmp_path, "  - {kind: landmark, samples: 'a.csv'}", suta_urdf, suta_urdf)
    with pytest.raises(JobError, match="artefact"):
        read_row(bad, None, ["landmark"])
    with pytest.raises(JobError, match="observations of kind landmark"):
        read_row(bad, None, ["fixed_point"])
    with pytest.raises(UrdfError):
        read_arm(job, tmp_path / "none.urdf")
    with pytest.raises(ArtefactError, match="did you mean 'M1'"):
        plan_of(job, arm, "O,m1")
    with pytest.raises(InputError, match="--sequence"):
        touched(arm, read_row(job, None, ["pairwise_distance"]), "P1", "1", [])
    for label in ("", "a/b", " P1", "P\n1"):
        with pytest.raises(InputError, match="--point"):
            repeated(arm, FixedPoint, label, "1", 3)


def test_the_device_may_have_more_joints_in_another_order() -> None:
    choose = ArmReadings(device(("c", "a", "b")), ("a", "b"))
    (found,) = choose([reading([3.0, 1.0, 2.0], 0.0, flags=[0])])
    assert found.angles.tolist() == [1.0, 2.0]
    assert not found.error.any()
    with pytest.raises(InputError, match=r"device.yaml: joints: found the joints c, a, b; .*a, d"):
        ArmReadings(device(("c", "a", "b")), ("a", "d"))


def test_seating_knows_another_landmark_by_its_distances(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray]
) -> None:
    artefact = read_row(job, None, ["pairwise_distance"]).artefact
    assert artefact is not None
    seating = SeatingCheck(arm, artefact)
    for name in ("O", "M1", "M2"):
        seating.put(name, postures[name])
    for name in ("L1", "S4", "M3"):
        assert seating.which("L2", ["L1", "L2", "M3", "S4"], postures[name]) == name
        assert seating.misfit(name, postures[name]) < 5e-3
    assert seating.same_place(postures["O"], postures["O"] + 1e-4)
    assert not seating.same_place(postures["O"], postures["M1"])


@pytest.mark.parametrize("missed", [1, 2])
def test_landmarks_missed_at_the_start_are_noticed_by_the_distances(
    job: Path, arm: ArmModel, postures: dict[str, FloatArray], tmp_path: Path, missed: int
) -> None:
    """Whoever starts late takes the second landmark for the first, until the distances object."""
    names = ["O", "M1", "M2", "L1", "M3", "L2"]
    plan = plan_of(job, arm, ",".join(names))
    readings = visit(postures, ",".join(names[missed:])).readings()
    attempt = Attempt(plan, file_of(plan, tmp_path / "a.csv"), readings)
    assert attempt.done
    assert attempt.landmarks == names[missed:]
    check_against(attempt, postures)
    assert attempt.run.missing == tuple(names[:missed])
    assert any("missed O" in line and "at the start" in line for line in attempt.said)
    assert not attempt.run.notes


LABELS = ["placement", "repeat", "landmark"]


def samples_file(path: Path, **options: bool) -> SamplesFile:
    return SamplesFile(path, ["a", "b"], LABELS, {"placement": "P1"}, **options)


# Of all characters, those that some think end a line.
ODD = "\u2028\u2029\x85\x0b\x0c\x1c\x1d\x1e"


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_what_is_no_line_end_shifts_no_row(tmp_path: Path, odd: str, end: str) -> None:
    path = tmp_path / "s.csv"
    lines = [
        f"# a{odd}b", "placement,repeat,landmark,a,b,seen", f"# c{odd}{odd}d",
        "P2,1,O,1.0,2.0,", "P1,1,O,0.5,0.25,yes", f"# {odd}", "P2,1,M1,3.0,4.0,", "",
    ]  # fmt: skip
    path.write_bytes(end.join(lines).encode())
    file = samples_file(path, resume=True)
    assert [labels["landmark"] for labels, _ in file.rows] == ["O"]
    file.put({"placement": "P1", "repeat": "1", "landmark": "M1"}, np.array([1.5, 2.5]))
    file.put({"placement": "P1", "repeat": "1", "landmark": "O"}, np.array([9.0, 8.0]), at=0)
    wanted = [each.encode() + end.encode() for each in lines[:-1]]
    wanted[4] = b"P1,1,O,9.0,8.0,yes\n"
    assert path.read_bytes() == b"".join([*wanted, b"P1,1,M1,1.5,2.5,\n"])
    table = read_csv_table(path)
    assert table.columns["placement"] == ("P2", "P1", "P2", "P1")


def test_a_last_line_without_its_end_is_not_grown(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    path.write_text("placement,repeat,landmark,a,b\nP2,1,O,1.0,2.0")
    samples_file(path).put(dict.fromkeys(LABELS, "P1"), np.array([0.5, 0.25]))
    assert path.read_text().splitlines()[1:] == ["P2,1,O,1.0,2.0", "P1,P1,P1,0.5,0.25"]


def test_what_others_write_meanwhile_stays(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    file = samples_file(path)
    own = {"placement": "P1", "repeat": "1"}
    file.put({**own, "landmark": "O"}, np.array([0.1, 0.2]))
    # Another placement measured at once, a comment, an order of rows that is another one.
    header, row = path.read_text().splitlines()
    path.write_text(f"{header}\n1.0,2.0,P7,1,O\n# by hand\n{row}\n")
    file.put({**own, "landmark": "M1"}, np.array([0.3, 0.4]))
    file.put({**own, "landmark": "O"}, np.array([0.7, 0.8]), at=0)
    assert path.read_text().splitlines()[1:] == [
        "1.0,2.0,P7,1,O",
        "# by hand",
        "0.7,0.8,P1,1,O",
        "0.3,0.4,P1,1,M1",
    ]
    # Rows of this very run that are others now: nothing says which are right.
    changed = path.read_text().replace("0.7,0.8", "0.9,0.8")
    path.write_text(changed)
    with pytest.raises(OutputError, match="that somebody changed meanwhile"):
        file.put({**own, "landmark": "L1"}, np.array([0.5, 0.6]))
    assert path.read_text() == changed
    # A file that is gone comes back with all there was.
    path.write_text(changed.replace("0.9,0.8", "0.7,0.8"))
    file.put({**own, "landmark": "L1"}, np.array([0.5, 0.6]))
    path.unlink()
    file.put({**own, "landmark": "S1"}, np.array([0.5, 0.6]))
    assert len(samples_file(path, resume=True).rows) == 4
