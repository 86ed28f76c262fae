"""What is to be measured: plans from jobs, files that grow, landmarks told apart."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from acquisition_scenes import Scene, device
from device_stand_in import reading
from torso_robot import torso_robot_urdf

from suta_calib.acquisition.run import SamplesFile
from suta_calib.acquisition.seating_check import SeatingCheck
from suta_calib.acquisition.session import ArmReadings
from suta_calib.acquisition.touch_sequence import read_arm, read_row, repeated, touched
from suta_calib.errors import (
    ArtefactError,
    InputError,
    JobError,
    OutputError,
    SamplesError,
    UrdfError,
)
from suta_calib.measurements import read_csv_table
from suta_calib.terms import FixedPoint

# ── Files ──────────────────────────────────────────────────────────────────────────────────────
LABELS = ["placement", "repeat", "landmark"]


def samples_file(path: Path, **options: bool) -> SamplesFile:
    return SamplesFile(path, ["a", "b"], LABELS, {"placement": "P1"}, **options)


def test_a_file_keeps_what_is_not_its_own(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    text = '# by hand\nrepeat,a,note,placement,landmark,b\n1,0.5,"x, y",P2,O,0.25\n'
    path.write_text(text, encoding="utf-8")
    labels = {"placement": "P1", "repeat": "1", "landmark": "O"}
    samples_file(path).put(labels, np.array([0.1, -0.2]))
    text += "1,0.1,,P1,O,-0.2\n"
    assert path.read_text() == text
    with pytest.raises(SamplesError, match=r"a.csv:4: .*existing samples.*--resume"):
        samples_file(path)
    samples_file(path, resume=True).put(labels, np.array([0.3, 0.4]), at=0)
    assert path.read_text() == text.replace("1,0.1,,P1,O,-0.2", "1,0.3,,P1,O,0.4")


def test_a_file_of_another_arm_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,placement\n1,P1\n")
    with pytest.raises(SamplesError, match="column 'a'"):
        SamplesFile(path, ["a"], ["placement"], {"placement": "P2"})


# ── Plans ──────────────────────────────────────────────────────────────────────────────────────
@pytest.fixture
def job_with(tmp_path: Path, suta_urdf: Path, repository: Path) -> Callable[[str], Path]:
    """A job of some observations of the SUTA's artefact."""

    def write(observations: str) -> Path:
        job, artefact = tmp_path / "calibration.yaml", repository / "data/suta/artefact.yaml"
        text = f"arm: {{urdf: {suta_urdf}, tip: tip}}\nobservations:\n{observations}\n"
        job.write_text(text.replace("ARTEFACT", str(artefact)), encoding="utf-8")
        return job

    return write


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
    tmp_path: Path, job_with: Callable[[str], Path], which: str, found: str, file: str
) -> None:
    row = read_row(job_with(OBSERVATIONS), which, ["pairwise_distance", "landmark"])
    assert row.where == found
    assert row.file("P1", "2") == tmp_path / file


@pytest.mark.parametrize("which", ["3", "validation[1]", "landmarks", "observations[x]"])
def test_a_row_that_is_not_there_is_refused(job_with: Callable[[str], Path], which: str) -> None:
    job = job_with(OBSERVATIONS)
    with pytest.raises(JobError, match=r"--observation: found .*observations\[1\] \(landmark\)"):
        read_row(job, which, ["landmark"])


@pytest.mark.parametrize("seated", [True, False])
def test_a_plug_whose_bias_is_sought_is_turned_to_its_stop_at_every_landmark(
    scene: Scene, job_with: Callable[[str], Path], seated: bool
) -> None:
    bias = ", seating: {clearance_mm: 0.05, rotation_deg: 1}" if seated else ""
    row = f"  - {{kind: landmark, artefact: ARTEFACT, samples: '*.csv'{bias}}}"
    row_read = read_row(job_with(row), None, ["landmark"])
    it = scene.guidance(touched(scene.arm, row_read, "P1", "1", ["O", "M1"]), "O")
    it.guided.press("s")
    first, second = it.said[-2:]
    assert "O (1 of 2)" in first
    assert "M1 (2 of 2)" in second
    for line in (first, second):
        assert ("turn the plug counter-clockwise until it stops; " in line) == seated


def test_bad_jobs_are_refused(scene: Scene, job_with: Callable[[str], Path]) -> None:
    bad = job_with("  - {kind: landmark, samples: 'a.csv'}")
    with pytest.raises(JobError, match="artefact"):
        read_row(bad, None, ["landmark"])
    with pytest.raises(JobError, match="observations of kind landmark"):
        read_row(bad, None, ["fixed_point"])
    with pytest.raises(UrdfError):
        read_arm(scene.job, scene.folder / "none.urdf")
    with pytest.raises(ArtefactError, match="did you mean 'M1'"):
        scene.plan("O,m1")
    with pytest.raises(InputError, match="--sequence"):
        touched(scene.arm, read_row(scene.job, None, ["pairwise_distance"]), "P1", "1", [])
    for label in ("", "a/b", " P1", "P\n1"):
        with pytest.raises(InputError, match="--point"):
            repeated(scene.arm, FixedPoint, label, "1", 3)


def test_the_device_may_have_more_joints_in_another_order() -> None:
    choose = ArmReadings(device(("c", "a", "b")), ("a", "b"))
    (found,) = choose([reading([3.0, 1.0, 2.0], 0.0, flags=[0])])
    assert found.angles.tolist() == [1.0, 2.0]
    assert not found.error.any()
    with pytest.raises(InputError, match=r"device.yaml: joints: found the joints c, a, b; .*a, d"):
        ArmReadings(device(("c", "a", "b")), ("a", "d"))


def test_seating_knows_another_landmark_by_its_distances(scene: Scene) -> None:
    artefact = read_row(scene.job, None, ["pairwise_distance"]).artefact
    assert artefact is not None
    seating = SeatingCheck(scene.arm, artefact)
    for name in ("O", "M1", "M2"):
        seating.put(name, scene[name])
    for name in ("L1", "S4", "M3"):
        assert seating.which("L2", ["L1", "L2", "M3", "S4"], scene[name]) == name
        assert seating.misfit(name, scene[name]) < 5e-3
    assert seating.same_place(scene["O"], scene["O"] + 1e-4)
    assert not seating.same_place(scene["O"], scene["M1"])


@pytest.mark.parametrize("missed", [1, 2])
def test_landmarks_missed_at_the_start_are_noticed_by_the_distances(
    scene: Scene, missed: int
) -> None:
    """Whoever starts late takes the second landmark for the first, until the distances object."""
    names = ["O", "M1", "M2", "L1", "M3", "L2"]
    attempt = scene.attempt(",".join(names), scene.visit(",".join(names[missed:])))
    assert attempt.done
    assert attempt.landmarks == names[missed:]
    scene.check(attempt)
    assert attempt.run.missing == tuple(names[:missed])
    assert any("missed O" in line and "at the start" in line for line in attempt.said)
    assert not attempt.run.notes


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
    with pytest.raises(OutputError, match="the file was changed during the run"):
        file.put({**own, "landmark": "L1"}, np.array([0.5, 0.6]))
    assert path.read_text() == changed
    # A file that is gone comes back with all there was.
    path.write_text(changed.replace("0.9,0.8", "0.7,0.8"))
    file.put({**own, "landmark": "L1"}, np.array([0.5, 0.6]))
    path.unlink()
    file.put({**own, "landmark": "S1"}, np.array([0.5, 0.6]))
    assert len(samples_file(path, resume=True).rows) == 4


CHAINS = """\
arm: {urdf: robot.urdf, chains: {left: {tip: left_hand}, right: {tip: right_hand}}}
observations:
  - {kind: fixed_point, chain: left, samples: left/*.csv}
  - {kind: fixed_point, chain: right, samples: right/*.csv}
"""


def test_of_several_chains_one_is_measured(tmp_path: Path) -> None:
    job = tmp_path / "calibration.yaml"
    job.write_text(CHAINS)
    (tmp_path / "robot.urdf").write_text(torso_robot_urdf())
    for which, chain in ((None, "right"), ("fixed_point", "right"), ("1", "")):
        row = read_row(job, which, ["fixed_point"], chain)
        assert (row.pattern, row.chain) == ("right/*.csv", ("right", ""))
        assert read_arm(job, chain=row.chain).tip == "right_hand"
    for which in (None, "fixed_point"):
        with pytest.raises(
            InputError, match=r"several chains; expected .* left, right; choose one"
        ):
            read_row(job, which, ["fixed_point"])
    with pytest.raises(InputError, match="did you mean 'right'"):
        read_row(job, None, ["fixed_point"], "rihgt")
    with pytest.raises(InputError, match="several chains"):
        read_arm(job)


def test_an_arm_without_chains_has_none_to_choose(job_with: Callable[[str], Path]) -> None:
    with pytest.raises(InputError, match="no name: the arm has one chain"):
        read_row(job_with(OBSERVATIONS), None, ["pairwise_distance"], "left")
